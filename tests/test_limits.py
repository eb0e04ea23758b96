"""Torque limits of motors and brakes, known or unknown, and what faults leave of them."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.core.limits import Limits, checked_limits
from ftforce.errors import DimensionError, InputError

UNKNOWN = float("nan")
WEAK, FREE = FaultMode.WEAK, FaultMode.FREE


def equal(got, wanted):
    np.testing.assert_array_equal(got, np.array(wanted, dtype=float))


def test_limits_of_motors_and_brakes():
    limits = Limits.of([87, 12.5, np.inf], [20, np.inf, 5], "a file")
    equal(limits.effort, [87, 12.5, UNKNOWN])
    equal(limits.brake, [20, UNKNOWN, 5])
    bare = Limits.of([87.0, UNKNOWN])
    equal(bare.brake, [UNKNOWN, UNKNOWN])
    assert (limits.source, bare.source) == ("a file", "given")


def test_limits_are_copies_that_cannot_be_changed():
    given_, brakes = np.array([87.0, np.inf]), np.array([1.0, 2.0])
    limits = Limits.of(given_, brakes)
    given_[0], brakes[0] = 1.0, 9.0
    equal(limits.effort, [87, UNKNOWN])
    equal(limits.brake, [1, 2])
    for values in (limits.effort, limits.brake, limits.largest_torques(FaultSet())):
        assert not values.flags.writeable
    with pytest.raises(AttributeError):
        limits.effort = None
    equal(pickle.loads(pickle.dumps(limits)).effort, limits.effort)


def test_each_fault_takes_its_part():
    limits = Limits.of([10, 20, 30, 40, UNKNOWN], [1, 2, 3, UNKNOWN, 5])
    faults = FaultSet((Fault(0), Fault(1, FREE), Fault(2, WEAK, 0.25), Fault(4, WEAK, 0.5)))
    # A locked joint bears what its brake does, a free one nothing, a weak one its share.
    equal(limits.largest_torques(faults), [1, 0, 7.5, 40, UNKNOWN])
    equal(limits.largest_torques(FaultSet.locked([3])), [10, 20, 30, UNKNOWN, UNKNOWN])
    equal(limits.largest_torques(FaultSet()), limits.effort)


def test_a_joint_without_torque_needs_no_limit():
    limits = Limits.of([UNKNOWN, UNKNOWN])
    equal(limits.largest_torques(FaultSet((Fault(0, FREE), Fault(1, WEAK, 0.0)))), [0, 0])


@pytest.mark.parametrize("factor", [5e-324, 1e-310, 1e-300])
def test_next_to_no_torque_is_still_a_limit(factor):
    # Rounded to 0 it would be counted as a free joint here, and as a sound one elsewhere.
    faults = FaultSet((Fault(0, WEAK, factor),))
    assert not faults.free
    assert 0.0 < Limits.of([0.1]).largest_torques(faults)[0] < 1e-299


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(1e-3, 1e6))
def test_a_weaker_joint_bears_less(one, other, effort):
    low, high = (
        Limits.of([effort]).largest_torques(FaultSet((Fault(0, WEAK, factor),)))[0]
        for factor in sorted([one, other])
    )
    assert 0.0 <= low <= high <= effort


@pytest.mark.parametrize(
    ("effort", "brake", "error", "message"),
    [
        ([1.0, 0.0], None, InputError, r"effort limits must be positive, NaN where unknown; got"),
        ([1.0, -np.inf], None, InputError, r"effort limits must be positive.*-inf"),
        ([1.0, 2.0], [1.0, 0.0], InputError, r"brake limits must be positive"),
        ([1.0, 2.0], [1.0], DimensionError, "brake limits needs 2 numbers, got 1.*one per joint"),
        (5.0, None, InputError, r"effort limits need one number per joint, got .*shape \(\)"),
        ([[1.0], [2.0]], None, InputError, r"effort limits need one number per joint.*\(2, 1\)"),
        (["1", "2"], None, InputError, "effort limits needs numbers"),
        ([True, False], None, InputError, "effort limits needs numbers"),
    ],
)
def test_malformed_limits_end_in_one_clear_line(effort, brake, error, message):
    with pytest.raises(error, match=message) as caught:
        Limits.of(effort, brake)
    assert "\n" not in str(caught.value)


def test_faults_beyond_the_chain():
    for faults in (FaultSet.locked([5]), FaultSet.all_of(FREE, [2])):
        with pytest.raises(InputError, match=r"joint \d is out of range; the chain has 2 joints"):
            Limits.of([1.0, 2.0]).largest_torques(faults)


def test_the_name_is_said():
    equal(checked_limits([1, np.inf, UNKNOWN], "limits"), [1, UNKNOWN, UNKNOWN])
    with pytest.raises(InputError, match=r"^payloads must be positive"):
        checked_limits([-1.0], "payloads")
    equal(checked_limits([], "limits"), [])
