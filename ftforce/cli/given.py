"""What a user has typed, among what a command would take."""

from collections.abc import Container

import typer


def given_options(context: typer.Context, among: Container[str]) -> list[str]:
    """Return the options, as one types them, that stand on the command line.

    Parameters
    ----------
    context :
        Of the command that runs.
    among :
        Names of the parameters that are looked at.
    """
    named = []
    for parameter in context.command.params:
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        if name in among and source is not None and source.name == "COMMANDLINE":
            is_argument = parameter.param_type_name == "argument"
            named.append(name.upper() if is_argument else parameter.opts[0])
    return named
