"""``ftforce analyze``: one posture, one fault set."""

from ftforce.cli.options import (
    ChainOptions,
    DriveOptions,
    FaultOptions,
    FrictionOption,
    LimitsOption,
    LoadOptions,
    MotionOptions,
    Outputs,
    PostureOptions,
    RobotArgument,
    TaskOptions,
    Tolerances,
    WeightOptions,
    merged,
)


def analyze(
    robot: RobotArgument,
    fault_options: FaultOptions,
    posture_options: PostureOptions,
    load: LoadOptions,
    motion: MotionOptions,
    weight: WeightOptions,
    limits: LimitsOption,
    friction: FrictionOption,
    drives: DriveOptions,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    outputs: Outputs,
) -> None:
    """Show how a fault changes the force at the tip, and which torques to command.

    Without --force or --torque, unit forces along the task axes are analysed and
    the lost directions listed.
    """
    from ftforce.analysis import analyze as analysis
    from ftforce.show.tables.analysis import analysis_view

    arm = chain.load(robot, posture_options.posture)
    asked = merged(
        fault_options, load, motion, weight, limits, friction, drives, task_options, tolerances
    )
    result = analysis.analyze(arm, posture_options.of(arm), **asked)
    shown = analysis_view(result, degrees=posture_options.deg)
    outputs.emit(shown, result, f"ftforce analyze {arm.name}")
