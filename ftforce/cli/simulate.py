"""``ftforce simulate``: motion along a trajectory while joints fail."""

from typing import Annotated

import typer

from ftforce.cli.options import (
    ChainOptions,
    DriveOptions,
    FrictionOption,
    HistoryOutputs,
    LimitsOption,
    PostureOptions,
    TaskOptions,
    Tolerances,
    WeightOptions,
    given_options,
    merged,
    numbers,
)
from ftforce.cli.progress import progress_bar
from ftforce.cli.trajectories import TrajectoryOptions

_BESIDE_PAPER = {"paper", "debug", "rate", "delay", "no_remap", "plot", "form", "output"}

Robot = Annotated[
    str | None,
    typer.Argument(
        metavar="ROBOT",
        help="A URDF, a DH table (.toml), or a known name such as panda (see `ftforce robots`).",
        show_default=False,
    ),
]
Force = Annotated[
    str | None,
    typer.Option(
        metavar="FX,FY,FZ",
        help="Force the tool exerts throughout, N (and N·m); 0,0,0 for free motion.",
    ),
]
_FaultOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="JOINTS@S",
        help="What fails when: 3@50, 3,4@50, free:2@10, weak:3:0.5@5. Repeat it for more.",
    ),
]


def simulate(
    context: typer.Context,
    trajectory_options: TrajectoryOptions,
    posture_options: PostureOptions,
    weight: WeightOptions,
    limits: LimitsOption,
    friction: FrictionOption,
    drives: DriveOptions,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    outputs: HistoryOutputs,
    robot: Robot = None,
    force: Force = None,
    fault: _FaultOption = None,
    delay: Annotated[
        float, typer.Option(metavar="S", help="Time from a fault until the remap takes effect.")
    ] = 0.0,
    no_remap: Annotated[
        bool, typer.Option("--no-remap", help="The controller never learns of the faults.")
    ] = False,
    paper: Annotated[
        bool, typer.Option("--paper", help="Section V of the paper, on dh5; needs nothing else.")
    ] = False,
) -> None:
    """Move an arm along a trajectory while its tool exerts a force and joints fail.

    The result is three histories: of the healthy arm, without the remap, and
    with it. -o FILE with .csv, .npz or .parquet stores all their instants.
    """
    from ftforce.show.tables.history import history_view
    from ftforce.trajectory.section_v import section_v
    from ftforce.trajectory.simulate import simulate as simulation

    remap = not no_remap
    if paper:
        given = given_options(context)
        if named := [given[name] for name in given if name not in _BESIDE_PAPER]:
            raise typer.BadParameter(
                f"--paper determines these itself; leave out {', '.join(named)}"
            )
        with progress_bar("instants") as progress:
            rate = trajectory_options.rate
            history = section_v(rate=rate, delay=delay, remap=remap, progress=progress)
    elif robot is None:
        raise typer.BadParameter(
            "ROBOT is missing: a URDF, DH table or known name (see `ftforce robots`)"
        )
    elif force is None:
        raise typer.BadParameter("--force is missing, e.g. 80,50,10; 0,0,0 is a free motion")
    else:
        arm = chain.load(robot, posture_options.posture)
        asked = merged(weight, limits, friction, drives, task_options, tolerances)
        asked["force"] = numbers(force, "--force") or []
        asked |= trajectory_options.arguments_for(arm, posture_options, asked)
        with progress_bar("instants") as progress:
            history = simulation(
                arm,
                faults=fault or (),
                delay=delay,
                remap=remap,
                progress=progress,
                **asked,
            )
    outputs.emit(history_view(history), history, f"ftforce simulate {history.setting.robot}")
