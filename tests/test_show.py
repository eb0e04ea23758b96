"""Results as people see them: in 80 columns, in notebooks, as pictures."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from rich.text import Text

import ftforce
from ftforce.analysis.capability import CapabilityRange
from ftforce.analysis.paper import replicate
from ftforce.core.feasible_forces import LimitingFactor
from ftforce.core.task import Task
from ftforce.core.verdict import Verdict
from ftforce.report import analysis as sentences
from ftforce.report import capability as capability_words
from ftforce.report import text as words
from ftforce.report.census import critical_joint
from ftforce.robot.known_robots import known_robots
from ftforce.show.render import render, to_html, to_svg, to_text
from ftforce.show.tables.analysis import analysis_view
from helpers import CAMPAIGN
from results import massless


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def papers_case(arm):
    return ftforce.analyze(arm, locked=[2, 4, 5], force=[80, 50, 10])


def results(arm):
    velocity = np.ones(arm.n)
    yield arm
    yield ftforce.analyze(arm, locked=[1], force=[80, 50, 10], velocity=velocity)
    yield ftforce.analyze(arm, locked=[1, 2], task="wrench", velocity=velocity)
    yield ftforce.analyze(arm, torque=velocity, task="fx,my")
    yield ftforce.census(arm, faults=2, force=[80, 50, 10])
    yield ftforce.census(arm, task="moment")
    moving = {"velocity": velocity, "acceleration": -velocity, "payload": (0.5, (0, 0, 0.1))}
    mixed = {"locked": [1], "free": [2], "weak": {3: 0.5}}
    for task, force in (("force", [8, 5, 1]), ("wrench", [8, 5, 1, 1, 2, 3])):
        yield ftforce.analyze(arm, **mixed, **moving, task=task, force=force)
        yield ftforce.analyze(arm, **mixed, **moving, task=task)
        yield ftforce.analyze(arm, free=[1, 3], task=task, torque=velocity)
        yield ftforce.census(arm, mode="free", task=task, force=force, limits="urdf")
        yield ftforce.census(arm, faults=2, task=task, rank_by="capability", **moving)
        yield ftforce.census(arm, rank_by="capability", task=task, force=force)
        for faults in ({"locked": [1, 3]}, {"free": [2]}, {"weak": {2: 0.05}}, mixed):
            direction = np.ones(len(force))
            yield ftforce.capability(arm, **faults, **moving, task=task, direction=direction)


@pytest.mark.no_cover
@pytest.mark.thorough
@pytest.mark.parametrize("name", known_robots() if CAMPAIGN else ("panda", "tiago"))
def test_everything_fits_a_terminal_of_80_columns(name):
    for result in results(ftforce.load_robot(name)):
        shown = to_text(result)
        lines = shown.splitlines()
        assert max(map(len, lines)) <= 80
        assert "…" not in shown.replace("… and", "")  # nothing is cut off
        assert not re.search(r"-0\.?0*(\s|$)", shown)
        assert not re.search(r"\b(nan|inf)\b", shown)
        assert "\n\n\n" not in shown


def test_the_table_holds_the_answer(papers_case):
    shown = to_text(papers_case)
    frame, tolerances = "axes of the tool frame", "rank tolerance 1e-06, borderline below 0.01"
    for expected in (
        frame,
        tolerances,
        "Condition number cond(K)   ∞",
        "posture 'paper'",
        "2 of 3",
        "joint2 -6.59 N·m",
        "1.02",
    ):
        assert expected in shown
    cells = ["2", "joint2", "locked", "1.222", "-12.33", "0.00", "0.00", "brake", "unknown", "?"]
    assert row(papers_case, "2 joint2") == cells


def test_degrees_and_metres(arm):
    shown = to_text(analysis_view(ftforce.analyze(arm, force=[1, 1, 1]), degrees=True))
    assert "[deg]" in shown
    assert "70.00" in shown
    tiago = ftforce.analyze(ftforce.load_robot("tiago"), force=[1, 1, 1])
    line = next(line for line in to_text(tiago).splitlines() if "torso_lift" in line)
    assert "0.150 m" in line
    assert "2000 N" in line


def test_a_request_beyond_the_healthy_arm_is_shown():
    ur5 = ftforce.load_robot("ur5")
    straight = ftforce.analyze(ur5, np.zeros(6), force=[8, 5, 1, 1, 2, 3], task="wrench")
    shown = to_text(straight)
    assert "unsupported" in shown
    assert "Even the healthy arm cannot exert" in " ".join(shown.split())
    units = to_text(ftforce.analyze(ur5, np.zeros(6), task="wrench"))
    assert "* partly beyond even the healthy arm" in units


def test_names_are_never_markup(arm):
    evil = ftforce.load_robot("dh5")
    joint = evil.joints[0]
    object.__setattr__(joint, "name", "[red]x[/red]<b>")
    evil.__dict__.pop("names", None)
    limits = {"limits": "urdf", "weak": {1: 0.01}}
    for result in (
        evil,
        ftforce.analyze(evil, locked=[1], force=[1, 1, 1]),
        ftforce.analyze(evil, free=[1], velocity=np.ones(5)),
        ftforce.analyze(evil, **limits, force=[80, 50, 10], task="force"),
        ftforce.census(evil, force=[1, 1, 1]),
        ftforce.census(evil, rank_by="capability", mode="free"),
        ftforce.capability(evil, locked=[1]),
        ftforce.capability(evil, **limits),
    ):
        assert "[red]x[/red]<b>" in "".join(line.strip() for line in to_text(result).split("\n"))
        assert "<b>" not in to_html(result)
        ElementTree.fromstring(to_svg(result, "[red]<b>"))


def test_names_of_files_are_never_markup(arm, tmp_path):
    path = tmp_path / "[red]x<b>.csv"
    path.write_text("joint,effort\n1,5\n")
    for result in (
        ftforce.analyze(arm, limits=path),
        ftforce.census(arm, limits=path),
        ftforce.capability(arm, limits=path),
    ):
        assert "[red]x<b>.csv" in "".join(map(str.strip, to_text(result).splitlines()))
        assert "<b>" not in to_html(result)


def test_notebooks_get_html(papers_case, arm):
    capability = ftforce.capability(arm, locked=[2, 4], direction=[1, 1, 0])
    assert "461.2" in capability._repr_html_()
    by_capability = ftforce.census(arm, rank_by="capability", mode="free")
    tables = (papers_case, arm, ftforce.census(arm), by_capability, capability, replicate(arm))
    for result in tables:
        html = result._repr_html_()
        assert html.startswith("<pre")
        ElementTree.fromstring(html)
    assert "43.66" in papers_case._repr_html_()


def test_svg_is_a_picture_and_repeats(papers_case):
    first, second = (to_svg(papers_case, "title") for _ in range(2))
    assert first == second
    ElementTree.fromstring(first)


def test_a_remap_shows_itself():
    J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
    result = ftforce.remap(J, J.T @ [10.0, 5.0], np.array([False, True, True]))
    shown = to_text(result)
    assert "locked" in shown
    assert "Jump norm  5.0000" in shown


def test_what_has_no_table_shows_its_repr():
    assert render(3) == Text("3")


def test_replication_marks_every_outcome(arm):
    shown = to_text(replicate(arm))
    assert "3.18 1.02 e" in shown
    assert "43.66 43.66 ✓" in shown


def test_numbers_show_no_negative_zero_and_no_jump_as_none():
    for x, expected in ((-0.001, "0.00"), (-0.0, "0.00"), (2.346, "2.35"), (-12.346, "-12.35")):
        assert words.number(x) == expected
    for x, expected in ((-0.001, "-1e-03"), (-1e-12, "0.00"), (0.004, "4e-03"), (0.006, "0.01")):
        assert words.size(x) == expected


def test_directions_in_words():
    task = Task.parse("wrench")
    assert words.direction(task, np.eye(6)[1]) == "force along y"
    assert words.direction(task, np.eye(6)[5]) == "moment about z"
    assert (
        words.direction(task, np.array([0.6, 0, 0, 0, -0.8, 0])) == "wrench along +0.60 fx -0.80 my"
    )
    assert words.lost_directions(task, []) == "none"


def test_the_verdict_in_words(arm):
    force = {"force": [80, 50, 10]}
    for case, expected in (
        ({"locked": [2, 4], **force}, "maintain the full 94.87 N"),
        ({"locked": [3], **force}, "80.00 N of 94.87 N can no longer be commanded"),
        ({"locked": [2, 4], **force, "wary": 0.05}, "Borderline"),
        ({"locked": [2, 4]}, "every force that the healthy arm can exert here is kept"),
        ({"locked": [3]}, "force along x"),
        ({"locked": [2, 4], "wary": 0.05}, "close to losing a direction"),
        (force, "with every joint healthy"),
    ):
        assert expected in sentences.verdict_sentence(ftforce.analyze(arm, **case))


def test_the_critical_joint_in_words(arm):
    assert "all 5 are not tolerated" in critical_joint(ftforce.census(arm, faults=2))
    one = ftforce.census(arm, faults=1)
    assert critical_joint(one) == "Critical joint: 3 joint3. Its fault is not tolerated."
    panda = ftforce.census(ftforce.load_robot("panda"))
    assert all(report.verdict is Verdict.TOLERATED for report in panda.sets)
    assert "Every fault set is tolerated here" in critical_joint(panda)
    near = ftforce.census(ftforce.load_robot("tiago"), wary=0.03)
    assert "borderline" in critical_joint(near)


# ---- weight, limits and fault modes ----------------------------------------------------------


def flat(result):
    """Return what is shown on one line."""
    return " ".join(to_text(result).split())


def row(result, start):
    """Return the cells of the first line that starts so."""
    return next(x for x in to_text(result).splitlines() if x.startswith(start)).split()


def test_conditions_are_shown(arm):
    bare = flat(ftforce.analyze(arm, force=[1, 1, 1]))
    assert "Gravity (0, 0, -9.81) m/s² in the root's axes (the model's)" in bare
    assert "Limits not enforced (--limits urdf enforces them)" in bare
    assert "Payload" not in bare
    case = {"gravity": [1, 0, 2], "limits": "urdf", "locked": [2], "force": [1, 1, 1]}
    whole = flat(ftforce.analyze(arm, **case, payload=(2, (0, 0, 0.1))))
    assert "Gravity (1, 0, 2) m/s² in the root's axes Payload" in whole
    assert "Payload 2 kg at (0, 0, 0.1) m in the tool's axes" in whole
    assert "Limits urdf; unknown and ignored: brakes of joint2" in whole
    assert "Payload 2 kg at the tip Limits" in flat(ftforce.analyze(arm, **case, payload=2))
    assert "Payload 2 kg at the tip Limits" in flat(ftforce.capability(arm, payload=2))


def test_faults_are_shown(arm):
    mixed = ftforce.analyze(arm, locked=[2], free=[4], weak={3: 0.5}, force=[1, 1, 1])
    for expected in (
        "Faults {2 locked, 3 weak 0.5, 4 free} joint2 locked, joint3 weak 0.5, joint4 free",
        "with joint2 locked, joint4 free and joint3 at 50% of its torque",
    ):
        assert expected in flat(mixed)
    assert row(mixed, "3 joint3")[2:4] == ["weak", "0.5"]
    assert row(mixed, "4 joint4")[-2:] == ["0", "–"]  # no torque of none


def test_weight_of_a_sliding_joint_is_a_force():
    tiago = ftforce.load_robot("tiago")
    assert row(ftforce.analyze(tiago, free=[8]), "1 torso")[-2:] == ["187.74", "N"]
    asked = row(ftforce.analyze(tiago, force=[1, 2, 3]), "1 torso")
    assert asked[9:13] == ["187.74", "N", "187.87", "N"]
    moving = ftforce.analyze(tiago, force=[1, 2, 3], acceleration=np.ones(8))
    table = to_text(moving).split("Weight and motion [N·m]: the")[1]
    assert "187.74 N" in next(x for x in table.splitlines() if x.startswith("1 torso"))


def test_a_joint_without_torque_is_said_to_keep_its_velocity(arm):
    note = "a joint without torque is assumed to keep its velocity"
    assert note in to_text(ftforce.analyze(arm, free=[2], velocity=np.ones(5)))
    assert note in to_text(ftforce.analyze(arm, weak={2: 0}, velocity=np.ones(5)))
    assert note not in to_text(ftforce.analyze(arm, locked=[2], velocity=np.ones(5)))


def test_impact_and_remap_stand_side_by_side(arm):
    result = ftforce.analyze(arm, locked=[2, 4], velocity=np.ones(5), force=[1, 1, 1])
    shown = to_text(result)
    assert "Appendix A's remap, and immediately after the lock" in shown
    line = next(x for x in shown.split("Joint velocities")[1].splitlines() if "1 joint1" in x)
    before, impact, remap, change = map(float, line.split()[3:7])
    assert before == 1.0
    found = [result.impact.after[0], result.velocity.after[0]]
    np.testing.assert_allclose([impact, remap], found, atol=1e-4)
    np.testing.assert_allclose(change, remap - before, atol=2e-4)


def test_a_jump_is_never_a_part_of_what_was_there(arm):
    """A force may turn and grow: 98.60 N of 94.87 N would be nonsense."""
    free = sentences.verdict_sentence(ftforce.analyze(arm, free=[3], force=[80, 50, 10]))
    assert free == (
        "Not tolerated: with joint3 free, the force that the motors command jumps by 98.60 N "
        "(94.87 N before, 46.98 N after): joint3 is free-swinging; no motor torque can "
        "produce force along (0.51, 0.86, 0); no fraction of the force is feasible."
    )
    two = sentences.verdict_sentence(ftforce.analyze(arm, free=[4, 5], force=[80, 50, 10]))
    assert "joint4 and joint5 are free-swinging" in two
    assert "none of the force can be commanded in its own direction" in two
    limits = {"limits": "urdf", "force": [50, 80, 90]}
    panda = ftforce.analyze(ftforce.load_robot("panda"), locked=[1], **limits)
    said = sentences.verdict_sentence(panda)
    sizes = [np.linalg.norm(x) for x in (panda.force.jump, panda.force.before, panda.force.after)]
    jump, before, after = (f"{size:.2f} N" for size in sizes)
    assert f"jumps by {jump} ({before} before, {after} after): panda_joint5 is at its limit" in said
    share = f"{100 * panda.bounded.share:.3g}% of the force can be commanded"
    assert f"{share} in its own direction" in said
    assert f"Share in its direction {share}" in flat(panda)
    assert "At its limit panda_joint5" in flat(panda)


def test_shares_in_words():
    none = sentences.share_in_words(None)
    assert none == "no fraction of the force is feasible"
    parts = {0.0: "none", 0.5: "50%", 0.9999: ">99.9%", 1e-10: "<1e-7%", 1.0: "100%"}
    for share, part in parts.items():
        said = f"{part} of the force can be commanded in its own direction"
        assert sentences.share_in_words(share) == said


def test_weak_motors_are_no_healthy_joints(arm):
    within = sentences.verdict_sentence(ftforce.analyze(arm, weak={3: 0.5}, force=[80, 50, 10]))
    assert "the motors maintain the full 94.87 N at the tip within the limits" in within
    kept = ftforce.analyze(arm, locked=[2], force=[80, 50, 10], limits="urdf")
    said = sentences.verdict_sentence(kept)
    assert "the healthy joints maintain the full 94.87 N at the tip within the limits" in said
    all_kept = sentences.verdict_sentence(ftforce.analyze(arm, locked=[2], limits="urdf"))
    assert "is kept, within the limits" in all_kept


def test_why_an_arm_falls_in_words():
    tiago = ftforce.load_robot("tiago")
    ideal = {"free": [8], "force": [1, 2, 3], "friction": 0}
    turning = sentences.verdict_sentence(ftforce.analyze(tiago, **ideal))
    assert turning.startswith("Borderline: with arm_7_joint free, the arm cannot be held in ")
    doubt = "at the tolerance 1e-06; a tolerance up to 0.01 changes the answer."
    assert turning.endswith(f"balances that {doubt}")
    strict = ftforce.analyze(tiago, **ideal, wary=1e-5)
    assert sentences.verdict_sentence(strict).endswith("(fx, fy, fz) balances that.")
    heavy = ftforce.analyze(tiago, free=[1], force=[1, 2, 3], limits="urdf")
    said = sentences.verdict_sentence(heavy)
    # The weight alone takes 11.20 N·m of arm_3_joint: the rest is the force that carries the torso.
    assert "weight, motion and the force that balances torso_lift_joint require" in said
    assert "59.59 N·m at arm_3_joint, whose limit is 17.86 N·m" in said
    torque = heavy.rnea.after + heavy.bounded.feasible.F0 @ heavy.reduced.J
    assert math.isclose(abs(torque[3]), 59.59, abs_tol=0.005)
    weak = sentences.verdict_sentence(ftforce.analyze(ftforce.load_robot("dh5"), weak={3: 0.05}))
    assert "weight and motion require 4.76 N·m at joint3, whose limit is 4.00 N·m" in weak


def test_limits_of_a_census_are_shown(arm, tmp_path):
    def said(**options):
        return flat(ftforce.census(arm, **options)).split("Limits ")[1].split(" Force")[0]

    path = tmp_path / "limits.csv"
    path.write_text("joint,effort,brake\n" + "".join(f"{i},9,\n" for i in (1, 2, 3, 4)) + "5,9,9")
    assert said() == "not enforced (--limits urdf enforces them)"
    assert said(limits="urdf") == "urdf; brake limits are unknown and ignored"
    assert said(limits="urdf", mode="free") == "urdf"
    unknown = "; unknown and ignored: brakes of joint1, joint2, joint3, joint4"
    assert said(limits=path).replace(" ", "").endswith(unknown.replace(" ", ""))
    path.write_text("joint,effort,brake\n" + "".join(f"{i},9,9\n" for i in range(1, 6)))
    assert ";" not in said(limits=path)


def test_notes_of_a_census(arm):
    tiago = ftforce.load_robot("tiago")
    falls = "* the arm cannot be held in static equilibrium"
    share = "share: of the force, if its direction must not change"
    none = "–: no fraction of it is feasible"
    full = "an arm that cannot be held counts as a jump of 100%"
    for census, expected, others in (
        (ftforce.census(arm, force=[80, 50, 10]), ["mean jump: jump over force"], [share, falls]),
        (ftforce.census(arm), ["a lost direction counts as 100%"], [share, falls, full]),
        (ftforce.census(arm, force=[8, 5, 1], limits="urdf"), [share], [none, falls]),
        (ftforce.census(arm, force=[8, 5, 1], mode="free"), [share, none], [falls]),
        (ftforce.census(tiago, mode="free", friction=0), [falls, full], [share]),
        (ftforce.census(tiago, mode="free", friction=0, rank_by="capability"),
         [falls, "–: the arm cannot be held without a force", "least of all"], [full]),
        (ftforce.census(tiago, mode="free", friction=0, rank_by="capability", force=[1, 2, 3]),
         [("largest force along (0.27, 0.53, 0.80) [N]; –: the arm cannot be held with a "
          "force along it")], []),
        (ftforce.census(tiago, task="wrench", rank_by="capability"),
         ["in the weakest direction of each set [weighted N]"], ["stand still"]),
        (ftforce.census(tiago, task="wrench", rank_by="capability", direction=[0, 0, 0, 0, 0, 2]),
         ["along (0.00, 0.00, 0.00, 0.00, 0.00, 1.00) [N·m]"], []),
    ):  # fmt: skip
        shown = flat(census)
        assert all(text in shown for text in expected), expected
        assert not any(text in shown for text in others), others


def test_the_critical_joint_by_capability_in_words(arm):
    tiago, so101 = ftforce.load_robot("tiago"), ftforce.load_robot("so101")

    def said(robot, **options):
        sentence = critical_joint(ftforce.census(robot, rank_by="capability", **options))
        return re.split(r"\. When (?:it|one of them) fails alone, ", sentence)[1]

    assert said(arm) == "no motor torque can produce force in the weakest direction."
    down = "the motors can command 235.46 N along (0.00, 0.00, -1.00), 100% of the healthy arm's."
    assert said(arm, force=[0, 0, -5]) == down
    assert said(arm, mode="free") == "the arm can be held only with a force at the tip."
    assert said(tiago, mode="free") == "the arm cannot be held in static equilibrium."
    # Joint 3 alone needs a force, but another one than this.
    assert said(arm, mode="free", direction=[1, 0, 0]) == (
        "the arm cannot be held with any force along (1.00, 0.00, 0.00)."
    )
    unknown = (
        "no known limit bounds the force in the weakest direction that the motors can command."
    )
    assert said(so101) == unknown


def test_capabilities_in_words(arm):
    tiago, so101 = ftforce.load_robot("tiago"), ftforce.load_robot("so101")
    panda = ftforce.load_robot("panda")
    for robot, case, expected in (
        (arm, {}, ("With every joint healthy, the motors can command 175.08 N in every direction "
                  "that the healthy arm has; the tip carries 47.01 kg.")),
        (arm, {"locked": [2, 4]}, ("With joint2 and joint4 locked, the motors can command 175.08 N "
         "in every direction that the healthy arm has, as before; the tip carries 47.01 kg, as "
         "before.")),
        (tiago, {"weak": {1: 0.1}}, ("With torso_lift_joint at 10% of its torque, the motors can "
         "command 12.26 N in every direction that the healthy arm has (16.86 N before); the tip "
         "carries 1.25 kg (1.80 kg before).")),
        (panda, {"locked": [2, 4], "payload": 2}, ("With panda_joint2 and panda_joint4 locked, "
         "no motor torque can produce force along (0.39, 0, 0.92) (before: 35.06 N in every "
         "direction); the tip carries 9.26 kg more, as before.")),
        (arm, {"free": [3]}, ("With joint3 free, the arm can be held only with a force at the tip "
         "(before: 175.08 N in every direction); the arm cannot be held with any payload (47.01 kg "
         "before).")),
        (arm, {"weak": {3: 0.05}}, ("With joint3 at 5% of its torque, weight overloads joint3 and "
         "the arm can be held only with a force at the tip (before: 175.08 N in every direction); "
         "the arm cannot be held with any payload (47.01 kg before).")),
        (tiago, {"free": [1]}, ("With torso_lift_joint free, the arm cannot be held in "
         "static equilibrium (before: 16.86 N in every direction); the arm cannot be held with any "
         "payload (1.80 kg before).")),
        (so101, {"locked": [2]}, ("With shoulder_lift locked, no known limit bounds the force "
         "that the motors can command, as before; no known limit bounds the payload, as before.")),
        (arm, {"locked": [3], "limits": "none"}, ("With joint3 locked, no motor torque can produce "
         "force along x (no known limit before); no known limit bounds the payload, as before.")),
        (panda, {"locked": [2], "task": "wrench"}, ("With panda_joint2 locked, no motor torque can "
         "produce wrench along +0.95 fx -0.21 fz -0.22 my (before: 9.48 weighted N in "
         "every direction); the tip carries 11.26 kg, as before.")),
        (panda, {"locked": [7], "task": "moment"}, ("With panda_joint7 locked, the motors can "
         "command 9.72 N·m in every direction that the healthy arm has, as before; the tip carries "
         "11.26 kg, as before.")),
    ):  # fmt: skip
        capability = ftforce.capability(robot, **case)
        assert capability_words.capability_sentence(capability) == expected
        assert expected in flat(capability)


def test_a_payload_that_a_free_joint_cannot_carry(tmp_path):
    """An arm without weight stands still by itself, but a mass at the tip would turn joint 2."""
    found = ftforce.capability(massless(tmp_path), free=[2])
    said = capability_words.capability_sentence(found)
    assert "; the tip can carry no payload (" in said
    assert row(found, "after  0.00")[2:] == ["fault", "of", "j2"]


def test_ranges_of_a_capability(arm):
    weak = ftforce.capability(arm, weak={3: 0.05})
    assert row(weak, "-fx ")[4:8] == ["4.7", "to", "53.7", "4.7"]
    assert row(weak, "+fx ")[4:] == ["–", "–", "weight", "overloads", "joint3"]
    note = "only a, a to b: with less than a the arm cannot be held either"
    dash = "– the arm cannot be held with any force in this direction"
    assert note in to_text(weak)
    assert dash in to_text(weak)
    free = ftforce.capability(arm, free=[3])
    assert row(free, "-fx ")[4:] == ["only", "29.2", "only", "29.2", "fault", "of", "joint3"]
    assert row(free, "after  commanded")[2:6] == ["–"] * 4  # no direction is the weakest
    locked = to_text(ftforce.capability(arm, locked=[2]))
    assert note not in locked
    assert dash not in locked


def test_amounts_in_words():
    def said(least, most):
        amount = CapabilityRange(np.zeros(3), most, least, LimitingFactor.LIMIT, ())
        return capability_words.amount_in_words(amount, "N")

    assert said(0.0, 12.345) == "12.35 N"
    assert said(1e-12, 5e-4) == "5e-04 N"
    assert said(3.0, 7.0) == "only 3.00 N to 7.00 N"
    assert said(3.0, 3.0) == "only 3.00 N"
    assert said(3.0, math.inf) == "only 3.00 N to no known limit"
    assert said(0.0, math.inf) == "no known limit"
    assert said(math.nan, math.nan) == "nothing"


def test_ends_in_words(arm):
    analysis = ftforce.analyze(arm, locked=[2], limits="urdf")

    def said(end, *stops):
        amount = CapabilityRange(np.zeros(3), 1.0, 0.0, end, stops)
        return capability_words.end_in_words(analysis, amount)

    assert said(LimitingFactor.LIMIT, 0, 1, 2) == "joint1, brake of joint2 and joint3"
    assert said(LimitingFactor.FAULT, 1) == "fault of joint2"
    assert said(LimitingFactor.FAULT) == "beyond the healthy arm"
    assert said(LimitingFactor.WEIGHT, 0, 2) == "weight overloads joint1 and joint3"
    assert said(LimitingFactor.WEIGHT) == "weight"
    assert said(LimitingFactor.UNLIMITED) == "no known limit"


def test_a_direction_asked_for_is_named_once(arm):
    wrench = ftforce.capability(arm, task="wrench", direction=[1, 0, 0, 0, 0, 2])
    shown = flat(wrench)
    assert "Direction (1.00, 0.00, 0.00, 0.00, 0.00, 2.00), requested" in shown
    assert row(wrench, "requested")[:2] == ["requested", "N"]
    assert "requested" not in to_text(ftforce.capability(arm))


def test_units_of_sizes():
    for task, unit in (("force", "N"), ("moment", "N·m"), ("wrench", "weighted N")):
        assert words.unit_of_size(Task.parse(task)) == unit
    for task, direction, unit in (
        ("wrench", [0, 0, 1, 1, 0, 0], "N"),
        ("wrench", [0, 0, 0, 1, 0, 0], "N·m"),
        ("fx,my", [0, 1], "N·m"),
    ):
        assert words.unit_of_size(Task.parse(task), np.array(direction)) == unit


def test_one_moving_joint_is_one():
    assert "1 moving joint held fixed" in flat(ftforce.load_robot("so101"))
    assert "2 moving joints held fixed" in flat(ftforce.load_robot("panda"))


def test_self_motion_names_its_inverse(arm):
    for inverse in ("euclidean", "dynamic"):
        shown = flat(ftforce.analyze(arm, torque=np.ones(5), inverse=inverse))
        assert f"(norm; exerts no force; {inverse} inverse)" in shown


def test_unit_wrenches_have_a_table_for_forces_and_one_for_moments():
    tiago = ftforce.load_robot("tiago")
    result = ftforce.analyze(tiago, locked=[1], task="wrench")
    tables = to_text(result).split("Motor torque [N·m] for each unit force")[1:]
    assert len(tables) == 2
    matrix = result.J.T
    for shown, first in zip(tables, (0, 3), strict=True):
        for i, joint in enumerate(tiago.joints):
            if joint.type == "prismatic":
                continue
            line = next(x for x in shown.splitlines() if x.startswith(f"{i + 1} {joint.name} "))
            cells = line.split()
            before = [float(cell.split("→")[0]) for cell in cells[4:7]]
            np.testing.assert_allclose(before, matrix[i, first : first + 3], atol=6e-4)
            np.testing.assert_allclose(float(cells[7]), result.rnea.gravity[i], atol=6e-3)
    assert len(to_text(ftforce.analyze(tiago)).split("Motor torque [N·m] for each unit force")) == 2
