"""The command line: one file per command, which parses, calls and shows.

What a command needs is imported when it runs, so ``ftforce --help`` answers at once.
"""

import sys
from contextlib import suppress
from typing import Annotated

import typer

from ftforce import __version__
from ftforce.cli.analyze import analyze
from ftforce.cli.capability import capability
from ftforce.cli.census import census
from ftforce.cli.common import guarded
from ftforce.cli.dh import dh
from ftforce.cli.inspect import inspect
from ftforce.cli.printing import prepare_streams, reason_of, silence
from ftforce.cli.replicate import replicate
from ftforce.cli.robots import robots

app = typer.Typer(
    name="ftforce",
    help="What a robot arm can still do when a joint fails.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for command in (analyze, census, capability, inspect, robots, dh, replicate):
    app.command()(guarded(command))


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"ftforce {__version__}")
        raise typer.Exit


@app.callback()
def top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Say what a robot arm can still do when a joint fails."""


def main() -> None:
    """Run the command line."""
    prepare_streams()
    try:
        app()
    except OSError as problem:  # from help and version; a command sees to its own output
        if "--debug" in sys.argv:
            raise
        silence()
        with suppress(OSError):  # it may have been stderr that failed
            typer.echo(f"error: {reason_of(problem)}", err=True)
        sys.exit(1)
