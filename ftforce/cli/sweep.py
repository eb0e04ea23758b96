"""``ftforce sweep``: many postures, all fault sets."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ftforce.cli.options import (
    CapabilityLimits,
    ChainOptions,
    ForceOptions,
    FrictionOption,
    MethodOption,
    PlotOutputs,
    RobotArgument,
    SeedOption,
    SetOptions,
    TaskOptions,
    ThreadsOption,
    Tolerances,
    TopOption,
    WeightOptions,
    merged,
    numbers,
)
from ftforce.cli.progress import rate_bar

if TYPE_CHECKING:
    from ftforce.batch.postures.postures import Postures
    from ftforce.robot.robot import Robot


class SweepOutputs(PlotOutputs):
    """Where the sweep, its tables and its plot go."""

    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR.zarr|FILE",
            help="Store the sweep in DIR.zarr; the same command resumes it if interrupted. Or a "
            "file to write (.json .csv .txt .svg .html); repeat it for more.",
        ),
    ] = None


def sweep(
    robot: RobotArgument,
    sets: SetOptions,
    forces: ForceOptions,
    weight: WeightOptions,
    limits: CapabilityLimits,
    friction: FrictionOption,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    outputs: SweepOutputs,
    samples: Annotated[
        float | None, typer.Option(metavar="N", help="Number of postures to draw, e.g. 1e6.")
    ] = None,
    method: MethodOption = "sobol",
    seed: SeedOption = 0,
    postures: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Instead of --samples: recorded postures (.npy .csv .parquet, or a bag: .mcap "
            ".db3 .bag), rad or m.",
        ),
    ] = None,
    deg: Annotated[
        bool, typer.Option("--deg", help="Angles in --postures are in degrees.")
    ] = False,
    topic: Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC",
            help="Topic of a bag given by --postures.",
            show_default="the only one that has the joints",
        ),
    ] = None,
    grid: Annotated[
        str | None,
        typer.Option(
            metavar="K|K1,K2,…",
            help="Instead of --samples: all combinations of K positions of every joint.",
        ),
    ] = None,
    keep: Annotated[
        str | None,
        typer.Option(
            metavar="worst|all|summary",
            help="Samples stored in a .zarr: of each posture's worst set, of every set, or none.",
            show_default="worst",
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Edge length of the workspace cells, m.",
            show_default="about a twentieth of the reach",
        ),
    ] = None,
    chunk: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Postures processed and stored at a time.",
            show_default="65,536; fewer for many fault sets",
        ),
    ] = None,
    threads: ThreadsOption = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Instead of threads: N Dask processes.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://…", help="Instead of threads: scheduler of a Dask cluster."),
    ] = None,
    top: TopOption = 20,
) -> None:
    """Analyse every set of up to --faults failed joints at many postures.

    Draws postures within the joint limits, or takes recorded ones or a grid.
    Reports the share of the workspace that survives, and the critical joint.
    """
    from ftforce.batch import sweep as batch
    from ftforce.show.tables.sweep import sweep_view

    arm = chain.load(robot)
    source = _source(arm, samples, postures, grid, deg=deg, topic=topic)
    store, files = _split(outputs.output or [])
    if keep not in {None, "summary"} and store is None:
        raise typer.BadParameter(f"--keep {keep} needs an --output that ends in .zarr")
    kept: Any = keep  # checked by the function, with a message that lists what is valid
    try:
        with rate_bar("postures") as progress:
            result = batch.sweep(
                arm,
                source,
                n=samples,
                method=method,
                seed=seed,
                keep=kept,
                cell=cell,
                output=store,
                chunk=chunk,
                threads=threads,
                workers=workers,
                scheduler=scheduler,
                progress=progress,
                **merged(sets, forces, weight, limits, friction, task_options, tolerances),
            )
    except KeyboardInterrupt as pressed:
        kept = "nothing was kept (--output DIR.zarr stores finished chunks)"
        if store is not None:
            noted = getattr(pressed, "__notes__", ())  # by the runner; none before and after it
            kept = next(iter(noted), "finished chunks are kept; the same command resumes the sweep")
        typer.echo(f"interrupted; {kept}", err=True)
        raise typer.Exit(130) from None
    outputs = SweepOutputs(**(vars(outputs) | {"output": files}))
    outputs.emit(sweep_view(result, most=top), result, f"ftforce sweep {arm.name}")


def _split(output: list[Path]) -> tuple[Path | None, list[Path]]:
    """Return the store and the other files.

    Raises
    ------
    BadParameter
        There are two stores.
    """
    stores = [path for path in output if path.suffix.lower() == ".zarr"]
    if len(stores) > 1:
        raise typer.BadParameter("--output: a sweep is stored in one .zarr only")
    return next(iter(stores), None), [path for path in output if path not in stores]


def _source(
    arm: "Robot",
    samples: float | None,
    postures: Path | None,
    grid: str | None,
    *,
    deg: bool,
    topic: str | None,
) -> "Postures | None":
    """Return the postures from a file or grid; ``None`` if they are to be sampled.

    Raises
    ------
    BadParameter
        Not exactly one of the three sources is given.
    """
    given = [value for value in (samples, postures, grid) if value is not None]
    if len(given) != 1:
        raise typer.BadParameter("give one of --samples, --postures and --grid")
    if deg and postures is None:
        raise typer.BadParameter("--deg requires --postures")
    if topic is not None and postures is None:
        raise typer.BadParameter("--topic requires --postures")
    if postures is not None:
        from ftforce.batch.postures.files import postures_from_file

        return postures_from_file(arm, postures, degrees=deg, topic=topic)
    if grid is not None:
        from ftforce.batch.postures.postures import Grid

        counts = _counts(grid)
        return Grid.of(arm, counts[0] if len(counts) == 1 else counts)
    return None


def _counts(grid: str) -> list[int]:
    found = numbers(grid, "--grid") or []
    if any(x != int(x) for x in found):
        raise typer.BadParameter("--grid needs whole numbers, e.g. 5 or 5,5,4")
    return [int(x) for x in found]
