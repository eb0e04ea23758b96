"""The task: the components of the tip wrench to analyse, their axes and their weights."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from ftforce.core.arrays import Matrix, Vector, as_vector, is_number, read_only
from ftforce.errors import InputError, UnknownNameError, check_word

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

Axes = Literal["tool", "world"]

AXES: tuple[str, ...] = get_args(Axes)
COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")  # linear first, as in Pinocchio
DEFAULT_LENGTH = 1.0
_SHORTEST, _LONGEST = 1e-6, 1e6  # m; outside this range, forces or moments vanish in rounding error
_ROUNDING = 1e-12  # smaller forces, relative to the weighted norm, count as zero
_SHORTHANDS = {"force": COMPONENTS[:3], "moment": COMPONENTS[3:], "wrench": COMPONENTS}


@dataclass(frozen=True)
class Task:
    """The m components of the tip force and moment that the arm has to exert.

    Forces and moments have different units and no common norm. The moment rows are therefore
    weighted by a characteristic length L, ``J̃ = [J_lin; L·J_ang]`` and ``F̃ = [f; μ/L]``
    (docs/theory/force), so that ``‖f‖² + ‖μ‖²/L²`` is minimised. L has no effect on a task without
    moments.

    Attributes
    ----------
    components :
        Any of ``fx, fy, fz, mx, my, mz``, each at most once.
    axes :
        ``tool``: axes of the tip frame (as in the paper); ``world``: axes of the robot's root, at
        the tip point.
    length :
        Characteristic length L in m, from 1e-6 to 1e6.
    """

    components: tuple[str, ...] = COMPONENTS[:3]
    axes: Axes = "tool"
    length: float = DEFAULT_LENGTH

    def __post_init__(self) -> None:
        """Check components, axes and length.

        Raises
        ------
        InputError
            Components are missing, unknown or repeated, the axes are unknown, or the length is out
            of range.
        """
        if not isinstance(self.components, tuple):
            raise InputError(f"the task needs a tuple of components, got {self.components!r}")
        for name in self.components:
            if not isinstance(name, str) or name not in COMPONENTS:
                raise UnknownNameError("task component", name, (*_SHORTHANDS, *COMPONENTS))
        if not self.components or len(set(self.components)) < len(self.components):
            given = ",".join(self.components)
            raise InputError(f"the task {given!r} must have one or more components, each only once")
        check_word("axes", self.axes, AXES)
        _checked_length(self.length)

    @classmethod
    def parse(
        cls,
        task: str | Iterable[str] | Task = "force",
        axes: Axes = "tool",
        length: float | None = None,
    ) -> Task:
        """Return the task for ``force``, ``moment``, ``wrench`` or components like ``fx,fz,my``.

        Parameters
        ----------
        task :
            A shorthand, comma-separated components, or a list of them. A ``Task`` is returned
            unchanged.
        axes :
            ``tool`` or ``world``.
        length :
            Characteristic length in m; 1 m by default.

        Raises
        ------
        InputError
            Components, axes or length are invalid; see the class.
        """
        if isinstance(task, Task):
            return task
        length = DEFAULT_LENGTH if length is None else _checked_length(length)
        if isinstance(task, str) and isinstance(axes, str):
            return _parsed(task, axes, length)
        return cls._of_words(task.split(",") if isinstance(task, str) else task, axes, length)

    @classmethod
    def _of_words(cls, words: Iterable[str], axes: Axes, length: float) -> Task:
        names: list[str] = []
        for word in words if np.iterable(words) else [words]:
            if not isinstance(word, str):
                raise UnknownNameError("task component", word, (*_SHORTHANDS, *COMPONENTS))
            names += _SHORTHANDS.get(word.strip().lower(), (word.strip().lower(),))
        return cls(tuple(names), axes, length)

    @property
    def m(self) -> int:
        """Number of task rows."""
        return len(self.components)

    @cached_property
    def rows(self) -> slice | list[int]:
        """Rows of the frame Jacobian (linear first) that belong to the task."""
        rows = [COMPONENTS.index(name) for name in self.components]
        if rows == list(range(rows[0], rows[0] + len(rows))):
            return slice(rows[0], rows[0] + len(rows))  # a view, not a copy
        return rows

    @cached_property
    def moment_rows(self) -> tuple[int, ...]:
        """Indices of the moments among the m components."""
        return tuple(i for i, name in enumerate(self.components) if name[0] == "m")

    @cached_property
    def force_rows(self) -> tuple[int, ...]:
        """Indices of the forces among the m components."""
        return tuple(i for i, name in enumerate(self.components) if name[0] == "f")

    @cached_property
    def weights(self) -> Vector | None:
        """Row weights (1, or L in m), shape (m,); ``None`` if all are 1."""
        if not self.moment_rows or self.length == 1.0:
            return None
        weights = np.ones(self.m)
        weights[list(self.moment_rows)] = self.length
        return read_only(weights)

    @cached_property
    def _elements(self) -> str:
        """What the elements of a force are, for error messages."""
        return f"{', '.join(self.components)} of the task '{self}'"

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each component: N or N·m."""
        return tuple("N" if name[0] == "f" else "N·m" for name in self.components)

    @property
    def size_unit(self) -> str:
        """Unit of force magnitudes: N, or N·m for a task with moments only."""
        return "N" if self.force_rows else "N·m"

    @property
    def velocity_units(self) -> tuple[str, ...]:
        """Unit of each component of the tip velocity: m/s or rad/s."""
        return tuple("m/s" if name[0] == "f" else "rad/s" for name in self.components)

    @property
    def velocity_components(self) -> tuple[str, ...]:
        """Names of the power-conjugate velocity components: vx for fx, wx for mx."""
        return tuple(name.replace("f", "v").replace("m", "w") for name in self.components)

    def vector(self, x: ArrayLike, name: str) -> Vector:
        """Return a force or direction in task axes as a validated vector, shape (m,).

        Parameters
        ----------
        x :
            The components.
        name :
            Name of the value, for error messages.

        Raises
        ------
        InputError
            The value does not consist of m finite numbers.
        """
        return as_vector(x, self.m, name, self._elements)

    def weigh_jacobian(self, J: Matrix) -> Matrix:
        """Return the weighted Jacobian J̃ of J, shape (m, n).

        Parameters
        ----------
        J :
            Task Jacobian, shape (m, n).
        """
        return J if self.weights is None else J * self.weights[:, None]

    def weigh_force(self, F: Vector) -> Vector:
        """Return the weighted force F̃ of F (N, N·m), shape (..., m).

        Parameters
        ----------
        F :
            Force, N and N·m, in task axes, shape (..., m).
        """
        return F if self.weights is None else F / self.weights

    def unweigh_force(self, F: Vector) -> Vector:
        """Return the force F (N, N·m) of the weighted force F̃, shape (..., m).

        Parameters
        ----------
        F :
            Weighted force, shape (..., m).
        """
        return F if self.weights is None else F * self.weights

    def unweigh_velocity(self, x: Vector) -> Vector:
        """Return the tip velocity (m/s, rad/s) of the weighted velocity J̃v, shape (m,).

        Parameters
        ----------
        x :
            Weighted tip velocity J̃v, shape (m,).
        """
        return x if self.weights is None else x / self.weights

    @property
    def weighted_unit(self) -> float:
        """Magnitude of a unit F̃: 1 (N), or L (N·m) for a task with moments only."""
        return 1.0 if self.force_rows else self.length

    def direction_of(self, F: Vector) -> Vector:
        """Return F scaled so that its force components, or else its moments, have norm 1.

        Forces at the level of rounding error are set to zero.

        Parameters
        ----------
        F :
            Nonzero force, shape (m,).
        """
        forces = F[list(self.force_rows)]
        size, whole = math.hypot(*forces), math.hypot(*self.weigh_force(F))
        if size > _ROUNDING * whole:
            return read_only(F / size)
        moment = F.copy()
        moment[list(self.force_rows)] = 0.0
        return read_only(moment / math.hypot(*moment))

    def __str__(self) -> str:
        """Return the shorthand, or the components separated by commas."""
        for word, components in _SHORTHANDS.items():
            if components == self.components:
                return word
        return ",".join(self.components)


def _checked_length(length: float) -> float:
    if not (is_number(length) and _SHORTEST <= length <= _LONGEST):
        raise InputError(
            f"the characteristic length must lie between {_SHORTEST:g} and {_LONGEST:g} m, "
            f"got {length}"
        )
    return float(length)


@lru_cache(maxsize=64)  # a task and its weights are the same for millions of postures
def _parsed(task: str, axes: Axes, length: float) -> Task:
    return Task._of_words(task.split(","), axes, length)
