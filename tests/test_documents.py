"""JSON: every number is recomputed from others by NumPy.

What a document says is enough to check it: Jacobian, weight, motion and limits stand in it.
"""

import numpy as np
import pytest

import ftforce
from helpers import campaign, load_text, serial_urdf
from results import (
    CAPABLE,
    CASES,
    INF,
    analysed,
    bounds,
    capable_of,
    json_of,
    massless,
    read,
    values,
)


@pytest.fixture(params=CASES)
def result(request):
    return analysed(request.param)


@pytest.fixture(params=CAPABLE)
def capability(request):
    return capable_of(request.param)


def state_masks(document):
    """Return which joints are locked, and which have no torque."""
    names, modes = document["robot"]["joints"], document["modes"]
    return (np.array([modes.get(name) == mode for name in names]) for mode in ("locked", "free"))


# ---- torques ---------------------------------------------------------------------------------


def test_torques_are_force_part_weight_and_motion(result):
    document = json_of(result)
    torque, force = document["torque"], document["force"]
    J = np.array(document["jacobian"]["matrix"])
    locked, free = state_masks(document)
    before, after, gravity, gravity_after, motion, motion_after = (
        values(part[when])
        for part in (torque, torque["gravity"], torque["motion"])
        for when in ("before", "after")
    )
    self_motion = values(torque["self_motion"])
    np.testing.assert_allclose(before, J.T @ force["before"] + self_motion, atol=1e-9)
    np.testing.assert_array_equal(gravity, gravity_after)
    np.testing.assert_allclose(values(torque["total"]["before"]), before + gravity + motion)
    part = J.T @ force["after"]  # what the force at the tip asks of every joint
    np.testing.assert_allclose(after, np.where(locked, 0.0, part), atol=1e-9)
    total = values(torque["total"]["after"])
    assert np.isnan(total[locked]).all()
    assert not total[free].any()
    np.testing.assert_allclose((part + gravity + motion_after)[free], 0.0, atol=1e-8)
    working = ~locked & ~free
    sum_ = part + gravity_after + motion_after
    np.testing.assert_allclose(total[working], sum_[working], atol=1e-8)
    loads = torque["brake_load"]
    assert list(loads) == document["locked"]
    np.testing.assert_allclose(list(loads.values()), sum_[locked], atol=1e-8)
    jump = np.array(force["before"]) - force["after"]
    np.testing.assert_allclose(force["jump"], jump, atol=1e-9)


def test_motion_is_that_of_joints_that_are_not_locked(result):
    document, conditions = json_of(result), result.conditions
    before, after = (values(document["torque"]["motion"][when]) for when in ("before", "after"))
    if not conditions.moves:
        assert not before.any()
        assert not after.any()
        return
    locked, _ = state_masks(document)
    moving = {
        "velocity": np.where(locked, 0.0, conditions.velocity),
        "acceleration": np.where(locked, 0.0, conditions.acceleration),
        "payload": conditions.payload,
    }
    stopped = ftforce.analyze(result.robot, result.posture, **moving)
    expected = values(json_of(stopped)["torque"]["motion"]["before"])
    np.testing.assert_allclose(after, expected, atol=1e-9)
    assert np.abs(before - after).max() > 1e-3


@pytest.mark.parametrize("name", ["dh5", "tiago", "kinova"])
def test_weight_and_inertia_of_a_payload(name):
    """A point mass pulls with m·g at its place, and pushes back with m·a."""
    robot = ftforce.load_robot(name)
    mass, offset, gravity = 1.5, np.array([0.1, -0.05, 0.2]), np.array([1.0, -2.0, -9.0])
    a = np.linspace(-1.0, 1.0, robot.n)
    case = {"gravity": gravity, "acceleration": a, "task": "wrench"}
    bare = json_of(ftforce.analyze(robot, **case))
    loaded = json_of(ftforce.analyze(robot, **case, payload=(mass, offset)))
    assert bare["conventions"]["payload"] is None
    assert loaded["conventions"]["payload"] == {"mass": mass, "offset": offset.tolist()}
    assert loaded["conventions"]["gravity"] == gravity.tolist()
    tool = np.array(loaded["jacobian"]["matrix"])
    world = np.array(json_of(ftforce.analyze(robot, **case, axes="world"))["jacobian"]["matrix"])
    R = world[:3] @ np.linalg.pinv(tool[:3])  # from the tool's axes to the root's
    J = world[:3] - np.cross(R @ offset, world[3:], axisb=0).T
    added = {
        key: values(loaded["torque"][key]["before"]) - values(bare["torque"][key]["before"])
        for key in ("gravity", "motion")
    }
    np.testing.assert_allclose(added["gravity"], -mass * gravity @ J, atol=1e-9)
    np.testing.assert_allclose(added["motion"], mass * J.T @ J @ a, atol=1e-9)


def mass_matrix(robot, posture=None):
    """Return M column by column, from the torques for unit accelerations."""
    columns = [ftforce.analyze(robot, posture, acceleration=a) for a in np.eye(robot.n)]
    return np.array([values(json_of(one)["torque"]["motion"]["before"]) for one in columns]).T


@pytest.mark.parametrize("name", ["dh5", "panda", "tiago", "kinova"])
def test_velocities_right_after_a_lock(name):
    robot = ftforce.load_robot(name)
    M = mass_matrix(robot)
    np.testing.assert_allclose(M, M.T, atol=1e-9)
    v = np.linspace(0.5, -0.4, robot.n)
    document = json_of(ftforce.analyze(robot, locked=[2, 4], velocity=v))
    S = np.isin(np.arange(robot.n), [1, 3])
    after = np.where(S, 0.0, v)
    after[~S] += np.linalg.solve(M[np.ix_(~S, ~S)], M[np.ix_(~S, S)] @ v[S])
    impact = document["velocity"]["impact"]
    np.testing.assert_allclose(values(impact["after"]), after, atol=1e-9)
    tip = np.array(document["jacobian"]["matrix"]) @ after
    np.testing.assert_allclose(impact["tip_after"], tip, atol=1e-9)
    jump = tip - document["velocity"]["tip_before"]
    np.testing.assert_allclose(impact["jump"], jump, atol=1e-9)
    np.testing.assert_allclose(impact["jump_norm"], np.linalg.norm(jump))
    assert impact["angular_jump_norm"] is None


def test_without_a_lock_there_is_no_impact():
    robot = ftforce.load_robot("dh5")
    document = json_of(ftforce.analyze(robot, free=[2], velocity=np.ones(5)))
    assert document["velocity"]["impact"] is None


def test_the_dynamic_inverse_of_torques():
    robot, tau = ftforce.load_robot("panda"), np.arange(1.0, 8.0)
    documents = {
        inverse: json_of(ftforce.analyze(robot, torque=tau, inverse=inverse))
        for inverse in ("euclidean", "dynamic")
    }
    J = np.array(documents["dynamic"]["jacobian"]["matrix"])
    through = J @ np.linalg.inv(mass_matrix(robot))
    for inverse, F in (
        ("euclidean", np.linalg.lstsq(J.T, tau)[0]),
        ("dynamic", np.linalg.solve(through @ J.T, through @ tau)),
    ):
        assert documents[inverse]["conventions"]["inverse"] == inverse
        np.testing.assert_allclose(documents[inverse]["force"]["before"], F, atol=1e-9)
        self_motion = values(documents[inverse]["torque"]["self_motion"])
        np.testing.assert_allclose(self_motion, tau - J.T @ F, atol=1e-9)


def test_without_masses_weight_and_totals_are_unknown(tmp_path):
    robot = massless(tmp_path)
    result = ftforce.analyze(robot, locked=[2], force=[1, 2, 3], velocity=np.ones(4))
    document, unknown = json_of(result), None
    torque = document["torque"]
    assert torque["gravity"] == {"before": unknown, "after": unknown}
    assert torque["motion"] == {"before": unknown, "after": unknown}
    assert torque["total"] == {"before": unknown, "after": unknown}
    J = np.array(document["jacobian"]["matrix"])
    part = J.T @ document["force"]["after"]
    np.testing.assert_allclose(torque["brake_load"]["j2"], part[1])
    assert any("has no masses" in warning for warning in document["warnings"])


def test_without_masses_and_gravity_nothing_is_unknown(tmp_path):
    document = json_of(ftforce.analyze(massless(tmp_path), force=[1, 2, 3], gravity=[0, 0, 0]))
    torque = document["torque"]
    assert set(torque["gravity"]["before"].values()) == {0.0}
    assert torque["total"]["before"] == torque["before"]
    assert document["warnings"] == []


def test_the_condition_number_is_that_of_the_reduced_jacobian(result):
    document = json_of(result)
    lengths = [name[0] == "m" for name in document["conventions"]["components"]]
    weights = np.where(lengths, document["conventions"]["length"] or 1.0, 1.0)
    J = weights[:, None] * document["jacobian"]["matrix"]
    locked, free = state_masks(document)
    away = np.eye(len(J)) - J[:, free] @ np.linalg.pinv(J[:, free])
    K = away @ J[:, ~locked & ~free]
    found = document["jacobian"]["condition_number_after"]
    if document["jacobian"]["rank_after"] < len(J):
        assert found is None
        assert np.linalg.matrix_rank(K, rtol=1e-6) < len(J)
    else:
        np.testing.assert_allclose(found, np.linalg.cond(K), rtol=1e-9)


# ---- faults, limits, standing ----------------------------------------------------------------


def test_modes_and_factors():
    document = json_of(analysed("mixed"))
    assert document["locked"] == ["joint2"]
    assert document["modes"] == {"joint2": "locked", "joint3": "weak", "joint4": "free"}
    assert document["weak_factors"] == {"joint3": 0.5}


def test_limits_that_count(result):
    document = json_of(result)
    if result.limits is None:
        assert document["limits"] is None
        assert document["capability"] is None
        return
    names, limits = document["robot"]["joints"], document["limits"]
    assert limits["source"] == "urdf"
    assert list(limits["effort"]) == list(limits["brake"]) == names
    assert set(limits["brake"].values()) == {None}  # a URDF knows none
    known = {joint.name: joint.effort for joint in result.robot.joints}
    assert limits["effort"] == known
    largest = bounds(document)
    unknown = [name for name, most in zip(names, largest, strict=True) if most == INF]
    assert limits["unknown"] == unknown
    torque = document["torque"]
    given = values(torque["total"]["after"] | torque["brake_load"])
    assert (np.abs(given) <= largest + 1e-6).all()
    full = np.isclose(np.abs(given), largest, rtol=1e-9) & (largest > 0.0)
    assert limits["binding"] == [name for name, at in zip(names, full, strict=True) if at]
    least, most = interval(document, np.array(document["force"]["before"]))
    if least <= min(most, 1.0):
        np.testing.assert_allclose(limits["share"], min(most, 1.0), atol=1e-9)
    else:
        assert limits["share"] is None


def interval(document, d, when="after", reading="commanded"):
    """Return the s ≥ 0 for which motors (and locks) hold s·d, by nothing but J, weight and limits.

    (0, -1) if there are none.
    """
    J = np.array(document["jacobian"]["matrix"])
    parts = (document["torque"]["gravity"], document["torque"]["motion"])
    rnea = sum(values(part[when]) for part in parts)
    levers, largest = J.T @ d, bounds(document, when)
    least, most = 0.0, INF
    for x, weight, limit in zip(levers, rnea, largest, strict=True):
        if abs(x) > 1e-9:
            ends = sorted(((-limit - weight) / x, (limit - weight) / x))
            least, most = max(least, ends[0]), min(most, ends[1])
        elif abs(weight) > limit + 1e-9:
            return 0.0, -1.0
    locked = [document["modes"].get(n) == "locked" for n in document["robot"]["joints"]]
    if reading == "commanded" and when == "after":
        K = J[:, ~np.array(locked)]
        if np.linalg.norm(d - K @ np.linalg.pinv(K, rcond=1e-6) @ d) > 1e-6 * np.linalg.norm(d):
            most = min(most, 0.0)
    return (least, most) if least <= most + 1e-9 else (0.0, -1.0)


def test_support_of_a_free_joint():
    """The least force that balances a joint is the one of the pseudoinverse."""
    robot = ftforce.load_robot("dh5")
    document = json_of(ftforce.analyze(robot, free=[3]))
    J = np.array(document["jacobian"]["matrix"])
    weight = document["torque"]["gravity"]["after"]["joint3"]
    support = -weight * J[:, 2] / (J[:, 2] @ J[:, 2])
    standing = document["standing"]
    np.testing.assert_allclose(standing["support"], support, atol=1e-9)
    assert (standing["can_stand_still"], standing["unbalanced"]) == (True, {})
    assert standing["overloaded"] == {}  # no limits
    assert json_of(ftforce.analyze(robot, locked=[3]))["standing"]["support"] is None
    asked = json_of(ftforce.analyze(robot, free=[3], force=[1, 2, 3]))
    assert asked["standing"]["support"] is None  # the force is the question


def test_an_arm_that_falls():
    """Joint 8 of TIAGo turns about an axis through the tip: no force there balances it."""
    robot = ftforce.load_robot("tiago")
    result = ftforce.analyze(robot, free=[8], force=[1, 2, 3], friction=0)
    document = json_of(result)
    weight = document["torque"]["gravity"]["before"]["arm_7_joint"]
    assert document["standing"]["can_stand_still"] is False
    assert list(document["standing"]["unbalanced"]) == ["arm_7_joint"]
    np.testing.assert_allclose(document["standing"]["unbalanced"]["arm_7_joint"], weight)
    assert document["force"]["after"] is document["force"]["jump"] is None
    torque = document["torque"]
    assert torque["after"] is torque["total"]["after"] is torque["brake_load"] is None
    np.testing.assert_allclose(
        values(torque["total"]["before"]),
        values(torque["before"]) + values(torque["gravity"]["before"]),
    )
    assert document["residuals"] == {}
    assert "the arm cannot be held in static equilibrium" in document["summary"]


def test_a_motor_that_cannot_carry_the_arm():
    result = ftforce.analyze(ftforce.load_robot("dh5"), weak={3: 0.05})
    document = json_of(result)
    weight = document["torque"]["gravity"]["after"]["joint3"]
    standing = document["standing"]
    assert standing["overloaded"] == {"joint3": {"torque": weight, "limit": 4.0}}
    assert abs(weight) > 4.0
    J = np.array(document["jacobian"]["matrix"])
    np.testing.assert_allclose(J[:, 2] @ standing["support"] + weight, 4.0)
    assert document["limits"]["binding"] == ["joint3"]
    assert document["limits"]["share"] is None
    amounts = ("the arm can be held only while the tip presses", "4.76 N·m at joint3")
    assert all(text in document["summary"] for text in amounts)


def test_a_supporting_force_that_rounds_to_nothing_is_not_listed():
    panda = ftforce.load_robot("panda")
    for pull, is_listed in ((9.81, True), (1e-4, False)):
        document = json_of(ftforce.analyze(panda, free=[4], gravity=[0, 0, -pull], friction=0))
        support = np.array(document["standing"]["support"])
        assert np.linalg.norm(support) > 1e-6 * pull  # without it the arm falls
        assert ("presses" in document["summary"]) is is_listed
        assert "0.00 N, fy 0.00 N" not in document["summary"]


def test_residuals_are_small(result):
    document = json_of(result)
    laws = {"balance", "orthogonality", "uncommandable", "statics", "unchanged"}
    if result.bounded is not None:
        laws = {"equality", "limit", "optimality"}
    assert set(document["residuals"]) == laws
    assert all(0.0 <= value <= 1e-6 for value in document["residuals"].values())


# ---- capability ------------------------------------------------------------------------------


def test_the_largest_force_in_a_direction(capability):
    analysis = capability.analysis
    document, found = json_of(analysis), json_of(capability)["capability"]
    m = analysis.task.m
    signs = [f"{sign}{name}" for name in analysis.task.components for sign in "+-"]
    assert [one["name"] for one in found["directions"]] == [*signs, "direction"]
    rows = np.vstack([np.eye(m).repeat(2, axis=0) * np.tile([1, -1], m)[:, None], np.arange(m) + 1])
    for one, d in zip(found["directions"], rows, strict=True):
        size = np.linalg.norm(d[list(analysis.task.force_rows)]) or np.linalg.norm(d)
        np.testing.assert_allclose(one["direction"], d / size, atol=1e-12)
        assert one["unit"] == ("N" if d[list(analysis.task.force_rows)].any() else "N·m")
        for when in ("before", "after"):
            for reading in ("commanded", "held"):
                least, most = interval(document, d / size, when, reading)
                got = read(one[when][reading])
                if most < least:
                    assert got is None
                else:
                    np.testing.assert_allclose(got, (least, most), atol=1e-5)
                check_end(document, one[when][reading], d / size, when)


def check_end(document, amount, d, when):
    """See that the joints that stop a force are at their limits with it."""
    if amount["end"] != "limit":
        return
    names = document["robot"]["joints"]
    rnea = sum(values(document["torque"][part][when]) for part in ("gravity", "motion"))
    torque = rnea + np.array(document["jacobian"]["matrix"]).T @ d * amount["most"]
    largest = bounds(document, when)
    for name in amount["stops"]:
        i = names.index(name)
        np.testing.assert_allclose(abs(torque[i]), largest[i], rtol=1e-6)


def test_no_direction_is_weaker_than_the_weakest(capability):
    analysis = capability.analysis
    document, found = json_of(analysis), json_of(capability)["capability"]["weakest"]
    task, rng = analysis.task, np.random.default_rng(5)
    mixed = bool(task.force_rows and task.moment_rows)
    assert found["unit"] == ("weighted N" if mixed else task.units[0])
    scale = task.length if task.moment_rows and not task.force_rows else 1.0
    for when in ("before", "after"):
        for reading in ("commanded", "held"):
            amount = found[when][reading]
            got = read(amount)
            if got is None or got[1] == INF:
                assert amount["direction"] is None
                continue
            d = np.array(amount["direction"])
            weighted = d / (1.0 if task.weights is None else task.weights) * scale
            np.testing.assert_allclose(np.linalg.norm(weighted), 1.0)
            np.testing.assert_allclose(interval(document, d, when, reading)[1], got[1], atol=1e-5)
            for draw in rng.normal(size=(campaign(100), task.m)):
                other = draw / np.linalg.norm(draw)  # weighted
                plain = other * (1.0 if task.weights is None else task.weights) / scale
                if got[1] > 0.0:
                    assert interval(document, plain, when, reading)[1] >= got[1] * (1.0 - 1e-9)


def test_the_largest_payload(capability):
    """With it a motor, or a brake, is at its limit; the weight of more would be too much."""
    analysis = capability.analysis
    payload = json_of(capability)["capability"]["payload"]
    assert payload["unit"] == "kg"
    present = analysis.conditions.payload
    mass, offset = (0.0, np.zeros(3)) if present is None else (present.mass, present.offset)
    for when in ("before", "after"):
        amount = payload[when]
        if amount["end"] != "limit":
            continue
        conditions = analysis.conditions
        options = {"limits": "urdf", "axes": analysis.task.axes}
        options |= {"velocity": conditions.velocity, "acceleration": conditions.acceleration}
        options["payload"] = (mass + amount["most"], offset)
        if when == "after":
            faults = analysis.faults.faults
            options["locked"] = [f.joint + 1 for f in faults if f.mode == "locked"]
            options["weak"] = {f.joint + 1: f.factor for f in faults if f.mode == "weak"}
        document = json_of(ftforce.analyze(analysis.robot, analysis.posture, **options))
        parts = (document["torque"][part]["after"] for part in ("gravity", "motion"))
        used = np.abs(sum(map(values, parts))) / bounds(document)
        names = [n for n, x in zip(analysis.robot.names, used, strict=True) if x > 1.0 - 1e-9]
        assert names == amount["stops"]
        np.testing.assert_allclose(used.max(), 1.0)


def test_corners_of_the_polytope(capability):
    analysis = capability.analysis
    document, found = json_of(analysis), json_of(capability)["polytope"]
    if analysis.task.m > 3:
        assert found is None
        return
    for when in ("before", "after"):
        rnea = sum(values(document["torque"][part][when]) for part in ("gravity", "motion"))
        for reading in ("commanded", "held"):
            polytope = found[when][reading]
            corners = np.array(polytope["vertices"]).reshape(-1, analysis.task.m)
            torque = rnea + corners @ np.array(document["jacobian"]["matrix"])
            assert (np.abs(torque) <= bounds(document, when) + 1e-6).all()
            rows = {row for face in polytope["faces"] for row in face}
            assert rows <= set(range(len(corners)))
            assert len(corners) > polytope["dimension"]
    assert isinstance(found["before"]["held"]["is_bounded"], bool)


def test_an_analysis_holds_its_capability(capability):
    analysis = capability.analysis
    whole = json_of(ftforce.analysis.capability.capability_of(analysis))
    assert json_of(analysis)["capability"] == whole["capability"]
    document = json_of(analysis)
    keys = ["robot", "conventions", "posture", "locked", "modes", "weak_factors"]
    assert list(whole) == [
        *keys,
        "limits",
        "capability",
        "polytope",
        "summary",
        "warnings",
        "provenance",
    ]
    assert all(whole[key] == document[key] for key in (*keys, "warnings"))
    counted = (
        *("source", "effort", "effort_lower", "brake", "stall_torque", "no_load_speed"),
        "unknown",
    )
    assert whole["limits"] == {key: document["limits"][key] for key in counted}


def test_a_capability_without_limits():
    robot = ftforce.load_robot("dh5")
    document = json_of(ftforce.capability(robot, limits="none", locked=[3]))
    assert document["limits"] is None
    along_x, along_y = (document["capability"]["directions"][i]["after"] for i in (0, 2))
    nothing = {"most": None, "least": 0.0, "end": "unlimited", "stops": []}
    fault = {"most": 0.0, "least": 0.0, "end": "fault", "stops": ["joint3"]}
    assert along_x == {"commanded": fault, "held": nothing}
    assert along_y == {"commanded": nothing, "held": nothing}


# ---- census ----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["locked", "free"])
@pytest.mark.parametrize("force", [[5, 8, 9], None], ids=["force", "no force"])
def test_sets_of_a_census_are_analyses(mode, force):
    robot = ftforce.load_robot("panda")
    case = {"limits": "urdf", "payload": 1.0, "velocity": np.ones(7), "force": force}
    census = ftforce.census(robot, mode=mode, rank_by="capability", **case)
    document = json_of(census)
    assert (document["mode"], document["rank_by"], document["faults"]) == (mode, "capability", 1)
    assert document["limits"]["source"] == "urdf"
    assert document["conventions"]["payload"] == {"mass": 1.0, "offset": [0.0, 0.0, 0.0]}
    direction = None if force is None else np.array(force) / np.linalg.norm(force)
    np.testing.assert_allclose(
        document["direction"] or [], [] if direction is None else direction, atol=1e-12
    )
    for entry in document["sets"]:
        (name,) = entry["modes"]
        assert entry["modes"] == {name: mode}
        assert entry["locked"] == ([name] if mode == "locked" else [])
        assert entry["weak_factors"] == {}
        analysis = ftforce.analyze(robot, **{mode: name}, **case)
        whole = json_of(analysis)
        assert entry["can_stand_still"] == whole["standing"]["can_stand_still"]
        assert entry["binding"] == whole["limits"]["binding"]
        assert entry["share"] == pytest.approx(whole["limits"]["share"])
        assert entry["verdict"] == whole["verdict"]
        after = np.linalg.svd(np.where(analysis.reduced.locked, 0.0, analysis.J), compute_uv=False)
        if mode == "locked":
            assert whole["jacobian"]["sigma_min_after"] == pytest.approx(after[-1])
        capability = json_of(ftforce.analysis.capability.capability_of(analysis, direction))
        found = capability["capability"]
        after = found["weakest" if force is None else "directions"]
        after = after["after"] if force is None else after[-1]["after"]
        for reading in ("commanded", "held"):
            assert entry["capability"][reading] == pytest.approx(after[reading]["most"])
        stops = after["commanded"]["stops"] if after["commanded"]["end"] == "limit" else []
        assert entry["capability"]["stops"] == stops


def test_joints_of_a_census_by_capability():
    census = ftforce.census(ftforce.load_robot("dh5"), faults=2, rank_by="capability")
    document = json_of(census)
    for entry in document["joints"]:
        own = [one for one in document["sets"] if entry["joint"] in one["modes"]]
        assert entry["sets"] == len(own) == 5
        assert entry["alone"] == next(one for one in own if len(one["modes"]) == 1)
        least = min(one["capability"]["commanded"] for one in own)
        assert entry["least_capability"] == least
    commanded = [one["capability"]["commanded"] for one in document["sets"]]
    assert [round(x, 9) for x in commanded] == sorted(round(x, 9) for x in commanded)
    by_jump = json_of(ftforce.census(ftforce.load_robot("dh5")))
    assert by_jump["limits"] is by_jump["direction"] is None
    assert {entry["least_capability"] for entry in by_jump["joints"]} == {None}
    assert {str(entry["capability"]) for entry in by_jump["sets"]} == {"None"}


def test_a_planar_arm_by_hand():
    """Two rods of 0.4 m and 0.3 m, stretched along x; the free elbow cannot carry its rod.

    The rods' masses hang where the links' frames are: 1 kg at the elbow, 1 kg at the tip's link.
    """
    robot = load_text(
        serial_urdf(
            ("revolute", {"axis": (0, 1, 0), "effort": 20.0}),
            ("revolute", {"axis": (0, 1, 0), "effort": 10.0, "xyz": (0.4, 0, 0)}),
        ).replace('xyz="0.11 0.05 0.03"', 'xyz="0.3 0 0"')
    )
    case = {"task": "fz", "axes": "world", "limits": "urdf", "force": [-5.0]}
    result = ftforce.analyze(robot, [0.0, 0.0], **case)
    document, g = json_of(result), 9.81
    # About y a positive torque pushes the tip down: levers -0.7 m and -0.3 m.
    np.testing.assert_allclose(document["jacobian"]["matrix"], [[-0.7, -0.3]], atol=1e-12)
    gravity = values(document["torque"]["gravity"]["before"])
    np.testing.assert_allclose(gravity, [-(0.4 + 0.7) * g, -0.3 * g], atol=1e-9)
    np.testing.assert_allclose(values(document["torque"]["before"]), [3.5, 1.5], atol=1e-12)
    up, down = document["capability"]["directions"]
    np.testing.assert_allclose(
        [one["after"]["commanded"]["most"] for one in (up, down)],
        [(20.0 - 1.1 * g) / 0.7, (10.0 + 0.3 * g) / 0.3],
        rtol=1e-9,
    )
    assert [one["after"]["commanded"]["stops"] for one in (up, down)] == [["j1"], ["j2"]]
    payload = document["capability"]["payload"]["after"]
    np.testing.assert_allclose(payload["most"], (20.0 - 1.1 * g) / 0.7 / g, rtol=1e-9)
    free = json_of(ftforce.analyze(robot, [0.0, 0.0], free=[2], **case))
    # The table has to carry the elbow's rod: the tip presses down with 1 kg.
    np.testing.assert_allclose(free["force"]["after"], [-g], rtol=1e-9)
    assert free["torque"]["total"]["after"]["j2"] == 0.0
