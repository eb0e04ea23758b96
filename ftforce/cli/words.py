"""Words of a command line that must not be taken for something else: empty ones, repeated ones."""

from typing import Any

import typer
from typer.core import TyperCommand


class Command(TyperCommand):
    """A command that rejects empty values, and options that are given twice but hold one value."""

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
