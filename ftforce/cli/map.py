"""``ftforce map``: workspace regions that survive a fault."""

from pathlib import Path
from typing import Annotated

import typer

from ftforce.cli.options import PlotOutputs, items


def map(  # noqa: A001 # the command's name
    sweep: Annotated[
        Path, typer.Argument(metavar="SWEEP.zarr", help="A sweep stored by `ftforce sweep -o`.")
    ],
    outputs: PlotOutputs,
    joints: Annotated[
        str | None,
        typer.Option(
            metavar="2,4",
            help="Joints that fail together: numbers from 1 or names.",
            show_default="any set of the sweep",
        ),
    ] = None,
    plane: Annotated[
        str | None,
        typer.Option(metavar="xy|xz|yz", help="Plane of the root axes.", show_default="xz"),
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Position of the slice along the third axis, m.",
            show_default="all cells along that axis are pooled",
        ),
    ] = None,
    solid: Annotated[
        bool, typer.Option("--solid", help="Draw the cells of --plot in three dimensions.")
    ] = False,
    quantity: Annotated[
        str,
        typer.Option(
            metavar="rho,margin,…",
            help="Quantiles to show, of rho, margin, jump, capability.",
        ),
    ] = "rho,margin",
    top: Annotated[
        int, typer.Option(min=1, metavar="N", help="Number of worst cells to show.")
    ] = 8,
) -> None:
    """Show where in the workspace a sweep's postures tolerate a fault.

    Shows the share of postures per cell, the worst cells, the critical joints, and quantiles.
    """
    from ftforce.batch.store.store import open_sweep
    from ftforce.batch.workspace_map import workspace_map
    from ftforce.show.tables.map import map_view

    opened = open_sweep(sweep)
    found = workspace_map(
        opened,
        None if joints is None else _numbers(joints, opened.setting.joints),
        plane=plane or (None if at is None else "xz"),
        at=at,
        solid=solid,
        quantities=_words(quantity),
    )
    outputs.emit(map_view(found, most=top), found, f"ftforce map {sweep.name}")


def _words(text: str) -> list[str]:
    return list(dict.fromkeys(text.replace(",", " ").split()))


def _numbers(text: str, names: tuple[str, ...]) -> list[int]:
    """Parse joints, given as numbers from 1 or names.

    Raises
    ------
    UnknownNameError
        A joint is unknown.
    """
    from ftforce.errors import UnknownNameError

    found = set()
    given = items(text, "--joints")
    for word in (word for item in given for word in ([item] if item in names else item.split())):
        if word in names:
            found.add(names.index(word) + 1)
        elif word.isdecimal() and 1 <= int(word) <= len(names):
            found.add(int(word))
        else:
            numbered = [f"{i} {name}" for i, name in enumerate(names, start=1)]
            raise UnknownNameError("joint", word, numbered)
    return sorted(found)
