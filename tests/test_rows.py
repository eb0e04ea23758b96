"""CSV and tables say what JSON says, and results become files."""

import json
import math
import re
from itertools import chain

import numpy as np
import pytest

import ftforce
from ftforce.errors import InputError
from ftforce.report.analysis import QUANTITIES
from ftforce.report.files import to_rows, to_text
from ftforce.show.render import to_text as to_table
from results import (
    CAPABLE,
    CASES,
    INF,
    analysed,
    bounds,
    capable_of,
    csv_of,
    json_of,
    massless,
    number,
    read,
    values,
)
from urdfs import arm, joint, load


@pytest.fixture(params=CASES)
def result(request):
    return analysed(request.param)


@pytest.fixture(params=CAPABLE)
def capability(request):
    return capable_of(request.param)


# ---- CSV -------------------------------------------------------------------------------------


def test_csv_of_an_analysis_is_its_json(result):
    document, rows = json_of(result), csv_of(result)
    torque, force = document["torque"], document["force"]
    table = {}
    for row in rows:
        table.setdefault(row["quantity"], {})[row["name"]] = row
    parts = {name: torque[name] for name in ("gravity", "motion", "total")} | {"torque": torque}
    for quantity, part in parts.items():
        for when in ("before", "after"):
            got = [number(table[quantity][name][when]) for name in part[when]]
            np.testing.assert_array_equal(got, values(part[when]))
    for row in (row for part in parts for row in table[part].values()):
        change = number(row["after"]) - number(row["before"])
        np.testing.assert_allclose(number(row["change"]), change, atol=1e-12)
    for when in ("before", "after"):
        got = [number(table["force"][name][when]) for name in document["conventions"]["components"]]
        np.testing.assert_array_equal(got, force[when])
    loads = {name: float(row["after"]) for name, row in table.get("brake_load", {}).items()}
    assert loads == torque["brake_load"]
    condition = document["jacobian"]["condition_number_after"]
    assert table["jacobian"]["condition_number"]["after"] == str(condition or "")
    convention = {name: row["before"] for name, row in table["convention"].items()}
    assert convention["limits"] == ("none" if result.limits is None else "urdf")
    gravity = [float(convention[f"gravity_{axis}"]) for axis in "xyz"]
    assert gravity == document["conventions"]["gravity"]
    payload = document["conventions"]["payload"]
    assert float(convention["payload"]) == (0.0 if payload is None else payload["mass"])
    states = {name: row["after"].split()[0] for name, row in table["state"].items()}
    assert {name: x for name, x in states.items() if x != "healthy"} == document["modes"]
    assert {row["before"] for row in table["state"].values()} == {"healthy"}
    assert set(table) <= {field.key for field in QUANTITIES}  # a force or torques are given
    units = {joint.name: joint.torque_unit for joint in result.robot.joints}
    assert {name: row["unit"] for name, row in table["total"].items()} == units


def test_what_is_unknown_is_an_empty_cell(tmp_path):
    result = ftforce.analyze(massless(tmp_path), locked=[2], force=[1, 2, 3])
    for row in csv_of(result):
        if row["quantity"] in {"gravity", "total"}:
            assert (row["before"], row["after"], row["change"]) == ("", "", "")
    assert "Brake load (force part)" in to_table(result)
    assert "? unknown: the URDF has no masses; used: of the force part" in to_table(result)


def test_an_arm_that_falls_has_nothing_after():
    result = ftforce.analyze(ftforce.load_robot("tiago"), free=[8], force=[1, 2, 3], friction=0)
    own = [row for row in csv_of(result) if row["quantity"] in {"torque", "total", "force"}]
    assert {row["after"] for row in own} == {row["change"] for row in own} == {""}
    assert "" not in {row["before"] for row in own}


def test_csv_of_velocities_is_their_json():
    robot = ftforce.load_robot("tiago")
    result = ftforce.analyze(robot, locked=[1, 3], velocity=np.ones(8), task="wrench")
    velocity, rows = json_of(result)["velocity"], csv_of(result)
    for quantity, after in (
        ("velocity", velocity["after"]),
        ("velocity at impact", velocity["impact"]["after"]),
    ):
        own = {row["name"]: row for row in rows if row["quantity"] == quantity}
        assert {name: float(row["after"]) for name, row in own.items()} == after
        assert {name: float(row["before"]) for name, row in own.items()} == velocity["before"]
        assert own["torso_lift_joint"]["unit"] == "m/s"
    for quantity, after in (
        ("tip velocity", velocity["tip_after"]),
        ("tip velocity at impact", velocity["impact"]["tip_after"]),
    ):
        own = [row for row in rows if row["quantity"] == quantity]
        assert [row["name"] for row in own] == ["vx", "vy", "vz", "wx", "wy", "wz"]
        assert [float(row["after"]) for row in own] == after
        assert [row["unit"] for row in own] == ["m/s"] * 3 + ["rad/s"] * 3


def test_csv_of_a_capability_is_its_json(capability):
    analysis = capability.analysis
    found, rows = json_of(capability)["capability"], csv_of(capability)
    reports = {one["name"]: one for one in found["directions"]} | {"weakest": found["weakest"]}
    assert len(rows) == 4 * len(reports) + 2
    components = analysis.task.components
    for row in rows:
        at = row["quantity"]
        amount, direction, unit = found["payload"][row["when"]], None, "kg"
        if at != "payload":
            amount, unit = reports[at][row["when"]][row["reading"]], reports[at]["unit"]
            direction = amount["direction"] if at == "weakest" else reports[at]["direction"]
        else:
            assert row["reading"] == "held"
        assert row["unit"] == unit
        got = [row[key] for key in ("most", "least", "end", "stops")]
        numbers = ["" if amount[key] is None else str(amount[key]) for key in ("most", "least")]
        assert got == [*numbers, amount["end"], " ".join(amount["stops"])]
        cells = [row[f"direction_{name}"] for name in components]
        assert cells == ([""] * len(components) if direction is None else list(map(str, direction)))
        assert row["fault_set"] == str(analysis.faults)
        task = analysis.task
        length = str(task.length) if task.moment_rows else ""
        conventions = [row[key] for key in ("axes", "task", "length [m]", "limits")]
        assert conventions == [task.axes, str(task), length, "urdf"]


@pytest.mark.parametrize("mode", ["locked", "free"])
def test_csv_of_a_census_is_its_json(mode):
    census = ftforce.census(
        ftforce.load_robot("panda"), faults=2, mode=mode, force=[50, 80, 90], rank_by="capability"
    )
    document, rows = json_of(census), csv_of(census)
    assert len(rows) - 1 == len(document["sets"]) == 28  # the last one is the healthy arm
    for row, entry in zip(rows, [*document["sets"], document["healthy"]], strict=True):
        assert [row["rank_first"], row["rank_last"]] == list(map(str, entry["rank"] or ("", "")))
        assert row[mode].split() == list(entry["modes"])
        assert row["locked" if mode == "free" else "free"] == ""
        assert int(row["size"]) == len(entry["modes"])
        assert row["can_stand_still"] == str(entry["can_stand_still"])
        assert row["verdict"] == entry["verdict"]
        assert row["binding"].split() == entry["binding"]
        numbers = {
            "jump_norm [N]": entry["force"]["jump_norm"],
            "share": entry["share"],
            "kept": entry["force"]["kept"],
            "relative_jump": entry["force"]["relative_jump"],
            "capability_kept": entry["capability_kept"],
            "commanded": entry["capability"]["commanded"],
            "held": entry["capability"]["held"],
            "margin": entry["jacobian"]["margin"],
            "condition_number_after": entry["jacobian"]["condition_number_after"],
        }
        assert {key: row[key] for key in numbers} == {
            key: "" if value is None else str(value) for key, value in numbers.items()
        }
        assert (row["limits"], row["task"], row["axes"]) == ("urdf", "force", "tool")


def test_nothing_has_a_negative_zero_or_no_number(result):
    for form in ("json", "csv"):
        text = to_text(result, form)
        assert "-0.0," not in text.replace("\n", ",")
        assert not re.search(r"\bnan\b", text.lower())
    capability = ftforce.analysis.capability.capability_of(result)
    assert "-0.0," not in to_text(capability, "csv")


# ---- tables ----------------------------------------------------------------------------------


def shown(x):
    """Write a number as tables do."""
    text = f"{x:.2f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def test_the_table_of_torques_is_the_json(result):
    document = json_of(result)
    torque, lines = document["torque"], to_table(result).splitlines()
    largest = bounds(document) if result.limits is not None else None
    for i, joint_ in enumerate(result.robot.joints, start=1):
        name, state = joint_.name, document["modes"].get(joint_.name, "healthy")
        row = next(line for line in lines if line.startswith(f"{i} {name} ")).split()
        unit = ["N"] if joint_.type == "prismatic" else []
        cells = [[shown(torque[when][name]), *unit] for when in ("before", "after")]
        weight = torque["gravity"]["after"][name] + torque["motion"]["after"][name]
        total = torque["total"]["after"][name]
        motor = ["brake"] if state == "locked" else [shown(total), *unit]
        expected = list(chain(*cells, [shown(weight), *unit], motor))
        start = 3 + (state == "weak") + 1 + len(unit)  # number, name, state, q
        assert row[2] == state
        assert row[start : start + len(expected)] == expected
        used = row[-1]
        if largest is not None and math.isfinite(largest[i - 1]) and largest[i - 1] > 0.0:
            given = torque["brake_load"][name] if state == "locked" else total
            assert used == f"{100 * abs(given) / largest[i - 1]:.0f}"


def test_the_tables_of_a_capability_are_the_json(capability):
    analysis = capability.analysis
    found, text = json_of(capability)["capability"], to_table(capability)
    lines = [line.split() for line in text.splitlines()]

    def cell(amount, digits=1):
        got = read(amount)
        if got is None:
            return ["–"]
        most = ["no", "limit"] if got[1] == INF else [f"{got[1]:.{digits}f}"]
        if got[0] <= 1e-9:
            return most
        point = got[1] - got[0] <= 1e-9 * max(1.0, got[1])
        return ["only", *most] if point else [f"{got[0]:.{digits}f}", "to", *most]

    for one in found["directions"]:
        name = ["requested"] if one["name"] == "direction" else [one["name"]]
        cells = [cell(one[when][r]) for when in ("before", "after") for r in ("commanded", "held")]
        expected = [*name, one["unit"], *chain(*cells)]
        row = next(line for line in lines if line[: len(name)] == name)
        assert row[: len(expected)] == expected
    for when in ("before", "after"):
        for reading in ("commanded", "held"):
            amount = found["weakest"][when][reading]
            expected = [when, reading, *cell(amount)]
            expected += ["–"] * analysis.task.m
            if amount["direction"] is not None:
                expected[-analysis.task.m :] = map(shown, amount["direction"])
            row = next(line for line in lines if line[:2] == [when, reading])
            assert row[: len(expected)] == expected
    for when in ("before", "after"):
        expected = [when, *cell(found["payload"][when], 2)]
        assert any(line[: len(expected)] == expected for line in lines)
    assert json_of(capability)["summary"] in " ".join(text.split())


# ---- files -----------------------------------------------------------------------------------


def test_a_capability_is_saved(tmp_path):
    capability = ftforce.capability(ftforce.load_robot("dh5"), locked=[2], direction=[1, 1, 0])
    for form in ("json", "csv"):
        path = ftforce.save(capability, tmp_path / f"out.{form}")
        assert path.read_text(encoding="utf-8") == to_text(capability, form)
    assert json.loads((tmp_path / "out.json").read_text()) == ftforce.to_dict(capability)
    with pytest.raises(
        InputError, match=r"out\.txt: the name must end in \.json, \.csv, \.xlsx, \.tex or \.md"
    ):
        ftforce.save(capability, tmp_path / "out.txt")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.csv", "out.json"]


@pytest.mark.parametrize("thing", [None, 3, "dh5", {"force": [1, 2, 3]}], ids=repr)
def test_what_cannot_be_written(thing):
    name = type(thing).__name__
    for write in (ftforce.to_dict, to_rows):
        with pytest.raises(
            InputError, match=f"only a result or a robot can be written, got {name}"
        ):
            write(thing)


def test_names_and_files_are_data(tmp_path):
    """Nothing in a name is markup for JSON or CSV."""
    name = 'a,"b"\n<b>&amp;{}'.replace("\n", " ")
    escaped = name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    robot = load(tmp_path, arm(j2=joint(escaped, "l1", "l2")), tip="tool")
    capability = ftforce.capability(robot, locked=[2])
    assert json_of(capability)["locked"] == [name]
    assert {row["stops"] for row in csv_of(capability)} >= {"j1"}
    rows = csv_of(ftforce.analyze(robot, locked=[2], force=[1, 2, 3]))
    assert [row["after"] for row in rows if row["name"] == name][1] == "locked"
