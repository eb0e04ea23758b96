"""Forces as arrows at the tip, moments as double-headed arrows. Arrays only."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ftforce.core.arrays import Matrix, Vector, read_only
from ftforce.report.text import NEGLIGIBLE, size
from ftforce.view.model.state import in_components

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ftforce.core.task import Task

ARROW_KINDS = ("requested", "kept", "lost")
MAX_LENGTH = 0.45  # length of the longest arrow, as a share of the size of the arm
_MAX_MOMENT_LENGTH = 0.3  # shorter, so that along a force both heads lie on the force's shaft
_NICE = (1.0, 2.0, 5.0, 10.0)


class Scales(NamedTuple):
    """Arrow length per N and per N·m, m; NaN if the task has no such components."""

    force: float
    moment: float

    def of(self, task: Task) -> float:
        """Return the scale of the task's forces, or of its moments if it has no forces."""
        return self.force if task.force_rows else self.moment

    def notes(self) -> tuple[str, ...]:
        """Return the scales in words."""
        found = []
        for scale, what, unit in ((self.force, "force", "N"), (self.moment, "moment", "N·m")):
            if not math.isnan(scale):
                found.append(f"{what} arrows: 0.1 m = {size(0.1 / scale, 1)} {unit}")
        return tuple(found)


class TipAxes(NamedTuple):
    """Task axes at the tip, in root axes: position, m, shape (3,), and rotation, (3, 3)."""

    place: Vector
    rotation: Matrix

    def point(self, F: Vector, scale: float) -> Vector:
        """Return the end points of force (moment) arrows in root axes, m, shape (..., 3).

        Parameters
        ----------
        F :
            Forces (moments) in task axes, N (N·m), shape (..., 3).
        scale :
            Length per N (N·m), m.
        """
        return read_only(self.place + scale * F @ self.rotation.T)


class Arrow(NamedTuple):
    """A force or a moment at the tip.

    Attributes
    ----------
    kind :
        One of `ARROW_KINDS`.
    is_moment :
        Whether it is a moment, drawn with two heads.
    start, end :
        In root axes, m, shape (3,); equal if the vector is zero.
    label :
        What it represents, with its magnitude and unit.
    mark :
        Label drawn beside it; empty if a coinciding arrow carries the label.
    """

    kind: str
    is_moment: bool
    start: Vector
    end: Vector
    label: str
    mark: str

    @property
    def length(self) -> float:
        """Length, m."""
        return float(np.linalg.norm(self.end - self.start))


def has_both(task: Task) -> bool:
    """Return whether a task has forces and moments, which must not share a norm."""
    return bool(task.force_rows and task.moment_rows)


def forces_of(task: Task, F: Vector) -> Vector:
    """Return the force part of task vectors, shape (..., m), as (..., 3), N.

    Parameters
    ----------
    task :
        The task.
    F :
        Task vectors, N and N·m, shape (..., m).
    """
    return in_components(task.components, F)[..., :3]


def moments_of(task: Task, F: Vector) -> Vector:
    """Return the moment part of task vectors, shape (..., m), as (..., 3), N·m.

    Parameters
    ----------
    task :
        The task.
    F :
        Task vectors, N and N·m, shape (..., m).
    """
    return in_components(task.components, F)[..., 3:]


def spatial(task: Task, F: Vector) -> Vector:
    """Return the force part of task vectors, (..., m), or the moments if there are no forces.

    Parameters
    ----------
    task :
        The task, of forces or of moments.
    F :
        Task vectors, N (N·m), shape (..., m).
    """
    return forces_of(task, F) if task.force_rows else moments_of(task, F)


def scales_for(task: Task, vectors: Iterable[Vector], extent: float) -> Scales:
    """Return scales at which all arrows fit into the scene.

    Parameters
    ----------
    task :
        The task.
    vectors :
        Task vectors, N and N·m, shape (..., m) each; NaN is ignored.
    extent :
        Size of the scene, m.
    """
    whole = np.vstack([np.zeros(task.m), *(F.reshape(-1, task.m) for F in vectors)])
    whole = whole[np.isfinite(whole).all(axis=1)]
    force, moment = (
        float(np.linalg.norm(part(task, whole), axis=1).max()) for part in (forces_of, moments_of)
    )
    longest = _MAX_MOMENT_LENGTH if has_both(task) else MAX_LENGTH
    return Scales(
        nice_scale(force, extent) if task.force_rows else math.nan,
        nice_scale(moment, extent, longest) if task.moment_rows else math.nan,
    )


def nice_scale(largest: float, extent: float, longest: float = MAX_LENGTH) -> float:
    """Return a length per N (N·m), m, at which the largest force fits, in steps of 1, 2, 5.

    Parameters
    ----------
    largest :
        Magnitude of the largest force, N (N·m).
    extent :
        Size of the scene, m.
    longest :
        Maximum arrow length, as a share of ``extent``.
    """
    if largest <= NEGLIGIBLE:
        largest = 1.0
    exact = largest / (longest * extent)  # N per m, rounded up to the next nice number
    power = 10.0 ** math.floor(math.log10(exact))
    return 1.0 / next(step * power for step in _NICE if step * power >= exact * (1.0 - 1e-9))


def arrows_of(
    task: Task, vectors: dict[str, Vector | None], axes: TipAxes, scales: Scales
) -> tuple[Arrow, ...]:
    """Return three force arrows followed by three moment arrows, as far as the task has them.

    Parameters
    ----------
    task :
        The task.
    vectors :
        One task vector for each of `ARROW_KINDS`, N and N·m, shape (m,); ``None`` for those that
        are undefined because the arm falls. Empty if no force is requested: returns no arrows.
    axes :
        Task axes at the tip.
    scales :
        Arrow scales.
    """
    found: list[Arrow] = []
    for rows, part, scale, unit, noun in (
        (task.force_rows, forces_of, scales.force, "N", "force "),
        (task.moment_rows, moments_of, scales.moment, "N·m", "moment "),
    ):
        if vectors and rows:
            own = {kind: None if F is None else part(task, F) for kind, F in vectors.items()}
            found += _three(own, axes, scale, unit, noun if has_both(task) else "")
    return tuple(found)


def _three(
    vectors: dict[str, Vector | None], axes: TipAxes, scale: float, unit: str, noun: str
) -> list[Arrow]:
    arrows, is_moment = [], unit == "N·m"
    requested, kept = vectors["requested"], vectors["kept"]
    everything_kept = (
        requested is not None and kept is not None and norm(requested - kept) <= NEGLIGIBLE
    )
    for kind, F in vectors.items():
        end, label, mark = axes.place, f"{noun}{kind}: no static equilibrium", ""
        if F is not None:
            amount = f"{size(norm(F), 1)} {unit}"
            label = f"{noun}{kind} {amount}"
            if norm(F) > NEGLIGIBLE:
                end, mark = axes.point(F, scale), label
        if mark and everything_kept:  # the arrows coincide
            mark = f"{noun}all kept {amount}" if kind == "kept" else ""
        arrows.append(Arrow(kind, is_moment, axes.place, end, label, mark))
    return arrows


def norm(x: Vector) -> float:
    """Return the Euclidean norm of a vector."""
    return math.hypot(*x.tolist())
