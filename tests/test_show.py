"""Results as people see them: in 80 columns, in notebooks, as pictures."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
from rich.text import Text

import ftforce
from ftforce import sentences, words
from ftforce.metrics import Verdict
from ftforce.registry import known_robots
from ftforce.replicate import replicate
from ftforce.show.analysis import analysis_view
from ftforce.show.export import to_html, to_svg, to_text
from ftforce.show.render import render
from ftforce.task import Task


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


@pytest.mark.parametrize("name", known_robots())
def test_everything_fits_a_terminal_of_80_columns(name):
    for result in results(ftforce.load_robot(name)):
        shown = to_text(result)
        assert max(map(len, shown.splitlines())) <= 80
        assert "…" not in shown.replace("… and", "")  # nothing is cut off


def test_the_table_holds_the_answer(papers_case):
    shown = to_text(papers_case)
    for expected in (
        "tool: vectors are in the axes of the tool frame", "posture 'paper'", "43.66", "2 of 3",
        "rank tolerance 1e-06, wary below 0.01", "joint2 -6.59 N·m", "1.02", "force by the robot",
    ):  # fmt: skip
        assert expected in shown


def test_the_rows_of_the_joint_table(papers_case):
    row = next(line for line in to_text(papers_case).splitlines() if line.startswith("2 joint2"))
    assert row.split() == ["2", "joint2", "locked", "1.222", "-12.33", "0.00", "0.00", "brake",
                           "unknown", "?"]  # fmt: skip


def test_degrees_and_metres(arm):
    shown = to_text(analysis_view(ftforce.analyze(arm, force=[1, 1, 1]), degrees=True))
    assert "[deg]" in shown
    assert "70.00" in shown
    tiago = ftforce.analyze(ftforce.load_robot("tiago"), force=[1, 1, 1])
    row = next(line for line in to_text(tiago).splitlines() if "torso_lift" in line)
    assert "0.150 m" in row
    assert "2000 N" in row


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
    for result in (evil, ftforce.analyze(evil, locked=[1], force=[1, 1, 1]),
                   ftforce.census(evil, force=[1, 1, 1])):  # fmt: skip
        assert "[red]x[/red]<b>" in "".join(to_text(result).split("\n"))
    assert "<b>" not in to_html(ftforce.analyze(evil, locked=[1], force=[1, 1, 1]))


def test_notebooks_get_html(papers_case, arm):
    for result in (papers_case, arm, ftforce.census(arm), replicate(arm)):
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


@pytest.mark.parametrize(
    ("x", "expected"),
    [(-0.001, "0.00"), (0.0, "0.00"), (-0.0, "0.00"), (2.346, "2.35"), (-12.346, "-12.35")],
)
def test_numbers_show_no_negative_zero(x, expected):
    assert words.number(x) == expected


@pytest.mark.parametrize(
    ("x", "expected"), [(-0.001, "-1e-03"), (-1e-12, "0.00"), (0.004, "4e-03"), (0.006, "0.01")]
)
def test_a_small_jump_does_not_look_like_none(x, expected):
    assert words.size(x) == expected


def test_directions_in_words():
    task = Task.parse("wrench")
    assert words.direction(task, np.eye(6)[1]) == "force along y"
    assert words.direction(task, np.eye(6)[5]) == "moment along z"
    assert words.direction(task, np.array([0.6, 0, 0, 0, -0.8, 0])) == "+0.60 fx -0.80 my"
    assert words.lost_directions(task, []) == "none"


def test_the_verdict_in_words(arm):
    said = {
        verdict: sentences.verdict_sentence(analysis)
        for verdict, analysis in {
            "kept": ftforce.analyze(arm, locked=[2, 4], force=[80, 50, 10]),
            "lost": ftforce.analyze(arm, locked=[3], force=[80, 50, 10]),
            "near": ftforce.analyze(arm, locked=[2, 4], force=[80, 50, 10], wary=0.05),
            "all kept": ftforce.analyze(arm, locked=[2, 4]),
            "some lost": ftforce.analyze(arm, locked=[3]),
            "all near": ftforce.analyze(arm, locked=[2, 4], wary=0.05),
            "healthy": ftforce.analyze(arm, force=[80, 50, 10]),
        }.items()
    }
    assert "keep the whole 94.87 N" in said["kept"]
    assert "80.00 N of 94.87 N can no longer be commanded by any motor" in said["lost"]
    assert said["near"].startswith("Borderline")
    assert "every force that the healthy arm can exert here is kept" in said["all kept"]
    assert "force along x" in said["some lost"]
    assert "close to losing a direction" in said["all near"]
    assert "with every joint healthy" in said["healthy"]


def test_the_critical_joint_in_words(arm):
    assert "all 5 are not tolerated" in sentences.critical_joint(ftforce.census(arm, faults=2))
    one = ftforce.census(arm, faults=1)
    assert sentences.critical_joint(one) == "Critical joint: 3 joint3. Its fault is not tolerated."
    panda = ftforce.census(ftforce.load_robot("panda"))
    assert all(report.verdict is Verdict.TOLERATED for report in panda.sets)
    assert "Every fault set is tolerated here" in sentences.critical_joint(panda)
    near = ftforce.census(ftforce.load_robot("tiago"), wary=0.03)
    assert "borderline" in sentences.critical_joint(near)
