"""Files of torque limits: what they may look like, and what is said of those that are no use."""

import math

import numpy as np
import pytest

import ftforce
from ftforce.analysis.limits_files import choose_limits, read_limits
from ftforce.core.limits import Limits
from ftforce.errors import DimensionError, InputError, LimitsError
from urdfs import arm, joint, load

NAN = math.nan


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture
def file(tmp_path):
    def write(content, name="limits.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def refused(robot, path):
    """Return what is said of a file, without its path."""
    with pytest.raises(LimitsError) as caught:
        read_limits(robot, path)
    assert caught.value.path == str(path)
    message = str(caught.value)
    assert message.isprintable()  # one line, and nothing that a terminal would obey
    return message.removeprefix(f"{path}: ")


# ---- what can be read ------------------------------------------------------------------------

SAME = {  # effort 60 and brake 70 of joint 3, effort 5.5 of joint 5
    "plain": "joint,effort,brake\njoint3,60,70\njoint5,5.5,\n",
    "numbers": "joint,effort,brake\n3,60,70\n5,5.5,\n",
    "other order": "brake,joint,effort\n70,joint3,60\n,joint5,5.5\n",
    "capitals and blanks": " Joint , EFFORT, Brake \n joint3 , 60 ,70\n 5,\t5.5, \n",
    "byte order mark": b"\xef\xbb\xbfjoint,effort,brake\njoint3,60,70\n5,5.5,\n",
    "CRLF": "joint,effort,brake\r\njoint3,60,70\r\n5,5.5,\r\n",
    "blank lines": "\n\njoint,effort,brake\n\njoint3,60,70\n  \n,,\n5,5.5,\n\n",
    "joints without limits": "joint,effort,brake\njoint1,,\njoint3,60,70\n5,5.5,\n",
}
SAME_TOML = {
    "tables": "[joint3]\neffort = 60\nbrake = 70.0\n[joint5]\neffort = 5.5\n",
    "numbers as keys": "[3]\neffort = 60\nbrake = 70\n[5]\neffort = 5.5\n",
    "inline": "joint3 = {effort = 60, brake = 70}\n5.effort = 5.5\n",
    "list of tables": "[[joint]]\njoint = 3\neffort = 60\nbrake = 70\n"
    "[[joint]]\njoint = 'joint5'\neffort = 5.5\n",
    "both forms": "[joint3]\neffort = 60\nbrake = 70\n[[joint]]\njoint = '5'\neffort = 5.5\n",
    "texts": "[joint3]\neffort = '60'\nbrake = ' 70 '\n[joint5]\neffort = '5.5'\nbrake = ''\n",
    "empty table": "[joint1]\n[joint3]\neffort = 60\nbrake = 70\n[joint5]\neffort = 5.5\n",
    "CRLF": "[joint3]\r\neffort = 60\r\nbrake = 70\r\n[joint5]\r\neffort = 5.5\r\n",
    "byte order mark": b"\xef\xbb\xbf[3]\neffort = 60\nbrake = 70\n[5]\neffort = 5.5\n",
}


@pytest.mark.parametrize(
    ("name", "content"),
    [("limits.csv", x) for x in SAME.values()] + [("limits.toml", x) for x in SAME_TOML.values()],
    ids=[*SAME, *(f"TOML, {name}" for name in SAME_TOML)],
)
def test_forms_of_the_same_limits(dh5, file, name, content):
    path = file(content, name)
    limits = read_limits(dh5, path)
    np.testing.assert_array_equal(limits.effort, [NAN, NAN, 60.0, NAN, 5.5])
    np.testing.assert_array_equal(limits.brake, [NAN, NAN, 70.0, NAN, NAN])
    assert limits.source == str(path)
    assert not limits.effort.flags.writeable
    assert not limits.brake.flags.writeable


@pytest.mark.parametrize("name", ["LIMITS.CSV", "my limits.v2.Csv", "[red]ä.csv"])
def test_the_ending_counts_whatever_its_case(dh5, file, name):
    assert read_limits(dh5, file("joint,effort\n3,60\n", name)).effort[2] == 60.0


def test_every_digit_counts(dh5, file):
    x = 0.1 + 0.2
    toml, table = f"[joint3]\neffort = {x!r}\n", f"joint,effort\n3,{x!r}\n"
    assert read_limits(dh5, file(toml, "limits.toml")).effort[2] == x
    assert read_limits(dh5, file(table)).effort[2] == x


def test_what_the_file_leaves_out_is_unknown_whatever_the_urdf_says(dh5, file):
    assert not np.isnan(dh5.effort).any()
    limits = choose_limits(dh5, file("joint,brake\njoint3,70\n"))
    assert np.isnan(limits.effort).all()
    np.testing.assert_array_equal(np.isnan(limits.brake), [True, True, False, True, True])


@pytest.mark.parametrize("name", ["left.elbow", "left elbow", "a:b", "a,b", "関節", "joint", "a]"])
def test_names_of_any_kind(tmp_path, file, name):
    robot = load(tmp_path, arm(j2=joint(name, "l1", "l2")), tip="tool")
    for path in (
        file(f'joint,effort\n"{name}",7\n'),
        file(f'["{name}"]\neffort = 7\n', "limits.toml"),
        file(f'[[joint]]\njoint = "{name}"\neffort = 7\n', "list.toml"),
        file("[2]\neffort = 7\n", "number.toml"),
    ):
        np.testing.assert_array_equal(read_limits(robot, path).effort, [NAN, 7.0, NAN, NAN])


def test_a_table_called_joint_may_name_its_joint(dh5, file):
    limits = read_limits(dh5, file("[joint]\njoint = 3\neffort = 60\n", "limits.toml"))
    assert limits.effort[2] == 60.0


# ---- what is chosen --------------------------------------------------------------------------


def test_none_counts_none(dh5):
    assert choose_limits(dh5, None) is None
    assert choose_limits(dh5, "none") is None


def test_the_urdf_knows_motors_and_no_brakes(dh5):
    limits = choose_limits(dh5, "urdf")
    np.testing.assert_array_equal(limits.effort, [150.0, 150.0, 80.0, 40.0, 20.0])
    assert np.isnan(limits.brake).all()
    assert limits.source == "urdf"


def test_unknown_efforts_of_a_urdf_stay_unknown():
    assert np.isnan(choose_limits(ftforce.load_robot("so101"), "urdf").effort).all()


def test_limits_are_taken_as_they_are(dh5):
    limits = Limits.of([1.0, 2.0, 3.0, 4.0, NAN])
    assert choose_limits(dh5, limits) is limits
    with pytest.raises(DimensionError, match="limits needs 5 numbers, got 3 numbers: 1 joint1"):
        choose_limits(dh5, Limits.of([1.0, 2.0, 3.0]))


@pytest.mark.parametrize("limits", ["", 3, 2.5, [1, 2, 3, 4, 5], b"urdf", True], ids=repr)
def test_what_no_limits_are(dh5, limits):
    wanted = (
        "limits are 'urdf', 'none', a TOML, YAML or CSV file or ftforce.core.limits.Limits "
        "(of an array: Limits.of(effort)), got "
    )
    with pytest.raises(InputError) as caught:
        choose_limits(dh5, limits)
    assert str(caught.value) == wanted + repr(limits)


def test_limits_of_a_file_bind(dh5, file):
    """0.5 N·m at joint 5, whose lever is 0.08 m along y, carry 6.25 N."""
    path = file("joint,effort\njoint5,0.5\n")
    result = ftforce.analyze(dh5, force=[0, 50, 0], limits=path, gravity=[0, 0, 0])
    np.testing.assert_allclose(result.force.after, [0.0, 6.25, 0.0], atol=1e-9)
    assert result.bounded.binding == (4,)
    assert result.limits.source == str(path)


# ---- what cannot be used ---------------------------------------------------------------------

POSITIVE = "must be a positive number, N·m or N, got"
HEADER = "expected the header joint,effort,brake (brake is optional), got"
KIND = "expected a TOML, YAML or CSV file of limits (joint, effort, brake)"
THERE_IS = "in the chain of 'dh5'; available: joint1, joint2, joint3, joint4, joint5"
CHAIN = "the chain has: 1 joint1, 2 joint2, 3 joint3, 4 joint4, 5 joint5"
BAD_CSV = {
    "unknown joint": (
        "joint,effort\njoint1,5\nJont3,10\n",
        f"line 3: unknown joint 'Jont3' {THERE_IS}; did you mean 'joint3'?",
    ),
    "unknown number": ("joint,effort\n9,1\n", f"line 2: joint number 9 is out of range; {CHAIN}"),
    "no name": ("joint,effort\n,10\n", f"line 2: unknown joint '' {THERE_IS}"),
    "joint twice": (
        "joint,effort\njoint3,10\n\n 3,12\n",
        "line 4: joint 3 (joint3) already appears in line 2",
    ),
    "negative": (
        "joint,effort\n3,-10\n",
        f"line 2: effort of joint3 {POSITIVE} -10; limits apply in both directions",
    ),
    "zero": (
        "joint,effort\n3,0\n",
        f"line 2: effort of joint3 {POSITIVE} 0; omit it if unknown",
    ),
    "tiny": (
        "joint,effort\n3,1e-320\n",
        f"line 2: effort of joint3 {POSITIVE} 9.99989e-321; limits below 1e-09 are not accepted",
    ),
    "huge": (
        "joint,effort\n3,1e300\n",
        "line 2: effort of joint3: '1e300' is too large; the maximum",
    ),
    "NaN": (
        "joint,effort\n3,nan\n",
        "line 2: effort of joint3: 'nan' is not finite; omit it if unknown",
    ),
    "text": ("joint,effort\n3,strong\n", "line 2: effort of joint3: 'strong' is not a number"),
    "line break in a cell": (
        'joint,effort\n3,"1\n0"\n',
        "line 3: effort of joint3: '1\\n0': expected 1 number, got 2",
    ),
    "open quotes": ('joint,effort\n"3,1\n', "line 2: not valid CSV: unexpected end of data"),
    "decimal commas": (
        "joint;effort;brake\n3;10,5;12\n",
        "line 2: effort of joint3: '10,5' is not a number",
    ),
    "more columns": ("joint,effort,brake,speed\n3,1,2,3\n", f"{HEADER} joint,effort,brake,speed"),
    "column twice": ("joint,effort,effort\n3,1,2\n", f"{HEADER} joint,effort,effort"),
    "short line": ("joint,effort,brake\n3,10\n", "line 2: expected 3 cells, got 2"),
    "header only": (
        "joint,effort,brake\n",
        "contains no torque limits, the only ones that are read; expected joint, effort, brake for",
    ),
    "no numbers": ("joint,effort,brake\n3,,\n4, ,\n", "contains no torque limits"),
    "commas only": (",,,\n,,,\n", f"{HEADER} "),
    "empty": ("", f"is empty; {KIND}"),
    "escapes": ("joint,effort\n\x1b[31mred,1\n", "line 2: unknown joint '\\x1b[31mred'"),
}


@pytest.mark.parametrize(("content", "message"), BAD_CSV.values(), ids=BAD_CSV)
def test_csv_files_that_cannot_be_used(dh5, file, content, message):
    assert refused(dh5, file(content)).startswith(message)


TABLE = "use one per joint, e.g. [elbow] followed by effort = 87 and brake = 120 (N·m)"
KEYS = (
    "available: joint, effort, brake, effort_min, effort_max, stall_torque, "
    "no_load_speed, friction, damping, armature"
)
BAD_TOML = {
    "unknown joint": (
        "[join3]\neffort = 1\n",
        f"[join3]: unknown joint 'join3' {THERE_IS}; did you mean 'joint3'?",
    ),
    "unknown number": (
        "[[joint]]\njoint = 9\neffort = 1\n",
        f"[[joint]] number 1: joint number 9 is out of range; {CHAIN}",
    ),
    "name and number": (
        "[joint3]\neffort = 1\n[3]\neffort = 2\n",
        "[3]: joint 3 (joint3) already appears in [joint3]",
    ),
    "table and list": (
        "[joint3]\neffort = 1\n[[joint]]\njoint = 1\n[[joint]]\njoint = 3\n",
        "[[joint]] number 2: joint 3 (joint3) already appears in [joint3]",
    ),
    "table twice": ("[joint3]\n[joint3]\n", "is not valid TOML: Cannot declare ('joint3',) twice"),
    "joint in a table": (
        "[elbow]\njoint = 'joint3'\neffort = 1\n",
        "[elbow]: names two joints, 'elbow' and 'joint3'; use one table named after each joint",
    ),
    "no joint": ("[[joint]]\neffort = 1\n", "[[joint]] number 1: no joint given"),
    "truth as joint": (
        "[[joint]]\njoint = true\n",
        "[[joint]] number 1: a joint is given by number (1 to 5) or name, got True",
    ),
    "list as joint": (
        "[[joint]]\njoint = [3]\n",
        "[[joint]] number 1: a joint is given by number ",
    ),
    "misspelt": ("[joint3]\nefort = 1\n", f"[joint3]: unknown key 'efort'; {KEYS}"),
    "capitals": ("[joint3]\nEffort = 1\n", f"[joint3]: unknown key 'Effort'; {KEYS}"),
    "nested": (
        "[left.joint3]\neffort = 1\n",
        f"[left]: unknown key 'joint3'; {KEYS}; a name with a dot needs quotes",
    ),
    "number": ("joint3 = 10\n", f"'joint3' is not a table; {TABLE}"),
    "numbers": ("effort = [1, 2, 3, 4, 5]\n", f"'effort' is not a table; {TABLE}"),
    "NaN": ("[joint3]\neffort = nan\n", "[joint3]: effort of joint3: 'nan' is not finite; omit"),
    "long number": (f"[joint3]\neffort = {'9' * 400}\n", "[joint3]: effort of joint3: '9999"),
    "longer number": (f"[joint3]\neffort = {'9' * 5000}\n", "is not valid TOML: Exceeds the limit"),
    "text": ("[joint3]\neffort = 'ten'\n", "[joint3]: effort of joint3: 'ten' is not a number"),
    "truth": ("[joint3]\neffort = true\n", f"[joint3]: effort of joint3 {POSITIVE} True"),
    "date": ("[joint3]\neffort = 2020-01-01\n", f"[joint3]: effort of joint3 {POSITIVE} datetime"),
    "comment only": (
        "# nothing\n",
        "contains no torque limits, the only ones that are read; expected joint, effort, brake",
    ),
    "empty tables": ("[joint3]\n[joint4]\n", "contains no torque limits"),
    "deep": ("a = " + "[" * 5000, "is not valid TOML: "),
    "line break in a name": ('["a\\nb"]\neffort = 1\n', "[a b]: unknown joint 'a\\nb'"),
    "empty": ("", f"is empty; {KIND}"),
}


@pytest.mark.parametrize(("content", "message"), BAD_TOML.values(), ids=BAD_TOML)
def test_toml_files_that_cannot_be_used(dh5, file, content, message):
    assert refused(dh5, file(content, "limits.toml")).startswith(message)


@pytest.mark.parametrize("name", ["limits", "limits.txt", "limits.csv.bak", ".csv", "urdf.json"])
def test_other_endings(dh5, file, name):
    wanted = "expected 'urdf', 'none' or a TOML, YAML or CSV file of limits (joint, effort, brake) "
    assert refused(dh5, file("joint,effort\n3,1\n", name)).startswith(wanted)


def test_paths_that_are_no_files(dh5, tmp_path):
    (tmp_path / "folder.csv").mkdir()
    assert refused(dh5, tmp_path / "none.toml").startswith(f"no such file; {KIND}")
    assert refused(dh5, tmp_path / "folder.csv").startswith(f"is a folder; {KIND}")
