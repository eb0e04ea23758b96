"""Where a result comes from: version, command, the robot's file, and what rows are pooled by."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ftforce.__version__ import __version__
from ftforce.analysis.paper import Replication
from ftforce.errors import printable
from ftforce.io.text import file_digest
from ftforce.report.fields import Field, document
from ftforce.robot.robot import Robot

if TYPE_CHECKING:
    from ftforce.analysis.question import Question


class Provenance(NamedTuple):
    """Where a result comes from.

    Attributes
    ----------
    version :
        Version of ftforce that wrote the file.
    command :
        The command line as it was typed; ``None`` in Python.
    robot :
        Name of the robot; ``None`` if there are several.
    robot_sha256 :
        SHA-256 of the robot's file as it is when the result is written; ``None`` without one.
    posture :
        The posture, or the postures, in words; ``None`` if there are none.
    limits :
        Source of the torque limits in force, or ``none``.
    """

    version: str
    command: str | None
    robot: str | None
    robot_sha256: str | None
    posture: str | None
    limits: str

    @classmethod
    def of(cls, result: Any) -> Provenance:
        """Return the provenance of a result, of a robot, or of a list of robots.

        Parameters
        ----------
        result :
            The result.
        """
        robot, posture, limits = _subject(result)
        return cls(__version__, _command(), *_file_of(robot), posture, limits)


# fmt: off
ROBOT = Field("robot", "name of the robot")
ROBOT_SHA256 = Field("robot_sha256", "SHA-256 of the robot's file; `null` without a file, for "
    "several robots and for results of older versions")
ORIGIN = (
    Field("version", "version of ftforce that wrote the file"),
    Field("command", "the command line; `null` in Python"),
    ROBOT_SHA256,
)
"""Keys of ``provenance`` in JSON."""
POOLED = (
    ROBOT,
    Field("posture", "the positions along the chain, or a description of many postures"),
    Field("limits", "source of the torque limits in force, or `none`"),
    *ORIGIN,
)
"""Columns by which rows of several files can be pooled."""
# fmt: on


def origin_of(result: object) -> list[tuple[str, str]]:
    """Return where a result comes from, as names and texts; what is unknown is left out.

    Parameters
    ----------
    result :
        As of `Provenance.of`.
    """
    said = document(POOLED, Provenance.of(result))
    return [(name.replace("_", " "), str(text)) for name, text in said.items() if text is not None]


def origin_line(result: object) -> str:
    """Return where a result comes from, on one line for the metadata of pictures.

    Parameters
    ----------
    result :
        As of `Provenance.of`.
    """
    return "; ".join(f"{name}: {text}" for name, text in origin_of(result))


def _command() -> str | None:
    """Return the command line; ``None`` if this is another program, which uses ftforce."""
    program = Path(sys.argv[0] if sys.argv else "")
    is_module = program.name == "__main__.py" and program.parent.name == "ftforce"
    if not (is_module or program.stem == "ftforce"):
        return None
    return printable(shlex.join(["ftforce", *sys.argv[1:]]))


def _subject(result: Any) -> tuple[Any, str | None, str]:
    """Return the robot of a result or a setting that names it, its postures, and its limits."""
    if isinstance(result, Robot):
        return result, None, "none"
    if hasattr(result, "arms"):  # a comparison, whose rows name the robots
        setting = result.question
        return (
            None,
            f"{setting.count:,} postures within the limits of each arm",
            _named(setting.limits),
        )
    result = getattr(result, "sweep", result)  # of a map
    if (setting := getattr(result, "setting", None)) is not None:
        return (
            setting,
            getattr(setting, "postures", None) or setting.course,
            _named(setting.limits),
        )
    if isinstance(result, Replication):
        result = result.healthy
    result = getattr(result, "analysis", result)  # of a capability
    question: Question | None = getattr(result, "question", None)
    if question is None:  # a reach, or a list
        return getattr(result, "robot", None), None, "none"
    limits = _named(question.limits.source if question.limits else None)
    if question.posture is None or hasattr(result, "course"):
        return question.robot, result.course, limits
    return question.robot, " ".join(map(repr, question.q.tolist())), limits


def _named(limits: str | None) -> str:
    return printable(limits) if limits else "none"


def _file_of(robot: Any) -> tuple[str | None, str | None]:
    """Return the name of a robot, and the SHA-256 of its file."""
    if isinstance(robot, Robot):
        return robot.name, file_digest(robot.path)
    if robot is None:
        return None, None
    return robot.robot, robot.robot_sha256
