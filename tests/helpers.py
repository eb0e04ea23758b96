"""What the tests of the mathematics share: one tolerance, random Jacobians, random arms."""

from __future__ import annotations

import math
import os
import sys
import tempfile
import tracemalloc
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ftforce import Robot, known_robots, load_robot, write_robot
from ftforce.analysis.fault_names import named_faults
from ftforce.analysis.question import Question
from ftforce.core.reduced_jacobian import RTOL, reduce
from ftforce.robot.formats.dh import DHRow, DHTable, MassModel
from ftforce.robot.kinematics import tip_pose
from ftforce.robot.posture import choose_posture
from ftforce.trajectory.path import Path as TipPath
from ftforce.view.model import state

TOL = 1e-9
# Of the arms generated from published DH tables, one more than before stands for all in the
# long tests: gen3, whose table is modified and has a flange. test_robots and test_published_arms
# have all of them.
KNOWN = tuple(name for name in known_robots() if name not in {"iiwa14", "fr3", "xarm6", "sawyer"})
QUARTER = math.pi / 2
# No test asserts a time: Hypothesis's own deadline of 0.2 s fails on a busy machine.
settings.register_profile("ftforce", deadline=None)
settings.load_profile("ftforce")

CAMPAIGN = os.environ.get("FTFORCE_CAMPAIGN") == "1"


def campaign(full: int, quick: int | None = None) -> int:
    """Return how many cases to try: all in `nox -s campaign`, a tenth (or ``quick``) otherwise."""
    if CAMPAIGN:
        return full
    return max(1, full // 10) if quick is None else quick


def assert_close(got, wanted, *, scale=None, tol=TOL):
    """Compare within ``tol`` of ``scale``; without it, of the largest number that is wanted."""
    wanted = np.asarray(wanted, dtype=float)
    if wanted.ndim:  # a wanted number may stand for a whole array, an array only for its like
        assert np.shape(got) == wanted.shape
    if scale is None:
        scale = np.abs(wanted).max(initial=0.0) or 1.0
    np.testing.assert_allclose(got, wanted, rtol=0.0, atol=tol * float(scale))


def arrays_in(result, name="result"):
    """Yield every array of a result with its name, but none of its robot's."""
    if isinstance(result, np.ndarray):
        yield name, result
    elif isinstance(result, tuple):
        for i, item in enumerate(result):
            yield from arrays_in(item, f"{name}[{i}]")
    elif is_dataclass(result) and not isinstance(result, Robot):
        for field in fields(result):
            yield from arrays_in(getattr(result, field.name), f"{name}.{field.name}")


@contextmanager
def eager_threads():
    """Yield four threads that take turns as often as they can."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            yield pool
    finally:
        sys.setswitchinterval(usual)


# ---- Jacobians -------------------------------------------------------------------------------

# Ratios to σ_max on both sides of the rank tolerance, and far from it.
RATIOS = (1.0, 0.5, 0.1, 1e-3, 30 * RTOL, 1.01 * RTOL, 0.99 * RTOL, RTOL / 30, 1e-12, 0.0)
seeds = st.integers(0, 2**32 - 1)


class Case(NamedTuple):
    """A Jacobian, locked joints, and a force, torques and velocities before the fault."""

    J: Any
    locked: Any
    F: Any
    tau: Any
    v: Any


def orthogonal(rng, size):
    """Draw an orthogonal matrix."""
    return np.linalg.qr(rng.normal(size=(size, size)))[0]


def with_singular_values(rng, m, n, s):
    """Draw an (m, n) matrix with these singular values."""
    rank = min(m, n)
    return orthogonal(rng, m)[:, :rank] @ np.diag(s[:rank]) @ orthogonal(rng, n)[:rank]


@st.composite
def jacobians(draw, most_rows=6, most_joints=10):
    """Draw Jacobians: generic, of small integers, deficient, nearly singular, or hung on a joint.

    The last kind has one direction that a single joint supports well and the others hardly.
    """
    m, n = draw(st.integers(1, most_rows)), draw(st.integers(1, most_joints))
    kind = draw(st.sampled_from(["generic", "integers", "deficient", "spectrum", "hung"]))
    if kind == "integers":
        return draw(hnp.arrays(np.float64, (m, n), elements=st.integers(-2, 2).map(float)))
    rng = np.random.default_rng(draw(seeds))
    J = rng.normal(size=(m, n))
    if kind == "deficient":
        rank = draw(st.integers(0, min(m, n)))
        J = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
    if kind == "spectrum":
        ratios = draw(st.lists(st.sampled_from(RATIOS), min_size=5, max_size=5))
        J = with_singular_values(rng, m, n, np.array([1.0, *sorted(ratios, reverse=True)]))
    if kind == "hung":
        u = orthogonal(rng, m)[0]
        J += np.outer(u, (draw(st.sampled_from(RATIOS)) - 1.0) * (u @ J))
        J[:, draw(st.integers(0, n - 1))] += u
    return J * draw(st.sampled_from([1.0, 1e-3, 1e3]))


@st.composite
def cases(draw, **sizes):
    """Draw a Jacobian with everything that can be asked about it."""
    J = draw(jacobians(**sizes))
    m, n = J.shape
    rng = np.random.default_rng(draw(seeds))
    locked = draw(hnp.arrays(np.bool_, n))
    return Case(J, locked, *(100.0 * rng.normal(size=size) for size in (m, n, n)))


def is_clear(J, *masks, factor=3.0):
    """Return whether no singular value is so close to the tolerance that rounding decides."""
    none = np.zeros(J.shape[1], dtype=bool)
    for mask in (none, *masks):
        s = np.linalg.svd(np.where(mask, 0.0, J), compute_uv=False)
        limit = RTOL * np.linalg.norm(J, 2)
        if np.any((s < factor * limit) & (s > limit / factor)):
            return False
    return True


def is_beyond_doubt(J, *masks):
    """Return whether every direction is either well supported or not at all."""
    none = np.zeros(J.shape[1], dtype=bool)
    largest = np.linalg.norm(J, 2)
    s = [np.linalg.svd(np.where(mask, 0.0, J), compute_uv=False) for mask in (none, *masks)]
    ratios = np.concatenate(s) / (largest or 1.0)
    return not np.any((ratios > 1e-13) & (ratios < 1e-4))


def only(*numbers, n=3):
    """Return the mask of these joints, numbered from 1."""
    return np.isin(np.arange(1, n + 1), numbers)


def diagonal(*strengths, locked=()):
    """Return the reduced Jacobian of an arm that has one joint for each task direction."""
    mask = np.zeros(len(strengths), dtype=bool)
    mask[list(locked)] = True
    return reduce(np.diag(np.array(strengths, dtype=float)), mask)


# ---- arms ------------------------------------------------------------------------------------


def joint(name, kind, parent, child, **options):
    """Return a URDF joint; ``options``: xyz, rpy, axis, lower, upper, effort, mimic."""
    o = {"xyz": (0, 0, 0), "rpy": (0, 0, 0), "axis": (0, 0, 1), "lower": -3, "upper": 3, **options}
    xyz, rpy, axis = (" ".join(map(repr, map(float, o[key]))) for key in ("xyz", "rpy", "axis"))
    mimic = ""
    if o.get("mimic"):
        leader, multiplier, offset = o["mimic"]
        mimic = f'<mimic joint="{leader}" multiplier="{multiplier!r}" offset="{offset!r}"/>'
    bounds = f'lower="{o["lower"]!r}" upper="{o["upper"]!r}"' if kind != "continuous" else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        f'<limit {bounds} effort="{o.get("effort", 10.0)}" velocity="1"/>{mimic}</joint>'
    )


def urdf_of(*links, joints):
    """Return a URDF of massive links."""
    body = (
        '<inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" '
        'izz="0.01"/></inertial>'
    )
    text = "".join(f'<link name="{link}">{body}</link>' for link in links)
    return f'<robot name="arm">{text}{"".join(joints)}</robot>'


def serial_urdf(*steps):
    """Return the URDF of a chain base → tool from (kind, options) of its joints j1, j2, …"""
    links = ["base", *(f"l{i}" for i in range(1, len(steps) + 1)), "tool"]
    joints = [
        joint(f"j{i}", kind, links[i - 1], links[i], **options)
        for i, (kind, options) in enumerate(steps, start=1)
    ]
    joints.append(joint("end", "fixed", links[-2], "tool", xyz=(0.11, 0.05, 0.03)))
    return urdf_of(*links, joints=joints)


# Joints that slide and turn without end.
SLIDING = serial_urdf(
    ("prismatic", {"lower": -0.5, "upper": 0.5}),
    ("continuous", {"xyz": (0.1, 0, 0.1)}),
    ("revolute", {"xyz": (0.3, 0, 0), "axis": (0, 1, 0)}),
    ("prismatic", {"xyz": (0.2, 0, 0), "axis": (0.6, 0, 0.8), "lower": 0.0, "upper": 0.4}),
    ("continuous", {"xyz": (0.2, 0, 0), "axis": (0, 1, 0)}),
)
LINES = {  # robot: where the tip goes, from where it is
    "dh5": (-0.1, 0.08, 0.05),
    "panda": (-0.1, 0.1, -0.1),
    "ur5": (0.05, 0.1, -0.05),
    "kinova": (0.1, -0.05, -0.1),
    "tiago": (-0.05, 0.05, 0.05),
}


def straight(robot, change=None, *, speed=0.2, q=None, **options):
    """Return a path of the tip from its place in a posture, or in the default one."""
    x = tip_pose(robot, choose_posture(robot).q if q is None else np.asarray(q))[1]
    way = LINES[robot.name] if change is None else change
    return TipPath.through([x, x + way], speed=speed, **options)


def without_masses(urdf):
    """Return a URDF without inertials."""
    start, end = "<inertial>", "</inertial>"
    while start in urdf:
        urdf = urdf[: urdf.index(start)] + urdf[urdf.index(end) + len(end) :]
    return urdf


def srdf_of(**states):
    """Return an SRDF with these states, each a dictionary of joint values."""
    text = "".join(
        f'<group_state name="{name}" group="arm">'
        + "".join(f'<joint name="{key}" value="{value!r}"/>' for key, value in state.items())
        + "</group_state>"
        for name, state in states.items()
    )
    return f'<robot name="arm">{text}</robot>'


def load_text(urdf, srdf=None, **options):
    """Load a robot from texts."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "arm.urdf")
        path.write_text(urdf)
        if srdf is not None:
            path.with_suffix(".srdf").write_text(srdf)
        return load_robot(path, **options)


def stretched(little):
    """Return an arm and a posture in which joint 4 alone serves the radial direction well."""
    y = {"axis": (0, 1, 0)}
    arm = load_text(
        serial_urdf(
            ("revolute", {"xyz": (0, 0, 0.2)}),
            ("revolute", y),
            ("revolute", {"xyz": (0.4, 0, 0), **y}),
            ("revolute", {"xyz": (0.3, 0, 0.2), **y}),
        ).replace("0.11 0.05 0.03", "0.1 0.0 -0.2")
    )
    return arm, [0.3, 0.2, little, 0.0]


lengths = st.integers(-25, 25).map(lambda x: x / 50)  # m; a rod is as long as it is thick
angles = st.sampled_from([k * QUARTER for k in range(-2, 3)]) | st.floats(-3.0, 3.0)
triples = st.tuples(lengths, lengths, lengths)
axes = st.sampled_from([(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0.6, 0.0, 0.8)])
kinds = st.sampled_from(["revolute", "revolute", "continuous", "prismatic"])
steps = st.tuples(
    kinds,
    st.fixed_dictionaries({"xyz": triples, "rpy": st.tuples(angles, angles, angles), "axis": axes}),
)
# Multiples of a quarter turn stretch and fold an arm; a little more brings it close to that.
near_singular = st.builds(
    lambda quarters, little: quarters * QUARTER + little,
    st.integers(-1, 1),
    st.sampled_from([0.0, 1e-9, 1e-7, 3e-6, 1e-5, 1e-3, 0.1, 0.7]),
)


@st.composite
def arms(draw, least=2, most=7):
    """Draw an arm and a posture, often close to a singular one."""
    chain = draw(st.lists(steps, min_size=least, max_size=most))
    q = draw(st.lists(near_singular, min_size=len(chain), max_size=len(chain)))
    return load_text(serial_urdf(*chain)), np.array(q)


dh_rows = st.builds(
    DHRow,
    a=lengths,
    alpha=angles,
    d=lengths,
    theta=angles,
    type=st.sampled_from(["revolute", "revolute", "prismatic"]),
    lower=st.just(-9.0),
    upper=st.just(9.0),
)
dh_tables = st.builds(
    DHTable,
    name=st.just("random"),
    convention=st.sampled_from(["standard", "modified"]),
    rows=st.lists(dh_rows, min_size=1, max_size=7).map(tuple),
    mass=st.just(MassModel("solid cylinder", radius=0.03, density=2700.0)),
)


def toolbox():
    """Import roboticstoolbox, which warns about its own dependencies."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import roboticstoolbox

        return roboticstoolbox


def toolbox_arm(table):
    """Build a DH table's arm in roboticstoolbox."""
    rtb = toolbox()
    links = []
    for row in table.rows:
        turns = row.type == "revolute"
        make = getattr(
            rtb,
            ("Revolute" if turns else "Prismatic")
            + ("DH" if table.convention == "standard" else "MDH"),
        )
        constant = {"d": row.d} if turns else {"theta": row.theta}
        offset = row.theta if turns else row.d
        links.append(make(a=row.a, alpha=row.alpha, offset=offset, **constant))
    return rtb.DHRobot(links)


def changed_model(arm, gravity=None, payload=None):
    """Return a copy of the model with another gravity, and the payload as part of the last link."""
    model = arm.model.copy()
    if gravity is not None:
        model.gravity.linear = np.asarray(gravity, dtype=float)
    if payload is not None:
        tip = model.frames[arm.tip_frame]
        point = pin.Inertia(payload.mass, np.array(payload.offset), np.zeros((3, 3)))
        model.appendBodyToJoint(tip.parentJoint, point, tip.placement)
    return model


def differences(arm, q, step=1e-6):
    """Return the Jacobian in world axes at the tip by central differences of the tip's pose."""
    columns = []
    for unit in np.eye(arm.n):
        (R1, p1), (R2, p2) = tip_pose(arm, q - step * unit), tip_pose(arm, q + step * unit)
        columns.append(np.concatenate([p2 - p1, pin.log3(R2 @ R1.T)]) / (2.0 * step))
    return np.column_stack(columns)


def load_table(table):
    """Load a DH table's arm by way of its URDF."""
    with tempfile.TemporaryDirectory() as folder:
        return load_robot(write_robot(table, Path(folder, "arm.urdf"))[0], tip="tool")


def initial_state(robot, q=None, *, origin=None, locked=(), free=(), weak=(), limits=None, **asked):
    """Return the page's initial state for the arguments of `ftforce.analyze`."""
    place = choose_posture(robot, q, None if q is not None or origin is None else origin.posture)
    faults = named_faults(robot, locked, free, weak)
    question = Question.parse(robot, posture=place, faults=faults, limits=limits, **asked)
    given = limits is not None
    return state.initial_state(question, origin=origin, are_limits_given=given)


def peak_memory(function, refuses=()):
    """Call a function, and return the most bytes that it held; it may refuse with some errors."""
    tracemalloc.start()
    try:
        with suppress(*refuses):
            function()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
