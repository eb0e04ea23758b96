"""``ftforce analyze``: one posture, one fault set."""

from ftforce.cli.options import (
    Acceleration,
    AxesOption,
    Base,
    Degrees,
    Force,
    FormatOption,
    Free,
    Gravity,
    InverseOption,
    Length,
    LimitsOption,
    Locked,
    Output,
    PayloadOption,
    Positions,
    PostureName,
    RobotArgument,
    Rtol,
    TaskOption,
    Tip,
    Torque,
    Velocity,
    Wary,
    Weak,
    load,
    numbers,
    refuse_force_and_torque,
)
from ftforce.cli.output import emit


def analyze(
    robot: RobotArgument,
    locked: Locked = None,
    free: Free = None,
    weak: Weak = None,
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
    form: FormatOption = None,
    output: Output = None,
) -> None:
    """Say what faults do to the force at the tool, and which torques to command now.

    Without --force or --torque: the same for every unit force, and which directions are lost.
    """
    refuse_force_and_torque(force, torque)
    from ftforce.analysis import analyze as analysis
    from ftforce.robot.posture import choose_posture
    from ftforce.show.tables.analysis import analysis_view

    arm = load(robot, tip, base, posture)
    place = choose_posture(arm, numbers(q, "--q"), posture, degrees=deg)
    result = analysis.analyze(
        arm,
        place,
        locked=",".join(locked or ()),
        free=",".join(free or ()),
        weak=",".join(weak or ()),
        force=numbers(force, "--force"),
        torque=numbers(torque, "--torque"),
        velocity=numbers(velocity, "--velocity"),
        acceleration=numbers(acceleration, "--acceleration"),
        gravity=numbers(gravity, "--gravity"),
        payload=payload,
        limits=limits,
        inverse=inverse,  # type: ignore[arg-type] # checked there, with a message that lists them
        task=task,
        length=length,
        axes=axes,  # type: ignore[arg-type] # likewise
        rtol=rtol,
        wary=wary,
    )
    emit(
        analysis_view(result, degrees=deg),
        result,
        form=form,
        output=output,
        title=f"ftforce analyze {arm.name}",
        warnings=result.warnings,
    )
