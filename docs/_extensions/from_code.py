"""What the reference takes from the code itself, so that the two cannot drift apart.

``{command-options} analyze``
    The arguments and options of a command as a table.
``{commands}``
    The commands with their first sentences.
JSON keys
    Every key of every kind of document must stand in ``reference/json.md``, and every key that
    stands there must occur; else the build warns.
Modules
    Every module of the package must stand in ``architecture.md``; else the build warns.
"""

from __future__ import annotations

import inspect
import pkgutil
import re
from enum import Enum
from pathlib import Path as File
from typing import TYPE_CHECKING, Any, get_args

import typer
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

import ftforce
from ftforce.analysis.paper import replicate
from ftforce.batch.workspace_map import workspace_map
from ftforce.cli import app as program
from ftforce.trajectory.path import Path

if TYPE_CHECKING:
    from collections.abc import Iterator

    from docutils import nodes
    from sphinx.application import Sphinx

logger = logging.getLogger(__name__)
COMMANDS = {c.callback.__name__: c.callback for c in program.registered_commands}
_WORDS = {str: "TEXT", int: "NUMBER", float: "NUMBER", File: "FILE"}
_JSON_PAGE = "reference/json"
# Dictionaries by the names of joints, links or postures, and what has the keys of something else.
_CLOSED = {
    "torque.before", "torque.after", "torque.brake_load", "torque.self_motion",
    "torque.gravity.before", "torque.gravity.after", "torque.motion.before",
    "torque.motion.after", "torque.total.before", "torque.total.after",
    "velocity.before", "velocity.after", "velocity.impact.after", "limits.effort", "limits.brake",
    "modes", "weak_factors", "standing.unbalanced", "standing.overloaded", "residuals",
    "sets[].modes", "sets[].weak_factors", "joints[].alone",
    "unit_forces[].force", "unit_forces[].torque",
    "capability.directions[].after", "capability.directions[].before.held",
    "capability.weakest.after", "capability.weakest.before.held", "capability.payload.after",
    "polytope.after", "polytope.before.held",
}  # fmt: skip
_CLOSED_OF = {
    "Robot": {"limits", "followers", "postures", "tip_candidates", "held"},
    "History": {
        "robot", "conventions", "effort", "runs.remapped", "runs.unremapped",
        *(f"runs.healthy.{name}" for name in ("torque", "brake", "unbalanced", "used")),
    },
    "Timeline": {
        "robot", "conventions", "limits", "capability_limits", "sets[].modes",
        "sets[].weak_factors", "columns[].modes", "columns[].weak_factors",
    },
    "WorkspaceMap": {"robot", "conventions", "postures"},
    "Comparison": {
        "question", "units", "arms[].postures", "arms[].critical_joint",
        *(f"arms[].{name}" for name in ("tolerated", "every", "worst_rho", "healthy_capability")),
        *(f"arms[].sizes[].{x}" for x in ("tolerated", "margin", "rho", "jump", "capability")),
    },
    "Sweep": {
        "robot", "limits", "every_set_tolerated", "conventions.units",
        *(f"sets[].{name}" for name in (
            "tolerated", "borderline", "not_tolerated", "margin", "relative_manipulability",
            "jump", "capability",
        )),
        *(f"joints[].{name}" for name in (
            "not_tolerated", "alone", "margin", "relative_manipulability", "capability",
        )),
    },
}  # fmt: skip
_SHARED = "Analysis, census and capability"


class Commands(SphinxDirective):
    """A table of all commands."""

    def run(self) -> list[nodes.Node]:
        lines = ["| command | what it does |", "|---|---|"]
        for name, command in COMMANDS.items():
            first = inspect.getdoc(command).split("\n\n")[0].replace("\n", " ")
            first = re.sub(r"(--[a-z-]+)", r"`\1`", first)
            lines.append(f"| [`ftforce {name}`](#ftforce-{name}) | {first} |")
        return self.parse_text_to_nodes("\n".join(lines))


class CommandOptions(SphinxDirective):
    """A table of one command's arguments and options."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        lines = ["| option | default | meaning |", "|---|---|---|"]
        for parameter in inspect.signature(COMMANDS[self.arguments[0]]).parameters.values():
            if parameter.annotation is typer.Context:
                continue
            kind, info = get_args(parameter.annotation)
            help_text = re.sub(r"(?<!`)(--[a-z-]+)", r"`\1`", info.help)
            cells = (_names(parameter.name, kind, info), _default(parameter, info), help_text)
            lines.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
        return self.parse_text_to_nodes("\n".join(lines))


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


def check_json_page(app: Sphinx) -> None:
    """Warn about keys that are missing in ``reference/json.md`` or stand there for nothing."""
    text = File(app.srcdir, "reference", "json.md").read_text("utf-8")
    sections = {part.partition("\n")[0]: _keys(part) for part in text.split("\n## ")}
    for kind, document in _documents():
        shared = sections[_SHARED] if kind.lower() in _SHARED.lower() else set()
        closed = _CLOSED_OF.get(kind, _CLOSED)
        found, written = set(_paths(document, closed)), sections[kind] | shared
        for path in sorted(found - written):
            logger.warning("%s: the key %s is not documented", kind, path, location=_JSON_PAGE)
        for path in sorted(written - found):
            logger.warning("%s: no document holds the key %s", kind, path, location=_JSON_PAGE)


def check_modules(app: Sphinx) -> None:
    """Warn about modules that are missing in ``architecture.md``."""
    text = File(app.srcdir, "architecture.md").read_text("utf-8")
    for module in pkgutil.iter_modules(ftforce.__path__):
        if f"`{module.name}`" not in text and not module.name.startswith("_"):
            message = "the module %s is not described"
            logger.warning(message, module.name, location="architecture")


def _keys(section: str) -> set[str]:
    first_cells = re.findall(r"^\| (`[^|]+`) \|", section, re.MULTILINE)
    return {key for cell in first_cells for key in re.findall(r"`(.+?)`", cell)}


def _documents() -> Iterator[tuple[str, dict[str, Any]]]:
    arm = ftforce.load_robot("dh5")
    case = {"limits": "urdf", "payload": 1.0}
    given = {"force": [80, 50, 10], "velocity": [0.1] * 5}
    with_force = ftforce.to_dict(ftforce.analyze(arm, locked=[3], **given, **case))
    same_as_below = {"capability": None}
    without = ftforce.to_dict(ftforce.analyze(arm, locked=[3]))
    yield "Analysis", without | with_force | same_as_below
    yield "Census", ftforce.to_dict(ftforce.census(arm, rank_by="capability", **case))
    yield "Capability", ftforce.to_dict(ftforce.capability(arm, locked=[3], **case))
    line = Path.through([(0.9, 0.3, 0.2), (0.8, 0.4, 0.25)], speed=0.5)
    forced = {"force": [80, 50, 10], "rate": 10}
    yield "History", ftforce.to_dict(ftforce.simulate(arm, line, faults="3@0.2", **forced))
    yield "Timeline", ftforce.to_dict(ftforce.timeline(arm, line, **forced))
    swept = {"n": 1000, "force": [80, 50, 10], "limits": "urdf"}
    sweep = ftforce.sweep(arm, **swept)
    yield "Sweep", ftforce.to_dict(sweep)
    yield "WorkspaceMap", ftforce.to_dict(workspace_map(sweep))
    yield "Comparison", ftforce.to_dict(ftforce.compare([arm, "panda"], n=1000, force=[80, 50, 10]))
    yield "Robot", ftforce.to_dict(ftforce.load_robot("panda"))
    yield "Replication", ftforce.to_dict(replicate())


def _paths(value: Any, closed: set[str], path: str = "") -> Iterator[str]:
    """Yield the path of every key; ``[]`` is an element of a list."""
    if isinstance(value, list):
        value, path = next(iter(value), None), f"{path}[]"
    if isinstance(value, dict) and path not in closed:
        for key, inner in value.items():
            here = f"{path}.{key}".removeprefix(".")
            yield here
            yield from _paths(inner, closed, here)


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_directive("commands", Commands)
    app.add_directive("command-options", CommandOptions)
    app.connect("builder-inited", check_json_page)
    app.connect("builder-inited", check_modules)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
