"""``ftforce dh``: conversion of a DH table to URDF and SRDF."""

import os
from pathlib import Path
from typing import Annotated

import typer

from ftforce.cli.printing import say
from ftforce.errors import OutputError, printable


def dh(
    table: Annotated[
        Path, typer.Argument(metavar="TABLE", help="DH table (TOML), e.g. robots/dh5.toml.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="URDF to write; the SRDF goes beside it.",
            show_default="the table's file name with .urdf, in the current folder",
        ),
    ] = None,
) -> None:
    """Turn a DH table into a URDF, and an SRDF with its postures beside it.

    Replaces the file that --output names, and an SRDF that it wrote earlier, but
    no other. If one of the two cannot be written, both stay as they were.
    """
    from ftforce.robot.formats.dh import TIP, DHTable
    from ftforce.robot.formats.dh_to_urdf import write_robot

    made = output or Path(table.stem + ".urdf")
    if output is None:
        for path in (made, made.with_suffix(".srdf")):
            if os.path.lexists(path):
                raise OutputError(path, f"exists; to replace it, give --output {made}")
    arm = DHTable.from_toml(table)
    urdf, srdf = write_robot(arm, made)
    postures = ", ".join(arm.postures) or "none"
    joints = "1 joint" if len(arm.rows) == 1 else f"{len(arm.rows)} joints"
    files = f"{printable(urdf)} and {printable(srdf)}"
    say(f"wrote {files}: {joints}, tip {TIP!r}, postures: {postures}")
