"""``ftforce reach``: the region that is reached whichever joint locks."""

from pathlib import Path
from typing import Annotated

import typer

from ftforce.cli.options import (
    ChainOptions,
    ExportOption,
    OpenOption,
    ReachOutputs,
    RobotArgument,
    SeedOption,
    SetOptions,
    numbers,
)
from ftforce.cli.progress import progress_bar


def reach(
    robot: RobotArgument,
    sets: SetOptions,
    chain: ChainOptions,
    outputs: ReachOutputs,
    task: Annotated[
        str | None,
        typer.Option(
            metavar="force|fx,fy|…",
            help="A point in space, or in the plane of a planar arm.",
            show_default="what suits the arm",
        ),
    ] = None,
    within: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Artificial position limits before the fault (.toml .yaml).",
            show_default="those of the arm",
        ),
    ] = None,
    release: Annotated[
        bool, typer.Option("--release", help="After the fault, the arm's own limits hold.")
    ] = False,
    soften: Annotated[
        bool,
        typer.Option("--soften", help="Choose artificial limits that make the region large."),
    ] = False,
    around: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,X,Y,Z",
            help="Corners of a box that the softened limits are to tolerate first, m.",
            show_default="none",
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Edge of the cells, m.",
            show_default="from the size of the reach",
        ),
    ] = None,
    seed: SeedOption = 0,
    open_page: OpenOption = False,
    export: ExportOption = None,
) -> None:
    """Find the region that the tip reaches whichever joint locks, wherever it is.

    What is proved, an estimate, and what is not excluded are given. Ctrl-C ends
    the search; what was found until then is shown. Collisions are not checked.
    """
    from ftforce.cli.view import check_pages, show
    from ftforce.planning.reach import Search
    from ftforce.show.tables.reach import reach_view

    check_pages(export)
    arm = chain.load(robot)
    corners = numbers(around, "--around")
    box = None
    if corners is not None:
        half = len(corners) // 2
        box = [corners[:half], corners[half:]]
    search = Search.of(
        arm, **vars(sets), task=task, within=within, release=release, soften=soften, around=box,
        cell=cell, seed=seed,
    )  # fmt: skip
    try:
        with progress_bar("steps") as progress:
            search.run(progress)
    except KeyboardInterrupt:
        pass  # the bounds hold, and the result says that it is not whole
    result = search.result()
    outputs.emit(reach_view(result), result, f"ftforce reach {arm.name}")
    if open_page or export is not None:
        from ftforce.view.planned import open_reach

        with open_reach(result) as session:
            show(session, export=export)
