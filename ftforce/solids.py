"""The bodies of a DH arm: rods along d and a, their masses and inertias.

A link is a rod along d (on z) and a rod along a (on the turned x), of the radius of the mass
model. Its mass is spread over both by length; the overlap at their corner is not subtracted.
A rod of mass m, length l and radius r has, about its centre,

==================  ============  ==================
model               about axis    across axis
==================  ============  ==================
``solid cylinder``  m r²/2        m (3 r² + l²)/12
``thin rod``        m r²/2        m l²/12
==================  ============  ==================

(A line of mass has no inertia about itself, which a URDF cannot state: the thin rod keeps that
one term.) The rods add up by the parallel axis theorem. A link without length is a ball of that
radius, 2/5 m r². Where a row gives no mass it is density times the volume of the rods or ball.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ftforce.errors import DHTableError
from ftforce.robot.formats.dh import DHTable, cos_sin

if TYPE_CHECKING:
    from ftforce.core.arrays import Matrix
    from ftforce.robot.formats.dh import MassModel

Triple: TypeAlias = tuple[float, float, float]
ZERO = (0.0, 0.0, 0.0)


class Origin(NamedTuple):
    """A constant pose (m, rad) as a URDF states it: Rot_z(yaw) Rot_y(pitch) Rot_x(roll)."""

    xyz: Triple
    rpy: Triple = ZERO


class Rod(NamedTuple):
    """A straight piece of a link: length (m), centre with z along the rod, direction."""

    length: float
    origin: Origin
    axis: Triple


class Body(NamedTuple):
    """A link, moved by its joint, and the constant step to the next joint (rad, m)."""

    name: str
    theta: float
    d: float
    a: float
    alpha: float
    mass: float | None

    @property
    def end(self) -> Origin:
        """Origin of the next joint."""
        c, s = cos_sin(self.theta)
        return Origin((self.a * c, self.a * s, self.d), (self.alpha, 0.0, self.theta))

    @property
    def rods(self) -> tuple[Rod, ...]:
        """The pieces along d and a; none if the link has no length."""
        c, s = cos_sin(self.theta)
        middle = (self.a * c / 2, self.a * s / 2, self.d)
        upright = Rod(abs(self.d), Origin((0.0, 0.0, self.d / 2)), (0.0, 0.0, 1.0))
        across = Rod(abs(self.a), Origin(middle, (0.0, math.pi / 2, self.theta)), (c, s, 0.0))
        return tuple(rod for rod in (upright, across) if rod.length)


def inertia_of(body: Body, model: MassModel) -> tuple[float, Triple, Matrix]:
    """Return mass (kg), centre of mass (m) and inertia about it, shape (3, 3), kg·m²."""
    r2 = model.radius * model.radius
    rods, density = body.rods, model.density or 0.0
    if not rods:
        mass = body.mass or density * 4 / 3 * math.pi * r2 * model.radius
        return mass, ZERO, 2 / 5 * mass * r2 * np.eye(3)
    lengths = np.array([rod.length for rod in rods])
    centres = np.array([rod.origin.xyz for rod in rods])
    share = lengths / lengths.sum()
    centre = (share[:, None] * centres).sum(axis=0)  # no @: BLAS may round differently elsewhere
    inertia = np.zeros((3, 3))  # per kg
    for rod, part, arm in zip(rods, share, centres - centre, strict=True):
        thickness = 3 * r2 if model.model == "solid cylinder" else 0.0
        about, across = r2 / 2, (thickness + rod.length * rod.length) / 12
        inertia += part * (across * np.eye(3) + (about - across) * np.outer(rod.axis, rod.axis))
        inertia += part * ((arm * arm).sum() * np.eye(3) - np.outer(arm, arm))  # parallel axes
    mass = body.mass or density * math.pi * r2 * float(lengths.sum())
    x, y, z = centre.tolist()
    return mass, (x, y, z), mass * inertia


def check_inertia(inertia: Matrix, body: Body, table: DHTable) -> None:
    """Refuse an inertia that no body has: a rod thicker than long, numbers beyond all sizes.

    Raises
    ------
    DHTableError
        The moments are not positive, or one exceeds the sum of the others.
    """
    # Moments of a body are positive and none exceeds the sum of the others (1e-9: a flat disc).
    moments = np.linalg.eigvalsh(inertia) if np.isfinite(inertia).all() else np.zeros(3)
    if not (moments[0] > 0 and moments[2] <= (moments[0] + moments[1]) * (1 + 1e-9)):
        size = f"d = {body.d:g} m, a = {body.a:g} m, radius {table.mass.radius:g} m"
        reason = f"link {body.name!r}: no body has the inertia of a {table.mass.model} of this size"
        hint = "a rod needs to be longer than it is thick, and of a usual size"
        raise DHTableError(table.source or table.name, f"{reason} ({size}); {hint}")
