"""``ftforce capability``: the force and payload that can be held."""

from ftforce.cli.options import (
    CapabilityLimits,
    ChainOptions,
    DirectionOption,
    DriveOptions,
    FaultOptions,
    FrictionOption,
    MotionOptions,
    PlotOutputs,
    PostureOptions,
    RankTolerance,
    RobotArgument,
    TaskOptions,
    WeightOptions,
    merged,
)


def capability(
    robot: RobotArgument,
    fault_options: FaultOptions,
    direction_option: DirectionOption,
    posture_options: PostureOptions,
    motion: MotionOptions,
    weight: WeightOptions,
    limits: CapabilityLimits,
    friction: FrictionOption,
    drives: DriveOptions,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerance: RankTolerance,
    outputs: PlotOutputs,
) -> None:
    """Show the force and payload that the arm can hold before and after a fault.

    Commanded: a force the motors apply. Held: a load already there, which the
    brakes carry too.
    """
    from ftforce.analysis import capability as force_capability
    from ftforce.show.tables.capability import capability_view

    arm = chain.load(robot, posture_options.posture)
    asked = merged(
        fault_options,
        direction_option,
        motion,
        weight,
        limits,
        friction,
        drives,
        task_options,
        tolerance,
    )
    result = force_capability.capability(arm, posture_options.of(arm), **asked)
    outputs.emit(capability_view(result), result, f"ftforce capability {arm.name}")
