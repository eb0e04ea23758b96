"""An arm over time: instants beside `analyze`, MuJoCo, energies, Appendix A written out."""

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

import ftforce
import physics
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.limits import Limits
from ftforce.core.verdict import VERDICTS
from ftforce.errors import DimensionError, FtforceError, InputError, TrajectoryError
from ftforce.robot.kinematics import tip_pose
from ftforce.robot.posture import choose_posture
from ftforce.trajectory import Path, Recording
from ftforce.trajectory.fault_events import phases, read_events
from ftforce.trajectory.history import QUANTITIES
from ftforce.trajectory.history_files import history_bytes
from ftforce.trajectory.simulate import _memory, simulate
from helpers import (
    CAMPAIGN,
    SLIDING,
    assert_close,
    campaign,
    peak_memory,
    serial_urdf,
    straight,
)
from results import massless
from urdfs import arm, followed, load

law = settings(deadline=None, max_examples=campaign(12, 2))
PUSH = (80.0, 50.0, 10.0)  # N
AGREES = 5e-5  # of the force, as in test_physics


def named(faults):
    """Return a fault set as options of `analyze`."""
    by_mode = {mode: [i + 1 for i in faults.in_mode(mode)] for mode in FaultMode}
    factors = {fault.joint + 1: fault.factor for fault in faults.faults}
    weak = {joint: factors[joint] for joint in by_mode[FaultMode.WEAK]}
    return {"locked": by_mode[FaultMode.LOCKED], "free": by_mode[FaultMode.FREE], "weak": weak}


def set_at(robot, events, t, delay=0.0):
    """Return the faults that there are, and those that are known, at a time."""
    phase = [p for p in phases(read_events(robot, events), delay) if p.start <= t][-1]
    return phase.actual, phase.known


def assert_as_analyzed(robot, run, i, faults, **options):
    """Compare an instant with `analyze`."""
    told = ftforce.analyze(
        robot, run.q[i], **named(faults), velocity=run.v[i], acceleration=run.a[i], **options
    )
    assert VERDICTS[run.verdict[i]] is told.verdict
    assert run.margin[i] == pytest.approx(told.margin, rel=1e-9, abs=1e-12)
    assert_close(run.rnea[i], told.rnea.after, tol=1e-9)
    if told.force.after is None:
        for name in ("force", "jump", "U", "motor"):
            assert np.isnan(getattr(run, name)[i]).all()
        return False
    scale = max(np.abs(told.force.before).max(), 1e-3)
    assert_close(run.force[i], told.force.after, scale=scale, tol=1e-8)
    assert_close(run.jump[i], told.force.jump, scale=scale, tol=1e-8)
    torque = told.torque
    scale = max(np.abs(torque.before).max(), np.abs(run.rnea[i]).max(), 1e-3)
    free = faults.free_mask(robot.n)
    commanding = ~faults.mask(robot.n) & (True if free is None else ~free)
    assert_close(run.force_part[i], torque.before, scale=scale, tol=1e-8)
    pushing = np.where(commanding, torque.after, 0.0)  # exact up to directions within rtol
    assert_close(run.U[i], pushing, scale=scale, tol=1e-6)
    assert_close(run.motor[i], np.where(commanding, run.rnea[i] + run.U[i], 0.0), scale=scale)
    if torque.total_after is not None:
        assert_close(run.motor[i], torque.total_after, scale=scale, tol=1e-8)
    if torque.brake_load is not None:
        assert_close(run.brake[i], torque.brake_load, scale=scale, tol=1e-8)
    assert not run.unbalanced[i].any()
    return True


# ---- with the remap every instant is an analysis ---------------------------------------------

LIMITED = Limits.of([87.0, 30.0, 87.0, 25.0, 12.0, 12.0, 12.0], [50.0] * 7)
CASES = {
    "no fault": ("dh5", (), {}),
    "one lock": ("dh5", "3@1", {}),
    "a lock that costs": ("dh5", "2,3@1", {}),
    "locks in turn": ("panda", ["2@0.5", "4@0.5001", "6@1"], {}),
    "from the start": ("ur5", "2@0", {}),
    "world": ("panda", "2,4@1", {"axes": "world"}),
    "free": ("panda", "free:4@1", {}),
    "free, limits": ("panda", ["free:4@0.5", "2@1"], {"limits": "urdf"}),
    "weak": ("panda", "weak:2:0.3,4:0.4@1", {}),
    "weak, then locked": ("panda", ["weak:2:0.2@0.5", "2@1"], {}),
    "weak, then free": ("panda", ["weak:2:0.2@0.5", "free:2@1"], {}),
    "weak without limits": ("panda", "weak:2:0.2@0.5", {"limits": "none"}),
    "brakes": ("panda", ["2@0.5", "weak:4:0.5@1"], {"limits": LIMITED}),
    "overloaded": ("dh5", "weak:1:0.02,2:0.02,3:0.02@1", {}),
    "payload": ("panda", ["4@0.5", "free:2@1"], {"payload": (2.0, (0.0, 0.1, 0.1))}),
    "gravity": ("ur5", "3@1", {"gravity": (1.0, -2.0, -3.0), "payload": 1.0}),
    "no gravity": ("dh5", "free:3@1", {"gravity": (0.0, 0.0, 0.0)}),
    "wrench": ("ur5", "2@1", {"task": "wrench", "length": 0.3, "force": (8, 5, 1, 1, 2, 3)}),
    "moment": ("panda", "2,4@1", {"task": "moment", "length": 0.2, "force": (1, 2, 3)}),
    "components": ("panda", "free:2@1", {"task": "fx,fz,my", "length": 0.2, "force": (9, 5, 1)}),
    "no force": ("dh5", "3@1", {"force": (0, 0, 0)}),
    "sliding": ("tiago", "1@0.5", {"limits": "urdf", "force": (5, 8, 9)}),
    "continuous": ("kinova", ["1@0.5", "free:3@1"], {"force": (5, 8, 9)}),
    "tolerances": ("dh5", "2@1", {"rtol": 1e-4, "wary": 0.2}),
}


QUICK = ("a lock that costs", "locks in turn", "from the start", "free, limits", "weak, then free",
         "weak without limits", "brakes", "payload", "wrench", "components", "no force", "sliding",
         "tolerances")  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("case", CASES if CAMPAIGN else QUICK)
def test_every_instant_with_the_remap_is_an_analysis(case):
    name, events, options = CASES[case]
    robot, options = ftforce.load_robot(name), {"force": PUSH, **options}
    history = simulate(robot, straight(robot), faults=events, rate=7, **options)
    run = history.remapped
    options = {"limits": history.setting.limits, **options}  # of a weak joint from the start on
    stood = [
        assert_as_analyzed(robot, run, i, set_at(robot, events, t)[0], **options)
        for i, t in enumerate(history.t.tolist())
    ]
    assert any(stood)
    for i in range(0, len(history.t), 3):
        assert_as_analyzed(robot, history.healthy, i, FaultSet(), **options)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_without_the_remap_a_weak_motor_gives_what_it_can_either_way(panda, sign):
    case = {"force": (0.0, 0.0, sign * 60.0), "gravity": (0, 0, 0), "limits": "urdf", "rate": 5}
    history = simulate(panda, straight(panda), faults="weak:2:0.1@0.5", remap=False, **case)
    after = history.t >= 0.5
    assert (sign * history.healthy.motor[after, 1] > 0.1 * panda.effort[1]).all()
    assert_close(history.unremapped.motor[after, 1], np.full(after.sum(), sign * 8.7))


def test_once_the_remap_acts_every_instant_is_an_analysis(panda):
    """And before, it is not."""
    events, delay = ["4@0.5", "free:2@0.9"], 0.3
    history = simulate(panda, straight(panda), force=PUSH, faults=events, delay=delay, rate=10)
    compared = 0
    for i, t in enumerate(history.t.tolist()):
        actual, known = set_at(panda, events, t, delay)
        if actual == known:
            compared += assert_as_analyzed(panda, history.remapped, i, actual, force=PUSH)
    assert compared > len(history.t) / 2
    assert compared < len(history.t) - 4


@given(st.data())
@law
def test_random_faults_beside_analyze(data):
    robot = ftforce.load_robot("panda")
    joints = data.draw(st.permutations(range(1, 8)))[: data.draw(st.integers(1, 3))]
    modes = st.sampled_from(["{}@{}", "free:{}@{}", "weak:{}:0.3@{}"])
    times = st.sampled_from([0.0, 0.3, 0.5, 0.77])
    events = [data.draw(modes).format(joint, data.draw(times)) for joint in joints]
    force = data.draw(st.sampled_from([PUSH, (0.0, 0.0, -30.0), (1.0, 0.0, 0.0)]))
    limits = data.draw(st.sampled_from(["urdf", "none"]))
    options = {"force": force, "limits": limits}
    history = simulate(robot, straight(robot), faults=events, rate=4, **options)
    for i, t in enumerate(history.t.tolist()):
        faults, _ = set_at(robot, events, t)
        assert_as_analyzed(robot, history.remapped, i, faults, **options)


# ---- the healthy run and the shape of a history ----------------------------------------------


def test_before_a_fault_all_runs_are_the_same(panda):
    history = simulate(panda, straight(panda), force=PUSH, faults="3@0.8", delay=0.2, rate=20)
    before, n = history.t < 0.8, len(history.t)
    for name in QUANTITIES:
        healthy = getattr(history.healthy, name)
        assert len(healthy) == n
        assert not healthy.flags.writeable
        for run in (history.unremapped, history.remapped):
            other = getattr(run, name)
            assert other.shape == healthy.shape
            assert_close(other[before], healthy[before], scale=100.0, tol=1e-6)
    assert list(history.runs) == ["healthy", "unremapped", "remapped"]
    assert history.answer is history.remapped


def test_without_the_remap(panda):
    history = simulate(panda, straight(panda), force=PUSH, faults="3@0.8", remap=False, rate=20)
    assert history.remapped is None
    assert list(history.runs) == ["healthy", "unremapped"]
    assert history.answer is history.unremapped
    assert math.isinf(history.setting.delay)
    late = simulate(
        panda, straight(panda), force=PUSH, faults="3@0.8", delay=np.float32(9.5), rate=5
    )
    assert late.setting.delay == 9.5


def test_a_delay_longer_than_the_rest_is_a_run_without_the_remap(panda):
    history = simulate(panda, straight(panda), force=PUSH, faults=["3@0.8", "free:2@1"], delay=1e3,
                       rate=20)  # fmt: skip
    for name in QUANTITIES:
        one, other = (getattr(run, name) for run in (history.remapped, history.unremapped))
        assert_close(one, other, scale=100.0, tol=1e-7)


def test_the_same_input_gives_the_same_bytes(panda):
    options = {"force": PUSH, "faults": ["3@0.5", "free:4@0.7"], "delay": 0.1, "rate": 20}
    one, other = (simulate(panda, straight(panda), **options) for _ in range(2))
    for name, run in one.runs.items():
        for quantity in QUANTITIES:
            again = getattr(other.runs[name], quantity)
            assert getattr(run, quantity).tobytes() == again.tobytes()
    assert one.t.tobytes() == other.t.tobytes()
    assert one.path.tobytes() == other.path.tobytes()
    assert one.setting == other.setting


@pytest.mark.parametrize("when", [0.8, 0.83])
def test_an_event_at_a_sample_and_between(panda, when):
    history = simulate(panda, straight(panda), force=PUSH, faults=f"3@{when}", rate=10)
    assert_close(history.t, np.arange(len(history.t)) / 10)
    stopped = np.flatnonzero(history.remapped.v[:, 2] == 0.0)
    assert stopped[1] == math.ceil(when * 10 - 1e-9)  # the first is the start, at rest
    assert history.index(when) == 8
    moves = history.unremapped.brake[:, 2] != 0.0
    assert (np.flatnonzero(moves) == np.arange(stopped[1], len(history.t))).all()


def test_place_path_and_velocity_errors_by_differences(panda):
    """The path error is what is missing, and its derivative the velocity that is."""
    path = straight(panda)
    history = simulate(panda, path, force=PUSH, faults="4@0.5", delay=0.5, rate=100)
    for run in history.runs.values():
        data = panda.model.createData()
        for i in range(0, len(history.t), 20):
            pin.framesForwardKinematics(panda.model, data, panda.to_model(run.q[i]))
            place = data.oMf[panda.tip_frame]
            assert_close(run.position[i], place.translation, tol=1e-12)
            turned = pin.Quaternion(*run.orientation[i][[3, 0, 1, 2]]).toRotationMatrix()
            assert_close(turned, place.rotation, tol=1e-12)
            assert_close(history.path[i], path.at(history.t[i])[0], tol=1e-12)
        assert_close(run.path_error, history.path - run.position, scale=1.0, tol=1e-12)
        assert_close(run.path_error_norm, np.linalg.norm(run.path_error, axis=1))
    late = slice(52, 98)  # between the fault and the remap
    for run in (history.unremapped, history.remapped):
        quotient = CubicSpline(history.t[late], -run.path_error[late])(history.t[late], 1)
        assert_close(run.velocity_jump[late][3:-3], quotient[3:-3], tol=1e-3)


# ---- energy ----------------------------------------------------------------------------------


def energies(robot, run, payload=None):
    """Return the mechanical energy of each instant, from Pinocchio and by hand."""
    model, found = robot.model, []
    data = model.createData()
    for q, v in zip(run.q, run.v, strict=True):
        x = robot.to_model(q)
        energy = pin.computeKineticEnergy(model, data, x, v)
        energy += pin.computePotentialEnergy(model, data, x)
        if payload is not None:
            mass, offset = payload
            pin.forwardKinematics(model, data, x, v)
            pin.updateFramePlacements(model, data)
            place = data.oMf[robot.tip_frame]
            twist = pin.getFrameVelocity(model, data, robot.tip_frame, pin.LOCAL_WORLD_ALIGNED)
            arm_ = place.rotation @ offset
            speed = twist.linear + np.cross(twist.angular, arm_)
            energy += 0.5 * mass * speed @ speed + mass * 9.81 * (place.translation + arm_)[2]
        found.append(energy)
    return np.array(found)


POWERS = [  # robot, faults, payload, force in world axes
    ("ur5", (), None, (0, 0, 0)),
    ("panda", "4@0.5", (2.0, (0.02, 0.1, 0.05)), (0, 0, 0)),  # a brake does no work
    ("panda", "4@0.5", None, PUSH),
]


@pytest.mark.parametrize(("name", "faults", "payload", "force"), POWERS, ids=str)
def test_motors_give_what_the_arm_gains_and_what_the_tip_does(name, faults, payload, force):
    robot = ftforce.load_robot(name)
    options = {"force": force, "axes": "world", "faults": faults, "payload": payload}
    history = simulate(robot, straight(robot), rate=100, **options)
    load = None if payload is None else (payload[0], np.array(payload[1]))
    run, energy = history.remapped, energies(robot, history.remapped, load)
    assert np.ptp(energy) > 1e-3
    for part in (slice(0, 50), slice(50, None)):  # before and after the fault
        t = history.t[part]
        spent = (run.v * run.motor).sum(axis=1)[part]
        gained = CubicSpline(t, energy[part])(t, 1)
        speed = CubicSpline(t, run.position[part])(t, 1)
        outside = (speed * run.force[part]).sum(axis=1)
        assert_close(spent[5:-5], (gained + outside)[5:-5], tol=1e-3)


# ---- without the remap: MuJoCo ---------------------------------------------------------------


def old_torques(robot, run, i, joint, *, payload=None):
    """Return the torques of motors that carry the weight at rest and push as before.

    What MuJoCo needs for the motion is taken off, so that it can start at rest.
    """
    around = {"payload": payload}
    moving = physics.inverse_dynamics(robot, run.q[i], run.v[i], run.a[i], **around)
    weight = physics.inverse_dynamics(robot, run.q[i], 0.0, 0.0, **around)
    tau = run.motor[i] - moving + weight
    if joint is not None:
        assert run.motor[i][joint] == 0.0
    return tau


HANGING = physics.Payload(1.5, (0.05, -0.02, 0.1))
HELD = [  # robot, joints that lock and that go free, payload
    ("dh5", [], [2], None),
    ("panda", [], [3], HANGING),
    ("panda", [3], [], None),
    ("panda", [1], [3], None),
]
if CAMPAIGN:
    HELD += [("dh5", [], [2], HANGING), ("panda", [], [1], HANGING), ("ur5", [], [2], HANGING)]
    HELD += [("panda", [1], [], None), ("panda", [5], [], None), ("ur5", [], [2], None)]


@pytest.mark.parametrize(("name", "locked", "free", "payload"), HELD, ids=str)
def test_old_torques_while_the_tip_is_held(name, locked, free, payload):
    robot = ftforce.load_robot(name)
    faults = [*(f"{i + 1}@0.5" for i in locked), *(f"free:{i + 1}@0.5" for i in free)]
    load = None if payload is None else tuple(payload)
    history = simulate(robot, straight(robot), force=PUSH, faults=faults, payload=load, rate=10)
    run, scale = history.unremapped, np.linalg.norm(PUSH)
    for i in (5, 8):
        tau = old_torques(robot, run, i, (locked + free)[-1], payload=payload)
        seen = physics.pinned(robot, run.q[i], tau, locked=locked, payload=payload)
        assert_close(run.force[i], seen.force, scale=scale, tol=AGREES)
        assert_close(run.jump[i], PUSH - run.force[i], scale=scale)
        weight = physics.inverse_dynamics(robot, run.q[i], 0.0, 0.0, payload=payload)
        load = seen.load - weight + run.rnea[i]
        if not free:  # nothing accelerates
            assert_close(run.brake[i][locked], load[locked], scale=scale, tol=AGREES)
        if not locked:  # what is left of the torques accelerates the arm
            M = physics.mass_matrix(robot, run.q[i], payload)
            assert_close(np.linalg.solve(M, run.unbalanced[i]), seen.acceleration, tol=AGREES)
            assert run.verdicts[i] is ftforce.Verdict.NOT_TOLERATED
            assert np.linalg.norm(run.jump[i]) > 1.0 or i == 5


def test_known_and_unknown_faults_at_once(panda):
    """A lock is known, a joint that goes free later is not yet."""
    events = ["2@0.4", "free:4@0.9"]
    history = simulate(panda, straight(panda), force=PUSH, faults=events, delay=0.3, rate=10)
    run, scale, i = history.remapped, np.linalg.norm(PUSH), 10
    told = ftforce.analyze(panda, run.q[i], locked=[2], force=PUSH, velocity=run.v[i],
                           acceleration=run.a[i])  # fmt: skip
    wanted = told.torque.total_after.copy()
    wanted[3] = 0.0
    assert_close(run.motor[i], wanted, tol=1e-8)
    seen = physics.pinned(panda, run.q[i], old_torques(panda, run, i, 3), locked=[1])
    assert_close(run.force[i], seen.force, scale=scale, tol=AGREES)


def test_motors_that_are_not_told_of_a_weak_one(panda):
    """The weak motor gives what it can: its share of the URDF's limit."""
    history = simulate(panda, straight(panda), force=PUSH, faults="weak:2:0.1@0.5", rate=10)
    run, i = history.unremapped, 8
    asked = history.healthy.motor[i]
    assert abs(asked[1]) > 0.1 * panda.effort[1]
    assert run.motor[i][1] == pytest.approx(math.copysign(0.1 * panda.effort[1], asked[1]))
    assert_close(np.delete(run.motor[i], 1), np.delete(asked, 1), tol=1e-6)
    seen = physics.pinned(panda, run.q[i], old_torques(panda, run, i, None))
    assert_close(run.force[i], seen.force, scale=np.linalg.norm(PUSH), tol=AGREES)


def test_without_masses_there_is_the_force_part_alone(tmp_path):
    robot = massless(tmp_path)
    q = np.array([0.2, 0.5, 0.4, 0.3])
    path = straight(robot, (-0.05, 0.02, 0.02), q=q)
    history = simulate(robot, path, q, force=(5, 1, 2), faults=["free:3@0.3"], rate=10)
    assert not history.setting.has_masses
    run = history.unremapped
    assert not run.rnea.any()
    for i in (3, 5):
        J = ftforce.robot.kinematics.frame_jacobian(robot, run.q[i], "tool")[:3]
        tau = J.T @ (5, 1, 2)
        tau[2] = 0.0
        assert_close(run.force[i], np.linalg.pinv(J.T) @ tau, tol=1e-9)
    assert any("no masses" in warning for warning in history.warnings)


# ---- what is said of an event ----------------------------------------------------------------


def world_jacobian(robot, q):
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, robot.to_model(q))
    pin.updateFramePlacements(robot.model, data)
    return pin.getFrameJacobian(
        robot.model, data, robot.tip_frame, pin.LOCAL_WORLD_ALIGNED
    )[:3]  # fmt: skip


@pytest.mark.parametrize("locked", [(2, 4), (1, 2, 3, 4, 6)])
def test_jumps_of_the_velocity(panda, locked):
    """At impact by momentum, with MuJoCo's mass matrix; after the remap (K K† - I) x_S."""
    event = f"{','.join(map(str, locked))}@0.5"
    history = simulate(panda, straight(panda), force=PUSH, faults=event, rate=10)
    (report,) = history.setting.events
    q, v = history.healthy.q[5], history.healthy.v[5]
    S = [joint - 1 for joint in locked]
    H = [i for i in range(7) if i not in S]
    J, M = world_jacobian(panda, q), physics.mass_matrix(panda, q)
    after = np.linalg.solve(M[np.ix_(H, H)], M[np.ix_(H, S)] @ v[S]) + v[H]
    x_S, K = J[:, S] @ v[S], J[:, H]
    assert_close(report.impact_jump, J[:, H] @ after - J @ v, scale=0.1, tol=1e-5)
    assert_close(report.velocity_jump, K @ np.linalg.pinv(K) @ x_S - x_S, scale=0.1, tol=1e-5)
    told = ftforce.analyze(panda, q, locked=locked, force=PUSH)
    assert report.force_jump == pytest.approx(told.force.jump_norm, abs=1e-4)
    assert report.verdict is told.verdict
    assert report.time == 0.5


@pytest.mark.parametrize("events", ["4,2@0.4", ["weak:3:0.5@0.2", "free:4@0.4"]])
def test_an_event_is_judged_as_its_instant_is(panda, events):
    """A moving arm: what a joint without torque carries takes part of the force."""
    history = simulate(panda, straight(panda, speed=0.5), force=(1, 2, 3), faults=events, rate=10)
    report, i = history.setting.events[-1], history.index(0.4)
    assert history.t[i] == 0.4
    jump = history.jump_norm(history.remapped)[i]
    assert report.force_jump == pytest.approx(jump, rel=1e-5, abs=1e-7)
    assert report.verdict is history.remapped.verdicts[i]
    assert np.abs(history.remapped.a[i]).max() > 0.1


def test_words_of_events(panda):
    history = simulate(panda, straight(panda), force=PUSH, faults=["weak:2:0.5@0.5", "3,4@0.2"],
                       rate=5)  # fmt: skip
    first, second = history.setting.events
    assert (first.time, second.time) == (0.2, 0.5)
    assert first.faults == "3 panda_joint3 locked, 4 panda_joint4 locked"
    assert second.faults == "2 panda_joint2 weak 0.5"
    assert second.all_faults == f"2 panda_joint2 weak 0.5, {first.faults}"
    assert history.setting.limits == "urdf"
    assert history.setting.delay == 0.0


def test_an_event_at_the_first_and_last_instant(panda):
    path = straight(panda)
    last = float(simulate(panda, path, force=PUSH, rate=10).t[-1])
    history = simulate(panda, path, force=PUSH, faults=["3@0", f"free:4@{last!r}"], rate=10)
    first, second = history.setting.events
    assert_close(first.velocity_jump, np.zeros(3), scale=1.0, tol=1e-9)  # at rest
    assert second.verdict is history.remapped.verdicts[-1]
    assert history.remapped.verdicts[-1] is ftforce.Verdict(second.verdict)
    assert np.ptp(history.remapped.q[:, 2]) == 0.0
    free = history.remapped.motor[:, 3]
    assert free[-1] == 0.0
    assert free[:-1].all()


def test_a_fault_that_nothing_can_hold(dh5):
    """All joints free: no force, and the run goes on."""
    history = simulate(dh5, straight(dh5), force=PUSH, faults="free:1,2,3,4,5@0.3", rate=10)
    late = history.t >= 0.3
    assert np.isnan(history.remapped.force[late]).all()
    assert np.isfinite(history.remapped.force[~late]).all()
    assert np.isfinite(history.remapped.q).all()
    (report,) = history.setting.events
    assert report.force_jump is None
    assert report.verdict is ftforce.Verdict.NOT_TOLERATED


# ---- robots and trajectories of other kinds --------------------------------------------------

KINDS = {
    "sliding": (SLIDING, [0.1, 3.0, 0.4, 0.2, 4.0], (0.1, 0.15, -0.1), ["4@0.5", "free:1@0.6"]),
    "weak slide": (SLIDING, [0.1, 3.0, 0.4, 0.2, 4.0], (0.1, 0.15, -0.1), ["weak:1:0.5@0.5"]),
    "mimic": (
        arm(j4=followed(4, "j2", -0.5, 0.2)), [0.3, 0.5, 0.4], (0.03, 0.03, -0.02),
        ["2@0.3", "free:3@0.5"],
    ),
    "recorded": (arm(), [0.2, 0.5, 0.4, 0.3], None, ["3@0.5"]),
    "one joint": (
        serial_urdf(("revolute", {"axis": (0, 1, 0)})), [0.0], None, ["free:1@0.3", "1@0.6"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", KINDS.values(), ids=KINDS)
def test_robots_and_trajectories_of_other_kinds(tmp_path, case):
    urdf, q, change, events = case
    robot, q, force = load(tmp_path, urdf, tip="tool"), np.array(q), (3, 1, 2)
    if change is None:
        t = np.linspace(0.0, 1.0, 11)
        q = q + 0.5 * np.sin(t)[:, None]
        history = simulate(robot, Recording.of(robot, t, q), force=force, faults=events)
        assert_close(history.healthy.q, q)
    else:
        history = simulate(
            robot, straight(robot, change, q=q), q, force=force, faults=events, rate=10
        )
    options = {"force": force, "limits": history.setting.limits}
    for i, time in enumerate(history.t.tolist()):
        faults, _ = set_at(robot, events, time)
        assert_as_analyzed(robot, history.remapped, i, faults, **options)
    units = ["m" if joint.type == "prismatic" else "rad" for joint in robot.joints]
    assert [joint.unit for joint in history.setting.joints] == units


def test_progress_goes_up_to_the_end(panda):
    for remap in (True, False):
        seen = []
        options = {"faults": "3@0.5", "rate": 20, "remap": remap}
        simulate(
            panda, straight(panda), force=PUSH, progress=lambda *x, to=seen: to.append(x), **options
        )
        done, totals = zip(*seen, strict=True)
        assert list(done) == sorted(done)
        assert set(totals) == {done[-1]}


# ---- memory ----------------------------------------------------------------------------------


def wave(robot, count):
    """Return times, and positions near the middle of the limits."""
    t = 0.01 * np.arange(count)
    at = 0.5 * (robot.lower + robot.upper)
    return t, at + 0.2 * np.sin(0.3 * np.outer(t, 1.0 + np.arange(robot.n)))


def size_of(run):
    """Return the bytes of memory that arrays occupy; equal rows may be one."""
    arrays = (getattr(run, name) for name in QUANTITIES)
    return sum(array.base.nbytes if 0 in array.strides else array.nbytes for array in arrays)


def test_the_memory_of_a_container_counts(tmp_path):
    machine = _memory(tmp_path)
    for name in ("memory.max", "memory/memory.limit_in_bytes"):  # of versions 2 and 1
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("max\n")
        assert _memory(tmp_path) == machine
        (tmp_path / name).write_text("1000000\n")
        assert _memory(tmp_path) == 1e6
        (tmp_path / name).unlink()


def test_memory_is_in_proportion_to_the_history(panda, monkeypatch):
    """94 numbers for each of two runs: by `Run`, for n = 7 and m = 3."""
    monkeypatch.setattr("ftforce.trajectory.history_files._ROWS", 100)
    options = {"force": PUSH, "faults": "3@4", "smooth": "none", "remap": False}
    small, large = (Recording.of(panda, *wave(panda, count)) for count in (500, 1500))
    kept = [simulate(panda, small, **options)]  # what is imported counts too
    whole = 8 * 2 * 94 * 1500
    assert peak_memory(lambda: kept.append(simulate(panda, large, **options))) < 1.2 * whole
    assert sum(map(size_of, kept[-1].runs.values())) < 0.9 * whole
    size = len(history_bytes(kept[-1], "csv"))
    assert peak_memory(lambda: history_bytes(kept[-1], "csv")) < 1.5 * size + whole


def test_runs_without_faults_are_one(panda):
    history = simulate(panda, straight(panda), force=PUSH, rate=20)
    assert history.unremapped is history.healthy is history.remapped
    assert not history.healthy.brake.any()
    with pytest.raises(ValueError, match="read-only"):
        history.healthy.brake[0] = 1.0


def test_a_long_history_is_announced_and_one_that_the_machine_cannot_hold_refused(
    panda, monkeypatch
):
    """94 numbers for each of three runs: by `Run`, for n = 7 and m = 3."""
    options = {"force": PUSH, "faults": "3@0.5", "rate": 20}
    path = straight(panda)
    count = len(simulate(panda, path, **options).t)
    size = 8 * 3 * 94 * count
    words = f"the history of {count} instants takes about .* of memory; a lower rate"
    monkeypatch.setattr("ftforce.trajectory.simulate._LARGE", size - 1)
    with pytest.warns(UserWarning, match=words):
        simulate(panda, path, **options)
    monkeypatch.setattr("os.sysconf", lambda name: 1 if name == "SC_PAGE_SIZE" else size - 1)
    with pytest.raises(MemoryError, match=words):
        simulate(panda, path, **options)


# ---- bad input -------------------------------------------------------------------------------

BAD = [  # the words of errors that others make are theirs
    ({"delay": -1}, "the delay must be 0 s or more, got -1"),
    ({"delay": math.nan}, "the delay must be 0 s or more, got nan"),
    ({"delay": "1"}, "the delay must be 0 s or more, got '1'"),
    ({"delay": True}, "the delay must be 0 s or more, got True"),
    ({"delay": 10**400, "faults": "3@1"}, "the delay must be 0 s or more, got 1"),
    ({"faults": ["3@1", "4@99"]}, "the fault at 99 s comes after the end of the trajectory"),
    ({"faults": ["3@0.1", "3@0.2"]}, ""),
    ({"rate": 1e12}, "5.63e+12 samples exceed the maximum of 5,000,000"),
    ({"force": (1, 2)}, "force needs 3 numbers, got 2 numbers: fx, fy, fz"),
    ({"force": None}, "the force is missing; e.g. force=[80, 50, 10]"),
    ({"axes": "tip"}, ""),
    ({"gravity": (0, 0)}, ""),
    ({"limits": "what"}, ""),
    ({"rtol": -1}, ""),
    ({"posture": "nowhere"}, ""),
]


@pytest.mark.parametrize(("options", "message"), BAD, ids=lambda x: str(x)[:40])
def test_values_that_make_no_sense(dh5, options, message):
    path = Path.through([(0.9, 0.3, 0.2), (0.8, 0.4, 0.25)], speed=0.05)
    with pytest.raises(FtforceError) as caught:
        simulate(dh5, path, **{"force": PUSH, **options})
    assert str(caught.value).startswith(message)


def test_a_trajectory_that_is_none(dh5, tmp_path):
    with pytest.raises(
        InputError, match="a trajectory must be a Path, a Recording, a CSV file or a bag"
    ):
        simulate(dh5, [(0, 0, 0), (1, 0, 0)], force=PUSH)
    with pytest.raises(TrajectoryError, match="no such file"):
        simulate(dh5, tmp_path / "none.csv", force=PUSH)
    with pytest.raises(DimensionError):
        simulate(dh5, tmp_path / "none.csv", force=(1,))


def test_place_comes_before_orientation():
    """Five joints cannot keep both; each instant turns as little as the place leaves open."""
    ur5 = ftforce.load_robot("ur5")
    q = choose_posture(ur5).q
    R0, x = tip_pose(ur5, q)
    line = Path.through([x, x + np.array([0.1, 0.1, -0.1])], speed=0.1, keep_orientation=True)
    for faults, most in (((), 1e-9), ("6@0.5", 1.0)):
        run = simulate(ur5, line, force=np.zeros(3), faults=faults, rate=20).remapped
        assert run.path_error_norm.max() < 1e-6
        for i in (0, 12, -1):
            turned = pin.log3(R0 @ tip_pose(ur5, run.q[i])[0].T)
            assert_close(run.orientation_error[i], turned, scale=1.0)
        assert run.orientation_error_norm.max() < most
    assert run.orientation_error_norm[-1] > 0.1


def test_quaternions_never_jump_to_their_negatives(panda):
    t = np.linspace(0.0, 2.0, 101)
    q = np.tile(panda.postures["default"], (101, 1))
    q[:, 6] = np.linspace(-2.8, 2.8, 101)
    run = simulate(panda, Recording.of(panda, t, q), force=np.zeros(3), faults="1@1").remapped
    assert (np.vecdot(run.orientation[1:], run.orientation[:-1]) > 0.99).all()
    for i in (0, 50, 100):
        R = pin.Quaternion(*run.orientation[i][[3, 0, 1, 2]]).matrix()
        assert_close(R, tip_pose(panda, run.q[i])[0])
