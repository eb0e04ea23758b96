"""``ftforce inspect``: the chain of a URDF."""

from ftforce.cli.options import Base, FormatOption, Output, RobotArgument, Tip, load
from ftforce.cli.output import emit


def inspect(
    robot: RobotArgument,
    base: Base = None,
    tip: Tip = None,
    form: FormatOption = None,
    output: Output = None,
) -> None:
    """Show the chain: joints, limits, effort, mass, tip candidates and postures."""
    from ftforce.show.tables.robot import robot_view

    arm = load(robot, tip, base, None)
    emit(
        robot_view(arm),
        arm,
        form=form,
        output=output,
        title=f"ftforce inspect {arm.name}",
    )
