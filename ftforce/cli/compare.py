"""``ftforce compare``: arms ranked by how gracefully they degrade."""

from typing import Annotated

import typer

from ftforce.cli.options import (
    Direction,
    Force,
    FormatOption,
    Gravity,
    Length,
    Output,
    PayloadOption,
    PlotOption,
    numbers,
)
from ftforce.cli.output import emit
from ftforce.cli.progress import rate_bar


def compare(
    robots: Annotated[
        list[str],
        typer.Argument(
            metavar="ROBOT…",
            help="Two or more: URDF files, known names, or stored sweeps (folders *.zarr).",
        ),
    ],
    samples: Annotated[
        float | None,
        typer.Option(metavar="N", help="How many postures of each to draw.", show_default="1e5"),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="sobol|uniform",
            help="How they are drawn within the limits.",
            show_default="sobol",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="The same for every arm.", show_default="0")
    ] = None,
    faults: Annotated[
        int | None, typer.Option(help="Size of the largest fault sets.", show_default="1")
    ] = None,
    mode: Annotated[
        str | None,
        typer.Option(metavar="locked|free", help="How the joints fail.", show_default="locked"),
    ] = None,
    force: Force = None,
    direction: Direction = None,
    limits: Annotated[
        str | None,
        typer.Option(
            metavar="urdf|FILE|none",
            help="Torque limits of the capability: each URDF's, or a file that suits every arm.",
            show_default="urdf",
        ),
    ] = None,
    gravity: Gravity = None,
    payload: PayloadOption = None,
    task: Annotated[
        str | None,
        typer.Option(
            help="force, moment, wrench, or components such as fx,fz,my.", show_default="force"
        ),
    ] = None,
    length: Length = None,
    axes: Annotated[
        str | None,
        typer.Option(
            help="tool: axes of the tip frame; world: axes of the root, at the tip.",
            show_default="tool",
        ),
    ] = None,
    base: Annotated[
        str | None,
        typer.Option(help="Base link of every arm that is loaded; without it each robot's own."),
    ] = None,
    tip: Annotated[
        str | None,
        typer.Option(help="Tip link of every arm that is loaded; without it each robot's own."),
    ] = None,
    rtol: Annotated[
        float | None,
        typer.Option(
            help="Singular values up to rtol * sigma_max(J) count as lost.", show_default="1e-06"
        ),
    ] = None,
    wary: Annotated[
        float | None,
        typer.Option(
            help="Borderline if a tolerance up to this changes the verdict.", show_default="0.01"
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Edge of the workspace's cells, m.",
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
    threads: Annotated[
        int | None, typer.Option(help="Threads on this machine.", show_default="all processors")
    ] = None,
    plot: PlotOption = None,
    form: FormatOption = None,
    output: Output = None,
) -> None:
    """Rank arms by how well they degrade, over many postures and every fault set.

    Every arm is asked the same; stored sweeps must have been.
    """
    from ftforce.batch import comparison
    from ftforce.show.tables.comparison import comparison_view

    with rate_bar("postures") as progress:
        result = comparison.compare(
            robots,
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
            cell=cell,
            enough=enough,
            tip=tip,
            base=base,
            threads=threads,
            progress=progress,
        )
    emit(
        comparison_view(result),
        result,
        form=form,
        output=output,
        plot=plot,
        title="ftforce compare",
        warnings=result.warnings,
    )
