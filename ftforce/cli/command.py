"""A command of the program: its help, and words that must not be taken for something else."""

from typing import Any

import typer
from typer.core import TyperCommand

from ftforce.cli.examples import EXAMPLES

# Headings of the help, in this order, and the options below each.
PANELS = {
    "Faults": "locked free weak faults mode fault joints delay no_remap paper",
    "Postures": "q posture samples method seed postures grid deg",
    "Trajectory": "start to speed keep_orientation rate max_gap topic smooth static",
    "Planning": "rpy like restarts maximize waypoints max_acceleration keep_start locks guarantee "
    "within release soften around",
    "Force and motion": "force torque inverse direction velocity acceleration "
    "joint_friction armature",
    "Weight, limits and friction": "gravity mounted payload limits friction",
    "Task and chain": "robot task length joint_length axes base tip srdf args package_path",
    "Tolerances": "rtol wary",
    "Workspace": "cell plane at solid enough",
    "Page": "history sweep host port no_browser open_page export screenshot",
    "Computation": "keep chunk threads workers scheduler",
    "Output": "rank_by quantity top form output plot debug help",
}
_PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names.split()}
_ORDER = list(_PANEL_OF)


class Command(TyperCommand):
    """A command whose help has headings, defaults in one style, and examples.

    It rejects empty values, and options that are given twice but hold one value.
    """

    def __init__(self, name: str | None, **options: Any) -> None:
        super().__init__(name, **options)
        for parameter in self.params:
            _describe(parameter)
        self.params.sort(key=_place)

    def get_help_option(self, ctx: Any) -> Any:
        """Return the option ``--help``, as `typer.core.TyperCommand.get_help_option`."""
        found = super().get_help_option(ctx)
        if found is not None:
            found.rich_help_panel = _PANEL_OF["help"]
        return found

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help, and the examples below it."""
        super().format_help(ctx, formatter)
        if examples := EXAMPLES.get(self.name or ""):
            lines = (f"   ftforce {words}\n" for words in examples)
            typer.echo(f" Examples\n\n{''.join(lines)}")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words, as `typer.core.TyperCommand.parse_args`.

        Raises
        ------
        BadParameter
            A value is empty, as that of a shell variable that is not set, or an option is repeated.
        """
        values, _, given = self.make_parser(ctx).parse_args(args=list(args))
        if not any(parameter.is_eager for parameter in given):  # --help
            for parameter in given:
                _check(parameter, values.get(str(parameter.name)), given.count(parameter))
        return super().parse_args(ctx, args)


def _place(parameter: Any) -> int:
    """Return where a parameter stands in the help; arguments keep the order in which they come."""
    is_option = parameter.param_type_name == "option" and parameter.name in _PANEL_OF
    return _ORDER.index(parameter.name) if is_option else -1


def _describe(parameter: Any) -> None:
    """Put a parameter below its heading, and say its default in a sentence."""
    if parameter.param_type_name != "option":
        parameter.show_default = False
        return
    parameter.rich_help_panel = _PANEL_OF.get(parameter.name)
    default = parameter.show_default
    if not isinstance(default, str):
        default = (
            ""
            if parameter.default is None or parameter.default is False
            else f"{parameter.default}"
        )
    if default:
        parameter.help = f"{parameter.help} Default: {default}."
    parameter.show_default = False


def _check(parameter: Any, value: Any, times: int) -> None:
    is_option = parameter.param_type_name == "option"
    if is_option and not parameter.multiple and not parameter.is_flag and times > 1:
        raise typer.BadParameter(f"{parameter.opts[-1]} is given {times} times; give it once")
    words = value if isinstance(value, (list, tuple)) else [value]
    if any(isinstance(word, str) and not word.strip() for word in words):
        name = parameter.opts[0] if is_option else parameter.metavar
        kind = parameter.metavar or "a value" if is_option else "a value"
        leave = ", or leave it out" if is_option and not parameter.required else ""
        raise typer.BadParameter(
            f"{name} is empty (is a shell variable not set?); give {kind}{leave}"
        )
