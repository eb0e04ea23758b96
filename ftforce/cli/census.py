"""``ftforce census``: one posture, all fault sets."""

import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from ftforce.cli.common import (
    AxesOption,
    Base,
    Degrees,
    Force,
    FormatOption,
    Length,
    Output,
    Positions,
    PostureName,
    RobotArgument,
    Rtol,
    TaskOption,
    Tip,
    Torque,
    Wary,
    emit,
    load,
    numbers,
    refuse_force_and_torque,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ftforce.fault_census import Progress

PATIENCE = 1.0  # s without a progress bar


def census(
    robot: RobotArgument,
    faults: Annotated[int, typer.Option(help="Size of the largest fault sets.")] = 1,
    q: Positions = None,
    posture: PostureName = None,
    deg: Degrees = False,
    force: Force = None,
    torque: Torque = None,
    task: TaskOption = "force",
    length: Length = None,
    axes: AxesOption = "tool",
    base: Base = None,
    tip: Tip = None,
    rtol: Rtol = 1e-6,
    wary: Wary = 1e-2,
    top: Annotated[int, typer.Option(min=1, help="How many sets the table shows.")] = 40,
    form: FormatOption = None,
    output: Output = None,
) -> None:
    """Analyse every set of up to --faults locked joints, worst first, and rank the joints."""
    refuse_force_and_torque(force, torque)
    from ftforce import fault_census
    from ftforce.posture import choose_posture
    from ftforce.show.census import census_view

    arm = load(robot, tip, base, posture)
    place = choose_posture(arm, numbers(q, "--q"), posture, degrees=deg)
    with _progress() as progress:
        result = fault_census.census(
            arm,
            place,
            faults=faults,
            force=numbers(force, "--force"),
            torque=numbers(torque, "--torque"),
            task=task,
            length=length,
            axes=axes,  # type: ignore[arg-type] # checked there, with a message that lists them
            rtol=rtol,
            wary=wary,
            progress=progress,
        )
    emit(
        census_view(result, most=top),
        result,
        form=form,
        output=output,
        title=f"ftforce census {arm.name}",
        warnings=result.posture.warnings,
    )


@contextmanager
def _progress() -> "Iterator[Progress]":
    """Yield a callback that shows a bar on stderr once the work has taken a second."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    console = Console(file=sys.stderr)
    bar = Progress(
        "fault sets", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=console, transient=True,
    )  # fmt: skip
    work = bar.add_task("fault sets")
    start, shown = time.monotonic(), False

    def update(done: int, total: int, /) -> None:
        nonlocal shown
        if console.is_terminal and not shown and time.monotonic() - start > PATIENCE:
            bar.start()
            shown = True
        if shown:
            bar.update(work, completed=done, total=total)

    try:
        yield update
    finally:
        if shown:
            bar.stop()
