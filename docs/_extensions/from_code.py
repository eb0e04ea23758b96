"""What the reference takes from the code itself, so that the two cannot drift apart.

``{command-options} analyze --force --rate``
    The arguments and options of a command, or only some of them, as a table.
``{commands}``
    The commands with their first sentences.
``{json-keys} census``
    The keys of a JSON document as a table; of several results, the keys that all of them have.
``{csv-columns} census``
    The columns of a CSV table.
``{summaries} ftforce.show.plots``
    The public names of a module, or only some of them, with the first sentences of their docs.
``{constant}`ftforce.core.reduced_jacobian.RTOL```
    The value of a constant, a power of ten.
``{errata}``
    The errata of the paper.
Modules
    Every module of the package must stand in ``architecture.md``; else the build warns.
"""

from __future__ import annotations

import inspect
import pkgutil
import re
from enum import Enum
from importlib import import_module
from pathlib import Path as File
from typing import TYPE_CHECKING, Any, get_args

import typer
from docutils import nodes
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

import ftforce
from ftforce.analysis.paper import ERRATA
from ftforce.cli import app as program
from ftforce.cli.examples import EXAMPLES
from ftforce.report import (
    analysis,
    capability,
    census,
    comparison,
    history,
    plan,
    posture,
    reach,
    robot,
    sweep,
    timeline,
)
from ftforce.report import map as map_
from ftforce.report.fields import Field, columns
from ftforce.report.parts import SETTING_COLUMNS
from ftforce.report.provenance import ORIGIN, POOLED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sphinx.application import Sphinx

logger = logging.getLogger(__name__)
COMMANDS = {c.callback.__name__: c.callback for c in program.registered_commands}
_WORDS = {str: "TEXT", int: "NUMBER", float: "NUMBER", File: "FILE"}
_UNIT = "N or N·m"
# Fields of the JSON document and columns of the CSV table of every result.
_DECLARED: dict[str, tuple[tuple[Field, ...], tuple[Field, ...]]] = {
    "analysis": (analysis.ANALYSIS, analysis.QUANTITIES),
    "capability": (capability.CAPABILITY_FIELDS, capability.CAPABILITY_COLUMNS),
    "census": (census.CENSUS, (*census.SET_COLUMNS, *census.QUESTION_COLUMNS)),
    "comparison": (comparison.COMPARISON, comparison.comparison_columns(_UNIT)),
    "history": (history.HISTORY, ()),
    "map": (map_.MAP, map_.map_columns()),
    "plan": (plan.PLAN, ()),
    "posture": (posture.POSTURE, posture.SET_COLUMNS),
    "reach": (reach.REACH, reach.reach_columns()),
    "replication": (robot.REPLICATION, robot.CHECK_COLUMNS),
    "provenance": ((Field("provenance", "where the document comes from", parts=ORIGIN),), POOLED),
    "robot": (robot.ROBOT_FIELDS, robot.ROBOT_COLUMNS),
    "sweep": (sweep.SWEEP, (*sweep.sweep_columns(_UNIT, _UNIT), *SETTING_COLUMNS)),
    "timeline": (timeline.TIMELINE, timeline.timeline_columns(_UNIT, _UNIT)),
}
_SHARED = ("analysis", "census", "capability")  # the keys of all three are listed once


class Commands(SphinxDirective):
    """A table of all commands."""

    def run(self) -> list[nodes.Node]:
        rows = []
        for name, command in COMMANDS.items():
            first = inspect.getdoc(command).split("\n\n")[0].replace("\n", " ")
            first = re.sub(r"(--[a-z-]+)", r"`\1`", first)
            rows.append((f"[`ftforce {name}`](#ftforce-{name})", first))
        return self.parse_text_to_nodes(_table(("command", "what it does"), rows))


class CommandOptions(SphinxDirective):
    """A table of one command's arguments and options."""

    required_arguments = 1
    optional_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        command, *wanted = " ".join(self.arguments).split()
        rows = []
        for parameter in inspect.signature(COMMANDS[command]).parameters.values():
            if parameter.annotation is typer.Context:
                continue
            kind, info = get_args(parameter.annotation)
            help_text = re.sub(r"(?<!`)(--[a-z-]+)", r"`\1`", info.help)
            names = _names(parameter.name, kind, info)
            if not wanted or any(f"`{one}`" in names or f"`{one} " in names for one in wanted):
                rows.append((names, _default(parameter, info), help_text))
        text = _table(("option", "default", "meaning"), rows)
        if not wanted:
            examples = "".join(f"$ ftforce {words}\n" for words in EXAMPLES[command])
            text += f"\n\n```console\n{examples}```\n"
        return self.parse_text_to_nodes(text)


def _names(name: str, kind: Any, info: Any) -> str:
    if isinstance(info, typer.models.ArgumentInfo):
        return f"`{info.metavar or name.upper()}`"
    declared = [word for word in (info.default, *(info.param_decls or ())) if isinstance(word, str)]
    names = " ".join(f"`{word}`" for word in declared or ("--" + name.replace("_", "-"),))
    kind = next((part for part in get_args(kind) if part is not type(None)), kind)
    value = info.metavar or _WORDS.get(kind, "")
    if not value and isinstance(kind, type) and issubclass(kind, Enum):
        value = "|".join(member.value for member in kind)
    return f"{names} `{value}`" if value else names


def _default(parameter: inspect.Parameter, info: Any) -> str:
    if parameter.default is parameter.empty:
        return "required"
    if parameter.default not in (None, False):
        return f"`{parameter.default}`"
    return info.show_default if isinstance(info.show_default, str) else ""


class JsonKeys(SphinxDirective):
    """A table of the keys of a document."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        kinds = self.arguments[0].split()
        shared = _in_all(_SHARED)
        rows = _in_all(kinds)
        if len(kinds) == 1 and kinds[0] in _SHARED:
            rows = [row for row in rows if row not in shared]
        return self.parse_text_to_nodes(_table(("key", "shape", "unit", "meaning"), rows))


class Summaries(SphinxDirective):
    """A table of public names and what they are for."""

    required_arguments = 1
    optional_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        path, *names = " ".join(self.arguments).split()
        module, rows = import_module(path), []
        for name in names or module.__all__:
            first = inspect.getdoc(getattr(module, name)).split("\n\n")[0].replace("\n", " ")
            rows.append((f"{{py:obj}}`~{path}.{name}`", first))
        return self.parse_text_to_nodes(_table(("name", "summary"), rows))


class Errata(SphinxDirective):
    """A table of the errata of the paper."""

    def run(self) -> list[nodes.Node]:
        return self.parse_text_to_nodes(_table(("where", "printed", "correct"), ERRATA))


class CsvColumns(SphinxDirective):
    """A table of the columns of a CSV table."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        heading, rows = "quantity" if self.arguments[0] == "analysis" else "column", []
        for field in _DECLARED[self.arguments[0]][1]:
            names = columns((field,), None, ("…",), {"…": _UNIT}, (_UNIT,))
            rows.append((", ".join(f"`{name}`" for name in names), field.meaning))
        return self.parse_text_to_nodes(_table((heading, "meaning"), rows))


def _in_all(kinds: Iterable[str]) -> list[tuple[str, ...]]:
    first, *others = (list(_keys(_DECLARED[kind][0])) for kind in kinds)
    return [row for row in first if all(row in other for other in others)]


def _keys(fields: Iterable[Field], path: str = "") -> Iterator[tuple[str, ...]]:
    """Yield path, shape, unit and meaning of every key; ``[]`` is an element of a list."""
    for field in fields:
        yield f"`{path}{field.key}`", field.shape, field.unit, field.meaning
        if not field.shape or field.shape.startswith("list"):
            yield from _keys(field.parts, f"{path}{field.key}{'[]' if field.shape else ''}.")


def _table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = (header, ["---"] * len(header), *rows)
    escaped = ([cell.replace("|", r"\|") for cell in line] for line in lines)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in escaped)


def check_modules(app: Sphinx) -> None:
    """Warn about modules that are missing in ``architecture.md``."""
    text = File(app.srcdir, "architecture.md").read_text("utf-8")
    for module in pkgutil.iter_modules(ftforce.__path__):
        if f"`{module.name}`" not in text and not module.name.startswith("_"):
            message = "the module %s is not described"
            logger.warning(message, module.name, location="architecture")


def constant(_name: str, _raw: str, path: str, *_: Any) -> tuple[list[nodes.Node], list[str]]:
    """Return the power of ten that a constant is."""
    module, name = path.rsplit(".", 1)
    exponent = f"{getattr(import_module(module), name):.0e}".removeprefix("1e")
    shown = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return [nodes.Text(f"10{shown}")], []


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_directive("commands", Commands)
    app.add_directive("command-options", CommandOptions)
    app.add_directive("json-keys", JsonKeys)
    app.add_directive("csv-columns", CsvColumns)
    app.add_directive("summaries", Summaries)
    app.add_directive("errata", Errata)
    app.add_role("constant", constant)
    app.connect("builder-inited", check_modules)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
