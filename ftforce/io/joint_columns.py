"""Names of joint columns as recorders and plotting tools write them, reduced to the joints' own.

Understood are ``/joint_states/elbow/position`` and the like (PlotJuggler, Foxglove, rqt),
``q_elbow`` and ``elbow_position``, positions by number such as ``actual_q_0``, ``q1`` or
``position[3]``, and columns ``name[3]`` that hold the names of the joints.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from ftforce.errors import InputError
from ftforce.io.csv_table import split_unit

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_POSITIONS = frozenset({"q", "j", "joint", "pos", "position", "positions", "angle", "theta"})
_VELOCITIES = frozenset({"qd", "dq", "vel", "velocity", "velocities", "speed"})
_WISHES = frozenset(
    {"target", "desired", "commanded", "command", "cmd", "goal", "ref", "reference", "error"}
)
_NUMBERED = re.compile(r"(?P<stem>.*)\[(?P<number>\d+)\](?P<unit> \[[^\]]*\])?")
_NAMES = frozenset({"name", "names", "joint_name", "joint_names"})


def joint_columns(
    header: tuple[str, ...],
    joints: Sequence[str],
    names_in: Callable[[Sequence[int]], list[str]] | None = None,
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
        Returns the texts in some columns, the same in all rows; ``None`` if rows cannot be read.

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
        words = set(re.findall("[a-z]+", others.lower()))
        if joint is None or _WISHES & words:
            continue
        kind = "" if _POSITIONS & words else "v_" if _VELOCITIES & words else None
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
    header: tuple[str, ...],
    joints: Sequence[str],
    names_in: Callable[[Sequence[int]], list[str]] | None,
) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the header with the names that columns ``name[0]`` … hold for ``position[0]`` …."""
    columns: dict[str, dict[int, int]] = {}
    for i, cell in enumerate(header):
        if found := _NUMBERED.fullmatch(cell):
            columns.setdefault(found["stem"], {})[int(found["number"])] = i
    named = [group for stem, group in columns.items() if _last_word(stem) in _NAMES]
    if len(named) != 1 or names_in is None:
        return None
    numbers = sorted(named[0])
    texts = dict(zip(numbers, names_in([named[0][k] for k in numbers]), strict=True))
    cells = list(header)
    for stem, group in columns.items():
        kind = {True: "", False: "v_"}.get(_last_word(stem) in _POSITIONS)
        if not _WISHES.isdisjoint(re.findall("[a-z]+", stem.lower())):
            continue
        if _last_word(stem) in _POSITIONS | _VELOCITIES:
            for number, i in group.items():
                if texts.get(number) in joints:
                    unit = _NUMBERED.fullmatch(header[i])["unit"] or ""  # type: ignore[index]
                    cells[i] = f"{kind}{texts[number]}{unit}"
    if tuple(cells) == header:
        return None
    first = header[named[0][numbers[0]]]
    return tuple(cells), (f"the names of the joints are those in columns such as {first}",)


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
    n = len(joints)
    groups: dict[str, dict[int, int]] = {}
    units = {}
    for i, cell in enumerate(header):
        if found := _NUMBERED.fullmatch(cell):
            stem, number, units[i] = found["stem"], found["number"], found["unit"] or ""
        else:
            name, unit = split_unit(cell)
            stem = name.rstrip("0123456789")
            number, units[i] = name[len(stem) :], f" [{unit}]" if unit else ""
        words = re.findall("[a-z]+", stem.lower())
        if number and words and words[-1] in _POSITIONS and _WISHES.isdisjoint(words):
            groups.setdefault(stem, {})[int(number)] = i
    fitting = [
        [group[number] for number in sorted(group)]
        for group in groups.values()
        if sorted(group) in (list(range(n)), list(range(1, n + 1)))
    ]
    if len(fitting) != 1:
        return header, ()
    cells = list(header)
    for joint, i in zip(joints, fitting[0], strict=True):
        cells[i] = f"{joint}{units[i]}"
    first, last = header[fitting[0][0]], header[fitting[0][-1]]
    taken = f"columns {first!r} to {last!r} are taken for the joints 1 to {n}"
    return tuple(cells), (f"{taken}, as no column has the name of a joint",)
