"""Self-motion manifolds against closed forms, Pinocchio and brute force."""

import math

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import ftforce
from ftforce.errors import DimensionError, InputError
from ftforce.planning.projection import project
from ftforce.planning.self_motion import self_motion
from ftforce.planning.target import (
    POINT,
    POSE,
    TipTarget,
    residual,
    residual_and_jacobian,
    residuals_and_jacobians,
)
from ftforce.robot.formats.dh import DHRow, DHTable
from helpers import SLIDING, load_table, load_text, serial_urdf

PI = math.pi


def planar(kind="revolute", bound=PI):
    """Return an arm of three links of 1 m in the plane z = 0."""
    z = {"axis": (0, 0, 1), "lower": -bound, "upper": bound}
    text = serial_urdf(*((kind, {**z, "xyz": (x, 0, 0)}) for x in (0.0, 1.0, 1.0)))
    return load_text(text.replace("0.11 0.05 0.03", "1.0 0.0 0.0"))


def srs():
    """Return an arm with spherical shoulder and wrist, standard DH, limits ±170°."""
    rows = zip((-1, 1, 1, -1, -1, 1, 0), (0.34, 0.0, 0.4, 0.0, 0.39, 0.0, 0.126), strict=True)
    return load_table(
        DHTable(
            name="srs",
            convention="standard",
            rows=tuple(
                DHRow(0.0, 0.5 * PI * turn, d, 0.0, "revolute", -2.967, 2.967) for turn, d in rows
            ),
        )
    )


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


def tip_misses(arm, q, target):
    """Return the largest distance of the tip from a target, m and rad, by Pinocchio alone."""
    data, worst = arm.model.createData(), 0.0
    for one in q:
        pin.framesForwardKinematics(arm.model, data, arm.to_model(one))
        pose = data.oMf[arm.tip_frame]
        error = np.concatenate([pose.translation - target.position, np.zeros(3)])
        if target.rotation is not None:
            error[3:] = pin.log3(pose.rotation @ target.rotation.T)
        worst = max(worst, np.abs(error[list(target.rows)]).max())
    return worst


# ---- the planar arm, whose ranges docs/theory/self-motion gives --------------------------------


def ranges_of(r):
    """Return how far each joint may be from pointing ahead, and the least bend of the elbows."""
    base = (r * r - 3.0) / (2.0 * r)
    turn = PI if base < -1.0 else math.acos(base)
    bend = 2.0 * math.acos(abs(r - 1.0) / 2.0)
    least = 2.0 * math.acos((r + 1.0) / 2.0) if r < 1.0 else 0.0
    return turn, bend, least


@pytest.mark.parametrize("r", [1.2, 1.7, 2.0, 2.6, 2.99])
def test_planar_arm_turns_as_far_as_the_closed_forms_say(r):
    turn, bend, _ = ranges_of(r)
    found = self_motion(planar("continuous"), TipTarget.of((r, 0.0, 0.0)))
    (loop,) = found.components
    assert loop.closed
    assert loop.dimension == 1
    assert_allclose(loop.ranges, [[-turn, turn], [-bend, bend], [-bend, bend]], atol=1e-8)
    assert_allclose(found.ranges, loop.ranges)


@pytest.mark.parametrize("r", [0.3, 0.8])
def test_close_to_the_base_each_way_to_bend_is_a_loop_of_its_own(r):
    turn, bend, least = ranges_of(r)
    assert turn == PI
    found = self_motion(planar("continuous"), TipTarget.of((0.0, r, 0.0)))
    assert [one.closed for one in found.components] == [True, True]
    for one in found.components:
        way = np.sign(one.q[0, 1])
        assert_allclose(np.sort(way * one.ranges[1]), [least, bend], atol=1e-8)
        assert np.ptp(one.q[:, 0]) > 2.0 * PI - 0.2  # a whole turn


def test_limits_end_the_curves_exactly():
    arm = planar(bound=1.8)
    r = 1.5
    found = self_motion(arm, TipTarget.of((r, 0.0, 0.0)))
    ends = np.array([one.q[i] for one in found.components for i in (0, -1)])
    assert not any(one.closed for one in found.components)
    assert np.abs(np.abs(ends) - 1.8).min(axis=1).max() == 0.0
    assert (np.abs(found.q) <= 1.8).all()
    # Where an elbow is at its limit, the law of cosines gives the other one.
    reached = np.abs(found.q[:, 1:]).max(axis=0)
    bend = ranges_of(r)[1]
    assert_allclose(reached, [min(1.8, bend)] * 2, atol=1e-8)


def test_locked_joint_keeps_its_place():
    arm = planar()
    limits = np.array([arm.lower, arm.upper])
    limits[:, 0] = 0.3
    found = self_motion(arm, TipTarget.of((1.5, 0.2, 0.0)), limits=limits)
    assert found.dimension == 0
    assert len(found.components) == 2  # elbow to the left or to the right
    assert (found.q[:, 0] == 0.3).all()
    assert_allclose(found.q[0, 2], -found.q[1, 2], atol=1e-8)


# ---- arms with spherical shoulder and wrist ------------------------------------------------------


def test_elbow_between_spherical_joints_keeps_its_angle():
    """Its bend depends on the distance of shoulder and wrist alone."""
    arm = srs()
    for seed in range(2):
        q = np.random.default_rng(seed).uniform(-2.0, 2.0, 7)
        q[3] = 0.4 + 0.9 * seed
        target = TipTarget.at_posture(arm, q)
        found = self_motion(arm, target, start=q, restarts=12)
        wrist = target.position - 0.126 * target.rotation[:, 2]
        d = np.linalg.norm(wrist - [0.0, 0.0, 0.34])
        bend = PI - math.acos((0.4**2 + 0.39**2 - d * d) / (2.0 * 0.4 * 0.39))
        assert found.dimension == 1
        for one in found.components:
            assert np.ptp(one.ranges[3]) <= 1e-8
            assert_allclose(np.abs(one.q[:, 3]), bend, atol=1e-8)
        assert found.tip_error <= 1e-9


# ---- any arm -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "rows", "dimension"),
    [
        ("panda", POSE, 1),
        ("panda", (0, 1, 2, 5), 3),
        ("kinova", POSE, 0),
        ("ur5e", POSE, 0),
        ("ur5e", (0, 1, 2, 3, 4), 1),
        ("dh5", POINT, 2),
        ("tiago", POSE, 2),
        ("sliding", POINT, 2),
    ],
)
def test_every_sample_reaches_the_target_within_the_limits(name, rows, dimension):
    arm = load_text(SLIDING) if name == "sliding" else ftforce.load_robot(name)
    low, high = arm.ranges
    q = low + np.random.default_rng(5).uniform(0.2, 0.8, arm.n) * (high - low)
    target = TipTarget.at_posture(arm, q, rows)
    found = self_motion(arm, target, start=q, restarts=12, most=400)
    assert found.dimension == dimension == arm.n - len(rows)
    assert (found.q >= arm.lower).all()
    assert (found.q <= arm.upper).all()
    assert found.tip_error <= 1e-9
    assert tip_misses(arm, found.q[:: max(1, len(found.q) // 200)], target) <= 1e-9
    if dimension == 0:
        assert all(len(one.q) == 1 for one in found.components)


def test_curves_hold_all_postures_that_reach_the_target(panda):
    """Postures found from others, by Newton's method, lie on the curves traced before."""
    q = np.array([0.3, 0.4, -0.2, -1.9, 0.4, 2.2, 0.1])
    target = TipTarget.at_posture(panda, q)
    found = self_motion(panda, target, seed=1)
    low, high = panda.ranges
    drawn = low + np.random.default_rng(99).random((300, 7)) * (high - low)
    others, reached = project(panda, drawn, target)
    others = others[reached]
    assert np.abs(residual(panda, others, target)).max() <= 1e-9
    assert len(others) > 80
    whole = [np.diff(one.q, axis=0) for one in found.components]
    assert max(np.linalg.norm(steps, axis=1).max() for steps in whole) <= 0.05 * 1.2
    nearest = [np.linalg.norm(found.q - one, axis=1).min() for one in others]
    assert max(nearest) <= 0.03  # half a step
    limits = np.array([panda.lower, panda.upper])
    ends = [one.q[i] for one in found.components if not one.closed for i in (0, -1)]
    assert all((limits == end).any() for end in ends)


def test_neighbours_cover_manifolds_of_more_dimensions(panda):
    q = np.array([0.3, 0.4, -0.2, -1.9, 0.4, 2.2, 0.1])
    target = TipTarget.at_posture(panda, q, (0, 1, 2, 3, 4))
    found = self_motion(panda, target, restarts=24, resolution=0.3)
    low, high = panda.ranges
    drawn = low + np.random.default_rng(7).random((100, 7)) * (high - low)
    others, reached = project(panda, drawn, target)
    others = others[reached]
    assert np.abs(residual(panda, others, target)).max() <= 1e-9
    near = [np.linalg.norm(found.q - one, axis=1).min() <= 1.5 * found.step for one in others]
    assert np.mean(near) > 0.95
    assert found.dimension == 2
    apart = np.linalg.norm(found.q[:, None] - found.q[None, ::40], axis=2)
    assert np.sort(apart, axis=0)[1].max() <= 1.5 * found.step


def test_derivative_of_the_residual_is_that_of_finite_differences(panda):
    rng = np.random.default_rng(3)
    for rows in ((3, 4), (0, 2, 5), POSE):
        q, away = rng.uniform(-1.0, 1.0, (2, 7))
        target = TipTarget.at_posture(panda, away, rows)
        r, J = residual_and_jacobian(panda, q, target)
        h = 1e-6
        rates = [
            (residual(panda, q + h * unit, target) - residual(panda, q - h * unit, target))
            / (2 * h)
            for unit in np.eye(7)
        ]
        assert_allclose(J, np.transpose(rates), atol=1e-8)
        many, Js = residuals_and_jacobians(panda, np.array([q, away]), target)
        assert_allclose(many, [r, np.zeros(len(rows))], atol=1e-12)
        assert_allclose(Js[0], J, atol=1e-12)


def test_projection_moves_as_little_as_needed_and_respects_limits(panda):
    q = np.array([0.3, 0.4, -0.2, -1.9, 0.4, 2.2, 0.1])
    target = TipTarget.at_posture(panda, q)
    near = q + 1e-4 * np.random.default_rng(2).normal(size=(5, 7))
    onto, _ = project(panda, near, target)
    J = residual_and_jacobian(panda, q, target)[1]
    null = np.linalg.svd(J)[2][-1]
    assert np.abs((onto - near) @ null).max() <= 1e-7  # orthogonal to the self-motion
    limits = np.array([panda.lower, panda.upper])
    limits[0, 0] = 0.4
    held, _ = project(panda, near, target, limits=limits)
    assert (held[:, 0] >= 0.4).all()
    assert np.abs(residual(panda, held, target)).max() <= 1e-9


def test_result_is_reproducible_and_read_only(panda):
    target = TipTarget.of((0.5, 0.1, 0.4), (PI, 0.0, 0.0))
    calls = []
    one, other = (self_motion(panda, target, restarts=8, progress=lambda *x: calls.append(x))
                  for _ in range(2))  # fmt: skip
    assert_allclose(one.q, other.q, rtol=0, atol=0)
    assert calls[-1] == (one.found_from,) * 2
    assert one.found_from > 0
    with pytest.raises(ValueError, match="read-only"):
        one.q[0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        one.components[0].q[0] = 0.0


# ---- bad input -----------------------------------------------------------------------------------


def test_unreachable_point_says_how_far_the_closest_one_is():
    far = (
        r"^the tip cannot reach the point at \(4, 0, 0\) m in root axes within the joint limits: "
        r"the closest posture found is 1 m away"
    )
    with pytest.raises(InputError, match=far):
        self_motion(planar(), TipTarget.of((4.0, 0.0, 0.0)))
    with pytest.raises(InputError, match=r"is 0\.25 m away"):
        self_motion(planar(), TipTarget.of((1.0, 0.0, 0.25)))
    with pytest.raises(InputError, match=r"cannot reach the pose .* m and .*° away"):
        self_motion(ftforce.load_robot("panda"), TipTarget.of((1.5, 0.0, 0.3), (0.1, 0.2, 0.3)))


def test_limits_that_exclude_everything_are_named(panda):
    limits = np.array([panda.lower, panda.upper])
    limits[0, 2] = 3.0
    with pytest.raises(InputError, match=r"no posture is within the limits: .*'panda_joint3', 3"):
        self_motion(panda, TipTarget.of((0.5, 0.1, 0.4)), limits=limits)
    locked = np.array([[0.1] * 7, [0.1] * 7])
    with pytest.raises(InputError, match="the closest posture found is"):
        self_motion(panda, TipTarget.of((0.5, 0.1, 0.4)), limits=locked)


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: TipTarget.of((1.0, 2.0)), "the tip position needs 3"),
        (lambda: TipTarget.of((1.0, 2.0, math.nan)), "finite"),
        (lambda: TipTarget.of((1.0, 2.0, 3.0), np.ones((3, 3))), "orthonormal"),
        (lambda: TipTarget.of((1.0, 2.0, 3.0), -np.eye(3)), "orthonormal"),
        (lambda: TipTarget.of((1.0, 2.0, 3.0), rows=(0, 4)), "row 4 is angular"),
        (lambda: TipTarget.of((1.0, 2.0, 3.0), rows=(2, 1)), "increasing numbers from 0 to 5"),
        (lambda: TipTarget.of((1.0, 2.0, 3.0), (0.0, 0.0)), "rotation needs"),
    ],
)
def test_malformed_targets_are_named(make, error):
    with pytest.raises((InputError, DimensionError), match=error):
        make()


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"restarts": 0}, "restarts must be an integer of at least 1"),
        ({"seed": -1}, "seed must be an integer of at least 0"),
        ({"step": 0.0}, "step must be a length"),
        ({"resolution": math.inf}, "resolution must be a length"),
        ({"start": [0.0]}, "start needs 3"),
        ({"limits": [[0.0] * 3]}, "limits needs"),
        ({"limits": [[math.nan] * 3] * 2}, "NaN"),
        ({"progress": 3}, "progress is a function"),
    ],
)
def test_malformed_options_are_named(options, error):
    with pytest.raises(InputError, match=error):
        self_motion(planar(), TipTarget.of((1.5, 0.0, 0.0)), **options)
