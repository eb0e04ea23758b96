"""``ftforce timeline``: severity of each fault along a trajectory."""

from ftforce.cli.options import (
    ChainOptions,
    DriveOptions,
    ForceOptions,
    FrictionOption,
    LimitsOption,
    PlotOutputs,
    PostureOptions,
    RobotArgument,
    SetOptions,
    TaskOptions,
    Tolerances,
    TopOption,
    WeightOptions,
    merged,
)
from ftforce.cli.progress import progress_bar
from ftforce.cli.trajectories import TrajectoryOptions


def timeline(
    robot: RobotArgument,
    trajectory_options: TrajectoryOptions,
    sets: SetOptions,
    forces: ForceOptions,
    posture_options: PostureOptions,
    weight: WeightOptions,
    limits: LimitsOption,
    friction: FrictionOption,
    drives: DriveOptions,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    outputs: PlotOutputs,
    top: TopOption = 40,
) -> None:
    """Evaluate every set of failed joints at every instant of a trajectory.

    The healthy arm follows the trajectory; jump, margin and capability are those
    of a fault at that instant.
    """
    from ftforce.show.tables.timeline import timeline_view
    from ftforce.trajectory import timeline as fault_timeline

    arm = chain.load(robot, posture_options.posture)
    asked = merged(sets, forces, weight, limits, friction, drives, task_options, tolerances)
    asked |= trajectory_options.arguments_for(arm, posture_options, asked)
    with progress_bar("instants") as progress:
        result = fault_timeline.timeline(arm, progress=progress, **asked)
    outputs.emit(timeline_view(result, most=top), result, f"ftforce timeline {arm.name}")
