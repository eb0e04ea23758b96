"""Slides beside hinges (theory §2.7): one arm in two units of length has one set of answers."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import asdict, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ftforce
from ftforce.analysis.analyze import load_without_force
from ftforce.analysis.question import AllFaultSets, Question
from ftforce.batch.comparison import compare
from ftforce.batch.plan import Plan
from ftforce.batch.remapper import Remapper
from ftforce.batch.result import SweepSetting
from ftforce.core.joint_scale import JointScale
from ftforce.errors import InputError, OutputError
from ftforce.report.files import to_text
from ftforce.robot.posture import choose_posture
from ftforce.show import render
from ftforce.trajectory.history import QUANTITIES
from ftforce.view.model.state import command_line, initial_state
from helpers import SLIDING, assert_close, seeds, straight
from urdfs import load

pytestmark = pytest.mark.thorough  # every command, in two units

CENTI = 100.0  # what was 1 m is 100 cm


class Step(NamedTuple):
    """A joint of a chain: is it a slide, its axis and the placement before it."""

    slides: bool
    axis: tuple[float, float, float]
    xyz: tuple[float, float, float]


# A surgical instrument that turns about its incision: two hinges, a slide, a wrist of two hinges.
PSM = (
    Step(False, (0, 0, 1), (0, 0, 0)),
    Step(False, (0, 1, 0), (0, 0, 0)),
    Step(True, (1, 0, 0), (0, 0, 0)),
    Step(False, (0, 1, 0), (0, 0, 0)),
    Step(False, (0, 0, 1), (0.009, 0, 0)),
)
Q = np.array([0.3, -0.4, 0.145, 0.7, 0.5])


def urdf(steps, per_metre=1.0):
    """Return a chain whose slides are moved by leaders in another unit of length.

    A leader is a slide beside the arm: it has no mass, and its followers carry the tool.
    """
    body = (
        '<inertial><origin xyz="0.02 0.01 0"/><mass value="0.3"/>'
        '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>'
    )
    parts = ['<link name="l0"/>']
    for i, step in enumerate(steps, start=1):
        axis, xyz = (" ".join(map(repr, map(float, x))) for x in (step.axis, step.xyz))
        kind = "prismatic" if step.slides else "revolute"
        follower = ""
        if step.slides and per_metre != 1.0:
            low, high, effort = -per_metre, per_metre, 10.0 / per_metre
            parts.append(
                f'<link name="side{i}"/><joint name="j{i}" type="prismatic"><parent link="l0"/>'
                f'<child link="side{i}"/><axis xyz="1 0 0"/><limit lower="{low!r}" '
                f'upper="{high!r}" effort="{effort!r}" velocity="{per_metre!r}"/></joint>'
            )
            follower = f'<mimic joint="j{i}" multiplier="{1.0 / per_metre!r}"/>'
        name = f"follower{i}" if follower else f"j{i}"
        parts.append(
            f'<link name="l{i}">{body}</link><joint name="{name}" type="{kind}">'
            f'<parent link="l{i - 1}"/><child link="l{i}"/><origin xyz="{xyz}"/>'
            f'<axis xyz="{axis}"/><limit lower="-1" upper="1" effort="10" velocity="1"/>'
            f"{follower}</joint>"
        )
    parts.append(
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="l{len(steps)}"/>'
        '<child link="tip"/><origin xyz="0.009 0 0"/></joint>'
    )
    return f'<robot name="mixed">{"".join(parts)}</robot>'


class Two(NamedTuple):
    """One arm in metres, and in another unit; ``per_metre`` converts positions of its joints."""

    metres: ftforce.Robot
    other: ftforce.Robot
    per_metre: np.ndarray

    def ask(self, question, q, joint_length=1.0, velocity=None, **asked):
        """Return the answers for both, each with lengths and torques in its own unit."""
        found = []
        for robot, unit in ((self.metres, np.ones(len(q.T))), (self.other, self.per_metre)):
            own = dict(asked, joint_length=joint_length * unit.max())
            for name in ("torque", "friction"):
                if name in asked:
                    own[name] = np.asarray(asked[name]) / unit
            if velocity is not None:
                own["velocity"] = np.asarray(velocity) * unit
            found.append(question(robot, q * unit, **own))
        return found


def two_of(folder, steps, per_metre):
    unit = np.array([per_metre if step.slides else 1.0 for step in steps])
    return Two(
        load(folder, urdf(steps), tip="tip"), load(folder, urdf(steps, per_metre), tip="tip"), unit
    )


@pytest.fixture(scope="module")
def psm(tmp_path_factory):
    return two_of(tmp_path_factory.mktemp("psm"), PSM, CENTI)


@pytest.fixture(scope="module")
def sliding(tmp_path_factory):
    return load(tmp_path_factory.mktemp("sliding"), SLIDING, tip="tool")


def shown(result):
    """Return what a terminal shows, without its line ends."""
    return " ".join(render.to_text(render.render(result)).split())


def same_numbers(a, b, *, tol=1e-9):
    """Compare within ``tol`` of the largest number, or of 1; any may be unknown or infinite."""
    if a is None or b is None:
        assert a is b
        return
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    assert np.array_equal(np.isfinite(a), np.isfinite(b))
    known = np.isfinite(a)
    assert_close(b[known], a[known], scale=np.abs(a[known]).max(initial=1.0), tol=tol)
    assert np.array_equal(a[~known], b[~known], equal_nan=True)


def test_one_metre_for_both_means_two_arms(psm):
    """With the same L, 1 m in one and 1 cm in the other, the verdicts differ."""
    one, other = (
        ftforce.analyze(robot, q, locked=[1]).verdict.value
        for robot, q in zip(psm[:2], (Q, Q * psm.per_metre), strict=True)
    )
    assert (one, other) == ("borderline", "tolerated")


def test_the_default_posture_does_not_depend_on_the_unit(psm):
    one, other = (ftforce.analyze(robot, locked=[1]).posture for robot in psm[:2])
    assert one.source == other.source
    assert_close(other.q, one.q * psm.per_metre)


QUESTIONS = {
    "locked": {"locked": [3]},
    "two locked": {"locked": [1, 3], "force": [3, 4, 5]},
    "free": {"free": [2], "force": [3, 4, 5]},
    "a free slide": {"free": [3]},
    "locked and free": {"locked": [3], "free": [2]},
    "all free": {"free": [1, 2, 3, 4, 5], "friction": [0.0] * 5},
    "friction": {"free": [1, 3], "friction": [5, 5, 40, 5, 5], "force": [3, 4, 5]},
    "friction unknown": {"free": [3], "friction": [math.nan] * 5},
    "too little friction": {"free": [1, 2, 3, 4, 5], "friction": [0.1, 0.1, 0.2, 0.1, 0.1]},
    "weak": {"weak": "3:0.5", "force": [30, 4, 5]},
    "limits": {"locked": [2], "force": [50, 0, 0], "limits": "urdf"},
    "overloaded": {"free": [5], "limits": "urdf", "payload": 30.0},
    "wrench": {"locked": [4], "task": "wrench", "length": 0.1, "force": [1, 2, 3, 0.1, 0.2, 0.3]},
    "torques": {"locked": [3], "torque": [1, 2, 3, 0.5, 0.5]},
    "dynamic": {"locked": [3], "torque": [1, 2, 3, 0.5, 0.5], "inverse": "dynamic"},
    "moving": {"locked": [2, 3], "velocity": [0.1, 0.2, 0.3, 0.4, 0.5], "force": [1, 2, 3]},
}


@pytest.mark.parametrize("length", [1.0, 0.05])
@pytest.mark.parametrize("case", QUESTIONS)
def test_an_analysis_does_not_depend_on_the_unit(psm, case, length):
    a, b = psm.ask(ftforce.analyze, Q, length, **QUESTIONS[case])
    unit = psm.per_metre
    assert a.verdict is b.verdict
    assert a.reduced.rank_after == b.reduced.rank_after
    assert a.can_stand_still == b.can_stand_still
    for name in ("margin", "condition_number", "relative_manipulability"):
        same_numbers(getattr(a, name), getattr(b, name))
    same_numbers(a.force_error, b.force_error / CENTI)  # L is 100 times as much, and σ the less
    same_numbers(a.lost_directions, b.lost_directions)
    if a.force is not None:
        for name in ("before", "after", "jump", "unsupported"):
            same_numbers(getattr(a.force, name), getattr(b.force, name))
        for name in ("before", "after", "brake_load", "self_motion", "total_after"):
            one, other = getattr(a.torque, name), getattr(b.torque, name)
            same_numbers(one, None if other is None else other * unit)
        same_numbers(a.force_contributions, b.force_contributions)
    if a.velocity is not None:
        same_numbers(a.velocity.after, b.velocity.after / unit)
        same_numbers(a.velocity.jump, b.velocity.jump)
        same_numbers(a.velocity_contributions, b.velocity_contributions)
        same_numbers(a.impact.after, b.impact.after / unit)
    for one in (a, b):
        assert one.is_proved()
    assert_same_support(a, b, unit)
    standing = json.loads(to_text(a, "json"))["standing"]
    assert bool(standing["overloaded"]) == (case == "overloaded")
    assert bool(standing["unbalanced"]) == (case == "all free")


def assert_same_support(a, b, unit):
    """Compare what holds the arms without a force, or what is said if nothing does."""
    same_numbers(load_without_force(a), load_without_force(b) * unit)
    one, other = (json.loads(to_text(x, "json"))["standing"] for x in (a, b))
    for name, scale in zip(a.robot.names, unit, strict=True):
        x, y = (found["unbalanced"].get(name, 0.0) for found in (one, other))
        same_numbers(x, y * scale)
        for group in ("overloaded", "friction"):
            x, y = (found[group].get(name, {}) for found in (one, other))
            assert x.keys() == y.keys()
            for key in x.keys() - {"source"}:
                same_numbers(x[key], y[key] * scale)


@pytest.mark.parametrize("mode", ["locked", "free"])
def test_a_census_and_a_capability_do_not_depend_on_the_unit(psm, mode):
    asked = {"faults": 2, "mode": mode, "limits": "urdf", "force": [3, 4, 5]}
    a, b = psm.ask(ftforce.census, Q, 0.1, rank_by="capability", **asked)
    for one, other in zip(a.sets, b.sets, strict=True):
        assert (one.faults, one.verdict) == (other.faults, other.verdict)
        for name in ("margin", "relative_jump", "relative_manipulability", "jump_norm", "kept"):
            same_numbers(getattr(one, name), getattr(other, name))
        for name in ("commanded", "held", "minimum"):
            same_numbers(getattr(one.capability, name), getattr(other.capability, name))
    a, b = psm.ask(ftforce.capability, Q, 0.1, **{mode: [2]}, direction=[1, 2, 3])
    for one, other in zip((*a.directions, a.weakest), (*b.directions, b.weakest), strict=True):
        for x, y in ((one.before, other.before), (one.after, other.after)):
            for model in x:
                assert x[model].limiting_joints == y[model].limiting_joints
                same_numbers(x[model].maximum, y[model].maximum)
    for one, other in zip(a.payload, b.payload, strict=True):
        same_numbers(one.maximum, other.maximum)
    if mode == "locked":
        same_numbers(np.sort(a.polytope(after=False).vertices, 0),
            np.sort(b.polytope(after=False).vertices, 0))  # fmt: skip


@pytest.mark.parametrize(
    ("mode", "force"), [("locked", [3, 4, 5]), ("locked", None), ("free", [3, 4, 5])]
)
def test_a_timeline_does_not_depend_on_the_unit(psm, mode, force):
    line = straight(psm.metres, (0.02, -0.02, 0.01), speed=0.1, q=Q)

    def question(robot, q, **asked):
        return ftforce.timeline(robot, line, q, rate=20, mode=mode, faults=2, force=force, **asked)

    a, b = psm.ask(question, Q, 0.05)
    # The same integration to 1e-8 of what each unit calls 1.
    same_numbers(a.q, b.q / psm.per_metre, tol=1e-6)
    assert np.array_equal(a.verdict, b.verdict)
    for name in ("jump", "margin", "capability", "held"):
        same_numbers(getattr(a, name), getattr(b, name), tol=1e-5)


@pytest.mark.parametrize("faults", [["4@0.2", "free:2@0.4"], ["3,5@0.2", "4@0.3"]])
def test_a_simulation_does_not_depend_on_the_unit(psm, faults):
    line = straight(psm.metres, (0.02, -0.02, 0.01), speed=0.1, q=Q, keep_orientation=True)

    def question(robot, q, **asked):
        return ftforce.simulate(
            robot, line, q, rate=20, force=[3, 4, 5], faults=faults, delay=0.1,
            limits="urdf", **asked
        )  # fmt: skip

    a, b = psm.ask(question, Q, 0.05)
    for name, run in a.runs.items():
        other = b.runs[name]
        assert np.array_equal(run.verdict, other.verdict)
        for quantity in QUANTITIES:
            one, two = getattr(run, quantity), getattr(other, quantity)
            if quantity in {"q", "v", "a"}:
                two = two / psm.per_metre
            elif quantity in {"rnea", "force_part", "U", "motor", "unbalanced", "brake"}:
                two = two * psm.per_metre
            # Accelerations are differences of integrated velocities.
            same_numbers(one, two, tol=1e-3 if quantity == "a" else 1e-5)
    for one, other in zip(a.setting.events, b.setting.events, strict=True):
        same_numbers(one.velocity_jump, other.velocity_jump, tol=1e-5)
        same_numbers(one.impact_jump, other.impact_jump, tol=1e-5)


@pytest.mark.parametrize("task", ["force", "wrench", "fx,fz,my"])
@pytest.mark.parametrize("mode", ["locked", "free"])
def test_a_sweep_does_not_depend_on_the_unit(psm, mode, task):
    postures = np.random.default_rng(1).uniform(-1.0, 1.0, (300, 5))
    m = {"force": 3, "wrench": 6}.get(task, 3)
    asked = {"force": np.arange(1.0, m + 1), "task": task, "length": 0.1}

    def question(robot, q, **own):
        return ftforce.sweep(robot, q, faults=2, mode=mode, **asked, **own)

    a, b = psm.ask(question, postures, 0.05)
    assert np.array_equal(a.summary.verdicts, b.summary.verdicts)
    for one, other in zip(a.ranked, b.ranked, strict=True):
        assert one.faults == other.faults
        assert one.margin == other.margin  # quantiles of histograms
        assert one.capability == other.capability


@pytest.mark.parametrize("task", ["force", "wrench"])
@pytest.mark.parametrize("mode", ["locked", "free"])
def test_the_kernels_agree_with_analyze(sliding, mode, task):
    """Margins, verdicts and capabilities of a sweep at L = 0.2 m, posture by posture."""
    m = 3 if task == "force" else 6
    force = np.arange(1.0, m + 1)
    asked = {"task": task, "length": 0.3, "joint_length": 0.2}
    question = Question.parse(sliding, force=force, direction=force, limits="urdf", **asked)
    sets = tuple(AllFaultSets.parse(sliding, 2, mode))
    q = np.random.default_rng(2).uniform(-0.4, 0.4, (6, sliding.n))
    block = Plan.of(question, sets, needs_gravity=True).evaluator()(q)
    for k, one in enumerate(q):
        found = ftforce.census(
            sliding, one, faults=2, mode=mode, force=force, direction=force, limits="urdf",
            rank_by="capability", **asked,
        )  # fmt: skip
        free = ftforce.census(sliding, one, faults=2, mode=mode, force=force, **asked)
        judged = {report.faults: report for report in free.sets}
        capable = {report.faults: report.capability.commanded for report in found.sets}
        for s, faults in enumerate(sets):
            report = judged[faults]
            assert ftforce.core.verdict.VERDICTS[block.verdict[s, k]] is report.verdict
            assert_close(block.margin[s, k], report.margin, scale=1.0)
            same_numbers(capable[faults], block.capability[s, k], tol=1e-6)
            assert_close(block.sigma_min[s, k], report.sigma_min_after, scale=1.0)


@pytest.mark.parametrize("mode", ["locked", "free"])
def test_a_remapper_agrees_with_analyze(sliding, mode):
    remapper = Remapper(sliding, 2, mode=mode, joint_length=0.2)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, tau, force = (rng.uniform(-0.4, 0.4, size) for size in (sliding.n, sliding.n, 3))
        for given_load in ({"torque": tau}, {"force": force}):
            by_torque = "torque" in given_load
            got = remapper(q, tau) if by_torque else remapper(q, force=force)
            for s, faults in enumerate(remapper.sets):
                numbers = [i + 1 for i in faults.joints]
                wanted = ftforce.analyze(
                    sliding, q, **{mode: numbers}, joint_length=0.2, **given_load
                )
                assert got.verdicts[s] is wanted.verdict
                assert_close(got.margin[s], wanted.margin, scale=1.0)
                assert_close(got.force_before, wanted.force.before)
                assert_close(got.self_motion, wanted.torque.self_motion, scale=1.0)
                if wanted.torque.after is None:
                    assert np.isnan(got.U[s]).all()
                else:
                    assert_close(got.U[s], wanted.torque.after, scale=10.0)


def test_rounding_does_not_become_a_lever(tmp_path):
    """A floor for entries of J is one for the arm as it is, whatever weighs its joints."""
    steps = [
        Step(False, (1e-11, 0, 1), (0, 0, 0)),  # tilted by rounding
        Step(True, (1, 0, 0), (0.3, 0, 0)),
        Step(False, (0, 0, 1), (0.3, 0, 0)),
    ]
    robot = load(tmp_path, urdf(steps), tip="tip")
    asked = {"task": "fz", "joint_length": 1e-6}
    with pytest.raises(InputError, match="even the healthy arm cannot exert"):
        ftforce.analyze(robot, [0.1, 0.2, 0.3], locked=[1], **asked)
    question = Question.parse(robot, **asked)
    sets = tuple(AllFaultSets.parse(robot, 1, "locked"))
    block = Plan.of(question, sets, needs_gravity=False).evaluator()(np.array([[0.1, 0.2, 0.3]]))
    assert block.rank.tolist() == [0]
    remapped = Remapper(robot, 1, **asked)(np.array([0.1, 0.2, 0.3]), force=np.ones(1))
    assert {one.value for one in remapped.verdicts} == {"not tolerated"}


def test_a_remapper_keeps_its_result_and_its_torques(sliding):
    remapper = Remapper(sliding, 1, joint_length=0.2)
    q, tau = np.full(sliding.n, 0.2), np.arange(1.0, sliding.n + 1)
    kept = remapper(q, tau).copy()
    assert np.array_equal(tau, np.arange(1.0, sliding.n + 1))
    for malformed in (tau[:-1], np.full(sliding.n, np.nan), np.ones(1)):
        with pytest.raises(InputError):
            remapper(q, malformed)
        assert np.array_equal(remapper.result.U, kept.U)
    assert np.array_equal(remapper(q, tau).U, kept.U)


def jacobian_of(robot, q):
    """Return the linear rows in tip axes, by Pinocchio alone; no joint of the arm follows."""
    data = robot.model.createData()
    return pin.computeFrameJacobian(robot.model, data, q, robot.tip_frame, pin.LOCAL)[:3]


@pytest.mark.parametrize("length", [1.0, 0.1, 25.0])
def test_numpy_finds_the_same_force_and_margin(psm, length):
    """F̂ = (J̃ᵀ)† τ̃, margin, 1/σ and Δv by `numpy.linalg` for columns divided by L."""
    robot, tau, v = psm.metres, np.array([1, 2, 3, 0.5, 0.5]), np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    c = np.array([1 / length, 1 / length, 1, 1 / length, 1 / length])
    J = jacobian_of(robot, Q) * c
    asked = {"locked": [4], "joint_length": length}
    found = ftforce.analyze(robot, Q, torque=tau, velocity=v, **asked)
    F = np.linalg.pinv(J.T) @ (c * tau)
    assert_close(found.force.before, F)
    assert_close(found.torque.self_motion, tau - J.T @ F / c, scale=1.0)
    K = J.copy()
    K[:, 3] = 0.0
    s, s_K = (np.linalg.svd(A, compute_uv=False) for A in (J, K))
    assert_close(found.margin, s_K[-1] / s[0])
    assert_close(found.force_error, 1 / s_K[-1])
    assert_close(found.relative_manipulability, math.prod(s_K) / math.prod(s))
    healthy = np.where(np.arange(5) == 3, 0.0, v)
    after = healthy + c * (np.linalg.pinv(K) @ J[:, 3] / c[3] * v[3])
    assert_close(found.velocity.after, after)


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(4, 7), st.sampled_from([1e-3, 0.0254, 7.0, 100.0, 1e3]))
def test_no_unit_of_length_changes_a_verdict(tmp_path_factory, seed, n, per_metre):
    rng = np.random.default_rng(seed)
    slides = rng.random(n) < 0.4
    slides[0], slides[1] = False, True
    steps = []
    for slide in rng.permutation(slides):
        axis = rng.normal(size=3)
        steps.append(Step(bool(slide), tuple(axis / np.linalg.norm(axis)), rng.normal(size=3)))
    two = two_of(tmp_path_factory.mktemp("drawn"), steps, per_metre)
    q, L = rng.uniform(-1.0, 1.0, n), float(rng.uniform(0.1, 3.0))
    found = [
        ftforce.census(robot, q * unit, faults=2, joint_length=length, force=[1, 2, 3])
        for robot, unit, length in (
            (two.metres, 1.0, L),
            (two.other, two.per_metre, L * per_metre),
        )
    ]
    for one, other in zip(*(sorted(x.sets, key=lambda r: r.faults.joints) for x in found),
        strict=True):  # fmt: skip
        assert one.faults == other.faults
        same_numbers(one.margin, other.margin, tol=1e-8)
        near = any(abs(one.margin - t) < 1e-6 * t for t in (1e-2, 1e-6))
        assert near or one.verdict is other.verdict
        same_numbers(one.jump, other.jump, tol=1e-6) if one.margin > 1e-5 else None


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_an_arm_of_one_kind_has_no_joint_length(tmp_path, kind):
    steps = [step._replace(slides=kind == "prismatic") for step in PSM]
    robot = load(tmp_path, urdf(steps), tip="tip")
    a, b = (
        ftforce.analyze(robot, Q, locked=[2], torque=[1, 2, 3, 4, 5], joint_length=L)
        for L in (1.0, 0.1)
    )
    assert a.margin == b.margin
    assert np.array_equal(a.force.before, b.force.before)
    assert a.force_error == b.force_error
    assert "Joint kinds" not in shown(a)
    assert "--joint-length has no effect" in shown(b)
    assert json.loads(to_text(b, "json"))["conventions"]["joint_length"] is None


@pytest.mark.parametrize("wrong", [0, -1.0, math.inf, math.nan, 1e-7, "1", True, [1.0]])
def test_a_joint_length_is_a_positive_number(psm, wrong):
    with pytest.raises(InputError, match=r"^the joint length must lie between 1e-06 and 1e\+06 m"):
        ftforce.analyze(psm.metres, Q, joint_length=wrong)
    with pytest.raises(InputError, match="joint length"):  # also where it would have no effect
        ftforce.analyze(ftforce.load_robot("dh5"), joint_length=wrong)


def test_every_result_says_the_joint_length(psm, tmp_path):
    robot, words = psm.metres, "hinges and slides: 1 rad weighed as 0.2 m (--joint-length)"
    line = straight(robot, (0.01, 0, 0), speed=0.1, q=Q)
    asked = {"joint_length": 0.2}
    results = {
        "analysis": ftforce.analyze(robot, Q, locked=[1], **asked),
        "census": ftforce.census(robot, Q, **asked),
        "capability": ftforce.capability(robot, Q, locked=[1], **asked),
        "timeline": ftforce.timeline(robot, line, Q, rate=10, **asked),
        "history": ftforce.simulate(robot, line, Q, rate=10, force=[1, 2, 3], **asked),
        "sweep": ftforce.sweep(robot, n=64, **asked),
    }
    results["comparison"] = compare({"a": results["sweep"], "b": results["sweep"]})
    for name, result in results.items():
        assert words in shown(result), name
        document = json.loads(to_text(result, "json"))
        place = document["question" if name == "comparison" else "conventions"]
        assert place["joint_length"] == 0.2, name
        if name == "history":
            continue
        rows = list(csv.DictReader(io.StringIO(to_text(result, "csv"))))
        if name == "analysis":
            assert [r["before"] for r in rows if r["name"] == "joint_length"] == ["0.2"]
        else:
            assert {float(r["joint_length [m]"]) for r in rows} == {0.2}, name
    default = ftforce.analyze(robot, Q)
    text = shown(default)
    assert "hinges and slides: 1 rad weighed as 1 m (--joint-length)" in text
    assert "per N (N·m divided by 1 m) of torque error" in text


def test_the_page_asks_the_same(psm):
    robot = psm.metres
    question = Question.parse(robot, posture=choose_posture(robot, Q), joint_length=0.2)
    state = initial_state(question)
    assert "--joint-length=0.2" in command_line(robot, state)
    assert state.question(robot).scale.length == 0.2
    other = replace(state, scale=JointScale.of(["rad", "m"]))
    assert other.essence() != state.essence()
    assert "joint-length" not in command_line(robot, other)


def test_files_keep_the_joint_length_and_older_ones_have_a_metre(psm, tmp_path):
    robot = psm.metres
    line = straight(robot, (0.01, 0, 0), speed=0.1, q=Q)
    history = ftforce.simulate(robot, line, Q, rate=10, force=[1, 2, 3], joint_length=0.2)
    ftforce.save(history, tmp_path / "run.npz")
    assert ftforce.load_history(tmp_path / "run.npz").setting.joint_length == 0.2
    arrays = dict(np.load(tmp_path / "run.npz"))
    about = json.loads(str(arrays["about"]))
    del about["setting"]["joint_length"]
    about["version"] = 1  # which has no digest
    np.savez(tmp_path / "old.npz", **{**arrays, "about": np.array(json.dumps(about))})
    assert ftforce.load_history(tmp_path / "old.npz").setting.joint_length == 1.0
    sweep = ftforce.sweep(robot, n=64, joint_length=0.2, output=tmp_path / "s.zarr")
    assert ftforce.open_sweep(tmp_path / "s.zarr").setting.joint_length == 0.2
    old = asdict(sweep.setting)
    del old["joint_length"]
    assert SweepSetting.from_dict(old).joint_length == 1.0
    with pytest.raises(
        OutputError, match=r"joint_length 0\.2 instead of 0\.3"
    ):  # another sweep is not resumed
        ftforce.sweep(robot, n=64, joint_length=0.3, output=tmp_path / "s.zarr")


def test_only_arms_of_both_kinds_must_agree_in_a_comparison(psm):
    asked = {"n": 64, "force": [1, 2, 3]}
    hinges = ftforce.sweep(ftforce.load_robot("dh5"), **asked)
    one, other = (ftforce.sweep(psm.metres, joint_length=L, **asked) for L in (1.0, 0.2))
    found = compare({"dh5": hinges, "psm": other})
    assert any("0.2 m of travel" in words for words in found.warnings)
    with pytest.raises(InputError, match=r"joint length 1 and 0\.2"):
        compare({"dh5": hinges, "one": one, "other": other})


def test_commands_take_a_joint_length(psm, tmp_path):
    """The option of every command that has a task, and what it says of a bad value."""
    from typer.testing import CliRunner

    from ftforce import cli

    def run(*arguments, status=0):
        result = CliRunner().invoke(cli.app, list(map(str, arguments)), env={"COLUMNS": "80"})
        assert result.exit_code == status, result.output
        return result

    path, where = psm.other.path, ",".join(map(repr, (Q * psm.per_metre).tolist()))
    asked = (path, "--q", where, "--joint-length", 100)
    document = json.loads(run("analyze", *asked, "--locked", 1, "--format", "json").stdout)
    assert_close(document["jacobian"]["margin"], ftforce.analyze(psm.metres, Q, locked=[1]).margin)
    words = "1 rad weighed as 100 m (--joint-length)"
    move = ("--to", "0.12,0.02,0.04", "--speed", 0.5, "--rate", 10)
    for command in (
        ("census", *asked),
        ("capability", *asked, "--locked", 1),
        ("timeline", *asked, *move),
        ("simulate", *asked, *move, "--force", "1,2,3"),
        ("sweep", path, "--samples", 64, "--joint-length", 100),
        ("compare", path, "dh5", "--samples", 64, "--joint-length", 100),
    ):
        assert words in " ".join(run(*command).stdout.split()), command
    stored = tmp_path / "s.zarr"
    run("sweep", path, "--samples", 64, "--joint-length", 100, "-o", stored)
    assert words in " ".join(run("map", stored).stdout.split())
    for wrong in ("0", "-1", "nan", "inf"):
        failed = run("analyze", path, f"--joint-length={wrong}", status=1)
        assert len(failed.stderr.splitlines()) == 1
        assert "the joint length must lie between" in failed.stderr
