"""Exceptions raised by ftforce.

::

    FtforceError
    ├── InputError (ValueError)      a value given by the caller is malformed
    │   ├── DimensionError           a vector or matrix of the wrong shape
    │   └── UnknownNameError         a joint, tip, posture, robot … that does not exist
    ├── SolverError                  a numerical solver failed; please report it
    └── FileError                    a file is invalid or inaccessible; carries its path
        ├── URDFError
        ├── SRDFError
        ├── DHTableError
        ├── LimitsError              a torque limits file
        ├── TrajectoryError          a trajectory, history or postures file
        ├── SweepError               a stored sweep
        └── OutputError              a result could not be written

A fault that cannot be tolerated is a result, not an error.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable
    from os import PathLike


_LONGEST = 1500  # characters of a message


class FtforceError(Exception):
    """Base class of all exceptions that ftforce raises."""

    def __str__(self) -> str:
        """Return the message in one printable line; arrays in it are printed in several."""
        text = printable(re.sub(r"\n\s*", " ", super().__str__()))
        return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} … {text[-500:]}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle message and attributes, bypassing ``__init__``: errors cross processes."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(
    kind: type[FtforceError], args: tuple[Any, ...], data: dict[str, Any]
) -> FtforceError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(data)
    return error


class InputError(FtforceError, ValueError):
    """A value given by the caller is malformed; the message states what is valid."""


class DimensionError(InputError):
    """A vector or matrix has the wrong shape.

    Attributes
    ----------
    name :
        Name of the value, e.g. ``"force"``.
    expected, got :
        Expected and actual shape.
    """

    def __init__(
        self, name: str, expected: tuple[int, ...], got: tuple[int, ...], hint: str = ""
    ) -> None:
        self.name, self.expected, self.got = name, expected, got
        message = f"{name} needs {_in_words(expected)}, got {_in_words(got)}"
        super().__init__(f"{message}: {hint}" if hint else message)


class UnknownNameError(InputError):
    """A name does not exist; the message lists the available names.

    Attributes
    ----------
    kind :
        Kind of object that was looked up, e.g. ``"joint"``.
    name :
        The unknown name.
    available :
        The available names.
    suggestion :
        The closest available name, or the closest of those in ``similar``; ``None`` if none is.
    """

    def __init__(
        self,
        kind: str,
        name: object,
        available: Iterable[str],
        where: str = "",
        similar: Iterable[str] | None = None,
    ) -> None:
        self.kind, self.name, self.available = kind, name, tuple(map(str, available))
        self.suggestion = closest(name, self.available if similar is None else similar)
        place = f" {where}" if where else ""
        message = f"unknown {kind} {name!r}{place}; available: {listed(self.available)}"
        if self.suggestion is not None:
            message += f"; did you mean {self.suggestion!r}?"
        super().__init__(message)


class SolverError(FtforceError):
    """A numerical solver failed on a problem that has a solution; please report it."""


class FileError(FtforceError):
    """A file is invalid or inaccessible.

    Attributes
    ----------
    path :
        The file; unprintable characters are escaped in the message.
    reason :
        What is wrong with the file, and what is valid.
    """

    def __init__(self, path: str | PathLike[str], reason: str) -> None:
        self.path, self.reason = str(path), reason
        super().__init__(f"{printable(self.path)}: {reason}")


class URDFError(FileError):
    """A URDF cannot be read or does not describe a robot."""


class SRDFError(FileError):
    """An SRDF cannot be read."""


class DHTableError(FileError):
    """A DH table cannot be read or is inconsistent."""


class LimitsError(FileError):
    """A torque limits file cannot be read or does not match the robot."""


class PayloadError(FileError):
    """A file of a payload that cannot be read, or describes no rigid body."""


class TrajectoryError(FileError):
    """A trajectory, history or postures file cannot be read or does not match the robot."""


class SweepError(FileError):
    """A stored sweep is missing, damaged, or not a sweep."""


class OutputError(FileError):
    """A result could not be written; no partial file is left behind."""


def out_of_memory(problem: MemoryError) -> str:
    """Return the message for an allocation that failed, which is no mistake of anybody's.

    Parameters
    ----------
    problem :
        What was raised.
    """
    detail = printable(problem)
    reason = f" ({detail[0].lower()}{detail[1:]})" if detail else ""
    return f"this machine has too little free memory for what is asked{reason}"


def printable(text: object) -> str:
    r"""Return a text, usually a path, with unprintable characters escaped, e.g. as ``\n``.

    Parameters
    ----------
    text :
        The text.
    """
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))


def check_word(kind: str, word: object, available: Iterable[str]) -> None:
    """Check that a word is one of a few.

    Parameters
    ----------
    kind, word, available :
        As of `UnknownNameError`.

    Raises
    ------
    UnknownNameError
        It is another, or no text.
    """
    if not isinstance(word, str) or word not in available:
        raise UnknownNameError(kind, word, available)


_LONGEST_GUESS = 200  # characters


def closest(name: object, available: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Return the available name most similar to ``name``, or ``None``.

    Parameters
    ----------
    name :
        The name to look for; case is ignored.
    available :
        The available names.
    cutoff :
        The least similarity, from 0 to 1, as of `difflib.SequenceMatcher`.
    """
    if not isinstance(name, str):  # a number resembles no name
        return None
    from difflib import get_close_matches

    if len(name) > _LONGEST_GUESS:  # the comparison takes the square of the length
        return None
    by_folded = {x.casefold(): x for x in available if len(x) <= _LONGEST_GUESS}
    matches = get_close_matches(name.casefold(), list(by_folded), n=1, cutoff=cutoff)
    return by_folded[matches[0]] if matches else None


def listed(names: Iterable[str], most: int = 24) -> str:
    """Join names for a message, truncated to ``most`` names with a count of the rest.

    Parameters
    ----------
    names :
        The names.
    most :
        Number of names to show.
    """
    names = tuple(names)
    if not names:
        return "(none)"
    more = f", … and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(map(printable, names[:most])) + more


def _in_words(shape: tuple[int, ...]) -> str:
    if shape == ():
        return "a single number"
    if len(shape) == 1:
        return "1 number" if shape[0] == 1 else f"{shape[0]} numbers"
    return "an array of shape " + " x ".join(map(str, shape))
