"""Faults by the names and numbers of an arm's joints, and what cannot be read as such."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import ftforce
from ftforce.analysis.fault_names import named_faults
from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.errors import InputError, UnknownNameError
from helpers import joint, load_text, serial_urdf, urdf_of

FREE, WEAK = FaultMode.FREE, FaultMode.WEAK


@pytest.fixture(scope="module")
def arm():
    return load_text(serial_urdf(*[("revolute", {"axis": (0, 1, 0), "xyz": (0.3, 0, 0)})] * 4))


@pytest.fixture(scope="module")
def colons():
    """Return an arm whose joints have names that look like weak joints."""
    return load_text(
        urdf_of(
            *("base", "a", "b", "tool"),
            joints=[
                joint("arm:1", "revolute", "base", "a", xyz=(0.3, 0, 0)),
                joint("arm:0.5", "revolute", "a", "b", xyz=(0.3, 0, 0)),
                joint("x,y", "revolute", "b", "tool", xyz=(0.3, 0, 0)),
            ],
        )
    )


# ---- what can be said ------------------------------------------------------------------------


def test_no_faults(arm):
    assert named_faults(arm) == FaultSet()
    assert named_faults(arm, [], [], {}) == FaultSet()


@pytest.mark.parametrize("text", ["", " ", ",", "2,", ",2", "2,,3"])
def test_an_empty_text_is_not_no_fault(arm, text):
    """`locked=os.environ.get("JOINTS", "")` must not say that nothing failed."""
    for mode in ("locked", "free"):
        with pytest.raises(InputError, match=r"joints are given as numbers or names, .* empty"):
            named_faults(arm, **{mode: text})
    with pytest.raises(InputError, match=r"joints are given as numbers or names, .* empty"):
        named_faults(arm, weak=text.replace("2", "2:0.5").replace("3", "3:0.5"))


@pytest.mark.parametrize("joints", ["2,j4", [2, "j4"], ("j4", 2), {2, 4}, [False, True] * 2])
def test_locked_and_free_joints(arm, joints):
    assert named_faults(arm, locked=joints) == FaultSet.locked([1, 3])
    assert named_faults(arm, free=joints) == FaultSet.all_of(FREE, [1, 3])


@pytest.mark.parametrize(
    "weak",
    [
        "2:0.5,j4:0",
        " 2 : 0.5 , j4:0.0 ",
        {2: 0.5, "j4": 0},
        "2:5e-1,j4:0",
        {"2": np.float64(0.5), 4: np.int64(0)},
        [(4, 0.0), ("j2", 0.5)],
        [[4, 0.0], ["j2", Fraction(1, 2)]],
        (pair for pair in [("j4", 0), ("j2", 0.5)]),
    ],
    ids=lambda weak: type(weak).__name__,
)
def test_weak_joints(arm, weak):
    assert named_faults(arm, weak=weak) == FaultSet((Fault(1, WEAK, 0.5), Fault(3, WEAK, 0.0)))


def test_all_modes_at_once(arm):
    faults = named_faults(arm, locked=4, free="j1", weak={2: 0.25})
    assert str(faults) == "{1 free, 2 weak 0.25, 4 locked}"


def test_names_with_colons(colons):
    assert named_faults(colons, weak="arm:1:0.5").faults == (Fault(0, WEAK, 0.5),)
    assert named_faults(colons, weak="arm:0.5:0.25").faults == (Fault(1, WEAK, 0.25),)
    assert named_faults(colons, weak={"arm:0.5": 0.1}).faults == (Fault(1, WEAK, 0.1),)
    assert named_faults(colons, weak={"x,y": 0.1}).faults == (Fault(2, WEAK, 0.1),)
    assert named_faults(colons, locked="x,y") == FaultSet.locked([2])


def test_a_name_with_a_colon_still_needs_its_factor(colons):
    with pytest.raises(UnknownNameError, match=r"unknown joint 'arm'.*did you mean 'arm:1'"):
        named_faults(colons, weak="arm:1")  # the joint arm with all of its torque


def test_in_an_analysis(arm):
    q = [0.1, 0.5, -0.4, 0.3]
    result = ftforce.analyze(arm, q, locked=1, free=[3], weak={2: 0.5}, force=[1, 0, 2])
    assert result.modes == {"j1": FaultMode.LOCKED, "j2": WEAK, "j3": FREE}
    assert result.limits is not None  # a weak joint is nothing without


# ---- what cannot -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"locked": 2, "free": 2}, r"joint 2 \(j2\) cannot be both locked and free"),
        ({"locked": "j2", "weak": "2:0.5"}, r"joint 2 \(j2\) cannot be both locked and weak"),
        ({"free": [4, 1], "weak": {1: 0.5}}, r"joint 1 \(j1\) cannot be both free and weak"),
        ({"weak": {2: 0.5, "2": 0.5}}, r"joint 2 \(j2\) appears twice"),
        ({"free": "1,j1"}, r"joint 1 \(j1\) appears twice"),
        ({"weak": "elbow:0.5"}, "unknown joint 'elbow'"),
        ({"weak": {2.5: 0.5}}, r"a joint is given by number \(1 to 4\) or name, got 2.5"),
        ({"locked": None}, r"a joint is given by number \(1 to 4\) or name, got"),
        ({"free": [True, False]}, "a joint mask needs 4 entries"),
    ],
)
def test_joints_that_do_not_fit(arm, given, message):
    with pytest.raises(InputError, match=message) as caught:
        named_faults(arm, **given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("weak", "message"),
    [
        ("3", r"needs a factor after a colon, e\.g\. 3:0\.5 for half .* got '3'"),
        ("1:0.5, j3", r"needs a factor after a colon, .* got 'j3'"),
        ("3:x", "the factor of weak joint '3': 'x' is not a number"),
        ("3:", "the factor of weak joint '3': '': expected 1 number, got 0"),
        ("3:0.5 0.6", "the factor of weak joint '3': .*expected 1 number, got 2"),
        ("3:nan", "the factor of weak joint '3': 'nan' is not finite"),
        ("3:0,5", r"needs a factor after a colon, .* got '5'"),
        (":0.5", r"no joint before ':0\.5'; give the weak joint, e\.g\. 3:0\.5"),
        (" : ", "no joint before ':'"),
        ("3:0.5:2", "unknown joint '3:0.5'.*available: j1, j2, j3, j4"),
        ("3:0.5;4:0.5", "unknown joint '3:0.5;4'.*available: j1"),
        ("3:1.5", r"weak joint 3 must lie between 0 \(no torque\) and 1 \(full torque\), got 1\.5"),
        ({3: 2}, r"weak joint 3 must lie between 0 .* and 1 .*, got 2"),
        ({3: float("nan")}, r"weak joint 3 must lie between 0 .* and 1 .*, got nan"),
        ({3: "0.5"}, "the factor of weak joint 3 needs a number, got '0.5'"),
        ({"j3": None}, "the factor of weak joint 'j3' needs a number, got None"),
        ({3: True}, "the factor of weak joint 3 needs a number, got True"),
        ({3: [0.5]}, "the factor of weak joint 3 needs a number"),
        ({3: Decimal("0.5")}, "the factor of weak joint 3 needs a number"),
        (3, r"weak joints are given as \{joint: factor\}, got 3"),
        (None, r"weak joints are given as \{joint: factor\}, got None"),
        ([(3, 0.5, 1)], r"weak joints are given as \{joint: factor\}"),
        (["3:0.5"], r"weak joints are given as \{joint: factor\}"),
    ],
    ids=repr,
)
def test_malformed_weak_joints_end_in_one_clear_line(arm, weak, message):
    with pytest.raises(InputError, match=message) as caught:
        named_faults(arm, weak=weak)
    assert "\n" not in str(caught.value)
