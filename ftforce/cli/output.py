"""Output of results to terminal, files and plots; destinations are checked in advance."""

from __future__ import annotations

import errno
import os
import sys
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import typer

from ftforce.cli.printing import printing, say
from ftforce.errors import OutputError, printable

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import RenderableType


class Format(StrEnum):
    """Output formats."""

    TABLE = "table"
    JSON = "json"
    CSV = "csv"


_ENDINGS = ("json", "csv", "txt", "svg", "html", "htm")
_HISTORY_ENDINGS = ("npz", "parquet")
_MORE_ENDINGS = {"simulate": _HISTORY_ENDINGS, "sweep": ("zarr",)}
_DATA = ("json", "csv", *_HISTORY_ENDINGS)
_PLOT_ENDINGS = ("png", "pdf", "svg")


def check_outputs(
    command: str,
    *,
    form: Format | None,
    output: Path | None,
    plot: Path | None = None,
    **_others: Any,
) -> None:
    """Reject files that could not be written, before any computation starts.

    Raises
    ------
    BadParameter
        A file extension is unknown, or contradicts the requested format.
    OutputError
        The folder does not exist.
    """
    if output is not None:
        endings = _ENDINGS + _MORE_ENDINGS.get(command, ())
        ending = _ending(output)
        if ending in _HISTORY_ENDINGS and command != "simulate":
            raise typer.BadParameter(
                f".{ending} is for histories of `ftforce simulate`; use .json or .csv"
            )
        if ending == "zarr" and command != "sweep":
            raise typer.BadParameter(".zarr is for `ftforce sweep`; use .json or .csv")
        if ending and ending not in endings and form is None:
            raise typer.BadParameter(
                f"{printable(output)}: the name must end in {_listed(endings)}"
            )
        if form not in {None, ending} and ending in _DATA:
            raise typer.BadParameter(
                f"{printable(output)}: the extension does not match --format {form}"
            )
    if plot is not None:
        if _ending(plot) not in _PLOT_ENDINGS:
            raise typer.BadParameter(
                f"{printable(plot)}: the name must end in {_listed(_PLOT_ENDINGS)}"
            )
        from ftforce.show.plots.canvas import needs_matplotlib

        needs_matplotlib()
    for path in (output, plot):
        if path is not None and not path.parent.is_dir():
            above = next(folder for folder in path.parents if folder.exists())
            reason = os.strerror(errno.ENOENT if above.is_dir() else errno.ENOTDIR)
            raise OutputError(path, f"cannot be written ({reason})")


def _listed(endings: tuple[str, ...]) -> str:
    return f"{', '.join(f'.{ending}' for ending in endings[:-1])} or .{endings[-1]}"


def emit(
    shown: RenderableType,
    result: object,
    *,
    form: Format | None,
    output: Path | None,
    title: str,
    plot: Path | None = None,
    warnings: tuple[str, ...] = (),
) -> None:
    """Print a result or write it to a file; also plot it if requested.

    Parameters
    ----------
    shown :
        The result as tables.
    result :
        The result, for data formats and plots.
    form :
        Requested format; ``None`` derives it from the file extension.
    output :
        Output file; ``None`` for standard output.
    title :
        Title of an image of the tables.
    plot :
        Plot file; ``None`` for no plot.
    warnings :
        Printed on stderr if the format cannot contain them.
    """
    picture = None if plot is None else _plot(result, plot)  # fail before any output is written
    _emit(shown, result, form or _form_of(output), output, title, warnings)
    if plot is not None and picture is not None:
        from ftforce.io.text import write_whole

        # On stderr, as standard output may carry data.
        typer.echo(f"wrote {printable(write_whole(plot, picture))}", err=True)


def _emit(
    shown: RenderableType,
    result: object,
    form: str,
    output: Path | None,
    title: str,
    warnings: tuple[str, ...],
) -> None:
    if form == Format.TABLE and output is None:
        from rich.console import Console

        with printing():
            Console().print(shown)
        return
    content: str | bytes
    if form == Format.TABLE and output is not None:
        content = _picture(shown, output, title)
    else:
        from ftforce.report.files import to_content

        content = to_content(result, form)
        for warning in warnings:
            typer.echo(f"warning: {printable(warning)}", err=True)
    if output is None:
        with printing():
            sys.stdout.write(content if isinstance(content, str) else content.decode())
    else:
        from ftforce.io.text import write_whole

        say(f"wrote {printable(write_whole(output, content))}")


def _form_of(output: Path | None) -> str:
    ending = "" if output is None else _ending(output)
    return ending if ending in _DATA else Format.TABLE


def _plot(result: Any, path: Path) -> bytes:
    from ftforce.show.figures import figure_bytes

    return figure_bytes(result, path)


def _picture(shown: RenderableType, output: Path, title: str) -> str:
    from ftforce.show import render

    ending = output.suffix.lower()
    if ending == ".svg":
        return render.to_svg(shown, title)
    return render.to_page(shown, title) if ending in {".html", ".htm"} else render.to_text(shown)


def _ending(path: Path) -> str:
    return path.suffix.lower().removeprefix(".")
