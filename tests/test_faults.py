"""Fault sets: order, names, masks, and all sets up to a size."""

import pickle
from dataclasses import FrozenInstanceError
from itertools import combinations
from math import comb

import numpy as np
import pytest

from ftforce.core.faults import Fault, FaultMode, FaultSet, count_fault_sets, fault_sets
from ftforce.errors import InputError, UnknownNameError

FREE, WEAK = FaultMode.FREE, FaultMode.WEAK


def test_sets_are_equal_whatever_the_order():
    one, other = FaultSet.locked([3, 1]), FaultSet.locked([1, 3])
    assert one == other
    assert {one: "found"}[other] == "found"
    assert one != FaultSet.locked([1, 2])
    assert one.joints == (1, 3)
    assert len(one) == 2


def test_sets_print_modes_where_not_all_are_locked():
    mixed = FaultSet((Fault(3, FREE), Fault(1), Fault(0, WEAK, 0.25)))
    assert str(mixed) == "{1 weak 0.25, 2 locked, 4 free}"
    assert str(FaultSet.all_of(FREE, [1])) == "{2 free}"
    assert str(FaultSet.locked([3, 1])) == "{2, 4}"
    assert str(FaultSet()) == "{}"


# ---- modes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", list(FaultMode))
def test_modes_by_name(mode):
    assert FaultMode.parse(mode.value) is mode
    assert FaultMode.parse(mode) is mode
    assert Fault(0, mode.value).mode is mode  # a name that stayed one would be no mode anywhere


@pytest.mark.parametrize("mode", ["Locked", "broken", "", None, 3])
def test_a_mode_that_does_not_exist(mode):
    with pytest.raises(
        UnknownNameError, match=r"unknown fault mode .*available: locked, free, weak"
    ):
        FaultMode.parse(mode)
    with pytest.raises(
        UnknownNameError, match=r"unknown fault mode .*available: locked, free, weak"
    ):
        Fault(0, mode)


def test_each_mode_has_its_joints():
    mixed = FaultSet((Fault(3, FREE), Fault(1), Fault(0, WEAK, 0.5), Fault(4, WEAK, 0.0)))
    assert mixed.joints == (0, 1, 3, 4)
    assert mixed.in_mode(FaultMode.LOCKED) == (1,)
    assert mixed.in_mode(FREE) == (3,)
    assert mixed.in_mode(WEAK) == (0, 4)
    assert mixed.free == (3, 4)  # weak with nothing left is free
    assert mixed.mask(6).tolist() == [False, True, False, False, False, False]
    assert mixed.free_mask(6).tolist() == [False, False, False, True, True, False]
    assert mixed.factors(6).tolist() == [0.5, 1, 1, 0, 0, 1]
    assert not mixed.factors(6).flags.writeable
    assert not mixed.free_mask(6).flags.writeable


def test_without_a_swinging_joint_there_is_no_mask():
    assert FaultSet((Fault(1), Fault(2, WEAK, 1e-300))).free_mask(3) is None
    assert FaultSet().free_mask(3) is None


@pytest.mark.parametrize("factor", [0, 0.0, 0.5, 1, 1.0, np.float64(0.25), np.float32(0.5)])
def test_factors_in_range(factor):
    fault = Fault(0, WEAK, factor)
    assert fault.factor == factor
    assert fault.is_free is (factor == 0)


@pytest.mark.parametrize("factor", [-1e-9, 1.0000001, np.nan, np.inf, -np.inf, 2, "0.5", None, 1j])
def test_factors_out_of_range(factor):
    with pytest.raises(
        InputError, match=r"factor of weak joint 3 must lie between 0 .* and 1 .*, got"
    ) as caught:
        Fault(2, WEAK, factor)
    assert str(factor) in str(caught.value)


@pytest.mark.parametrize("mode", [FaultMode.LOCKED, FREE])
def test_only_a_weak_joint_has_a_factor(mode):
    with pytest.raises(InputError, match=f"only a weak joint has a factor; joint 3 is {mode}"):
        Fault(2, mode, 0.5)


def test_a_joint_fails_in_one_mode():
    with pytest.raises(InputError, match="joint 2 cannot be both locked and free; a joint fails"):
        FaultSet((Fault(1), Fault(0), Fault(1, FREE)))
    with pytest.raises(InputError, match="joint 2 appears twice in the fault set"):
        FaultSet((Fault(1, WEAK, 0.5), Fault(1, WEAK, 0.25)))
    with pytest.raises(InputError, match="joint 2 appears twice"):
        FaultSet.locked([1, 0, 1])


@pytest.mark.parametrize("ask", [FaultSet.mask, FaultSet.free_mask, FaultSet.factors])
@pytest.mark.parametrize("mode", list(FaultMode))
def test_joints_beyond_the_chain(ask, mode):
    with pytest.raises(InputError, match="joint 4 is out of range; the chain has 3 joints"):
        ask(FaultSet.all_of(mode, [0, 3]), 3)


@pytest.mark.parametrize("mode", list(FaultMode))
def test_all_sets_of_a_mode(mode):
    found = list(fault_sets(3, 2, mode))
    assert [faults.joints for faults in found] == [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2)]
    assert {fault.mode for faults in found for fault in faults.faults} == {mode}


# ---- masks and sets --------------------------------------------------------------------------


def test_negative_indices_are_refused():
    with pytest.raises(InputError, match="start at 0, got -1"):
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


def test_a_fault_set_keeps_what_any_iterable_holds():
    one, other = Fault(1), Fault(3)
    expected = FaultSet((one, other))
    for given in ([one, other], iter([one, other]), (fault for fault in (other, one))):
        found = FaultSet(given)
        assert (found, hash(found)) == (expected, hash(expected))
    assert FaultSet([]) == FaultSet()


@pytest.mark.parametrize("given", [0, None, "", "1", 1, [1]])
def test_what_is_no_fault_never_means_that_nothing_failed(given):
    with pytest.raises(InputError, match="a fault set needs faults"):
        FaultSet(given)
