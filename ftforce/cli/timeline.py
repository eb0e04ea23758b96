"""``ftforce timeline``: severity of each fault along a trajectory."""

from typing import Annotated

import typer

from ftforce.cli.options import (
    AxesOption,
    Base,
    Degrees,
    Direction,
    Force,
    FormatOption,
    Gravity,
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
    Wary,
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


def timeline(
    robot: RobotArgument,
    trajectory: TrajectoryArgument = None,
    start: From = None,
    to: To = None,
    speed: Speed = None,
    keep_orientation: KeepOrientation = False,
    faults: Annotated[int, typer.Option(help="Size of the largest fault sets.")] = 1,
    mode: Annotated[
        str, typer.Option(metavar="locked|free", help="How the joints fail.")
    ] = "locked",
    force: Force = None,
    direction: Direction = None,
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
    top: Annotated[int, typer.Option(min=1, help="How many sets the table shows.")] = 40,
    plot: PlotOption = None,
    form: FormatOption = None,
    output: Output = None,
) -> None:
    """Ask at every instant of a trajectory what every set of failed joints would do.

    The healthy arm moves; jump, margin and capability say how much each fault would take then.
    """
    from ftforce.show.tables.timeline import timeline_view
    from ftforce.trajectory import timeline as fault_timeline

    arm = load(robot, tip, base, posture)
    place = place_of(arm, trajectory, q, posture, degrees=deg)
    course = trajectory_of(
        arm, trajectory, start, to, speed=speed, keep_orientation=keep_orientation, place=place
    )
    with progress_bar("instants") as progress:
        result = fault_timeline.timeline(
            arm,
            course,
            place,
            faults=faults,
            mode=mode,
            force=numbers(force, "--force"),
            direction=numbers(direction, "--direction"),
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
    emit(
        timeline_view(result, most=top),
        result,
        form=form,
        output=output,
        plot=plot,
        title=f"ftforce timeline {arm.name}",
        warnings=result.warnings,
    )
