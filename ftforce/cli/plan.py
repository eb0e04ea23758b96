"""``ftforce plan``: the joint path along a tool path that keeps the most after the worst fault."""

from typing import Annotated

import typer

from ftforce.cli.options import (
    ChainOptions,
    ForceOptions,
    FrictionOption,
    LimitsOption,
    MaximizeOption,
    PlanOutputs,
    PostureOptions,
    RobotArgument,
    SeedOption,
    SetOptions,
    TaskOptions,
    Tolerances,
    WeightOptions,
    merged,
    numbers,
)
from ftforce.cli.progress import progress_bar
from ftforce.cli.trajectories import TrajectoryOptions


def plan(
    robot: RobotArgument,
    trajectory_options: TrajectoryOptions,
    sets: SetOptions,
    forces: ForceOptions,
    posture_options: PostureOptions,
    weight: WeightOptions,
    limits: LimitsOption,
    friction: FrictionOption,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    outputs: PlanOutputs,
    maximize: MaximizeOption = "margin",
    waypoints: Annotated[
        int,
        typer.Option(metavar="N", help="Points on the tool path at which postures are compared."),
    ] = 100,
    max_acceleration: Annotated[
        str | None,
        typer.Option(
            metavar="A",
            help="Largest joint accelerations, rad/s² or m/s², one number or one per joint.",
            show_default="not limited",
        ),
    ] = None,
    keep_start: Annotated[
        bool,
        typer.Option("--keep-start", help="Start in the posture in which the usual path starts."),
    ] = False,
    locks: Annotated[
        str | None,
        typer.Option(
            "--locked",
            metavar="J@POS|J@Ts",
            help="Joints that have locked, and where (3@0.7, rad or m) or when (3@2s): plan the "
            "rest of the path.",
            show_default="none",
        ),
    ] = None,
    guarantee: Annotated[
        bool,
        typer.Option(
            "--guarantee",
            help="Prefer a path that can be finished whichever joint locks on the way.",
        ),
    ] = False,
    seed: SeedOption = 0,
) -> None:
    """Plan the joint path along a tool path that keeps the most after a fault.

    The worst instant and the worst set of failed joints count. Only the path of
    the tip is kept; collisions are not checked.
    """
    from ftforce.planning import path
    from ftforce.show.tables.plan import plan_view

    arm = chain.load(robot, posture_options.posture)
    asked = merged(sets, forces, weight, limits, friction, task_options, tolerances)
    asked |= trajectory_options.arguments_for(arm, posture_options, asked)
    asked["keep_orientation"] |= trajectory_options.keep_orientation
    del asked["static"]  # a plan counts the weight only
    fastest = numbers(max_acceleration, "--max-acceleration")
    if fastest is not None:
        asked["max_acceleration"] = fastest[0] if len(fastest) == 1 else fastest
    with progress_bar("waypoints") as progress:
        result = path.plan(
            arm, maximize=maximize, waypoints=waypoints, keep_start=keep_start, seed=seed,
            locked=locks, guarantee=guarantee, progress=progress, **asked,
        )  # fmt: skip
    outputs.emit(plan_view(result), result, f"ftforce plan {arm.name}")
