"""The command line: one file per command, which parses arguments, calls the API and shows results.

Imports are deferred until a command runs, so that ``ftforce --help`` responds immediately.
"""

import atexit
import gc
import os
import sys
import threading
from contextlib import suppress
from functools import partial
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ftforce import __version__
from ftforce.cli.command import Command
from ftforce.cli.examples import ELSEWHERE
from ftforce.cli.options import guarded
from ftforce.cli.printing import prepare_streams, reason_of, silence

COMMANDS = (
    "analyze",
    "census",
    "capability",
    "posture",
    "reach",
    "view",
    "simulate",
    "timeline",
    "plan",
    "sweep",
    "map",
    "compare",
    "inspect",
    "robots",
    "dh",
    "replicate",
    "warmup",
)


_UsageError: Any = typer.BadParameter.__base__  # which typer does not export


class Program(TyperGroup):
    """The program; it reports a wrong command line in one line, with exit status 2."""

    def main(self, *args: Any, standalone_mode: bool = True, **options: Any) -> Any:
        """Run the program, as `typer.core.TyperGroup.main`."""
        options |= {"standalone_mode": False}
        run = partial(super().main, *args, **options)
        if not standalone_mode:
            return run()
        try:
            status = run()
        except _UsageError as error:
            if type(error).__name__ == "NoArgsIsHelpError":  # its message is the help
                error.show()
            else:
                typer.echo(f"error: {_wrong(error)}", err=True)
            status = error.exit_code
        except typer.Abort:
            status = 1
        sys.exit(status or 0)


def _wrong(error: Any) -> str:
    """Return what is wrong with a command line: in ftforce's words, or in typer's."""
    if isinstance(error, typer.BadParameter) and error.param is None:
        return error.message
    words = " ".join(error.format_message().split()).removesuffix(".")
    place = "ftforce" if error.ctx is None else error.ctx.command_path
    asked = (place.rpartition(" ")[2], getattr(error, "option_name", ""))
    if asked in ELSEWHERE:
        return f"{place} has no {asked[1]}: {ELSEWHERE[asked]}"
    return f"{words} (see `{place} --help`)"


def build(*names: str) -> typer.Typer:
    """Return the program with the given commands, each a function in the module of its name."""
    program = typer.Typer(
        name="ftforce",
        cls=Program,
        help="What a robot arm can still do when a joint fails.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        callback=top,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    for name in names:
        command = getattr(import_module(f"ftforce.cli.{name}"), name)
        program.command(name, cls=Command)(guarded(command))
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
    gc.set_threshold(100_000)  # collecting garbage while modules are imported finds none
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


def run() -> None:
    """Run the command line as a process of its own, and end that process.

    It ends without freeing every object first, which would take as long as an analysis; what was
    registered with `atexit` runs. A process with other threads, or under a profiler, ends as usual.
    """
    status: Any = 0
    try:
        main()
    except SystemExit as end:
        status = end.code or 0
    is_observed = sys.getprofile() is not None or sys.gettrace() is not None
    if is_observed or threading.active_count() > 1 or not isinstance(status, int):
        sys.exit(status)
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (
        OSError,
        AttributeError,
    ):  # a closed pipe, or no stream: the interpreter knows what to do
        sys.exit(status)
    os._exit(status)


def __getattr__(name: str) -> Any:
    """Build the full program on first access, for use as an object."""
    if name != "app":
        raise AttributeError(f"module 'ftforce.cli' has no attribute {name!r}")
    globals()[name] = build(*COMMANDS)
    return globals()[name]
