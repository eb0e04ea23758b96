"""Names of joint columns as recorders and plotting tools write them, reduced to the joints' own.

Understood are ``/joint_states/elbow/position`` and the like (PlotJuggler, Foxglove, rqt),
``q_elbow`` and ``elbow_position``, positions by number such as ``actual_q_0``, ``q1`` or
``position[3]``, and columns ``name[3]`` that hold the names of the joints. Units and the paths of
Foxglove are in their usual form here, see ``ftforce.io.csv_table``.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, TypeAlias

from ftforce.errors import InputError
from ftforce.io.csv_table import split_unit

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Sequence

NamesIn: TypeAlias = "Callable[[Sequence[int], Container[str]], list[str]]"

_POSITIONS = frozenset({"q", "j", "joint", "pos", "position", "positions", "angle", "theta"})
_VELOCITIES = frozenset({"qd", "dq", "vel", "velocity", "velocities", "speed"})
_WISHES = frozenset(
    {"target", "desired", "commanded", "command", "cmd", "goal", "ref", "reference", "error"}
    | {"output", "d"}
)
_OTHERS = frozenset(
    {"tcp", "ee", "eef", "tool", "cartesian", "pose", "motor", "wheel", "base"}
    | {
        "tau",
        "torque",
        "torques",
        "effort",
        "efforts",
        "velocity",
        "velocities",
        "current",
        "temperature",
    }
)
_NEUTRAL = frozenset({"joint", "joints", "j", "actual", "measured", "state", "states", "feedback"})
_NUMBERED = re.compile(
    r"(?P<stem>.*?)(?:\[(?P<bracket>[0-9]{1,6})\]|(?P<plain>[0-9]{1,6}))(?P<unit> \[[^\]]*\])?"
)
_NAMES = frozenset({"name", "names", "joint_name", "joint_names"})


def joint_columns(
    header: tuple[str, ...],
    joints: Sequence[str],
    names_in: NamesIn | None = None,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the header with the joints' own names where others stand for them, and notes.

    Nothing is changed if a column has the name of a joint.

    Parameters
    ----------
    header :
        Names of all columns.
    joints :
        Names of the joints along the chain.
    names_in :
        Returns the texts in some columns, the same in all rows, if some are among given ones;
        ``None`` if rows cannot be read.

    Raises
    ------
    InputError
        Several columns stand for one joint, or columns of names differ from row to row.
    """
    if any(cell in joints or split_unit(cell)[0] in joints for cell in header):
        return header, ()
    for understood in (_by_path(header, joints), _by_names(header, joints, names_in)):
        if understood is not None:
            return understood
    return _by_number(header, joints)


def _by_path(
    header: tuple[str, ...], joints: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the header with names from paths with a joint and ``position`` or ``velocity``."""
    found = list(header)
    columns: dict[str, int] = {}
    for i, cell in enumerate(header):
        name, unit = split_unit(cell)
        joint, others = _joint_in(name, joints)
        kind = None if joint is None else _kind_of(others)
        if kind is None:
            continue
        own = f"{kind}{joint}"
        if own in columns:
            raise InputError(
                f"columns {header[columns[own]]!r} and {cell!r} both hold joint {joint!r}; leave "
                "one out"
            )
        columns[own] = i
        found[i] = f"{own} [{unit}]" if unit else own
    if not columns:
        return None
    first = header[min(columns.values())]
    return tuple(found), (f"columns such as {first} hold the joints",)


def _kind_of(path: str) -> str | None:
    """Return the prefix of a joint's column for a path without the joint: ``v_`` for velocities.

    The last part of the path decides, ``None`` if it is neither a position nor a velocity.
    """
    if _WISHES & set(re.findall("[a-z]+", path.lower())):
        return None
    last = next((part for part in reversed(path.split("/")) if part), "")
    words = set(re.findall("[a-z]+|[^a-z_]+", last.lower())) - _NEUTRAL
    if not words:
        return None
    return "" if words <= _POSITIONS else "v_" if words <= _VELOCITIES else None


def _joint_in(name: str, joints: Sequence[str]) -> tuple[str | None, str]:
    """Return the joint in a path, and the rest of the path; a joint may have separators itself."""
    for joint in sorted(joints, key=len, reverse=True):
        before, middle, after = f"/{name}/".replace(".", "/").partition(
            f"/{joint.replace('.', '/')}/"
        )
        if middle:
            return joint, f"{before}/{after}"
        for word in _POSITIONS | _VELOCITIES:
            if name in {f"{word}_{joint}", f"{joint}_{word}"}:  # q_elbow, elbow_velocity
                return joint, word
    return None, name


def _by_names(
    header: tuple[str, ...], joints: Sequence[str], names_in: NamesIn | None
) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the header with the names that columns ``name[0]`` … hold for ``position[0]`` …."""
    columns = _numbered(header)
    named = [group for stem, group in columns.items() if _last_word(stem) in _NAMES]
    if len(named) != 1:
        return None
    numbers = sorted(named[0])
    first = header[named[0][numbers[0]]]
    if names_in is None:
        raise InputError(
            f"columns such as {first!r} hold the names of the joints, which is not read here; give "
            "the columns the names of the joints"
        )
    texts = names_in([named[0][k] for k in numbers], joints)
    cells = _with_names(header, columns, dict(zip(numbers, texts, strict=bool(texts))), joints)
    if cells == header:
        return None
    return cells, (f"the names of the joints are those in columns such as {first}",)


def _with_names(
    header: tuple[str, ...],
    columns: dict[str, dict[int, int]],
    texts: dict[int, str],
    joints: Sequence[str],
) -> tuple[str, ...]:
    """Return the header with the texts as names of positions and velocities of these numbers."""
    cells = list(header)
    for stem, group in columns.items():
        kind = _kind_of(stem.replace(".", "/"))
        for number, i in group.items():
            name = texts.get(number)
            if kind is not None and name in joints:
                cells[i] = f"{kind}{name}{_unit_of(header[i])}"
    return tuple(cells)


def _numbered(header: tuple[str, ...]) -> dict[str, dict[int, int]]:
    """Return the columns with a number at the end of their name, by stem and number."""
    columns: dict[str, dict[int, int]] = {}
    for i, cell in enumerate(header):
        if found := _NUMBERED.fullmatch(cell):
            number = int(found["bracket"] or found["plain"])
            columns.setdefault(found["stem"], {})[number] = i
    return columns


def _unit_of(cell: str) -> str:
    """Return the unit of a numbered column as it stands in the header, with its brackets."""
    found = _NUMBERED.fullmatch(cell)
    return (found and found["unit"]) or ""


def _last_word(stem: str) -> str:
    words = re.findall("[a-z_]+", stem.lower())
    return words[-1].strip("_") if words else ""


def _by_number(
    header: tuple[str, ...], joints: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the header with names of joints in place of numbers.

    Measured positions that are numbered from 0 or 1 are those of the joints in their order, if
    there is one such group of columns and it has all numbers.
    """
    n, groups = len(joints), {}
    for stem, group in _numbered(header).items():
        words = re.findall("[a-z]+", stem.lower())
        if words and words[-1] in _POSITIONS and (_WISHES | _OTHERS).isdisjoint(words):
            groups[stem] = group
    fitting = [
        [group[number] for number in sorted(group)]
        for group in groups.values()
        if sorted(group) in (list(range(n)), list(range(1, n + 1)))
    ]
    if len(fitting) != 1:
        return header, ()
    cells = list(header)
    for joint, i in zip(joints, fitting[0], strict=True):
        cells[i] = f"{joint}{_unit_of(header[i])}"
    first, last = header[fitting[0][0]], header[fitting[0][-1]]
    taken = f"columns {first!r} to {last!r} are taken for the joints 1 to {n}"
    return tuple(cells), (f"{taken}, as no column has the name of a joint",)
