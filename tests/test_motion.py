"""How an arm follows its reference: SciPy and NumPy written out, limits, singularities, delays."""

import math
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import ftforce
from ftforce.core.faults import FaultSet
from ftforce.trajectory.fault_events import phases, read_events
from ftforce.trajectory.motion import GAIN, LIMIT_GAIN, advance, rates_law
from ftforce.trajectory.reference import PathReference
from ftforce.trajectory.start import Path, Recording, start_of
from helpers import (
    CAMPAIGN,
    LINES,
    SLIDING,
    assert_close,
    campaign,
    differences,
    load_text,
    seeds,
    serial_urdf,
    straight,
)
from urdfs import arm, load

pytestmark = [pytest.mark.thorough, pytest.mark.no_cover]

law = settings(deadline=None, max_examples=campaign(25, 4))
NEVER = math.inf
LONG = np.arange(0.0, 5.0, 0.01)  # s: beyond the end of most paths
KEPT = 1e-5  # m: the bound of the tracking error
Y = {"axis": (0, 1, 0)}


def silent(count):
    """Ignore progress."""


def plane_arm(*, lower=-3.0, upper=3.0, joints=4):
    """Return an arm of equal links in the plane x, z; joint 2 may have narrow limits."""
    steps = [("revolute", dict(Y))]
    steps += [("revolute", {"xyz": (0.3, 0, 0), **Y}) for _ in range(joints - 1)]
    steps[1][1].update(lower=lower, upper=upper)
    return load_text(serial_urdf(*steps).replace("0.11 0.05 0.03", "0.3 0.0 0.0"), tip="tool")


def tip(robot, q):
    """Return place and orientation of the tip, from Pinocchio."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.to_model(np.asarray(q)))
    place = data.oMf[robot.tip_frame]
    return place.translation.copy(), place.rotation.copy()


def follow(robot, trajectory, q=None, *, faults=(), delay=0.0, rate=50, t=None):
    """Return the start and how the arm goes on from it."""
    start = start_of(robot, trajectory, q, rate=rate)
    times = start.times if t is None else np.array(t, dtype=float)
    all_phases = phases(read_events(robot, faults), delay)
    met = tuple(phase for phase in all_phases if phase.start <= times[-1])
    return start, advance(robot, start.reference, start.q, times, met, tick=silent)


def path_error(robot, start, motion, times=None):
    """Return the distance of the tip from its reference at each instant."""
    times = start.times if times is None else times
    targets = [start.reference.at(t).x for t in times.tolist()]
    return np.array(
        [math.dist(x, tip(robot, q)[0]) for x, q in zip(targets, motion.q, strict=True)]
    )


def assert_consistent(t, motion, tol=1e-5):
    """Check that velocities integrate to positions, and accelerations to velocities.

    A spline through accelerations is less exact: they have kinks at the ends of a line.
    """
    for rate, whole, within in ((motion.v, motion.q, tol), (motion.a, motion.v, 10.0 * tol)):
        integral = CubicSpline(t, rate).antiderivative()(t)
        size = max(np.abs(rate).max(), 1e-3)
        assert_close(whole - whole[0], integral, scale=size, tol=within)


# ---- a healthy arm ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", LINES if CAMPAIGN else ["dh5", "kinova", "tiago"])
def test_the_tip_keeps_to_its_line(name):
    robot = ftforce.load_robot(name)
    start, (motion, arrivals) = follow(robot, straight(robot, speed=0.1), rate=100)
    assert path_error(robot, start, motion).max() < KEPT / 10
    assert_consistent(start.times, motion)
    assert not arrivals
    assert (motion.q <= robot.upper + 1e-9).all()
    assert (motion.q >= robot.lower - 1e-9).all()
    assert np.abs(motion.v[[0, -1]]).max() < 1e-5  # at rest where the line ends
    assert np.abs(motion.v).max() > 0.01


@pytest.mark.parametrize("keep", [False, True])
def test_the_motion_is_that_of_an_ode_written_out(keep):
    """SciPy integrates J†(ẋ + k e) with NumPy's pseudoinverse and a Jacobian by differences."""
    robot = ftforce.load_robot("panda")
    path = straight(robot, speed=0.3, keep_orientation=keep)
    start, (motion, _) = follow(robot, path, rate=10)
    R0 = tip(robot, start.q)[1]

    def rates(t, q):
        (place, R), (x, x_dot) = tip(robot, q), path.at(t)
        wanted = [x_dot + GAIN * (x - place)]
        if keep:
            wanted.append(GAIN * pin.log3(R0 @ R.T))
        J = differences(robot, q)[: 3 * len(wanted)]
        return np.linalg.pinv(J) @ np.concatenate(wanted)

    t = start.times
    found = solve_ivp(rates, (0.0, t[-1]), start.q, t_eval=t, rtol=1e-8, atol=1e-10)
    assert_close(motion.q, found.y.T, scale=1.0, tol=1e-6)
    v = np.array([rates(*row) for row in zip(t.tolist(), motion.q, strict=True)])
    assert_close(motion.v, v, scale=1.0, tol=1e-6)


@pytest.mark.parametrize("rate", [2.0, 7.0, 200.0])
def test_accelerations_do_not_depend_on_the_rate(rate):
    robot = ftforce.load_robot("dh5")
    path = straight(robot)
    start, (motion, _) = follow(robot, path, rate=rate)
    fine, (wanted, _) = follow(robot, path, rate=100)
    spline = CubicSpline(fine.times, wanted.v)
    inside = start.times < path.duration - 0.1  # where a spline through samples sees no end
    assert_close(motion.a[inside], spline(start.times[inside], 1), tol=3e-4)


def test_waypoints_with_corners_are_met():
    robot = ftforce.load_robot("panda")
    x = tip(robot, ftforce.analyze(robot, force=[1, 0, 0]).posture.q)[0]
    points = x + np.array([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, -0.1)])
    path = Path.through(points, speed=0.3)
    start, (motion, _) = follow(robot, path, t=path.times)
    assert_close([tip(robot, q)[0] for q in motion.q], points, tol=KEPT)
    assert np.abs(motion.v).max() < 1e-5
    start, (motion, _) = follow(robot, path, rate=50)
    assert path_error(robot, start, motion).max() < KEPT


def test_an_arm_that_starts_beside_its_path_returns_to_it():
    """The distance falls with e^(-kt), and while it is long as fast as the path at most."""
    robot = ftforce.load_robot("panda")
    path = straight(robot, speed=0.1)
    start = start_of(robot, path, rate=20)
    q = start.q + np.linalg.pinv(differences(robot, start.q)[:3]) @ [0.0, 0.0, 1e-3]
    t = np.linspace(0.0, 1.0, 21)
    (phase,) = phases((), 0.0)
    motion, _ = advance(robot, start.reference, q, t, (phase,), tick=silent)
    error = path_error(robot, start, motion, t)
    assert_close(error, error[0] * np.exp(-GAIN * t), tol=1e-3)
    far = start.q + np.linalg.pinv(differences(robot, start.q)[:3]) @ [0.0, 0.0, 0.05]
    motion, _ = advance(robot, start.reference, far, t, (phase,), tick=silent)
    error = path_error(robot, start, motion, t)
    assert_close(error[0] - error[1:9], 0.1 * t[1:9], tol=1e-3)
    assert error[-1] < 0.1 * error[0]


def test_an_orientation_that_is_off_is_corrected():
    """By a turn about one axis whose angle falls with e^(-kt)."""
    path = straight(PANDA, keep_orientation=True)
    start = start_of(PANDA, path, rate=20)
    twist = np.array([0.0, 0.0, 0.0, 0.0, 3e-3, 4e-3])
    q = start.q + np.linalg.pinv(differences(PANDA, start.q)) @ twist
    t, (phase,) = np.linspace(0.0, 0.5, 21), phases((), 0.0)
    motion, _ = advance(PANDA, start.reference, q, t, (phase,), tick=silent)
    R = tip(PANDA, start.q)[1]
    angles = np.array([np.linalg.norm(pin.log3(R.T @ tip(PANDA, q)[1])) for q in motion.q])
    assert angles[0] == pytest.approx(5e-3, rel=1e-2)
    assert_close(angles, angles[0] * np.exp(-GAIN * t), tol=1e-2)


# ---- limits ----------------------------------------------------------------------------------


def test_redundancy_respects_a_limit_that_is_met_on_the_way():
    q = np.array([-1.0, 0.8, 0.7, 0.5])
    change = (-0.25, 0.0, -0.25)
    wide = plane_arm()
    _, (free, _) = follow(wide, straight(wide, change, q=q), q)
    assert free.q[:, 1].max() > 0.95
    narrow = plane_arm(upper=0.9)
    start, (motion, _) = follow(narrow, straight(narrow, change, q=q), q, rate=200)
    assert motion.q[:, 1].max() <= 0.9
    assert motion.q[:, 1].max() > 0.89
    assert path_error(narrow, start, motion).max() < KEPT
    assert_consistent(start.times, motion, tol=1e-3)
    # Ahead of its limit a joint slows down.
    assert (motion.v[:, 1] <= LIMIT_GAIN * (0.9 - motion.q[:, 1]) + 1e-9).all()


@pytest.mark.parametrize("name", ["panda", "kinova", "ur5"] if CAMPAIGN else ["panda"])
def test_speeds_stay_within_the_urdf_s(name):
    """The tip is asked to go faster than the joints can; it falls behind, and arrives."""
    robot = ftforce.load_robot(name)
    speeds = np.array([joint.velocity for joint in robot.joints])
    path = straight(robot, 2.0 * np.array(LINES[name]), speed=8.0)
    t = np.linspace(0.0, path.duration + 3.0, 200)
    start, (motion, _) = follow(robot, path, t=t, rate=1000)
    assert (np.abs(motion.v) <= speeds * (1.0 + 1e-9)).all()
    assert (np.abs(motion.v) > speeds * 0.999).any()
    error = path_error(robot, start, motion, t)
    assert error.max() > 0.01
    assert error[-1] < KEPT


def test_joints_whose_speed_is_unknown_are_as_fast_as_they_need(tmp_path):
    unlimited = arm().replace(' velocity="3"', "")
    robot, slow = load(tmp_path, unlimited, tip="tool"), load(tmp_path, arm(), tip="tool")
    assert [joint.velocity for joint in robot.joints] == [None] * 4
    q = np.array([0.2, 0.5, 0.4, 0.3])
    path = straight(robot, (-0.1, 0.0, 0.0), speed=2.0, q=q)
    for one, most in ((robot, 50.0), (slow, 3.0)):
        start, (motion, _) = follow(one, path, q, rate=1000)
        assert np.abs(motion.v).max() < most + 1e-9
        if one is robot:
            assert np.abs(motion.v).max() > 3.0
            assert path_error(one, start, motion).max() < KEPT


@given(seeds)
@law
def test_limits_are_kept_wherever_the_arm_is_asked_to_go(seed):
    rng = np.random.default_rng(seed)
    robot = plane_arm(lower=-0.5, upper=0.5)
    speeds = np.array([joint.velocity for joint in robot.joints])
    q = rng.uniform(0.9 * robot.lower, 0.9 * robot.upper)  # they lie on both sides of 0
    x = tip(robot, q)[0]
    change = rng.normal(scale=0.3, size=3) * [1.0, 0.0, 1.0]
    change *= max(1.0, 0.2 / np.linalg.norm(change))  # it takes some samples
    path = Path.through([x, x + change], speed=float(rng.uniform(0.2, 1.0)))
    _, (motion, _) = follow(robot, path, q, rate=20)
    assert (motion.q <= robot.upper + 1e-6).all()
    assert (motion.q >= robot.lower - 1e-6).all()
    assert (np.abs(motion.v) <= speeds + 1e-9).all()
    assert np.isfinite(motion.a).all()


# ---- singularities ---------------------------------------------------------------------------


def test_past_a_singularity_velocities_stay_bounded_and_the_path_is_found_again():
    """The line leaves the reach of a stretched arm by 2 cm, and comes back."""
    robot = plane_arm(joints=3)
    reach = 0.9
    path = Path.through([(0.8, 0, -0.2), (reach + 0.02, 0, 0), (0.8, 0, 0.2)], speed=0.1)
    start, (motion, _) = follow(robot, path, [-0.3, 0.6, 0.5], rate=50)
    error = path_error(robot, start, motion)
    assert error.max() == pytest.approx(0.02, rel=0.1)
    assert error[-1] < KEPT
    assert np.abs(motion.v).max() <= 1.0 + 1e-9  # the URDF's
    assert np.isfinite(motion.a).all()


# ---- faults ----------------------------------------------------------------------------------


@given(seeds)
@law
def test_the_law_after_a_lock_is_appendix_a(seed):
    """v_H + K†(ẋ - K v_H) with NumPy, v_H of the healthy arm at the same posture."""
    rng = np.random.default_rng(seed)
    robot = PANDA
    q = robot.lower + rng.uniform(0.1, 0.9, size=7) * (robot.upper - robot.lower)
    x = tip(robot, q)[0]
    path = Path.through([x, x + rng.normal(scale=0.2, size=3)], speed=0.02)
    reference, t = PathReference(robot, path, q), float(rng.uniform(0.0, 0.2))
    locked = rng.choice(7, size=rng.integers(1, 3), replace=False).tolist()
    J = differences(robot, q)[:3]
    H = [i for i in range(7) if i not in locked]
    if np.linalg.svd(J[:, H], compute_uv=False)[-1] < 0.02 * np.linalg.norm(J, 2):
        return  # damped
    place, x_dot = path.at(t)
    asked = x_dot + GAIN * (place - x)
    v_healthy = np.linalg.pinv(J) @ asked
    wanted = np.zeros(7)
    wanted[H] = v_healthy[H] + np.linalg.pinv(J[:, H]) @ (asked - J[:, H] @ v_healthy[H])
    got = rates_law(robot, reference, FaultSet.locked(locked))(t, q)
    assert_close(got, wanted, scale=np.linalg.norm(asked), tol=1e-6)
    assert not got[locked].any()
    assert_close(J @ got, asked, tol=1e-6)
    assert_close(rates_law(robot, reference, FaultSet())(t, q), v_healthy, tol=1e-6)


PANDA = ftforce.load_robot("panda")


def test_a_joint_that_swings_is_not_asked_to_help():
    """Once a joint locks, one without torque goes on as the healthy arm's does."""
    path = straight(PANDA)
    start = start_of(PANDA, path, rate=10)
    t = 0.5 * path.duration
    q = follow(PANDA, path, t=[0.0, t])[1].motion.q[1]
    faults = phases(read_events(PANDA, ["3@0", "free:5@0"]), 0.0)[0].known
    got = rates_law(PANDA, start.reference, faults)(t, q)
    J, asked = differences(PANDA, q)[:3], path.at(t)[1]
    v = np.linalg.pinv(J) @ asked
    kept, M = [i for i in range(7) if i != 2], [0, 1, 3, 5, 6]
    v[M] += np.linalg.pinv(J[:, M]) @ (asked - J[:, kept] @ v[kept])
    v[2] = 0.0
    assert_close(got, v, tol=1e-4)


ALL_LOCKS = list(product((0.0, 0.4, 0.5, 0.512345, 1.0), ("3", "3,5", "4")))
SOME_LOCKS = [(0.0, "4"), (0.4, "3,5"), (0.512345, "3")]


@pytest.mark.parametrize(("when", "faults"), ALL_LOCKS if CAMPAIGN else SOME_LOCKS)
def test_the_arm_keeps_to_its_path_after_a_lock(when, faults):
    path = straight(PANDA, speed=0.3)
    start, (motion, arrivals) = follow(PANDA, path, faults=f"{faults}@{when}", rate=100)
    late, joints = start.times >= when, [int(number) - 1 for number in faults.split(",")]
    assert path_error(PANDA, start, motion).max() < KEPT
    for k in joints:
        assert np.ptp(motion.q[late, k]) == 0.0
        assert not motion.v[late, k].any()
        assert not motion.a[late, k].any()
    assert list(arrivals) == ([when] if when else [])
    if when:
        state = arrivals[when]
        assert_close(motion.q[late][:, joints], np.tile(state.q[joints], (late.sum(), 1)))
        assert np.abs(state.v[joints]).max() > 0.0  # right before
    parts = [part for part in (start.times < when, late) if part.sum() > 8]
    for part in parts:
        assert_consistent(start.times[part], type(motion)(*(x[part] for x in motion)), tol=1e-5)


def test_until_the_controller_knows_the_others_go_on_as_planned():
    path = straight(PANDA, speed=0.3)
    start, (healthy, _) = follow(PANDA, path, rate=100)
    _, (motion, arrivals) = follow(PANDA, path, faults="4@0.3", delay=0.4, rate=100)
    t, others = start.times, [0, 1, 2, 4, 5, 6]
    blind, knows = (t >= 0.3) & (t < 0.7 - 1e-9), t >= 0.7 + 1e-9
    assert list(arrivals) == [0.3, 0.7]
    assert_close(motion.q[t < 0.3], healthy.q[t < 0.3], tol=1e-7)
    assert_close(motion.q[blind][:, others], healthy.q[blind][:, others], tol=1e-7)
    assert_close(motion.v[blind][:, others], healthy.v[blind][:, others], tol=1e-6)
    assert np.ptp(motion.q[t >= 0.3, 3]) == 0.0
    error = path_error(PANDA, start, motion)
    assert error[blind].max() > 1e-3
    assert error[knows][0] == pytest.approx(error[blind][-1], rel=0.1)
    assert error[-1] < 0.05 * error.max()
    assert_close(arrivals[0.7].q[others], healthy.q[70][others], tol=1e-6)
    assert arrivals[0.7].v[3] == 0.0


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-9, 1e-5])
def test_events_that_come_close_to_each_other(gap):
    """As 0.3 and 0.1 + 0.2 do."""
    path = straight(PANDA, speed=0.3)
    events = ["3@0.3", f"5@{0.1 + 0.2 + gap!r}", f"6@{math.nextafter(0.3, 0.0)!r}"]
    start, (motion, _) = follow(PANDA, path, faults=events, delay=gap / 2, rate=50)
    assert path_error(PANDA, start, motion).max() < KEPT
    assert np.ptp(motion.q[16:, [2, 4, 5]], axis=0).max() == 0.0
    assert np.isfinite(motion.a).all()


# ---- joints of other kinds -------------------------------------------------------------------


@pytest.mark.parametrize("faults", ["", "1@1", "3@0.5", "4@0.7", "1,5@0.7"])
def test_joints_that_slide_and_turn_without_end(faults):
    robot = load_text(SLIDING, tip="tool")
    q = np.array([0.1, 3.0, 0.4, 0.2, 4.0])  # beyond half a turn
    path = straight(robot, (0.1, 0.15, -0.1), q=q)
    start, (motion, _) = follow(robot, path, q, faults=faults or (), rate=100)
    assert path_error(robot, start, motion).max() < KEPT
    assert_close(start.q, q)
    assert np.abs(np.diff(motion.q, axis=0)).max() < 0.05  # no turn is dropped
    if not faults:
        assert_consistent(start.times, motion)


# ---- recorded motions ------------------------------------------------------------------------


def recorded(robot, q, *, velocities=False, count=41, end=2.0):
    """Return a recording of smooth joint motions and what it is made of."""
    t = np.linspace(0.0, end, count)
    swing = 0.15 * np.sin(np.outer(t, 1.0 + 0.2 * np.arange(robot.n)))
    rate = 0.15 * (1.0 + 0.2 * np.arange(robot.n))
    v = rate * np.cos(np.outer(t, 1.0 + 0.2 * np.arange(robot.n)))
    a = (
        -rate
        * (1.0 + 0.2 * np.arange(robot.n))
        * np.sin(np.outer(t, 1.0 + 0.2 * np.arange(robot.n)))
    )
    return Recording.of(robot, t, q + swing, v if velocities else None), q + swing, v, a


@pytest.mark.parametrize("velocities", [False, True])
def test_a_recorded_motion_is_what_was_recorded(velocities):
    q = ftforce.analyze(PANDA, force=[1, 0, 0]).posture.q
    recording, wanted, v, a = recorded(PANDA, q, velocities=velocities)
    start, (motion, _) = follow(PANDA, recording, rate=None)
    assert_close(start.times, recording.t)
    assert_close(motion.q, wanted, tol=1e-12)
    inner = slice(3, -3)
    assert_close(motion.v[inner], v[inner], tol=1e-12 if velocities else 1e-4)
    assert_close(motion.a[inner], a[inner], tol=2e-3)
    assert path_error(PANDA, start, motion).max() < 1e-12


def test_recorded_velocities_count_even_if_they_do_not_fit_the_positions():
    q = ftforce.analyze(PANDA, force=[1, 0, 0]).posture.q
    recording, _, v, _ = recorded(PANDA, q)
    other = Recording.of(PANDA, recording.t, recording.q, 1.1 * v + 0.01)
    start, (motion, _) = follow(PANDA, other, rate=33.0)
    spline = CubicSpline(recording.t, 1.1 * v + 0.01)
    assert_close(motion.v, spline(start.times))
    assert_close(motion.a, spline(start.times, 1))


@pytest.mark.parametrize("velocities", [False, True])
@pytest.mark.parametrize("rate", [None, 33.0])
def test_after_a_lock_a_recorded_tip_keeps_to_its_path(velocities, rate):
    q = ftforce.analyze(PANDA, force=[1, 0, 0]).posture.q
    recording, *_ = recorded(PANDA, q, velocities=velocities)
    start, (motion, _) = follow(PANDA, recording, faults="3@0.8", rate=rate)
    assert path_error(PANDA, start, motion).max() < KEPT
    late = start.times >= 0.8
    assert np.ptp(motion.q[late, 2]) == 0.0
    # The others stay close to what was recorded: Appendix A with its velocities.
    i = int(np.flatnonzero(late)[0])
    J, target = differences(PANDA, motion.q[i])[:3], start.reference.at(start.times[i])
    v_H = target.nominal_velocity.copy()
    place = tip(PANDA, motion.q[i])[0]
    v_H += np.linalg.pinv(J) @ (target.x_dot + GAIN * (target.x - place) - J @ v_H)
    v_H[2], J[:, 2] = 0.0, 0.0
    wanted = v_H + np.linalg.pinv(J) @ (target.x_dot + GAIN * (target.x - place) - J @ v_H)
    assert_close(motion.v[i], wanted, tol=1e-5)


def test_recorded_angles_may_jump_by_whole_turns():
    robot = ftforce.load_robot("kinova")
    endless = np.array([joint.type == "continuous" for joint in robot.joints])
    assert endless.any()
    q = ftforce.analyze(robot, force=[1, 0, 0]).posture.q
    q = np.where(endless, np.pi - 0.05, q)
    recording, wanted, v, _ = recorded(robot, q)
    wrapped = np.where(endless, (wanted + np.pi) % (2.0 * np.pi) - np.pi, wanted)
    assert np.abs(np.diff(wrapped, axis=0)).max() > 6.0
    _, (motion, _) = follow(robot, Recording.of(robot, recording.t, wrapped), rate=None)
    _, (plain, _) = follow(robot, recording, rate=None)
    assert_close(motion.v, plain.v, tol=1e-9)
    turns = (motion.q - wanted) / (2.0 * np.pi)
    assert_close(turns, np.round(turns), scale=1.0)
    assert_close(motion.v[3:-3], v[3:-3], tol=1e-3)


# ---- progress --------------------------------------------------------------------------------
