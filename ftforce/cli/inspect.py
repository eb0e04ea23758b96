"""``ftforce inspect``: the chain of a URDF."""

from ftforce.cli.options import ChainOptions, Outputs, RobotArgument


def inspect(robot: RobotArgument, chain: ChainOptions, outputs: Outputs) -> None:
    """Show the chain: joints, limits, effort, mass, tip candidates and postures."""
    from ftforce.show.tables.robot import robot_view

    arm = chain.load(robot)
    outputs.emit(robot_view(arm), arm, f"ftforce inspect {arm.name}")
