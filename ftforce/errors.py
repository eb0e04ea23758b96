"""Every error that ftforce raises on purpose.

::

    FtforceError
    ├── InputError (ValueError)      a value given by the caller is malformed
    │   ├── DimensionError           a vector or matrix of the wrong shape
    │   └── UnknownNameError         a joint, tip, posture, robot … that does not exist
    ├── SolverError                  a numerical solver gave up; please report it
    └── FileError                    something is wrong with a file; carries its path
        ├── URDFError
        ├── SRDFError
        ├── DHTableError
        ├── LimitsError              a file of torque limits
        ├── TrajectoryError          a file of a trajectory, of a history, or of postures
        ├── SweepError               a stored sweep
        └── OutputError              a result could not be written

A fault that cannot be tolerated is an answer, not an error: it is reported in the result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable
    from os import PathLike


class FtforceError(Exception):
    """Base of everything that ftforce raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the message and the data, not what ``__init__`` made them of: for processes."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(
    kind: type[FtforceError], args: tuple[Any, ...], data: dict[str, Any]
) -> FtforceError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(data)
    return error


class InputError(FtforceError, ValueError):
    """A value given by the caller is malformed; the message says what would have been valid."""


class DimensionError(InputError):
    """A vector or matrix has the wrong shape.

    Attributes
    ----------
    name :
        What the value is, e.g. ``"force"``.
    expected, got :
        Shapes.
    """

    def __init__(
        self, name: str, expected: tuple[int, ...], got: tuple[int, ...], hint: str = ""
    ) -> None:
        self.name, self.expected, self.got = name, expected, got
        message = f"{name} needs {_in_words(expected)}, got {_in_words(got)}"
        super().__init__(f"{message}: {hint}" if hint else message)


class UnknownNameError(InputError):
    """A name that does not exist, with the names that do.

    Attributes
    ----------
    kind :
        What was looked up, e.g. ``"joint"``.
    name :
        The unknown name.
    available :
        The names that exist.
    suggestion :
        The closest existing name, or ``None``.
    """

    def __init__(self, kind: str, name: object, available: Iterable[str], where: str = "") -> None:
        self.kind, self.name, self.available = kind, name, tuple(map(str, available))
        self.suggestion = closest(name, self.available)
        place = f" {where}" if where else ""
        message = f"no {kind} {name!r}{place}; there is: {listed(self.available)}"
        if self.suggestion is not None:
            message += f"; did you mean {self.suggestion!r}?"
        super().__init__(message)


class SolverError(FtforceError):
    """A numerical solver gave up on a problem that has an answer; please report it."""


class FileError(FtforceError):
    """Something is wrong with a file.

    Attributes
    ----------
    path :
        The file; the message shows it with line breaks and the like escaped.
    reason :
        What is wrong with it and what would have been valid.
    """

    def __init__(self, path: str | PathLike[str], reason: str) -> None:
        self.path, self.reason = str(path), reason
        super().__init__(f"{printable(self.path)}: {reason}")


class URDFError(FileError):
    """A URDF that cannot be read or does not describe a robot."""


class SRDFError(FileError):
    """An SRDF that cannot be read."""


class DHTableError(FileError):
    """A DH table that cannot be read or is inconsistent."""


class LimitsError(FileError):
    """A file of torque limits that cannot be read or does not fit the robot."""


class TrajectoryError(FileError):
    """A file of a trajectory or of a history that cannot be read or does not fit the robot."""


class SweepError(FileError):
    """A stored sweep that is missing, damaged or none."""


class OutputError(FileError):
    """A result could not be written; nothing was left behind."""


def printable(text: object) -> str:
    r"""Return a text, a path mostly, on one line: what cannot be printed is shown as ``\n``."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))


def closest(name: object, available: Iterable[str]) -> str | None:
    """Return the existing name that looks most like ``name``, or ``None``."""
    if not isinstance(name, str):  # a number where a name was wanted resembles none
        return None
    from difflib import get_close_matches

    by_folded = {other.casefold(): other for other in available}
    matches = get_close_matches(name.casefold(), list(by_folded), n=1, cutoff=0.6)
    return by_folded[matches[0]] if matches else None


def listed(names: Iterable[str], most: int = 24) -> str:
    """Join names for a message; a long list is cut and says by how many."""
    names = tuple(names)
    if not names:
        return "(none)"
    more = f", … and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _in_words(shape: tuple[int, ...]) -> str:
    if shape == ():
        return "a single number"
    if len(shape) == 1:
        return "1 number" if shape[0] == 1 else f"{shape[0]} numbers"
    return "an array of shape " + " x ".join(map(str, shape))
