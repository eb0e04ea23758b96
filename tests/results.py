"""Analyses and capabilities of every kind, and what a reader makes of their documents."""

from __future__ import annotations

import csv
import io
import json
import math
from functools import cache

import numpy as np
import pytest

import ftforce
from ftforce.analysis.friction import choose_friction
from ftforce.batch.plan import Plan, faults_of, mechanism_of, question_of
from ftforce.report.files import to_text
from ftforce.robot.kinematics import noise_floor
from urdfs import LINKS, arm, followed, j2, link, load

INF = math.inf


def json_of(result):
    """Return a document as whoever reads the file has it; NaN and infinity are none of JSON."""
    return json.loads(to_text(result, "json"), parse_constant=pytest.fail)


def csv_of(result):
    return list(csv.DictReader(io.StringIO(to_text(result, "csv"))))


def values(by_joint):
    """Return numbers by joint as a vector, NaN for ``None``."""
    return np.array([math.nan if x is None else x for x in by_joint.values()])


def number(cell):
    return math.nan if cell == "" else float(cell)


@cache
def analysed(case):
    """Return the analysis of a case of `CASES`, or of `CAPABLE`."""
    name, options = ALL[case]
    robot = ftforce.load_robot(name)
    options = dict(options)
    for key in ("velocity", "acceleration"):
        if key in options:
            options[key] = np.random.default_rng(options[key]).normal(size=robot.n)
    return ftforce.analyze(robot, **options)


@cache
def capable_of(case):
    """Return the capability of a case with limits, and in a direction."""
    analysis = analysed(case)
    direction = np.arange(1.0, analysis.task.m + 1.0)
    return ftforce.analysis.capability.capability_of(analysis, direction)


def answers_of(robot, q, sets, task, *, rtol=1e-6, wary=1e-2, gravity=None, payload=None, **asked):
    """Return the block of answers that the kernels give for postures, shape (k, n)."""
    asked = {"force": None, "direction": None, "limits": None, "friction": None} | asked
    asked["friction"] = choose_friction(robot, asked["friction"], asked["limits"]).torque
    question = question_of(
        task, robot.n, **asked, rtol=rtol, wary=wary, floors=noise_floor(robot), needs_gravity=True
    )
    both = asked["force"] is not None and bool(task.force_rows and task.moment_rows)
    mechanism = mechanism_of(robot, gravity=gravity, payload=payload)
    plan = Plan(mechanism, faults_of(sets, robot.n), question, robot.n, both)
    with np.errstate(all="ignore"):  # plain Python warns where compiled code does not
        return plan.evaluator()(np.ascontiguousarray(q))


# Arms whose joints are none of the known robots': they follow, turn on and on, or slide.
OTHER_ARMS = {
    "mimic": arm(j3=followed(3, "j1", -0.7, 0.3)),
    "continuous": j2("continuous", limit='<limit effort="10" velocity="3"/>'),
    "prismatic": j2("prismatic", axis="0.6 0 0.8"),
    "sliding follower": arm(j3=followed(3, "j1", 0.5, kind="prismatic")),
}


MIXED = {"locked": [2], "free": [4], "weak": {3: 0.5}}
MOVING = {"velocity": 1, "acceleration": 2, "payload": (1.5, (0.1, 0.0, 0.2))}
URDF = {"limits": "urdf"}
WRENCH = {"task": "wrench", "length": 0.3, **URDF}
CASES = {
    "healthy": ("dh5", {"force": [8, 5, 1]}),
    "locked": ("dh5", {"locked": [2, 4, 5], "force": [80, 50, 10]}),
    "free": ("dh5", {"free": [3], "force": [80, 50, 10]}),
    "weak": ("dh5", {"weak": {3: 0.05}, "force": [80, 50, 10]}),
    "mixed": ("dh5", {**MIXED, "force": [80, 50, 10]}),
    "moving": ("dh5", {**MOVING, "locked": [2, 4], "force": [8, 5, 1]}),
    "limits": ("panda", {"locked": [1], "force": [50, 80, 90], "limits": "urdf"}),
    "all": ("panda", {**MIXED, **MOVING, "force": [5, 8, 9], "limits": "urdf", "axes": "world"}),
    "torques": ("panda", {"free": [2], "torque": [1, 2, 3, 4, 5, 6, 7], "inverse": "dynamic"}),
    "wrench": ("ur5", {**WRENCH, "locked": [2], "force": [8, 5, 1, 1, 2, 3]}),
    "sliding": ("tiago", {**MOVING, "locked": [1], "weak": {4: 0.9}, "force": [1, 2, 3]}),
    "continuous": ("kinova", {**MOVING, "free": [1], "locked": [3], "force": [1, 2, 3]}),
    "weightless": ("panda", {"free": [2], "force": [1, 2, 3], "gravity": [0, 0, 0]}),
    "unknown limits": ("so101", {"weak": {2: 0.5}, "locked": [1], "force": [1, 2, 3]}),
}
CAPABLE = {
    "locked with limits": ("panda", {"locked": [2, 4], **URDF}),
    "free with limits": ("dh5", {"free": [3], **URDF}),
    "weak with limits": (
        "tiago",
        {"weak": {1: 0.1}, **URDF, "payload": (0.5, (0.0, 0.1, 0.0))},
    ),
    "mixed with limits": (
        "panda",
        {"locked": [1], "weak": {2: 0.5}, **URDF, "axes": "world"},
    ),
    "overloaded": ("dh5", {"weak": {3: 0.05}, **URDF}),
    "moving with limits": ("dh5", {**MOVING, "locked": [4], **URDF}),
    "plane": ("kinova", {"locked": [2], **URDF, "task": "fx,fz"}),
    "moment": ("panda", {"locked": [2], **URDF, "task": "moment", "length": 0.3}),
    "wrench with limits": ("ur5", {**WRENCH, "locked": [2]}),
    "unknown": ("so101", {"locked": [2], **URDF}),
}
ALL = CASES | CAPABLE


def bounds(document, when="after"):
    """Return what each motor, or brake, can give; infinite if unknown, 0 at free joints."""
    limits, modes = document["limits"], document["modes"] if when == "after" else {}
    largest = []
    for name in document["robot"]["joints"]:
        mode = modes.get(name)
        limit = limits["brake" if mode == "locked" else "effort"][name]
        factor = document["weak_factors"][name] if mode == "weak" else 1.0
        largest.append(0.0 if mode == "free" else INF if limit is None else limit * factor)
    return np.array(largest)


def read(amount):
    """Return an amount of a document as numbers, ``None`` if nothing holds the arm."""
    if amount["most"] is None:
        return (amount["least"], INF) if amount["end"] == "unlimited" else None
    return amount["least"], amount["most"]


def massless(folder):
    """Return an arm of four joints whose URDF has no masses."""
    links = {name: link(name, "") for name in LINKS}
    return load(folder, arm(**links), tip="tool")
