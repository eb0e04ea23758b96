"""Polytopes of forces meet pycapacity, SciPy's convex hulls, and what every polytope keeps."""

import math
import warnings
from collections import Counter
from itertools import combinations, pairwise, product

import numpy as np
import pytest
import scipy
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

import ftforce
from ftforce.core.feasible_forces import LockModel, feasible_forces, reach
from ftforce.core.limits import Limits
from ftforce.core.polytope import force_polytope
from ftforce.core.reduced_jacobian import reduce
from ftforce.errors import InputError
from helpers import assert_close, campaign, load_text, seeds, serial_urdf, with_singular_values

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of the modules that it imports
    from pycapacity.robot import force_polytope as pycapacity_polytope

EXACT = 1e-9  # of the largest force; 1e-14 is seen
ROUNDED = 1e-6  # the same; pycapacity rounds torques to 1e-7 N·m
UNKNOWN = math.nan
ARMS = ["panda", "ur5", "dh5", "kinova"]


def feasible_of(J, limits, rnea=None, *, locked=(), free=(), reading=LockModel.COMMANDED):
    """Return the forces within limits; joints by index."""
    J, limits = np.asarray(J, dtype=float), np.array(limits, dtype=float)
    S, L = (np.isin(np.arange(J.shape[1]), list(joints)) for joints in (free, locked))
    limits[S] = 0.0
    rnea = np.zeros(J.shape[1]) if rnea is None else np.asarray(rnea)
    return feasible_forces(reduce(J, L, free=S if S.any() else None), rnea, limits, reading)


def polytope_of(*args, **options):
    return force_polytope(feasible_of(*args, **options))


def assert_same_points(found, wanted, tol=EXACT):
    """Compare two sets of points, in whatever order; rounded ones may hold a point twice."""
    found, wanted = np.asarray(found), np.asarray(wanted)
    assert len(found) == len(wanted) or tol > EXACT
    apart = np.linalg.norm(found[:, None] - wanted, axis=2)
    size = np.abs(wanted).max(initial=1e-300)
    assert_close(apart.min(axis=1), 0.0, scale=size, tol=tol)
    assert_close(apart.min(axis=0), 0.0, scale=size, tol=tol)


def pycapacity_corners(J, limits, rnea):
    """Return pycapacity's corners, to about seven digits."""
    return pycapacity_polytope(J, limits, -limits, rnea).vertices.T


def volume(corners):
    return ConvexHull(corners).volume if len(corners) > corners.shape[1] else 0.0


def random_case(seed, m, n):
    """Return a Jacobian, limits and a weight that they carry."""
    rng = np.random.default_rng(seed)
    limits = rng.uniform(5.0, 90.0, size=n)
    return rng.normal(size=(m, n)), limits, rng.uniform(-0.8, 0.8, size=n) * limits


# ---- pycapacity ------------------------------------------------------------------------------


@given(seeds, st.integers(1, 3), st.integers(1, 4))
@settings(deadline=None, max_examples=campaign(40, 12))
def test_random_arms_against_pycapacity(seed, m, more):
    assume(m > 1)
    J, limits, rnea = random_case(seed, m, m + more)
    found = polytope_of(J, limits, rnea)
    assert (found.dimension, found.is_bounded, found.is_empty) == (m, True, False)
    assert_same_points(found.vertices, pycapacity_corners(J, limits, rnea), ROUNDED)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("task", ["force", "fx,fz"])
def test_known_arms_against_pycapacity(name, task):
    arm = ftforce.load_robot(name)
    limits = np.where(np.isnan(arm.effort), 30.0, arm.effort)
    for locked in ([], [1], [2]):
        result = ftforce.capability(arm, locked=locked, task=task, limits=Limits.of(limits))
        analysis = result.analysis
        H = [i for i in range(arm.n) if i + 1 not in locked]
        assert analysis.reduced.rank_after == analysis.task.m
        for after, joints in ((False, list(range(arm.n))), (True, H)):
            J, rnea = analysis.J[:, joints], analysis.rnea.after[joints]
            wanted = pycapacity_corners(J, limits[joints], rnea)
            for reading in LockModel:  # no brakes, no lost direction: it makes no difference
                found = result.polytope(after=after, reading=reading)
                assert_same_points(found.vertices, wanted, ROUNDED)
                assert_close(volume(found.vertices), volume(wanted), tol=ROUNDED)


@pytest.mark.parametrize("length", [1.0, 0.2])
def test_wrenches_against_pycapacity(length):
    arm = ftforce.load_robot("panda")
    result = ftforce.capability(arm, task="wrench", length=length)
    found, J = result.polytope(after=False), result.analysis.J
    assert found.dimension == 6
    # Torques do not know of the length, so the corners, in N and N·m, do not either.
    wanted = pycapacity_corners(J, arm.effort, result.analysis.rnea.before)
    assert_same_points(found.vertices, wanted, ROUNDED)
    torque = found.vertices @ J + result.analysis.rnea.before
    for face in found.faces:  # of five dimensions: one joint is at one of its limits
        at_limit = [(torque[list(face)] * side > arm.effort - 1e-6).all(axis=0) for side in (1, -1)]
        assert np.sum(at_limit) == 1
        assert len(face) >= 6
    ends = np.array([torque > arm.effort - 1e-6, torque < 1e-6 - arm.effort])
    assert len(found.faces) == np.sum(ends.sum(axis=1) >= 6)


# ---- flat ones -------------------------------------------------------------------------------


def test_a_lost_direction_leaves_a_flat_polygon():
    arm = ftforce.load_robot("panda")
    result = ftforce.capability(arm, locked=[2, 4])
    analysis, found = result.analysis, result.polytope(after=True)
    assert (analysis.reduced.rank_after, found.dimension) == (2, 2)
    H = [0, 2, 4, 5, 6]
    K, rnea = analysis.J[:, H], analysis.rnea.after[H]
    plane = scipy.linalg.orth(K, rcond=1e-6)
    wanted = pycapacity_corners(plane.T @ K, arm.effort[H], rnea)
    assert_same_points(found.vertices, wanted @ plane.T, ROUNDED)
    hull = ConvexHull(found.vertices @ plane)
    assert_close(hull.volume, ConvexHull(wanted).volume, tol=ROUNDED)
    (face,) = found.faces
    around = list(hull.vertices)
    start = around.index(face[0])
    turned = around[start:] + around[:start]
    assert list(face) in (turned, [turned[0], *turned[:0:-1]])
    held = result.polytope(after=True, reading="held")  # brakes carry the rest, without a limit
    assert_close(np.abs(held.unlimited @ analysis.lost_directions.T), [[1.0]])
    assert_close(ConvexHull(held.vertices @ plane).volume, hull.volume)
    strong = Limits.of(arm.effort, np.full(7, 100.0))
    braked = ftforce.capability(arm, locked=[2, 4], limits=strong).polytope
    assert (braked(after=True).dimension, braked(after=True, reading="held").dimension) == (2, 3)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_a_weight_that_only_a_force_at_the_tip_carries(unit):
    found = polytope_of(np.eye(2), [unit, 2.0 * unit], [3.0 * unit, 0.0])
    assert_same_points(found.vertices, unit * np.array([[-4, -2], [-4, 2], [-2, 2], [-2, -2]]))
    assert not found.vertices.flags.writeable


def test_a_segment():
    J, limits = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 4.0]], [10.0, 20.0, 40.0]
    found = polytope_of(J, limits, [1.0, 2.0, -8.0], locked=[0, 1])
    assert found.dimension == 1
    assert_same_points(found.vertices, [[0, 0, -8], [0, 0, 12]])
    assert [sorted(face) for face in found.faces] == [[0, 1]]
    ends = polytope_of(np.ones((1, 1)), [7.0], [2.0])
    assert_same_points(ends.vertices, [[5.0], [-9.0]])


def test_a_point():
    found = polytope_of(np.eye(3), [1.0] * 3, locked=[0, 1, 2])
    assert (found.dimension, found.faces, found.is_empty, found.is_bounded) == (0, (), False, True)
    assert_close(found.vertices, np.zeros((1, 3)))


def test_none_at_all():
    weights = [0.0, 1.5, 0.0]  # joint 2 cannot carry its weight, and no force at the tip helps
    J = np.diag([1.0, 0.0, 1.0])
    found = polytope_of(J, [1.0] * 3, weights)
    assert found.is_empty
    assert (found.vertices.shape, found.faces) == ((0, 3), ())
    # Two joints along one direction that need forces which do not meet:
    assert polytope_of([[1.0, 1.0], [0.0, 1e-9]], [1.0, 1.0], [5.0, -5.0]).is_empty


# ---- what every polytope keeps ---------------------------------------------------------------


@st.composite
def polytopes(draw):
    """Draw the feasible forces of a Jacobian: generic, of small integers, or almost flat."""
    m, n = draw(st.integers(1, 3)), draw(st.integers(1, 7))
    rng = np.random.default_rng(draw(seeds))
    kind = draw(st.sampled_from(["generic", "integers", "weak", "far"]))
    J = rng.normal(size=(m, n))
    if kind == "integers":  # planes that are parallel, or meet more than three in a corner
        J = rng.integers(-2, 3, size=(m, n)).astype(float)
    if kind == "weak":
        J = with_singular_values(rng, m, n, np.array([1.0, *rng.choice([1e-1, 1e-3, 1e-5], 2)]))
    if kind == "far":  # planes that are far away
        J[:, 0] *= rng.choice([1e-3, 1e-5, 3e-6])
    limits = rng.integers(1, 5, size=n) * 20.0
    rnea = rng.integers(-3, 4, size=n) * 0.25 * limits
    locked = draw(st.sets(st.integers(0, n - 1), max_size=2))
    limits[list(locked)] = draw(st.sampled_from([UNKNOWN, 15.0, 90.0]))
    reading = draw(st.sampled_from(list(LockModel)))
    return J, limits, rnea, feasible_of(J, limits, rnea, locked=locked, reading=reading)


def edges_of(face):
    return [frozenset(pair) for pair in pairwise([*face, face[0]])]


@given(polytopes())
@settings(deadline=None, max_examples=campaign(150, 60))
def test_corners_and_faces(case):
    J, limits, rnea, feasible = case
    found = force_polytope(feasible)
    if found.is_empty:
        return
    torque = rnea + found.vertices @ J
    beyond = np.abs(torque) - limits
    size = np.abs(found.vertices).max() or 1.0
    levers = np.linalg.norm(J.T @ feasible.Z, axis=1)
    ignored = np.where(levers > feasible.rtol * feasible.scale, 0.0, 2.0 * levers * size)
    assert np.nanmax(beyond - ignored - 1e-8 * limits, initial=-1.0) < 0.0
    assert_close(found.vertices - found.vertices @ feasible.Z @ feasible.Z.T, 0.0, scale=size)
    assert_close(found.vertices @ found.unlimited.T, 0.0, scale=size)
    if found.dimension == 3:
        edges = Counter(edge for face in found.faces for edge in edges_of(face))
        assert set(edges.values()) == {2}  # closed: every edge belongs to two faces
        assert len(found.vertices) - len(edges) + len(found.faces) == 2
        at_limit = np.abs(beyond) < 1e-6 * limits
        for face in found.faces:
            assert at_limit[list(face)].all(axis=0).any()
    if found.dimension == 2:
        assert [sorted(face) for face in found.faces] == [list(range(len(found.vertices)))]


@given(polytopes(), seeds)
@settings(deadline=None, max_examples=campaign(100, 30))
def test_corners_reach_as_far_as_a_linear_program(case, seed):
    *_, feasible = case
    found = force_polytope(feasible)
    bound = np.r_[feasible.upper, -feasible.lower]
    A = np.vstack([feasible.rows, -feasible.rows]) @ feasible.Z
    if not A.size:
        return
    strength = np.linalg.norm(A, axis=1)
    assume(not ((strength > 0.0) & (strength < 1e-5 * feasible.scale)).any())
    scale = np.where(strength > 0.0, strength, 1.0)
    # Planes that are nearly parallel meet far away, and the linear program knows 1e-7 only.
    s = np.linalg.svd(A / scale[:, None], compute_uv=False)
    assume(not ((s > 1e-13 * s[0]) & (s < 1e-3 * s[0])).any())
    for drawn in np.random.default_rng(seed).normal(size=(3, len(feasible.F0))):
        d = drawn - found.unlimited.T @ (found.unlimited @ drawn)
        best = scipy.optimize.linprog(
            -feasible.Z.T @ d, A / scale[:, None], bound / scale, bounds=(None, None)
        )
        if best.status == 2:
            assert found.is_empty
        elif best.status == 0:
            assert_close(np.max(found.vertices @ d), -best.fun, tol=1e-5)


@pytest.mark.parametrize("lever", [1e-2, 1e-4, 3e-6])
def test_a_joint_that_bounds_the_set_far_away_costs_no_digits(lever):
    J, limits, rnea = random_case(0, 3, 6)
    wanted = polytope_of(np.delete(J, 3, axis=1), np.delete(limits, 3), np.delete(rnea, 3))
    J[:, 3] *= lever
    found = polytope_of(J, limits * np.where(np.arange(6) == 3, 100.0, 1.0), rnea)
    assert_same_points(found.vertices, wanted.vertices)
    assert sorted(map(len, found.faces)) == sorted(map(len, wanted.faces))


@pytest.mark.parametrize(
    ("row", "limit"),
    [((1, 1, 1), 3.0), ((1, 1, 0), 2.0), ((1, 0, 0), 1.0), ((1, -1, 1), 5.0), ((0, 0, 0), 1.0)],
    ids=["corner", "edge", "the same plane", "beyond", "no lever"],
)
def test_planes_that_only_touch_a_cube_change_nothing(row, limit):
    found = polytope_of(np.column_stack([np.eye(3), row]), [1.0, 1.0, 1.0, limit])
    assert_same_points(found.vertices, list(product((-1.0, 1.0), repeat=3)))
    assert sorted(map(len, found.faces)) == [4] * 6


def test_a_slice_that_is_too_thin_to_tell_is_flat():
    J, limits, rnea = random_case(9, 3, 6)
    rnea[2] = 4.0
    flat = polytope_of(J, limits, rnea, free=[2])
    limits[2] *= 1e-15
    found = polytope_of(J, limits, rnea)
    assert (found.dimension, len(found.faces)) == (2, 1)
    assert_same_points(found.vertices, flat.vertices)


def test_limits_that_leave_only_a_plane():
    """Two joints bear all they can, and each keeps the force from going to its side."""
    J = [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0]]
    found = polytope_of(J, [2.0, 1.0, 1.0, 1.0], [1.0, 0.0, 0.0, -2.0])
    assert found.dimension == 2
    assert_same_points(found.vertices, [[1, y, z] for y in (-1, 1) for z in (-1, 1)])
    assert [sorted(face) for face in found.faces] == [[0, 1, 2, 3]]
    corner = polytope_of([[1.0, 1.0]], [2.0, 1.0], [1.0, -2.0])
    assert (corner.dimension, corner.faces) == (0, ())
    assert_same_points(corner.vertices, [[1.0]])
    cube = polytope_of(
        np.column_stack([np.eye(4), [1, 0, 0, 0]]), [2, 1, 1, 1, 1], [1, 0, 0, 0, -2]
    )
    assert cube.dimension == 3
    assert sorted(map(len, cube.faces)) == [4] * 6


@pytest.mark.parametrize("m", [4, 5])
@pytest.mark.parametrize("touching", [[], [[1, 1, 0, 0]]], ids=["plain", "touched"])
def test_cubes_of_more_dimensions(m, touching):
    """A plane that touches it in corners only, however many, makes no face."""
    rows = [*np.eye(m), *([*row, *[0] * (m - 4)] for row in touching)]
    found = polytope_of(np.transpose(rows), [2.0] * m + [4.0] * len(touching))
    assert_same_points(found.vertices, list(product((-2.0, 2.0), repeat=m)))
    assert sorted(map(len, found.faces)) == [2 ** (m - 1)] * (2 * m)
    for face in found.faces:
        assert np.ptp(found.vertices[list(face)], axis=0).min() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("vanishing", [1e-16, 1e-50, 1e-100, 5e-324])
@pytest.mark.parametrize("joints", [[2], [0, 3]])
def test_limits_that_vanish_leave_what_balances_those_joints(joints, vanishing):
    """Beside the weight, such a limit rounds to nothing: the joint leaves a plane."""
    J, limits, rnea = random_case(5, 3, 6)
    rnea *= 0.3
    limits[joints] *= vanishing
    limits = np.maximum(limits, np.finfo(float).tiny)
    with np.errstate(all="raise", under="ignore"):
        found = polytope_of(J, limits, rnea)
    assert found.dimension == 3 - len(joints)
    assert_close(found.vertices @ J[:, joints] + rnea[joints], 0.0, scale=90.0)
    others = [i for i in range(6) if i not in joints]
    rows, limit, weight = J.T[others], limits[others], rnea[others]
    for direction in np.random.default_rng(2).normal(size=(20, 3)):
        best = scipy.optimize.linprog(
            -direction,
            np.vstack([rows, -rows]),
            np.concatenate([limit - weight, limit + weight]),
            J.T[joints],
            -rnea[joints],
            bounds=(None, None),
        )
        assert_close((found.vertices @ direction).max(), -best.fun, scale=90.0)


# ---- joints without torque, unknown limits ---------------------------------------------------


def test_a_free_joint_leaves_the_forces_that_balance_it():
    J, limits, rnea = random_case(3, 3, 6)
    rnea *= 0.2
    found = polytope_of(J, limits, rnea, free=[4])
    assert found.dimension == 2
    assert_close(found.vertices @ J[:, 4] + rnea[4], 0.0, scale=limits[4])
    H = [0, 1, 2, 3, 5]
    plane = scipy.linalg.null_space(J[:, [4]].T)
    F0 = -J[:, 4] * rnea[4] / (J[:, 4] @ J[:, 4])
    wanted = pycapacity_corners(plane.T @ J[:, H], limits[H], rnea[H] + F0 @ J[:, H])
    assert_same_points(found.vertices, F0 + wanted @ plane.T, ROUNDED)


@pytest.mark.parametrize("unknown", [[0], [0, 1], [0, 1, 2, 3]], ids=str)
def test_unknown_limits_leave_directions_open(unknown):
    J, limits, rnea = random_case(8, 3, 4)
    limits[unknown] = UNKNOWN
    known = [i for i in range(4) if i not in unknown]
    found = polytope_of(J, limits, rnea)
    lacking = 3 - np.linalg.matrix_rank(J[:, known]) if known else 3
    assert found.is_bounded == (lacking == 0)
    assert (found.dimension, len(found.unlimited)) == (3 - lacking, lacking)
    assert_close(found.unlimited @ found.unlimited.T, np.eye(lacking))
    assert_close(found.unlimited @ J[:, known], 0.0, scale=1.0)
    assert_close(found.vertices @ found.unlimited.T, 0.0, scale=100.0)
    feasible = feasible_of(J, limits, rnea)
    for direction in found.unlimited:
        assert reach(feasible, direction).maximum == reach(feasible, -direction).maximum == math.inf


def test_too_many_joints_are_refused_at_once():
    steps = [("revolute", {"xyz": (0.1, 0, 0.02 * i), "axis": (0, i % 2, 1)}) for i in range(21)]
    arm = load_text(serial_urdf(*steps))
    result = ftforce.capability(arm, np.linspace(-1.0, 1.0, 21), task="wrench", gravity=[0, 0, 0])
    planes = math.comb(21, 6) * 2**6
    with pytest.raises(InputError) as caught:
        result.polytope(after=False)
    assert str(caught.value) == (
        f"the polytope has {planes:,} candidate vertices (21 joints with limits, 6 dimensions); "
        "at most 2,000,000 are supported: choose a smaller task"
    )
    smaller = ftforce.capability(arm, np.linspace(-1.0, 1.0, 21), gravity=[0, 0, 0])
    assert smaller.polytope(after=False).dimension == 3


def test_many_planes_are_worked_through_in_parts(monkeypatch):
    J, limits, rnea = random_case(6, 3, 7)
    whole = polytope_of(J, limits, rnea)
    monkeypatch.setattr("ftforce.core.polytope._CHUNK", 4)
    assert math.comb(7, 3) % 4
    parts = polytope_of(J, limits, rnea)
    np.testing.assert_array_equal(parts.vertices, whole.vertices)
    assert parts.faces == whole.faces
    assert len(list(combinations(range(7), 3))) == 35
