"""``ftforce compare``: arms ranked by how gracefully they degrade."""

from typing import Annotated, Any

import typer

from ftforce.cli.options import (
    CapabilityLimits,
    ChainOptions,
    ForceOptions,
    FrictionOption,
    MethodOption,
    PlotOutputs,
    SeedOption,
    SetOptions,
    TaskOptions,
    ThreadsOption,
    Tolerances,
    WeightOptions,
    given_options,
    merged,
)
from ftforce.cli.progress import rate_bar


def compare(
    context: typer.Context,
    robots: Annotated[
        list[str],
        typer.Argument(
            metavar="ROBOT…",
            help="Two or more: URDFs, DH tables, known names, or stored sweeps (folders *.zarr).",
        ),
    ],
    sets: SetOptions,
    forces: ForceOptions,
    weight: WeightOptions,
    limits: CapabilityLimits,
    friction: FrictionOption,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    outputs: PlotOutputs,
    samples: Annotated[
        float,
        typer.Option(
            metavar="N", help="Number of postures to draw for each arm.", show_default="1e5"
        ),
    ] = 1e5,
    method: MethodOption = "sobol",
    seed: SeedOption = 0,
    cell: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Edge length of the workspace cells, m.",
            show_default="a tenth of each arm's longest reach",
        ),
    ] = None,
    enough: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            help="A cell survives if this share of its postures tolerates every set.",
        ),
    ] = 0.95,
    threads: ThreadsOption = None,
) -> None:
    """Rank arms by how well they degrade, over many postures and every fault set.

    All arms are asked the same question; stored sweeps must match it.
    """
    from ftforce.batch import comparison
    from ftforce.show.tables.comparison import comparison_view

    asked: dict[str, Any] = {"n": samples, "method": method, "seed": seed}
    asked |= {"cell": cell} | merged(
        sets, forces, weight, limits, friction, task_options, chain, tolerances
    )
    # Only what was given: a stored sweep has a question of its own.
    given = {"n" if name == "samples" else name for name in given_options(context)}
    with rate_bar("postures") as progress:
        result = comparison.compare(
            robots,
            enough=enough,
            threads=threads,
            progress=progress,
            **{name: value for name, value in asked.items() if name in given},
        )
    outputs.emit(comparison_view(result), result, "ftforce compare")
