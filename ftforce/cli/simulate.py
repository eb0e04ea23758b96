"""``ftforce simulate``: motion along a trajectory while joints fail."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ftforce.cli.options import (
    AxesOption,
    Base,
    Degrees,
    FormatOption,
    Gravity,
    HistoryOutput,
    Length,
    LimitsOption,
    PayloadOption,
    PlotOption,
    Positions,
    PostureName,
    Rtol,
    TaskOption,
    Tip,
    Wary,
    given_options,
    load,
    numbers,
)
from ftforce.cli.output import emit
from ftforce.cli.progress import progress_bar
from ftforce.cli.trajectories import (
    From,
    KeepOrientation,
    MaxGap,
    Rate,
    Speed,
    To,
    TrajectoryArgument,
    place_of,
    trajectory_of,
)
from ftforce.errors import InputError

if TYPE_CHECKING:
    from ftforce.trajectory.history import History

_BESIDE_PAPER = {"paper", "debug", "rate", "delay", "no_remap", "plot", "form", "output"}

Robot = Annotated[
    str | None,
    typer.Argument(
        metavar="ROBOT",
        help="A URDF file, or a known name such as panda (see `ftforce robots`).",
        show_default=False,
    ),
]
PressingForce = Annotated[
    str | None,
    typer.Option(
        metavar="FX,FY,FZ",
        help="Force the tool exerts all the time, N (and N·m); 0,0,0 for a free motion.",
    ),
]
FaultOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="JOINTS@S",
        help="What fails when: 3@50, 3,4@50, free:2@10, weak:3:0.5@5. Repeat it for more.",
    ),
]


def simulate(
    context: typer.Context,
    robot: Robot = None,
    trajectory: TrajectoryArgument = None,
    start: From = None,
    to: To = None,
    speed: Speed = None,
    keep_orientation: KeepOrientation = False,
    force: PressingForce = None,
    fault: FaultOption = None,
    delay: Annotated[
        float, typer.Option(metavar="S", help="Time from a fault until the remap acts.")
    ] = 0.0,
    no_remap: Annotated[
        bool, typer.Option("--no-remap", help="See what happens if the controller never learns.")
    ] = False,
    paper: Annotated[
        bool, typer.Option("--paper", help="Section V of the paper, on dh5; nothing else needed.")
    ] = False,
    q: Positions = None,
    posture: PostureName = None,
    deg: Degrees = False,
    gravity: Gravity = None,
    payload: PayloadOption = None,
    limits: LimitsOption = None,
    task: TaskOption = "force",
    length: Length = None,
    axes: AxesOption = "tool",
    base: Base = None,
    tip: Tip = None,
    rate: Rate = None,
    max_gap: MaxGap = None,
    rtol: Rtol = 1e-6,
    wary: Wary = 1e-2,
    plot: PlotOption = None,
    form: FormatOption = None,
    output: HistoryOutput = None,
) -> None:
    """Move an arm along a trajectory while its tool presses and joints fail.

    Three histories come out: as if healthy, without the remap, and with it. -o FILE with .csv,
    .npz or .parquet keeps every instant of them.
    """
    if paper:
        _refuse_beside_paper(context)
        history = _paper(rate, delay, remap=not no_remap)
    elif robot is None:
        raise InputError("which robot? Give a URDF file or a known name (see `ftforce robots`)")
    elif force is None:
        raise InputError(
            "which force does the tool exert? Give --force, e.g. 80,50,10; 0,0,0 is a free motion"
        )
    else:
        from ftforce.trajectory import simulate as simulation

        arm = load(robot, tip, base, posture)
        place = place_of(arm, trajectory, q, posture, degrees=deg)
        course = trajectory_of(
            arm, trajectory, start, to, speed=speed, keep_orientation=keep_orientation, place=place
        )
        with progress_bar("instants") as progress:
            history = simulation.simulate(
                arm,
                course,
                place,
                force=numbers(force, "--force") or [],
                faults=fault or (),
                delay=delay,
                remap=not no_remap,
                gravity=numbers(gravity, "--gravity"),
                payload=payload,
                limits=limits,
                task=task,
                length=length,
                axes=axes,  # type: ignore[arg-type] # checked there, with a message
                rate=rate,
                speed=speed if trajectory else None,
                keep_orientation=keep_orientation and trajectory is not None,
                max_gap=max_gap,
                rtol=rtol,
                wary=wary,
                progress=progress,
            )
    _show(history, plot, form, output)


def _refuse_beside_paper(context: typer.Context) -> None:
    """Reject all options that are fixed by Section V of the paper.

    Raises
    ------
    InputError
        Such an option is given.
    """
    if named := given_options(context, context.params.keys() - _BESIDE_PAPER):
        raise InputError(f"--paper says all of that itself; leave out {', '.join(named)}")


def _paper(rate: float | None, delay: float, *, remap: bool) -> "History":
    from ftforce.trajectory.section_v import section_v

    with progress_bar("instants") as progress:
        return section_v(rate=rate, delay=delay, remap=remap, progress=progress)


def _show(history: "History", plot: Path | None, form: FormatOption, output: Path | None) -> None:
    from ftforce.show.tables.history import history_view

    emit(
        history_view(history),
        history,
        form=form,
        output=output,
        plot=plot,
        title=f"ftforce simulate {history.setting.robot}",
        warnings=history.warnings,
    )
