"""``ftforce census``: one posture, all fault sets."""

from typing import Annotated, Any

import typer

from ftforce.cli.options import (
    ChainOptions,
    DirectionOption,
    DriveOptions,
    FrictionOption,
    LimitsOption,
    LoadOptions,
    MotionOptions,
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


def census(
    robot: RobotArgument,
    sets: SetOptions,
    direction_option: DirectionOption,
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
    outputs: PlotOutputs,
    rank_by: Annotated[
        str,
        typer.Option(
            metavar="jump|capability",
            help="Ranking of the sets: by the force jump, or by the force capability.",
        ),
    ] = "jump",
    top: TopOption = 40,
) -> None:
    """Analyse every set of up to --faults failed joints, worst first, and rank the joints."""
    if direction_option.direction is not None and rank_by == "jump":
        raise typer.BadParameter("--direction requires --rank-by capability")
    from ftforce.analysis import census as fault_census
    from ftforce.show.tables.census import census_view

    arm = chain.load(robot, posture_options.posture)
    asked = merged(
        sets,
        direction_option,
        load,
        motion,
        weight,
        limits,
        friction,
        drives,
        task_options,
        tolerances,
    )
    ranking: Any = rank_by  # checked by the function, with a message that lists what is valid
    with progress_bar("fault sets") as progress:
        result = fault_census.census(
            arm,
            posture_options.of(arm),
            rank_by=ranking,
            progress=progress,
            **asked,
        )
    outputs.emit(census_view(result, most=top), result, f"ftforce census {arm.name}")
