"""The page's answer as HTML: the numbers of the answer, and no name that is more than text."""

from __future__ import annotations

import dataclasses
import math
from html.parser import HTMLParser

import numpy as np
import pytest
from markupsafe import Markup, escape

import ftforce
from ftforce.report.analysis import verdict_sentence
from ftforce.view.model.answer import answer
from ftforce.view.model.state import Origin, command_line
from ftforce.view.page.answer import (
    answer_part,
    banner,
    census_part,
    command_part,
    legend,
    problem_banner,
    set_label,
    static_page,
)
from ftforce.view.page.curves import Curve, chart
from ftforce.view.page.html import element
from ftforce.view.page.tables import bar, share_text
from ftforce.view.scene.picture import picture
from helpers import initial_state

BAD = "<img src=x onerror=\"alert('1')\">&amp;"
TABLES = {"table", "thead", "tbody", "tr", "th", "td"}
TAGS = TABLES | {"div", "span", "h3", "style", "details", "summary", "code", "button", "i"}


class Reader(HTMLParser):
    """Collect tags, attributes and, per table, cells."""

    def __init__(self, source):
        super().__init__()
        self.tags, self.attributes, self.texts, self.tables = set(), [], [], {}
        self._open = []
        self.feed(source)
        self.close()
        assert not self._open, self._open

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes += attrs
        self._open.append(tag)
        given = dict(attrs)
        if tag == "table":
            self._rows = self.tables[given["data-testid"]] = []
        elif tag == "tr":
            self._rows.append([])
        elif tag in {"td", "th"}:
            self._rows[-1].append("")

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)
        if {"td", "th"} & set(self._open):
            self._rows[-1][-1] += data


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


def answered(robot, **options):
    return answer(robot, initial_state(robot, origin=Origin("panda"), **options))


@pytest.fixture(scope="module")
def locked(panda):
    return answered(panda, locked=[2, 4], force=[10, 20, -60], limits="urdf")


def test_texts_are_escaped_and_only_once():
    inner = element("i", BAD)
    assert inner == f"<i>{escape(BAD)}</i>"
    assert element("div", inner, "<b>") == f"<div>{inner}&lt;b&gt;</div>"
    for title in (BAD, Markup(BAD)):  # an attribute is never markup
        assert Reader(element("div", title=title)).attributes == [("title", BAD)]
    assert not isinstance(f"{inner}", Markup)  # what is put together elsewhere is text again


def hostile(robot):
    joints = tuple(
        dataclasses.replace(joint, name=f"{BAD}{joint.number}") for joint in robot.joints
    )
    names = dict.fromkeys(("name", "base", "tip", "tip_source", "path"), BAD)
    postures = {BAD: robot.lower * 0.0 + 0.1}
    return dataclasses.replace(
        robot, joints=joints, held={BAD: 0.0}, postures=postures, preferred=(), **names
    )


@pytest.mark.parametrize(
    "options",
    [
        {"locked": [1, 2, 4], "limits": "urdf"},
        {"free": [2]},
        {"free": [2, 3, 4, 5, 6]},
        {"weak": {2: 0.01}},
        {"task": "wrench"},
    ],
)
def test_names_are_text_wherever_they_stand(panda, options):
    robot = hostile(panda)
    state = initial_state(
        robot, np.full(7, 9.0), origin=Origin(BAD, BAD, BAD, None, BAD), **options
    )
    found = answer(robot, state.showing(census=2, weakest=True))
    scene = picture(found)
    command = command_line(robot, state)
    parts = [answer_part(found), banner(found), census_part(found.census), legend(scene, [BAD])]
    parts += [command_part(command, BAD), problem_banner(BAD), static_page(found, scene, command)]
    for part in parts:
        read = Reader(part)
        assert read.tags <= TAGS
        handlers = [value for name, value in read.attributes if name.startswith("on")]
        assert all("alert" not in script for script in handlers)  # a script of ours alone
        assert "<img" not in part
    assert any(BAD in shown for shown in Reader(parts[0]).texts)


def test_the_banner_says_the_verdict_and_every_warning(panda, locked):
    assert verdict_sentence(locked.analysis) in Reader(banner(locked)).texts
    found = answered(panda, weak={2: 0.5}, limits="none")
    warned = Reader(banner(found)).texts
    assert found.analysis.warnings
    for warning in found.analysis.warnings:
        assert f"Warning: {warning}." in warned
    assert "no such thing" in Reader(problem_banner("no such thing")).texts


def test_the_tables_have_the_answers_numbers(locked):
    tables = Reader(answer_part(locked)).tables
    head, *rows = tables["torques"]
    assert head[2:4] == ["before", "after"]
    assert len(rows) == 7
    for cells, load in zip(rows, locked.loads, strict=True):
        assert cells[1] == load.name
        assert float(cells[2]) == pytest.approx(load.before, abs=0.00501)
        if load.fault is None:
            assert cells[0] == str(load.number)
            assert float(cells[3]) == pytest.approx(load.after, abs=0.00501)
            assert cells[5] == f"{100 * load.used:.0f}%"
        else:
            assert (cells[0], cells[3], cells[5]) == (f"{load.number} L", "brake", "?")
    head, *rows = tables["forces"]
    force = locked.analysis.force
    assert head == ["", "", "before", "after", "jump"]
    for cells, *numbers in zip(rows, force.before, force.after, force.jump, strict=False):
        for shown, number in zip(cells[2:], numbers, strict=True):
            assert float(shown) == pytest.approx(number, abs=0.00501)
    assert rows[-1][:2] == ["|force|", "N"]
    assert float(rows[-1][4]) == pytest.approx(force.jump_norm, abs=0.00501)
    facts = dict(tables["measures"])
    assert facts["Rank"].startswith("2 of 3 (healthy arm: 3)")
    for load in (locked.loads[1], locked.loads[3]):
        assert f"{load.name} {load.brake:.2f} N·m" in facts["Brake load"]


def test_the_heading_says_what_the_torques_include(panda, locked):
    assert "Motor torque [N·m], gravity included" in answer_part(locked)
    moving = answered(panda, locked=[2], velocity=[0.1] * 7)
    assert "Motor torque [N·m], gravity and motion included" in answer_part(moving)


def test_newtons_and_newton_metres_have_norms_of_their_own(panda):
    rows = Reader(answer_part(answered(panda, task="wrench", force=[1, 2, 2, 3, 0, 4]))).tables[
        "forces"
    ]
    assert [row[:3] for row in rows[-2:]] == [["|force|", "N", "3.00"], ["|moment|", "N·m", "5.00"]]


def test_without_a_force_every_direction_has_a_row(panda):
    state = initial_state(panda, locked=[2, 4]).loaded("every direction")
    found = answer(panda, state)
    rows = Reader(answer_part(found)).tables["forces"]
    assert [row[0] for row in rows[1:]] == ["fx 1 N", "fy 1 N", "fz 1 N"]
    after = found.analysis.unit_forces[2][0].after
    assert [float(x) for x in rows[3][1:]] == pytest.approx(list(after), abs=0.00501)


def test_what_is_not_there_is_a_dash(panda):
    rows = Reader(answer_part(answered(panda, free=[2, 3, 4, 5, 6]))).tables
    assert {row[3] for row in rows["torques"][1:]} == {"–"}
    assert {row[3] for row in rows["forces"][1:]} == {"–"}


@pytest.mark.parametrize(
    ("share", "width"),
    [(0.0, "0%"), (0.305, "30%"), (1.0, "100%"), (7.0, "100%"), (math.nan, "0%")],
)
def test_a_bar_is_as_full_as_the_share(share, width):
    (style,) = (
        value for name, value in Reader(bar(share, (1, 2, 3))).attributes if name == "style"
    )
    assert style == f"width:{width};background:rgb(1,2,3)"


def test_the_census_stands_worst_first_with_the_chosen_set_marked(panda, locked):
    census = locked.census
    shown = census_part(census, census.sets[2].faults.joints)
    rows = Reader(shown).tables["census"][1:]
    assert [row[0] for row in rows] == [str(report.faults) for report in census.sets]
    assert [row[1] for row in rows] == [report.verdict.value for report in census.sets]
    assert shown.count('class="b"') == 1
    assert "no census" in census_part(None)
    falls = answered(panda, force=[0, 0, 900], limits="urdf")
    labels = [set_label(report) for report in falls.census.sets]
    assert labels[0].startswith("{")
    assert "% lost" in labels[0]


def test_the_legend_has_the_arrows_and_their_scale(locked):
    scene = picture(locked)
    texts = Reader(legend(scene, ["mesh x is missing"])).texts
    for arrow in scene.arrows:
        assert arrow.label in texts
    assert {"lost direction", "mesh x is missing", *scene.notes} <= set(texts)


def test_a_curve_of_nothing_has_nothing_as_its_title():
    shown = chart("Force", "N", np.arange(3.0), [Curve("lost", np.zeros(3), "red")])
    assert "Force: 0 to 0 N" in shown


def test_a_share_of_a_limit_of_nothing():
    assert [share_text(share) for share in (math.inf, math.nan, 0.5)] == ["∞", "?", "50%"]


def test_the_command_is_copied_as_it_is():
    command = """ftforce analyze "it's" '--force=1,2' <b> & é"""
    read = Reader(command_part(command))
    given = dict(read.attributes)
    assert given["data-text"] == command
    assert command in read.texts
    assert command not in given["onclick"]
    assert "it's" not in given["onclick"]
