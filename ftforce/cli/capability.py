"""``ftforce capability``: the force and payload that can be held."""

from ftforce.cli.options import (
    Acceleration,
    AxesOption,
    Base,
    Degrees,
    Direction,
    FormatOption,
    Free,
    Gravity,
    Length,
    LimitsOfCapability,
    Locked,
    Output,
    PayloadOption,
    PlotOption,
    Positions,
    PostureName,
    RobotArgument,
    Rtol,
    TaskOption,
    Tip,
    Velocity,
    Weak,
    load,
    numbers,
)
from ftforce.cli.output import emit


def capability(
    robot: RobotArgument,
    locked: Locked = None,
    free: Free = None,
    weak: Weak = None,
    direction: Direction = None,
    q: Positions = None,
    posture: PostureName = None,
    deg: Degrees = False,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    gravity: Gravity = None,
    payload: PayloadOption = None,
    limits: LimitsOfCapability = "urdf",
    task: TaskOption = "force",
    length: Length = None,
    axes: AxesOption = "tool",
    base: Base = None,
    tip: Tip = None,
    rtol: Rtol = 1e-6,
    plot: PlotOption = None,
    form: FormatOption = None,
    output: Output = None,
) -> None:
    """Say which force, and which payload, the arm can hold before and after a fault.

    Commanded: what the motors make. Held: a load that is there already, with the locks' help.
    """
    from ftforce.analysis import capability as force_capability
    from ftforce.robot.posture import choose_posture
    from ftforce.show.tables.capability import capability_view

    arm = load(robot, tip, base, posture)
    place = choose_posture(arm, numbers(q, "--q"), posture, degrees=deg)
    result = force_capability.capability(
        arm,
        place,
        direction=numbers(direction, "--direction"),
        locked=",".join(locked or ()),
        free=",".join(free or ()),
        weak=",".join(weak or ()),
        velocity=numbers(velocity, "--velocity"),
        acceleration=numbers(acceleration, "--acceleration"),
        gravity=numbers(gravity, "--gravity"),
        payload=payload,
        limits=limits,
        task=task,
        length=length,
        axes=axes,
        rtol=rtol,
    )
    emit(
        capability_view(result),
        result,
        form=form,
        output=output,
        plot=plot,
        title=f"ftforce capability {arm.name}",
        warnings=result.analysis.warnings,
    )
