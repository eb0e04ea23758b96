"""Fault sets: order, names, masks, and all sets up to a size."""

import pickle
from dataclasses import FrozenInstanceError
from itertools import combinations
from math import comb

import numpy as np
import pytest

from ftforce.errors import InputError
from ftforce.faults import Fault, FaultMode, FaultSet, count_fault_sets, fault_sets


def test_sets_are_equal_whatever_the_order():
    one, other = FaultSet.locked([3, 1]), FaultSet.locked([1, 3])
    assert one == other
    assert {one: "found"}[other] == "found"
    assert one != FaultSet.locked([1, 2])
    assert one.joints == (1, 3)
    assert len(one) == 2


def test_sets_print_joints_counted_from_one():
    assert str(FaultSet.locked([3, 1])) == "{2, 4}"
    assert str(FaultSet()) == "{}"


def test_mode_is_locked_unless_said():
    assert Fault(2) == Fault(2, FaultMode.LOCKED)
    assert FaultMode("locked") is FaultMode.LOCKED


def test_mask_marks_the_locked_joints():
    mask = FaultSet.locked([1, 3]).mask(5)
    assert mask.dtype == np.bool_
    assert mask.tolist() == [False, True, False, True, False]
    assert not mask.flags.writeable
    assert not FaultSet().mask(2).any()


def test_mask_of_a_chain_that_is_too_short():
    with pytest.raises(InputError, match="joint 4 is out of range; the chain has 3 joints"):
        FaultSet.locked([0, 3]).mask(3)


def test_a_joint_fails_once():
    with pytest.raises(InputError, match="joint 2 is named twice"):
        FaultSet.locked([1, 0, 1])


def test_negative_indices_are_refused():
    with pytest.raises(InputError, match="count from 0"):
        FaultSet.locked([-1])


def test_sets_are_frozen_and_can_be_pickled():
    faults = FaultSet.locked([2])
    with pytest.raises(FrozenInstanceError):
        faults.faults = ()
    assert pickle.loads(pickle.dumps(faults)) == faults


@pytest.mark.parametrize(("n", "largest"), [(1, 1), (5, 1), (5, 3), (7, 2), (4, 4)])
def test_all_sets_come_once_and_small_ones_first(n, largest):
    found = [faults.joints for faults in fault_sets(n, largest)]
    assert found == [s for size in range(1, largest + 1) for s in combinations(range(n), size)]
    assert len(found) == count_fault_sets(n, largest) == sum(map(comb, [n] * largest, range(1, 9)))


def test_no_set_is_larger_than_the_arm():
    assert [str(faults) for faults in fault_sets(2, 5)] == ["{1}", "{2}", "{1, 2}"]
    assert count_fault_sets(2, 5) == 3
