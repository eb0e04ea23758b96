"""What a user has typed, among what a command would take."""

import inspect
from collections.abc import Callable, Container
from typing import get_args

import typer


def given_options(
    command: Callable[..., None], given: dict[str, object], among: Container[str]
) -> list[str]:
    """Return the options, as one types them, that were given another value than their default.

    Parameters
    ----------
    command :
        Whose they are.
    given :
        Its parameters, by name.
    among :
        Names of the parameters that are looked at.
    """
    named = []
    for name, parameter in inspect.signature(command).parameters.items():
        if name not in among or given[name] == parameter.default:
            continue
        info = get_args(parameter.annotation)[1]
        declared = [word for word in info.param_decls or () if word.startswith("--")]
        is_argument = isinstance(info, typer.models.ArgumentInfo)
        named.append(name.upper() if is_argument else (declared or [f"--{name}"])[0])
    return named
