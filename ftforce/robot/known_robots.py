"""Registry of known robots: URDF, SRDF, tip and postures by name (robots/robots.toml)."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ftforce.errors import FtforceError, UnknownNameError, closest

if TYPE_CHECKING:
    from collections.abc import Mapping

_EXAMPLE_ROBOTS = Path("cmeel.prefix/share/example-robot-data/robots")
_SHORT_NAME = 3  # letters; in a name as short as "ur", another letter makes another maker
_SAME_WORD = 0.75  # similarity of a word with two letters swapped, as xamr and xarm


@dataclass(frozen=True, slots=True)
class Correction:
    """An effort limit (N·m or N; 0 if unknown) that replaces that of the URDF, and the reason."""

    joint: str
    effort: float
    reason: str


@dataclass(frozen=True, slots=True)
class KnownRobot:
    """One entry of robots.toml.

    Attributes
    ----------
    name, about :
        Name of the robot, and a one-line description.
    urdf, srdf :
        Paths of the files; ``srdf`` may be ``None``.
    tip, base :
        Tip and base link; an empty base is the root of the URDF.
    posture :
        Name of the default posture.
    postures :
        Additional named postures: joint positions along the chain, rad or m.
    corrections :
        Effort limits that replace those of the URDF.
    notes :
        Remarks on the URDF for the user.
    same_motors :
        Whether all joints have the same motor, so that equal effort limits are no placeholders.
    """

    name: str
    about: str
    urdf: Path
    srdf: Path | None
    tip: str
    base: str
    posture: str
    postures: Mapping[str, tuple[float, ...]]
    corrections: tuple[Correction, ...]
    notes: tuple[str, ...]
    same_motors: bool = False


def robots_folder() -> Path:
    """Return the folder of robots.toml, in an installed package or a checkout."""
    package = Path(__file__).parents[1]
    installed = package / "robots"
    return installed if installed.is_dir() else package.parent / "robots"


@lru_cache(maxsize=1)
def known_robots() -> Mapping[str, KnownRobot]:
    """Return all known robots by name, in the order of robots.toml."""
    import tomllib  # imported lazily: not needed for a URDF path

    with (robots_folder() / "robots.toml").open("rb") as file:
        entries = tomllib.load(file)
    return MappingProxyType({name: _known(name, entry) for name, entry in entries.items()})


def find_robot(name: str) -> KnownRobot:
    """Return the known robot with the given name.

    Raises
    ------
    UnknownNameError
        There is no known robot with this name.
    """
    try:
        return known_robots()[name]
    except KeyError:
        similar = [known for known in known_robots() if _may_be_misspelt(name, known)]
        raise UnknownNameError("robot or file", name, known_robots(), similar=similar) from None


def _may_be_misspelt(name: str, known: str) -> bool:
    """Return whether a name can be a known one with a typing mistake, and not another model.

    Makers tell models apart by numbers and suffixes (ur5, ur5e; xarm6, xarm7; tiago, tiago_pro),
    and short names by any letter (fr3, ur3). So what follows the first digit must be equal,
    further words must not be added, and each word must be close to its counterpart.
    """
    (letters, model), (own_letters, own_model) = map(_letters_and_model, (name, known))
    if model != own_model or len(letters) > len(own_letters):
        return False
    if len(own_letters) == 1 and len(own_letters[0]) <= _SHORT_NAME:
        return bool(letters) and set(letters[0]) == set(own_letters[0])
    return all(
        closest(word, [own], _SAME_WORD) for word, own in zip(letters, own_letters, strict=False)
    )


def _letters_and_model(name: str) -> tuple[list[str], str]:
    """Return the words of a name before its first digit, and what follows without separators."""
    start = re.search(r"\d|$", name)
    end = len(name) if start is None else start.start()
    folded = name.casefold()
    return re.findall(r"[^\W_]+", folded[:end]), re.sub(r"[\W_]+", "", folded[end:])


def is_name(source: str | os.PathLike[str]) -> bool:
    """Return whether a source of a robot is a name; a path has a separator or an extension.

    What is no known name, but exists as a file, is a path, too.
    """
    if not isinstance(source, str) or os.sep in source or Path(source).suffix:
        return False
    return source in known_robots() or not os.path.lexists(source)


def files_of(source: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the files that are read for a robot: its URDF or DH table, and the SRDF beside it.

    Parameters
    ----------
    source :
        Path or known name; without files if it is an unknown name.
    """
    if is_name(source):
        known = known_robots().get(str(source))
        found = (known.urdf, known.srdf) if known else ()
        return tuple(path for path in found if path is not None)
    path = Path(source)
    return (path, srdf_beside(path)) if path.name else (path,)  # "." and "/" have none


def srdf_beside(path: Path) -> Path:
    """Return where the SRDF of a robot description is looked for: ``arm.srdf`` for ``arm.urdf``.

    Parameters
    ----------
    path :
        The URDF, xacro file (``arm.urdf.xacro``) or DH table.
    """
    name = path.name.removesuffix(".xacro")
    return path.with_name(name or path.name).with_suffix(".srdf")


def _known(name: str, entry: dict[str, Any]) -> KnownRobot:
    folder = robots_folder() if entry.get("bundled", False) else _example_robots()
    srdf = entry.get("srdf")
    return KnownRobot(
        name=name,
        about=entry["about"],
        urdf=folder / entry["urdf"],
        srdf=folder / srdf if srdf else None,
        tip=entry["tip"],
        base=entry.get("base", ""),
        posture=entry["posture"],
        postures=MappingProxyType({k: tuple(q) for k, q in entry.get("postures", {}).items()}),
        corrections=tuple(Correction(**c) for c in entry.get("corrections", ())),
        notes=tuple(entry.get("notes", ())),
        same_motors=entry.get("same_motors", False),
    )


@lru_cache(maxsize=1)
def _example_robots() -> Path:
    # example-robot-data 6 contains only data and cannot be imported, so its files are located.
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        folder = Path(str(distribution("example-robot-data").locate_file(_EXAMPLE_ROBOTS)))
    except PackageNotFoundError:
        folder = _EXAMPLE_ROBOTS
    if not folder.is_dir():
        raise FtforceError(
            "the robot models are missing; install them with `pip install example-robot-data`"
        )
    return folder
