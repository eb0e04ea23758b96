"""DH tables from TOML: what is taken, and what is refused in which words."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from ftforce.errors import DHTableError
from ftforce.robot.formats.dh import DHRow, DHTable, read_dh_table

DH5 = Path(__file__).parents[1] / "robots" / "dh5.toml"

# Every value differs, so that a mix-up shows.
TABLE = """\
name = "arm"
convention = "standard"
units = { length = "m", angle = "deg" }
rows = [
  { a = 0.3, alpha = 90, d = 0.1, theta = 30, type = "revolute", lower = -170, upper = 160, \
effort = 50, velocity = 60, mass = 2.5, joint = "shoulder" },
  { a = 0.2, alpha = -45, d = 0.4, theta = 15, type = "prismatic", lower = -0.1, upper = 0.7, \
velocity = 0.5, link = "slide" },
]
[mass]
model = "thin rod"
radius = 0.02
density = 1000
[postures]
home = [20, 0.25]
"""


@pytest.fixture
def read(tmp_path):
    def read_text(text, encoding="utf-8"):
        path = tmp_path / "arm.toml"
        path.write_bytes(text.encode(encoding))
        return DHTable.from_toml(path)

    return read_text


def test_dh5_is_table_1_of_the_paper():
    table = DHTable.from_toml(DH5)
    assert (table.name, table.convention) == ("dh5", "standard")
    assert [row.a for row in table.rows] == [0.45, 0.32, 0.18, 0.12, 0.08]
    assert [row.alpha for row in table.rows] == [0, math.pi / 2, 0, 0, 0]
    assert [(row.d, row.theta, row.type) for row in table.rows] == [(0.05, 0, "revolute")] * 5
    assert [(row.lower, row.upper) for row in table.rows] == [(-math.pi, math.pi)] * 5
    np.testing.assert_array_equal(table.postures["paper"], np.radians([10, 70, 25, 65, 0]))


def test_a_table_says_where_it_comes_from():
    table = DHTable.from_toml(DH5)
    assert table.source == DH5
    assert read_dh_table(DH5).rows == table.rows


def test_what_is_not_stated_has_defaults(read):
    table = read(TABLE[: TABLE.index("[postures]")], "utf-8-sig")
    assert (table.name, dict(table.postures)) == ("arm", {})
    assert table.joint_names == ("shoulder", "joint2")
    assert table.link_names == ("base", "link1", "slide", "tool")
    assert (table.rows[1].effort, table.rows[1].mass) == (None, None)


def test_radians_stay(read):
    (turn, _) = read(TABLE.replace('"deg"', '"rad"').replace("[20, 0.25]", "[30, 0.25]")).rows
    assert (turn.alpha, turn.theta, turn.lower, turn.velocity) == (90, 30, -170, 60)


def test_degrees_become_radians_but_metres_stay(read):
    turn, slide = read(TABLE).rows
    rad = math.radians
    assert turn == DHRow(
        0.3, rad(90), 0.1, rad(30), "revolute", rad(-170), rad(160), 50, rad(60), 2.5, "shoulder"
    )
    assert slide == DHRow(
        0.2, rad(-45), 0.4, rad(15), "prismatic", -0.1, 0.7, velocity=0.5, link="slide"
    )
    np.testing.assert_array_equal(read(TABLE).postures["home"], [rad(20), 0.25])


MALFORMED = {
    # what is replaced in TABLE, by what, and what the message says
    "robot name missing": ('name = "arm"\n', "", "missing key 'name'"),
    "robot name empty": (
        '"arm"',
        '""',
        "name must be nonempty printable text without leading or trailing blanks",
    ),
    "convention unknown": (
        '"standard"',
        '"standart"',
        "unknown convention 'standart'; available: standard, modified; did you mean 'standard'",
    ),
    "convention missing": ('convention = "standard"\n', "", "missing key 'convention'"),
    "key unknown": (
        "convention",
        "convencion",
        "unknown key 'convencion'; available: name, .*did you mean 'convention'",
    ),
    "units missing": ('units = { length = "m", angle = "deg" }', "", "missing key 'units'"),
    "units no table": (
        '{ length = "m", angle = "deg" }',
        '"SI"',
        "units: expected a table with length",
    ),
    "units incomplete": ('length = "m", ', "", "units: missing key 'length'"),
    "length unit unknown": ('"m"', '"cm"', "units: unknown length unit 'cm'; available: m, mm"),
    "angle unit unknown": (
        '"deg"',
        '"grad"',
        "units: unknown angle unit 'grad'; available: deg, rad",
    ),
    "no rows": (r"rows = \[.*?\n\]", "rows = []", "rows is empty; a table needs one row per joint"),
    "rows no list": (r"rows = \[.*?\n\]", "rows = 3", "rows must be a list .*got 3"),
    "row no table": (
        r"rows = \[.*?\n\]",
        "rows = [1]",
        "row 1: expected a table with a, alpha.*got 1",
    ),
    "row key unknown": (
        "alpha = -45",
        "alfa = -45",
        "row 2: unknown key 'alfa'; available: a, alpha, .*did you mean 'alpha'",
    ),
    "row key missing": ("theta = 15, ", "", "row 2: missing key 'theta'"),
    "row type missing": ('type = "prismatic", ', "", "row 2: missing key 'type'"),
    "row type unknown": (
        '"prismatic"',
        '"prism"',
        "row 2: unknown type 'prism'; available: revolute, prismatic",
    ),
    "number as text": ("a = 0.2", 'a = "0.2"', "row 2: a needs a number, got '0.2'"),
    "nan": ("d = 0.4", "d = nan", "row 2: d needs a finite number, got nan"),
    "infinite": ("upper = 0.7", "upper = inf", "row 2: upper needs a finite number, got inf"),
    "huge integer": ("a = 0.2", "a = 1" + 400 * "0", "row 2: a needs a finite number, got 1000"),
    "lower above upper": (
        "lower = -170",
        "lower = 170",
        r"row 1: lower = 2.96706 rad \(170 deg\) exceeds upper = 2.79253 rad \(160 deg\)",
    ),
    "lower above upper, sliding": ("lower = -0.1", "lower = 1", "row 2: lower = 1 m exceeds"),
    "effort zero": ("effort = 50", "effort = 0", "row 1: effort must be positive, got 0"),
    "velocity negative": ("velocity = 60", "velocity = -6", "row 1: velocity must be positive"),
    "mass zero": ("mass = 2.5", "mass = 0", "row 1: mass must be positive, got 0"),
    "mass unknown": (
        "density = 1000\n",
        "",
        "row 2: missing key 'mass' .or 'density' in the table mass",
    ),
    "joint name empty": ('"shoulder"', '""', "row 1: joint must be nonempty printable text"),
    "link name no XML character": (
        '"slide"',
        r'"\uffff"',
        "row 2: link must be nonempty printable",
    ),
    "joint name twice": ('"shoulder"', '"joint2"', "names must be unique; 'joint2' appears twice"),
    "joint named as the last one": ('"shoulder"', '"tool_joint"', "'tool_joint' appears twice"),
    "link name twice": ('"slide"', '"base"', "names must be unique; 'base' appears twice"),
    "joint named as link": ('"shoulder"', '"slide"', "names must be unique; 'slide' appears twice"),
    "mass model missing": (
        r"\[mass\].*?\n\[",
        "[",
        "row 1 has a mass, but the table mass is missing, which says how it is distributed",
    ),
    "mass model unknown": (
        '"thin rod"',
        '"rod"',
        "mass: unknown model 'rod'; available: thin rod, solid cylinder",
    ),
    "mass key unknown": ("radius", "radios", "mass: unknown key 'radios'.*did you mean 'radius'"),
    "radius missing": ("radius = 0.02\n", "", "mass: missing key 'radius'"),
    "radius zero": ("0.02", "0", "mass: radius must be positive, got 0"),
    "density negative": ("1000", "-1", "mass: density must be positive, got -1"),
    "posture too short": (r"\[20, 0.25\]", "[20]", "posture 'home' needs 2 numbers, got 1 number"),
    "posture too long": (r"\[20, 0.25\]", "[20, 0, 0]", "'home' needs 2 numbers, got 3 numbers"),
    "posture of text": (r"\[20, 0.25\]", '[20, "0"]', "posture 'home' needs a number, got '0'"),
    "posture nan": (r"\[20, 0.25\]", "[20, nan]", "posture 'home' needs a finite number, got nan"),
    "posture outside": (
        r"\[20, 0.25\]",
        "[161, 0.25]",
        r"posture 'home': shoulder = 2.80998 rad \(161 deg\) is outside its limits .*-170 deg.*160",
    ),
    "posture outside, sliding": (
        r"\[20, 0.25\]",
        "[20, -0.2]",
        "posture 'home': joint2 = -0.2 m is outside its limits -0.1 m to 0.7 m",
    ),
    "posture name empty": ("home =", '"" =', "posture name must be nonempty printable text"),
    "broken TOML": ("units = {", "units = {{", "is not valid TOML: .*line 3"),
    "endless nesting": ('"arm"', 9999 * "[", "is not valid TOML"),
    "endless integer": ("a = 0.2", "a = 1" + 9999 * "0", "is not valid TOML"),
}


@pytest.mark.parametrize(("old", "new", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_tables(read, tmp_path, old, new, message):
    text, changes = re.subn(old, lambda _: new, TABLE, count=1, flags=re.DOTALL)
    assert changes == 1
    with pytest.raises(DHTableError, match=message) as caught:
        read(text)
    assert caught.value.path == str(tmp_path / "arm.toml")
    assert "\n" not in str(caught.value)
    assert len(caught.value.reason) < 300


LACKING = ('name = "arm"\n', ', angle = "deg"', "alpha = 90, ", "lower = -0.1, ", "radius = 0.02\n")


def test_all_missing_keys_are_named_at_once(read):
    text = TABLE
    for part in LACKING:
        assert part in text
        text = text.replace(part, "")
    with pytest.raises(DHTableError) as caught:
        read(text)
    assert caught.value.reason == (
        "missing key 'name'; units: missing key 'angle'; mass: missing key 'radius'; "
        "row 1: missing key 'alpha'; row 2: missing key 'lower'"
    )
    with pytest.raises(DHTableError, match=r"rows 1, 2: missing keys 'theta', 'type'$"):
        read(re.sub('theta = [0-9]+, type = "[a-z]+", ', "", TABLE))
    misspelt = TABLE.replace("alpha = 90, ", "").replace("theta = 15", "tetha = 15")
    with pytest.raises(DHTableError, match=r"row 1: missing key 'alpha'$"):
        read(misspelt)


def test_millimetres_become_metres(read):
    """The same arm in both units, to the last digit."""
    numbers = {
        "a = 0.3": "a = 300", "d = 0.1": "d = 100", "a = 0.2": "a = 200", "d = 0.4": "d = 400",
        "lower = -0.1": "lower = -100", "upper = 0.7": "upper = 700",
        "velocity = 0.5": "velocity = 500", "radius = 0.02": "radius = 20",
        "[20, 0.25]": "[20, 250]", '"m"': '"mm"',
    }  # fmt: skip
    millimetres = TABLE
    for old, new in numbers.items():
        assert millimetres.count(old) == 1
        millimetres = millimetres.replace(old, new)
    expected, found = read(TABLE), read(millimetres)
    assert found.rows == expected.rows
    assert found.mass == expected.mass
    np.testing.assert_array_equal(found.postures["home"], expected.postures["home"])


def test_a_table_needs_no_masses(read):
    text = TABLE.replace(", mass = 2.5", "")
    table = read(text[: text.index("[mass]")] + text[text.index("[postures]") :])
    assert table.mass is None
    assert [row.mass for row in table.rows] == [None, None]


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("postures = 3", "postures must be a table of named lists, got 3"),
        ("postures = [[1, 2]]", "postures must be a table of named lists, got"),
        ("mass = 2", "mass: expected a table with model, radius; got 2"),
    ],
)
def test_values_where_tables_belong(read, entry, message):
    key = entry.split()[0]
    others = re.sub(rf"\[{key}\].*?(?=\n\[|\Z)", "", TABLE, flags=re.DOTALL)
    with pytest.raises(DHTableError, match=re.escape(message)):
        read(f"{entry}\n{others}")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b" \n", "empty"),
        (b"# only a comment", "missing keys 'name', 'convention', 'units', 'rows'"),
        (b"\x00\x01\x02", "binary"),
        ("name = 'Gelenkärm'".encode("latin-1"), "not UTF-8"),
        (bytes(range(128, 256)), "not UTF-8"),
    ],
)
def test_files_that_are_no_tables(tmp_path, content, message):
    path = tmp_path / "arm.toml"
    path.write_bytes(content)
    with pytest.raises(DHTableError, match=message) as caught:
        DHTable.from_toml(path)
    assert str(path) in str(caught.value)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(DHTableError, match=r"none\.toml: no such file"):
        DHTable.from_toml(tmp_path / "none.toml")
    with pytest.raises(DHTableError, match="is a folder"):
        DHTable.from_toml(str(tmp_path))
