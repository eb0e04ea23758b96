"""``ftforce census``: one posture, all fault sets."""

from typing import Annotated

import typer

from ftforce.cli.options import (
    Acceleration,
    AxesOption,
    Base,
    Degrees,
    Direction,
    Force,
    FormatOption,
    Gravity,
    InverseOption,
    Length,
    LimitsOption,
    Output,
    PayloadOption,
    PlotOption,
    Positions,
    PostureName,
    RobotArgument,
    Rtol,
    TaskOption,
    Tip,
    Torque,
    Velocity,
    Wary,
    load,
    numbers,
    refuse_force_and_torque,
)
from ftforce.cli.output import emit
from ftforce.cli.progress import progress_bar


def census(
    robot: RobotArgument,
    faults: Annotated[int, typer.Option(help="Size of the largest fault sets.")] = 1,
    mode: Annotated[
        str, typer.Option(metavar="locked|free", help="How the joints fail.")
    ] = "locked",
    rank_by: Annotated[
        str,
        typer.Option(
            metavar="jump|capability",
            help="What the sets are sorted by: the force jump, or the force that can be held.",
        ),
    ] = "jump",
    direction: Direction = None,
    q: Positions = None,
    posture: PostureName = None,
    deg: Degrees = False,
    force: Force = None,
    torque: Torque = None,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    gravity: Gravity = None,
    payload: PayloadOption = None,
    limits: LimitsOption = None,
    inverse: InverseOption = "euclidean",
    task: TaskOption = "force",
    length: Length = None,
    axes: AxesOption = "tool",
    base: Base = None,
    tip: Tip = None,
    rtol: Rtol = 1e-6,
    wary: Wary = 1e-2,
    top: Annotated[int, typer.Option(min=1, help="How many sets the table shows.")] = 40,
    plot: PlotOption = None,
    form: FormatOption = None,
    output: Output = None,
) -> None:
    """Analyse every set of up to --faults failed joints, worst first, and rank the joints."""
    refuse_force_and_torque(force, torque)
    if direction is not None and rank_by == "jump":
        raise typer.BadParameter("--direction counts only with --rank-by capability")
    from ftforce.analysis import census as fault_census
    from ftforce.robot.posture import choose_posture
    from ftforce.show.tables.census import census_view

    arm = load(robot, tip, base, posture)
    place = choose_posture(arm, numbers(q, "--q"), posture, degrees=deg)
    with progress_bar("fault sets") as progress:
        result = fault_census.census(
            arm,
            place,
            faults=faults,
            mode=mode,
            force=numbers(force, "--force"),
            torque=numbers(torque, "--torque"),
            velocity=numbers(velocity, "--velocity"),
            acceleration=numbers(acceleration, "--acceleration"),
            gravity=numbers(gravity, "--gravity"),
            payload=payload,
            limits=limits,
            inverse=inverse,  # type: ignore[arg-type] # checked there, with a message
            rank_by=rank_by,  # type: ignore[arg-type] # likewise
            direction=numbers(direction, "--direction"),
            task=task,
            length=length,
            axes=axes,  # type: ignore[arg-type] # likewise
            rtol=rtol,
            wary=wary,
            progress=progress,
        )
    emit(
        census_view(result, most=top),
        result,
        form=form,
        output=output,
        plot=plot,
        title=f"ftforce census {arm.name}",
        warnings=result.warnings,
    )
