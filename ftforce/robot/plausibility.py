"""Numbers of a URDF that no real arm has: placeholders, mixed-up units and impossible inertias.

They are reported wherever they count, and never corrected.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ftforce.errors import listed
from ftforce.robot.robot import Implausible

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ftforce.core.arrays import Matrix
    from ftforce.robot.chain import Chain
    from ftforce.robot.formats.tree import UrdfJoint, UrdfLink
    from ftforce.robot.robot import Joint

STANDARD_GRAVITY = 9.80665  # m/s²
_FEWEST_ALIKE = 5  # joints with the same effort limit; wrists have three motors of a kind
_STRONGEST = 2.0  # payload at full stretch over the arm's own mass; real arms hold less than it
# Moving mass over the cube of the reach, kg/m³; arms have 3 to 60, legs and humanoids too.
_LIGHTEST, _HEAVIEST = 0.1, 3e3
_SHORTEST = 0.2  # m; what reaches less far, such as a torso or a head, may be heavier
_DOMINANT = 100.0  # mass of a link over that of all others together
_ROUNDING = 0.01  # relative; URDFs state inertias with few digits
_TRACE = 1e-9  # kg·m², 1 mg at 3 cm
_FULL = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # of the six moments in a 3×3 matrix


def implausible_numbers(
    chain: Chain, joints: Sequence[Joint], mass: float, *, same_motors: bool = False
) -> Implausible:
    """Return warnings about the effort limits, masses and inertias of an arm.

    Parameters
    ----------
    chain :
        The chain in its URDF.
    joints :
        Its joints, with their effort limits.
    mass :
        Moving mass, kg; 0 if the URDF has none.
    same_motors :
        Whether all joints are known to have the same motor.
    """
    path = chain.tree.path_to(chain.tip)
    bodies = list(_moving_links(chain))
    return Implausible(
        tuple(_efforts(joints, _levers(path), mass, same_motors)),
        (*_incomplete(chain, bodies), *_masses(bodies, _reach(chain, path), mass)),
        tuple(_inertias(bodies)),
    )


def _moving_links(chain: Chain) -> Iterator[UrdfLink]:
    tree = chain.tree
    names: set[str] = set()
    for joint in tree.below(tree.root):  # parents first
        if joint.name in chain.moving or joint.parent in names:
            names.add(joint.child)
    yield from (link for name, link in tree.links.items() if name in names)


def _levers(path: Sequence[UrdfJoint]) -> dict[str, float]:
    """Return the largest distance of the tip from each joint on the path, m: the stretched arm."""
    levers: dict[str, float] = {}
    length = 0.0
    for joint in reversed(path):
        if joint.mimic is None:
            levers[joint.name] = length
        length += math.hypot(*joint.xyz) + _travel(joint)
    return levers


def _travel(joint: UrdfJoint) -> float:
    """Return the length that a slide adds to the stretched arm, m; infinite if it has no limits."""
    if joint.type != "prismatic":
        return 0.0
    if joint.lower is None or joint.upper is None:
        return math.inf
    return max(abs(joint.lower), abs(joint.upper))


def _reach(chain: Chain, path: Sequence[UrdfJoint]) -> float:
    """Return the length of the links from the first joint to the tip, m."""
    moving = [i for i, joint in enumerate(path) if joint.name in chain.moving]
    return sum(math.hypot(*joint.xyz) for joint in path[moving[0] + 1 :]) if moving else 0.0


def _efforts(
    joints: Sequence[Joint], levers: dict[str, float], mass: float, same_motors: bool
) -> Iterator[str]:
    known = [joint for joint in joints if joint.effort is not None]
    alike = {joint.effort for joint in known}
    found = []
    if len(known) >= _FEWEST_ALIKE and len(alike) == 1 and not same_motors:
        found.append(
            f"all {len(known)} are {alike.pop():g} {known[0].torque_unit}, as if every joint had "
            "the same motor"
        )
    # Even if the whole own weight acted at full stretch, the payload would be too large.
    payload = min((_payload(joint, levers) for joint in known), default=math.inf) - mass
    if mass > 0.0 and _STRONGEST * mass < payload < math.inf:
        found.append(
            f"stretched out, the arm could hold {payload:.3g} kg at its tip, "
            f"{payload / mass:.2g} times its own mass of {mass:.3g} kg"
        )
    if found:
        yield f"the effort limits are doubtful: {'; '.join(found)}"


def _payload(joint: Joint, levers: dict[str, float]) -> float:
    """Return the mass that one joint can hold at the tip of the massless, stretched arm, kg."""
    if joint.effort is None or joint.name not in levers:
        return math.inf
    force = STANDARD_GRAVITY
    if joint.type != "prismatic":
        force *= levers[joint.name]
    return joint.effort / force if force > 0.0 else math.inf


def _incomplete(chain: Chain, bodies: Sequence[UrdfLink]) -> Iterator[str]:
    if names := [body.name for body in bodies if body.name in chain.tree.incomplete]:
        yield (
            f"the masses of {listed(names)} are incomplete: they follow from meshes that are "
            "missing, damaged or outside the file's folder (--package-path)"
        )


def _masses(bodies: Sequence[UrdfLink], reach: float, mass: float) -> Iterator[str]:
    if mass == 0.0:
        return
    heaviest = max(bodies, key=lambda body: body.mass or 0.0)
    others = sum(body.mass or 0.0 for body in bodies if body is not heaviest)
    if heaviest.mass and others > 0.0 and heaviest.mass > _DOMINANT * others:
        yield (
            f"the masses are doubtful: link {heaviest.name!r} has {heaviest.mass:.3g} kg, all "
            f"other links together have {others:.3g} kg"
        )
    if reach > _SHORTEST and not _LIGHTEST < mass / reach**3 < _HEAVIEST:
        yield f"the masses are doubtful: {mass:.3g} kg in all for a reach of {reach:.3g} m"


def _inertias(bodies: Sequence[UrdfLink]) -> Iterator[str]:
    bodies = [body for body in bodies if body.mass]
    impossible = _are_impossible(np.array([body.inertia for body in bodies]).reshape(-1, 6))
    if names := [body.name for body, is_one in zip(bodies, impossible, strict=True) if is_one]:
        yield (
            f"the inertias of {listed(names)} are impossible: a principal moment of a body is not "
            "negative and at most the sum of the other two"
        )


def _are_impossible(moments: Matrix) -> list[bool]:
    """Return which inertias, ixx, ixy, ixz, iyy, iyz, izz in each of N rows, no body has."""
    least, middle, most = np.linalg.eigvalsh(moments[:, _FULL]).T  # of matrices (N, 3, 3)
    slack = _ROUNDING * np.abs(most) + _TRACE
    found: list[bool] = ((least < -slack) | (most > least + middle + slack)).tolist()
    return found
