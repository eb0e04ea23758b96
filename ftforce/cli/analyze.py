"""``ftforce analyze``: one posture, one fault set."""

from ftforce.cli.options import (
    ChainOptions,
    FaultOptions,
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
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    outputs: Outputs,
) -> None:
    """Say what a fault does to the force at the tool, and which torques to command now.

    Without --force or --torque: the same for unit forces, and which directions
    are lost.
    """
    from ftforce.analysis import analyze as analysis
    from ftforce.show.tables.analysis import analysis_view

    arm = chain.load(robot, posture_options.posture)
    asked = merged(fault_options, load, motion, weight, limits, task_options, tolerances)
    result = analysis.analyze(arm, posture_options.of(arm), **asked)
    shown = analysis_view(result, degrees=posture_options.deg)
    outputs.emit(shown, result, f"ftforce analyze {arm.name}")
