"""Output of results to terminal, files and plots; destinations are checked in advance."""

from __future__ import annotations

import os
import sys
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import typer

from ftforce.cli.printing import printing, say
from ftforce.errors import FtforceError, OutputError, printable

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from rich.console import RenderableType


class Format(StrEnum):
    """Output formats."""

    TABLE = "table"
    JSON = "json"
    CSV = "csv"
    TEX = "tex"
    MD = "md"


_ENDINGS = ("json", "csv", "xlsx", "tex", "md", "txt", "svg", "html", "htm")
_HISTORY_ENDINGS = ("npz", "parquet", "mcap")
_MORE_ENDINGS = {
    "simulate": _HISTORY_ENDINGS,
    "plan": ("mcap",),
    "posture": ("srdf",),
    "reach": ("toml", "yaml", "yml"),
    "sweep": ("zarr",),
}
_DATA = ("json", "csv", "xlsx", "tex", "md", "srdf", "toml", "yaml", "yml", *_HISTORY_ENDINGS)
_PLOT_ENDINGS = ("png", "pdf", "svg")


def check_outputs(
    command: str,
    *,
    form: Format | None,
    output: list[Path] | None,
    plot: list[Path] | None = None,
    **_others: Any,
) -> None:
    """Reject files that could not be written, before any computation starts.

    Raises
    ------
    BadParameter
        A file extension is unknown, or contradicts the requested format.
    OutputError
        A file cannot be written.
    FtforceError
        What writes a file is not installed.
    """
    for path in output or ():
        _check_ending(command, path, form)
        if form is None and _ending(path) == "xlsx":
            from ftforce.report.spreadsheet import needs_xlsxwriter

            needs_xlsxwriter()
    for path in plot or ():
        if _ending(path) not in _PLOT_ENDINGS:
            raise typer.BadParameter(
                f"{printable(path)}: the name must end in {_listed(_PLOT_ENDINGS)}"
            )
        _start_matplotlib()
    from ftforce.io.text import check_writable, is_folder

    for path in (*(output or ()), *(plot or ())):
        if _ending(path) != "zarr":
            check_writable(path)
        elif not is_folder(path.parent):
            raise OutputError(path, "cannot be written (No such file or directory)")


def _start_matplotlib() -> None:
    """Import matplotlib without what it says of the user's settings, which no plot depends on.

    Raises
    ------
    FtforceError
        It is not installed, or does not start with its settings.
    """
    import logging

    from ftforce.show.plots.canvas import needs_matplotlib

    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    needs_matplotlib()


def _check_ending(command: str, path: Path, form: Format | None) -> None:
    endings = _ENDINGS + _MORE_ENDINGS.get(command, ())
    ending = _ending(path)
    if ending in _HISTORY_ENDINGS and ending not in endings:
        raise typer.BadParameter(
            f".{ending} is for histories of `ftforce simulate`; use .json or .csv"
        )
    if ending == "zarr" and command != "sweep":
        raise typer.BadParameter(".zarr is for `ftforce sweep`; use .json or .csv")
    if ending and ending not in endings and form is None:
        raise typer.BadParameter(f"{printable(path)}: the name must end in {_listed(endings)}")
    if form not in {None, ending} and ending in _DATA:
        raise typer.BadParameter(f"{printable(path)}: the extension does not match --format {form}")


def _listed(endings: tuple[str, ...]) -> str:
    return f"{', '.join(f'.{ending}' for ending in endings[:-1])} or .{endings[-1]}"


def emit(
    shown: RenderableType,
    result: object,
    *,
    form: Format | None,
    output: list[Path] | None,
    title: str,
    plot: list[Path] | None = None,
    warnings: tuple[str, ...] = (),
) -> None:
    """Print a result, and write it and its plot to the files requested.

    The tables are printed even if a file cannot be written, and files written even if standard
    output cannot.

    Parameters
    ----------
    shown :
        The result as tables.
    result :
        The result, for data formats and plots.
    form :
        Format of the files; of what is printed if there are none. ``None`` derives it from the
        file extension.
    output :
        Output files; then the tables go to standard output.
    title :
        Title of an image of the tables.
    plot :
        Plot files.
    warnings :
        Printed on stderr if the format cannot contain them.

    Raises
    ------
    OutputError
        A file cannot be written.
    FtforceError
        A file cannot hold the result; the others are written.
    """
    plots = [(path, _plot(result, path)) for path in plot or ()]  # fail before anything is written
    files, unfit = _contents(shown, result, form, output or (), title)
    written, failed = _write(files)
    plotted, not_plotted = _write(plots)
    if output or form in {None, Format.TABLE}:
        if not any(map(_is_stdout, written)):
            _print_tables(shown)
            for path in written:
                say(f"wrote {printable(path)}")
    else:
        _print_data(_data(result, str(form)))
        for warning in warnings:
            typer.echo(f"warning: {printable(warning)}", err=True)
    for path in plotted:  # on stderr, as standard output may carry data
        typer.echo(f"wrote {printable(path)}", err=True)
    for error in (*unfit, *failed, *not_plotted):
        raise error


def _contents(
    shown: RenderableType,
    result: object,
    form: Format | None,
    output: Sequence[Path],
    title: str,
) -> tuple[list[tuple[Path, str | bytes]], list[FtforceError]]:
    """Return the contents of files, and why some of them cannot hold the result."""
    files: list[tuple[Path, str | bytes]] = []
    unfit: list[FtforceError] = []
    for path in output:
        try:
            files.append((path, _content(shown, result, form, path, title)))
        except FtforceError as error:  # such as too many rows for Excel
            unfit.append(error)
    return files, unfit


def _write(files: Sequence[tuple[Path, str | bytes]]) -> tuple[list[Path], list[OutputError]]:
    """Write files, each completely or not at all; return those written, and what went wrong."""
    from ftforce.io.text import write_whole

    written: list[Path] = []
    failed: list[OutputError] = []
    for path, content in files:
        try:
            written.append(write_whole(path, content))
        except OutputError as error:
            failed.append(error)
    return written, failed


def _is_stdout(path: Path) -> bool:
    """Return whether a file is standard output itself, such as ``/dev/stdout``."""
    try:
        return os.path.samestat(path.stat(), os.fstat(sys.stdout.fileno()))
    except (OSError, ValueError):  # standard output is no file
        return False


def _print_tables(shown: RenderableType) -> None:
    from rich.console import Console

    with printing():
        Console().print(shown)


def _print_data(content: bytes) -> None:
    """Print data with the bytes that a file would hold, whatever the encoding of the terminal."""
    with printing():
        stream = getattr(sys.stdout, "buffer", None)
        if stream is None:  # replaced by a stream of text
            sys.stdout.write(content.decode())
            return
        sys.stdout.flush()
        stream.write(content)
        stream.flush()


def _content(
    shown: RenderableType, result: object, form: Format | None, output: Path, title: str
) -> str | bytes:
    kind = form or _form_of(output)
    return _picture(shown, result, output, title) if kind == Format.TABLE else _data(result, kind)


def _data(result: object, form: str) -> bytes:
    from ftforce.report.files import to_content

    content = to_content(result, form)
    # File names that are no UTF-8 are kept as \udcff, which JSON reads back.
    return content if isinstance(content, bytes) else content.encode(errors="backslashreplace")


def _form_of(output: Path) -> str:
    ending = _ending(output)
    return ending if ending in _DATA else Format.TABLE


def _plot(result: Any, path: Path) -> bytes:
    from ftforce.show.figures import figure_bytes

    return figure_bytes(result, path)


def _picture(shown: RenderableType, result: object, output: Path, title: str) -> str:
    from ftforce.report.provenance import origin_line
    from ftforce.show import render

    ending = _ending(output)
    if ending == "svg":
        return render.to_svg(shown, title, origin=origin_line(result))
    if ending in {"html", "htm"}:
        return render.to_page(shown, title, origin_line(result))
    return render.to_text(shown)


def _ending(path: Path) -> str:
    return path.suffix.lower().removeprefix(".")
