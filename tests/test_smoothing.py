"""Recordings as recorders write them: rounded, noisy, wrapped. The exact motion is the oracle."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import BSpline

import ftforce
from ftforce.core import smoothing
from ftforce.core.smoothing import Spline, noise_of, uncertainty_of
from ftforce.errors import InputError, TrajectoryError
from ftforce.show.render import render, to_text
from ftforce.trajectory import Path, Recording
from ftforce.trajectory.simulate import simulate
from ftforce.trajectory.start import start_of
from ftforce.trajectory.timeline import timeline
from helpers import assert_close

TURN = 2.0 * np.pi
PUSH = (5.0, 0.0, 10.0)  # N


def exact_motion(robot, t, seed=0, fastest=1.8, *, from_rest=False):
    """Return positions, velocities and accelerations of a sum of sines."""
    rng = np.random.default_rng(seed)
    rate, size, phase = (
        rng.uniform(*ends, (3, 1, robot.n)) for ends in ((0.3, fastest), (0.03, 0.2), (0.0, TURN))
    )
    s, ds, dds = t, np.ones_like(t), np.zeros_like(t)
    if from_rest:  # to rest: the sines' argument starts and ends at rest
        w = TURN / t[-1]
        s, ds, dds = t - np.sin(w * t) / w, 1.0 - np.cos(w * t), w * np.sin(w * t)
        rate = 0.5 * rate  # as fast in the middle
    x = rate * s[:, None] + phase
    of, by, by2 = size * np.sin(x), size * rate * np.cos(x), -size * rate**2 * np.sin(x)
    q, v, a = (
        part.sum(axis=0)
        for part in (of, by * ds[:, None], by2 * ds[:, None] ** 2 + by * dds[:, None])
    )
    return ftforce.analyze(robot).posture.q + q, v, a


def torques(robot, q, v, a):
    """Return motor torques, from Pinocchio's algorithm and data of its own."""
    model, data, G = robot.model, robot.model.createData(), robot.coordinates.G
    return np.array([
        pin.rnea(model, data, robot.to_model(x), G @ y, G @ z) @ G
        for x, y, z in zip(q, v, a, strict=True)
    ])  # fmt: skip


def times(end, rate):
    return np.arange(round(end * rate) + 1) / rate


def blurred(q, how):
    """Return positions with some decimals, or with noise."""
    if how == "noise":
        return q + np.random.default_rng(3).normal(0.0, 2e-4, q.shape)
    return np.round(q, how)


# ---- the oracle ------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [50, 100])
@pytest.mark.parametrize("how", [8, 6, 5, 4, 3, "noise"])
@pytest.mark.parametrize("name", ["ur5", "panda", "dh5"])
def test_torques_of_a_recording_are_those_of_the_motion(name, how, rate):
    """Within 2 % of the largest weight torque, at its ends too."""
    robot, t = ftforce.load_robot(name), times(10.0, rate)
    q, v, a = exact_motion(robot, t)
    wanted = torques(robot, q, v, a)
    weight = np.abs(torques(robot, q, 0.0 * v, 0.0 * a)).max()
    motion = start_of(robot, Recording.of(robot, t, blurred(q, how))).reference.motion(t)
    assert np.abs(torques(robot, *motion) - wanted).max() < 0.02 * weight
    assert np.abs(wanted - torques(robot, q, 0.0 * v, 0.0 * a)).max() > 0.02 * weight


@pytest.mark.parametrize("from_rest", [False, True])
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_ends_of_lively_motions(name, from_rest):
    """Of motions of up to 2.5 rad/s, all torques are within 2 %, most within 0.5 %."""
    robot, errors = ftforce.load_robot(name), []
    for seed in range(2):
        for rate, how in ((50, 3), (50, "noise"), (100, 4)):
            t = times(10.0, rate)
            exact = exact_motion(robot, t, seed, 2.5, from_rest=from_rest)
            motion = start_of(robot, Recording.of(robot, t, blurred(exact[0], how))).reference
            at = np.r_[0 : rate // 2 : 4, len(t) - 1 : len(t) - rate // 2 : -4, rate : len(t) : 20]
            wanted = torques(robot, *(x[at] for x in exact))
            weight = np.abs(torques(robot, exact[0][at], 0.0 * exact[1][at], 0.0 * wanted)).max()
            off = torques(robot, *motion.motion(t[at])) - wanted
            errors.append(np.abs(off).max() / weight)
    assert np.max(errors) < 0.02
    assert np.median(errors) < 0.005


@pytest.mark.parametrize("how", [5, 3, "noise"])
def test_answers_do_not_depend_on_the_decimals(panda, how):
    t = times(6.0, 50)
    q, *_ = exact_motion(panda, t)
    found, wanted = (
        timeline(panda, Recording.of(panda, t, x), force=PUSH, rate=10)
        for x in (blurred(q, how), q)
    )
    np.testing.assert_array_equal(found.verdict, wanted.verdict)
    assert_close(found.capability, wanted.capability, tol=0.02)
    assert not found.warnings
    history = simulate(panda, Recording.of(panda, t, blurred(q, how)), force=PUSH, rate=10)
    exact = torques(panda, *exact_motion(panda, history.t))
    assert np.abs(history.healthy.rnea - exact).max() < 0.02 * np.abs(exact).max()


def test_recorded_velocities_are_differentiated_once(panda):
    t = times(6.0, 50)
    q, v, a = exact_motion(panda, t)
    exact = torques(panda, q, v, a)
    rough = np.round(q, 2)  # too coarse to be differentiated
    for rates, limit in ((v, 0.005), (np.round(v, 3), 0.02)):
        motion = start_of(panda, Recording.of(panda, t, rough, rates)).reference.motion(t)
        assert_close(motion.v, v, tol=0.02)
        assert np.abs(torques(panda, q, motion.v, motion.a) - exact).max() < (
            limit * np.abs(exact).max()
        )


def test_velocities_that_are_worse_than_the_positions_do_not_count(panda):
    """A recorder of fine positions and coarse velocities; in joint 4 they have a glitch, too."""
    t = times(6.0, 100)
    q, v, a = exact_motion(panda, t)
    rates = np.round(v, 2)
    rates[300, 3] += 0.5
    motion = start_of(panda, Recording.of(panda, t, np.round(q, 6), rates)).reference.motion(t)
    assert_close(motion.v, v, tol=1e-3)
    assert_close(motion.a, a, tol=0.01)
    mixed = np.where(np.arange(7) == 2, np.round(q, 2), np.round(q, 6))
    rates[:, 2] = v[:, 2]
    motion = start_of(panda, Recording.of(panda, t, mixed, rates)).reference.motion(t)
    assert_close(motion.a, a, tol=0.01)


def test_an_exact_motion_is_not_degraded(panda):
    t = times(10.0, 50)
    q, v, a = exact_motion(panda, t)
    for order in (0, 1, 3):  # polynomials, too
        line = (0.1 * t) ** order
        found = start_of(panda, Recording.of(panda, t, np.tile(line, (7, 1)).T)).reference.motion(t)
        assert_close(found.q[:, 3], line, tol=1e-12)
        assert_close(found.a[:, 3], 0.06 * t * 0.1 * (order == 3), scale=0.01, tol=1e-6)
    reference = start_of(panda, Recording.of(panda, t, q)).reference
    motion = reference.motion(t)
    assert not reference.smoothing.noise.any()
    assert_close(motion.q, q, tol=1e-12)
    assert_close(motion.v, v, tol=1e-4)
    assert_close(motion.a, a, tol=2e-3)


# ---- the splines -----------------------------------------------------------------------------


@pytest.mark.parametrize("how", [3, 5, "noise"])
def test_the_noise_is_found(panda, how):
    t = times(20.0, 100)
    q, *_ = exact_motion(panda, t)
    size = 2e-4 if how == "noise" else 10.0**-how / np.sqrt(12.0)
    assert_close(noise_of(t, blurred(q, how)).level, np.full(7, size), tol=0.1)


def dense(t, spacing):
    """Return knots, basis and prior covariance of the coefficients, as full matrices."""
    knots = smoothing._knots(t, spacing)
    B = BSpline(knots, np.eye(len(knots) - 6), 5)(t)
    return knots, B, np.linalg.inv(precision(B.shape[1])[0])


def precision(count):
    """Return the precision of coefficients as a full matrix, and the log of its determinant."""
    bands, log_det = smoothing._prior(count)
    Q = sum(np.diag(row[i:], i) for i, row in enumerate(bands[::-1][:count]))
    return Q + np.triu(Q, 1).T, log_det


def test_the_prior_is_a_smooth_stationary_process():
    for count in (7, 12, 40):
        Q, log_det = precision(count)
        covariance = np.linalg.inv(Q)
        apart = np.subtract.outer(np.arange(count), np.arange(count))
        wanted = np.exp(-0.5 * (apart / 3.0) ** 2)
        near = np.abs(apart) <= 8
        assert_close(covariance[near], wanted[near], tol=1e-7)
        assert_close(covariance, covariance[::-1, ::-1], tol=1e-7)
        assert log_det == pytest.approx(-np.linalg.slogdet(covariance)[1], rel=1e-7)


def test_splines_are_those_of_dense_algebra():
    """Knots follow the samples; c = ΣBᵀ(BΣBᵀ + r)⁻¹x for coefficients of covariance Σ."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.005, 0.03, 300))
    x = np.sin(t)[:, None] + rng.normal(0.0, 0.1, (300, 2))
    for spacing, ratio in ((0.1, 1e-2), (0.3, 1e-4), (10.0, 1e-6)):
        found = Spline(t, x, np.full(2, spacing), np.full(2, ratio))
        knots, B, S = dense(t, spacing)
        mean = x.mean(axis=0)
        c = S @ B.T @ np.linalg.solve(B @ S @ B.T + ratio * np.eye(300), x - mean)
        wanted = BSpline(knots, c + mean, 5)
        for derivative in range(3):
            assert_close(found(t, derivative), wanted(t, derivative), tol=1e-6)
            assert_close(found(t[7], derivative), wanted(t[7], derivative), tol=1e-6)


def test_the_most_likely_spline_is_chosen():
    """By the density of the samples, from full matrices: it is next to its largest value."""
    t = times(4.0, 50)
    x = np.sin(2.0 * t) + 0.3 * np.cos(t) + np.random.default_rng(4).normal(0.0, 1e-3, len(t))
    found = noise_of(t, x[:, None])

    def likelihood(spacing, ratio):
        _, B, S = dense(t, spacing)
        C = B @ S @ B.T + ratio * np.eye(len(t))
        y = x - x.mean()
        size = y @ np.linalg.solve(C, y) / len(t)  # the most likely one
        return -0.5 * (len(t) * np.log(size) + np.linalg.slogdet(C)[1])

    best = likelihood(found.spacing[0], found.ratio[0])
    for width in (0.5, 0.7, 1.0, 1.4, 2.0):
        for size in (0.1, 0.4, 1.0, 2.5, 10.0):
            assert likelihood(width * found.spacing[0], size * found.ratio[0]) < best + 1.5
    assert likelihood(2.0 * found.spacing[0], found.ratio[0]) < best - 5.0


def test_times_may_be_uneven(panda):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.002, 0.03, 700))
    t = np.delete(t - t[0], slice(300, 305))
    q, v, a = exact_motion(panda, t)
    wanted, weight = torques(panda, q, v, a), np.abs(torques(panda, q, 0 * v, 0 * a)).max()
    motion = start_of(panda, Recording.of(panda, t, np.round(q, 4))).reference.motion(t)
    assert np.abs(torques(panda, *motion) - wanted).max() < 0.02 * weight


def test_a_clock_that_jitters(panda):
    """Samples that are late for 10 ms on end: not white, so only quick motion can be ruled out.

    With knots as close as 6 ms, accelerations were wrong by 30 times the largest one.
    """
    t, rng = times(4.0, 1000), np.random.default_rng(6)
    late = np.convolve(rng.normal(0.0, 1e-4, len(t) + 9), np.ones(10), "valid")  # s
    assert 3e-4 < late.std() < 4e-4
    q, *_ = exact_motion(panda, t + late)
    _, _, wanted = exact_motion(panda, t)
    reference = start_of(panda, Recording.of(panda, t, np.round(q, 6))).reference
    off = np.abs(reference.motion(t).a - wanted)[500:-500].max()
    assert off < 0.6 * np.abs(wanted).max()


def test_a_long_recording_is_judged_by_pieces():
    t = times(300.0, 100)
    x = np.column_stack([np.sin(t), np.sin(0.3 * t), 0.0 * t, t])
    noise = np.random.default_rng(2).normal(0.0, 1e-3, x.shape) * [1.0, 1.0, 0.0, 0.0]
    found = noise_of(t, x + noise)
    assert_close(found.level, [1e-3, 1e-3, 0.0, 0.0], tol=0.05)
    assert found.spacing[1] > found.spacing[0] > 0.1
    assert_close(Spline(t, x + noise, found.spacing, found.ratio)(t), x, scale=1.0, tol=2e-3)


@pytest.mark.parametrize("derivative", [1, 2])
def test_the_uncertainty_is_that_of_many_draws(derivative):
    """Motions and noise are drawn as assumed; errors are counted in the middle and at the ends."""
    t, rng, draws, level = times(5.0, 100), np.random.default_rng(5), 2000, 0.01
    for spacing, ratio in ((0.3, 1e-3), (0.6, 1e-5)):
        knots, B, S = dense(t, spacing)
        c = rng.multivariate_normal(np.zeros(len(S)), level**2 / ratio * S, draws).T
        x = B @ c + rng.normal(0.0, level, (len(t), draws))
        places = np.array([2.5, 0.0, 5.0])
        spline = Spline(t, x, np.full(draws, spacing), np.full(draws, ratio))
        off = spline(places, derivative) - BSpline(knots, c, 5)(places, derivative)
        told = uncertainty_of(
            t, smoothing.Noise(*np.array([[spacing], [ratio], [level]])), derivative
        )
        middle, *ends = np.sqrt(np.mean(off**2, axis=1))
        assert_close(told[:, 0], [middle, np.mean(ends)], tol=0.1)
        assert told[1, 0] > 2.0 * told[0, 0]
    none = smoothing.Noise(np.zeros(1), np.ones(1), np.ones(1))
    drawn = Spline(t, rng.normal(0.0, 1.0, (501, 30)), np.zeros(30), np.zeros(30))(t, derivative)
    assert_close(uncertainty_of(t, none, derivative)[:, 0], np.full(2, np.std(drawn)), tol=0.1)


@pytest.mark.parametrize("count", [4, 5, 6, 7, 12, 13, 20, 40])
def test_few_samples_of_an_exact_motion_are_kept(panda, count):
    t = np.linspace(0.0, 3.0, count)
    q = panda.postures["default"] + 0.3 * np.sin(2.0 * t)[:, None]
    reference = start_of(panda, Recording.of(panda, t, q)).reference
    assert_close(reference.motion(t).q, q, tol=1e-7)
    plain = Spline(t, q, np.zeros(7), np.zeros(7))
    wanted = -1.2 * np.sin(2.0 * t)[:, None]
    worse = np.abs(plain(t, 2) - wanted).max()
    assert np.abs(reference.motion(t).a - wanted).max() <= worse * (1.0 + 1e-9)


# ---- what the user may choose ----------------------------------------------------------------


def test_noise_that_the_torques_cannot_bear_is_warned_of(panda):
    t = times(6.0, 100)
    q, v, a = exact_motion(panda, t)
    recording = Recording.of(panda, t, np.round(q, 4))

    def noisy(**options):
        found = timeline(panda, recording, force=PUSH, rate=5, **options)
        told = simulate(panda, recording, force=PUSH, rate=5, **options)
        words = [words for words in found.warnings if "noise in the recording" in words]
        assert words == [words for words in told.setting.warnings if "noise in the rec" in words]
        return words

    assert not noisy()
    assert not noisy(static=True)
    assert not noisy(smooth=0.5)
    assert noisy(smooth=0.03)
    (words,) = noisy(smooth="none")
    motion = start_of(panda, recording, smooth="none").reference.motion(t)
    off = np.abs(torques(panda, *motion) - torques(panda, q, v, a))
    told = float(words.split("±")[1].split()[0])
    assert 0.5 < told / np.sqrt(np.mean(off**2, axis=0)).max() < 2.0


def test_ends_that_the_data_do_not_support_are_warned_of():
    """`dh5` is light and quick: three decimals do not bear its torques where samples end."""
    robot, t = ftforce.load_robot("dh5"), times(10.0, 50)

    def told(decimals):
        q, *_ = exact_motion(robot, t, 1, 2.5, from_rest=True)
        found = timeline(robot, Recording.of(robot, t, np.round(q, decimals)), rate=5)
        return [words for words in found.warnings if "noise in the recording" in words]

    (words,) = told(3)
    assert "at its ends, where there are samples on one side only" in words
    assert "record for longer" in words
    assert not told(5)


def test_the_smoothing_is_reported(panda):
    t = times(5.0, 100)
    recording = Recording.of(panda, t, np.round(exact_motion(panda, t)[0], 3))
    for result in (
        timeline(panda, recording, force=PUSH, rate=2),
        simulate(panda, recording, force=PUSH, rate=2),
    ):
        (note,) = ftforce.to_dict(result)["notes"]
        assert "by maximum likelihood: noise of up to 0.00029" in note
        assert "residual (rms) of up to 0.0002" in note
        assert "--smooth SECONDS" in note
        assert "recording smoothed by splines" in to_text(render(result), width=400)
    (note,) = timeline(panda, recording, rate=2, smooth="none").notes
    assert note.startswith("samples interpolated; noise of up to 0.00029")
    (note,) = timeline(panda, recording, rate=2, smooth=0.5).notes
    assert "knots 0.5 s apart, as asked for" in note


def test_weight_only(panda):
    t = times(2.0, 50)
    recording = Recording.of(panda, t, np.round(exact_motion(panda, t)[0], 2))
    q = recording.q[::10]
    wanted = torques(panda, q, 0.0 * q, 0.0 * q)
    options = {"force": PUSH, "static": True, "smooth": "none", "rate": 5}
    history = simulate(panda, recording, faults="3@1", **options)
    assert_close(history.healthy.rnea, wanted)
    assert_close(history.remapped.rnea[:5], wanted[:5])
    assert "weight only" in history.setting.notes[0]
    found = timeline(panda, recording, **options)
    for i, x in enumerate(q):
        for j in range(7):
            told = ftforce.capability(panda, x, locked=[j + 1], direction=PUSH)
            most = told.directions[-1].after["commanded"].maximum
            assert found.capability[i, j] == pytest.approx(most, rel=1e-9)


@pytest.mark.parametrize("smooth", ["much", 0, -1.0, True, np.nan, None, 0.001])
def test_smoothing_that_makes_no_sense(panda, smooth):
    t = times(2.0, 50)
    recording = Recording.of(panda, t, exact_motion(panda, t)[0])
    with pytest.raises(InputError, match="smooth"):
        timeline(panda, recording, smooth=smooth)


def test_a_path_is_not_smoothed(dh5):
    path = Path.through([(0.9, 0.3, 0.2), (0.8, 0.4, 0.25)], speed=0.05)
    with pytest.raises(InputError, match="smooth applies to a recorded motion"):
        timeline(dh5, path, smooth=0.1)
    assert "weight only" in timeline(dh5, path, static=True, rate=2).notes[0]


# ---- wrapped angles and degrees --------------------------------------------------------------


@pytest.fixture(scope="module")
def ur5():
    return ftforce.load_robot("ur5")


def turning(robot, joint, start, speed, end=4.0):
    """Return a motion in which one joint turns, at 50 Hz with three decimals."""
    t = times(end, 50)
    q = np.tile([0.3, -1.2, 1.4, -1.0, -1.5, 2.6], (len(t), 1))
    q[:, joint] = start + speed * t
    return t, np.round(q, 3)


def wrapped(q):
    return np.round((q + np.pi) % TURN - np.pi, 3)


def file_of(tmp_path, robot, t, q):
    path = tmp_path / "motion.csv"
    rows = [",".join(f"{x:.6g}" for x in row) for row in np.column_stack([t, q])]
    path.write_text("\n".join([f"t,{','.join(robot.names)}", *rows]))
    return path


def test_wrapped_angles_are_unwrapped(tmp_path, ur5):
    t, q = turning(ur5, 5, 2.6, 0.4)
    given = wrapped(q)
    assert np.abs(np.diff(given, axis=0)).max() > 6.0
    plain = timeline(ur5, Recording.of(ur5, t, q), force=PUSH)
    for recording, place in (
        (Recording.of(ur5, t, given), "sample 69"),
        (Recording.read(ur5, file_of(tmp_path, ur5, t, given)), "line 70"),
    ):
        assert_close(recording.q, q, scale=1.0, tol=2e-3)
        (note,) = recording.notes
        assert note.endswith(f"were unwrapped: wrist_3_joint (at {place})")
        found = timeline(ur5, recording, force=PUSH)
        assert_close(found.capability, plain.capability, tol=0.01)
        np.testing.assert_array_equal(found.verdict, plain.verdict)
        assert note in found.notes


def test_whole_turns_bring_angles_inside(ur5):
    """A recording may start on the other side: -3.0 for 3.28 rad, beyond it for -2π."""
    t, q = turning(ur5, 5, -3.0, -1.2)  # to -7.8, below -2π
    assert_close(Recording.of(ur5, t, wrapped(q)).q, q + TURN * np.eye(6)[5], tol=1e-3)


def test_angles_that_leave_their_limits_are_refused(tmp_path, ur5):
    t, q = turning(ur5, 2, 2.6, 0.4)  # the elbow turns by π at most
    with pytest.raises(TrajectoryError) as caught:
        Recording.read(ur5, file_of(tmp_path, ur5, t, wrapped(q)))
    assert "line 70: elbow_joint jumps from 3.136 to -3.1" in str(caught.value)
    assert "would leave its limits" in str(caught.value)


def test_quick_steps_of_slow_recorders_are_no_turns(ur5):
    """3.14 rad/s and 2 s between samples: the joint may well have turned by 4 rad."""
    t = np.array([0.0, 2.0, 4.0, 6.0, 8.0])
    q = np.tile([0.3, -1.2, 1.4, -1.0, -1.5, 2.6], (5, 1))
    q[:, 5] = [-2.0, 2.0, -2.0, 2.0, -2.0]
    recording = Recording.of(ur5, t, q)
    assert_close(recording.q, q)
    assert not recording.notes


@pytest.mark.parametrize("function", [timeline, simulate])
def test_degrees_are_recognised(ur5, function):
    t, q = turning(ur5, 5, 0.5, 0.4)
    found = function(ur5, Recording.of(ur5, t, np.rad2deg(q)), force=PUSH, rate=2)
    assert any("these look like degrees" in words for words in found.warnings)
    again = function(ur5, Recording.of(ur5, t, q), force=PUSH, rate=2)
    assert not any("degrees" in words for words in again.warnings)


# ---- columns of other recorders --------------------------------------------------------------


def test_columns_that_are_not_needed_are_named(tmp_path, ur5):
    t, q = turning(ur5, 5, 0.5, 0.4)
    order = [3, 0, 5, 1, 4, 2]
    header = ["seq", "Time [s]", *(ur5.names[i] for i in order), "effort_1", "frame_id"]
    rows = [[str(k), f"{s:.6g}", *(f"{x:.6g}" for x in row[order]), "-3", "base"]
            for k, (s, row) in enumerate(zip(t.tolist(), q, strict=True))]  # fmt: skip
    path = tmp_path / "bag.csv"
    path.write_text("\n".join(",".join(row) for row in [header, *rows]))
    recording = Recording.read(ur5, path)
    assert_close(recording.t, t)
    assert_close(recording.q, q)
    (note,) = recording.notes
    assert note == (
        "the times are column 'Time'; columns that are no times or joints are ignored: 'seq', "
        "'effort_1', 'frame_id'"
    )
    assert note in timeline(ur5, path, force=PUSH, rate=2).notes
