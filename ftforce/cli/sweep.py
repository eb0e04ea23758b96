"""``ftforce sweep``: many postures, all fault sets."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ftforce.cli.options import (
    AxesOption,
    Base,
    Direction,
    Force,
    FormatOption,
    Gravity,
    Length,
    LimitsOfCapability,
    PayloadOption,
    PlotOption,
    RobotArgument,
    Rtol,
    TaskOption,
    Tip,
    Wary,
    load,
    numbers,
)
from ftforce.cli.output import emit
from ftforce.cli.progress import rate_bar

if TYPE_CHECKING:
    from ftforce.batch.postures.postures import Postures
    from ftforce.robot.robot import Robot


def sweep(
    robot: RobotArgument,
    samples: Annotated[
        float | None, typer.Option(metavar="N", help="How many postures to draw, e.g. 1e6.")
    ] = None,
    method: Annotated[
        str, typer.Option(metavar="sobol|uniform", help="How they are drawn within the limits.")
    ] = "sobol",
    seed: Annotated[int, typer.Option(help="The same seed draws the same postures.")] = 0,
    postures: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Instead: recorded postures (.npy .csv .parquet; a column per joint, rad or m).",
        ),
    ] = None,
    deg: Annotated[bool, typer.Option("--deg", help="--postures is in degrees.")] = False,
    grid: Annotated[
        str | None,
        typer.Option(metavar="K|K1,K2,…", help="Instead: K positions of every joint, combined."),
    ] = None,
    faults: Annotated[int, typer.Option(help="Size of the largest fault sets.")] = 1,
    mode: Annotated[
        str, typer.Option(metavar="locked|free", help="How the joints fail.")
    ] = "locked",
    force: Force = None,
    direction: Direction = None,
    limits: LimitsOfCapability = "urdf",
    gravity: Gravity = None,
    payload: PayloadOption = None,
    task: TaskOption = "force",
    length: Length = None,
    axes: AxesOption = "tool",
    base: Base = None,
    tip: Tip = None,
    rtol: Rtol = 1e-6,
    wary: Wary = 1e-2,
    keep: Annotated[
        str | None,
        typer.Option(
            metavar="all|worst|summary",
            help="What a .zarr keeps of each posture: every set, its worst set, or nothing.",
            show_default="all",
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Edge of the workspace's cells, m.",
            show_default="about a twentieth of the reach",
        ),
    ] = None,
    chunk: Annotated[
        int | None,
        typer.Option(
            help="Postures that are done, and stored, at a time.",
            show_default="65,536; fewer for many fault sets",
        ),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(help="Threads on this machine.", show_default="all processors")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Instead: N processes under Dask.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://…", help="Instead: a Dask cluster's scheduler.")
    ] = None,
    top: Annotated[int, typer.Option(min=1, help="How many sets the table shows.")] = 20,
    plot: PlotOption = None,
    form: FormatOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR.zarr|FILE",
            help="Keep the sweep in DIR.zarr: the same command goes on if it was stopped. Or write "
            "the tables to a file (.json .csv .txt .svg .html).",
        ),
    ] = None,
) -> None:
    """Analyse every set of up to --faults failed joints at many postures.

    Draws postures within the joint limits, or takes recorded ones or a grid; says how much of the
    workspace survives, and which joint is the critical one.
    """
    from ftforce.batch import sweep as batch
    from ftforce.show.tables.sweep import sweep_view

    arm = load(robot, tip, base, None)
    source = _source(arm, samples, postures, grid, deg=deg)
    stored = output is not None and output.suffix.lower() == ".zarr"
    if keep not in {None, "summary"} and not stored:
        raise typer.BadParameter(f"--keep {keep} needs an --output that ends in .zarr")
    try:
        with rate_bar("postures") as progress:
            result = batch.sweep(
                arm,
                source,
                n=samples,
                method=method,
                seed=seed,
                faults=faults,
                mode=mode,
                force=numbers(force, "--force"),
                direction=numbers(direction, "--direction"),
                limits=limits,
                gravity=numbers(gravity, "--gravity"),
                payload=payload,
                task=task,
                length=length,
                axes=axes,  # type: ignore[arg-type] # checked there, with a message
                rtol=rtol,
                wary=wary,
                keep=keep,  # type: ignore[arg-type] # likewise
                cell=cell,
                output=output if stored else None,
                chunk=chunk,
                threads=threads,
                workers=workers,
                scheduler=scheduler,
                progress=progress,
            )
    except KeyboardInterrupt:
        kept = "nothing was kept (--output DIR.zarr would)"
        if stored:
            kept = "what is finished is kept: the same command goes on from there"
        typer.echo(f"interrupted; {kept}", err=True)
        raise typer.Exit(130) from None
    emit(
        sweep_view(result, most=top),
        result,
        form=form,
        output=None if stored else output,
        plot=plot,
        title=f"ftforce sweep {arm.name}",
        warnings=result.warnings,
    )


def _source(
    arm: "Robot", samples: float | None, postures: Path | None, grid: str | None, *, deg: bool
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
        raise typer.BadParameter("--deg is about --postures")
    if postures is not None:
        from ftforce.batch.postures.files import postures_from_file

        return postures_from_file(arm, postures, degrees=deg)
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
