"""The command line: one file per command, which parses arguments, calls the API and shows results.

Imports are deferred until a command runs, so that ``ftforce --help`` responds immediately.
"""

import sys
from contextlib import suppress
from importlib import import_module
from typing import Annotated, Any

import typer

from ftforce import __version__
from ftforce.cli.options import guarded
from ftforce.cli.printing import prepare_streams, reason_of, silence

COMMANDS = (
    "analyze",
    "census",
    "capability",
    "view",
    "simulate",
    "timeline",
    "sweep",
    "map",
    "compare",
    "inspect",
    "robots",
    "dh",
    "replicate",
)


def build(*names: str) -> typer.Typer:
    """Return the program with the given commands, each a function in the module of its name."""
    program = typer.Typer(
        name="ftforce",
        help="What a robot arm can still do when a joint fails.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        callback=top,
    )
    for name in names:
        command = getattr(import_module(f"ftforce.cli.{name}"), name)
        program.command(name)(guarded(command))
    return program


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"ftforce {__version__}")
        raise typer.Exit


def top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Say what a robot arm can still do when a joint fails."""


def main() -> None:
    """Run the command line."""
    prepare_streams()
    # Build only the command that is named, to avoid importing the others.
    named = [word for word in sys.argv[1:2] if word in COMMANDS]
    try:
        build(*(named or COMMANDS))()
    except OSError as problem:  # from --help and --version; commands handle their own output
        if "--debug" in sys.argv:
            raise
        silence()
        with suppress(OSError):  # stderr itself may have failed
            typer.echo(f"error: {reason_of(problem)}", err=True)
        sys.exit(1)


def __getattr__(name: str) -> Any:
    """Build the full program on first access, for use as an object."""
    if name != "app":
        raise AttributeError(f"module 'ftforce.cli' has no attribute {name!r}")
    globals()[name] = build(*COMMANDS)
    return globals()[name]
