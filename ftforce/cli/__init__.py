"""The command line: one file per command, which parses, calls and shows.

What a command needs is imported when it runs, so ``ftforce --help`` answers at once.
"""

import sys
from typing import Annotated

import typer

from ftforce import __version__
from ftforce.cli.analyze import analyze
from ftforce.cli.census import census
from ftforce.cli.common import guarded
from ftforce.cli.dh import dh
from ftforce.cli.inspect import inspect
from ftforce.cli.replicate import replicate
from ftforce.cli.robots import robots

app = typer.Typer(
    name="ftforce",
    help="What a robot arm can still do when a joint fails.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for command in (analyze, census, inspect, robots, dh, replicate):
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
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal that cannot show Ω shows ? instead
            stream.reconfigure(errors="replace")
    app()
