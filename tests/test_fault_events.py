"""Faults in time: texts read, phases by brute force, and what is said of those that make none."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.errors import InputError
from ftforce.trajectory.fault_events import FaultEvent, Phase, phases, read_events
from helpers import campaign
from urdfs import arm, joint, load

NAN, INF = math.nan, math.inf
law = settings(deadline=None, max_examples=campaign(200, 60))
NOTHING = FaultSet()


def free(*joints):
    return FaultSet.all_of(FaultMode.FREE, joints)


def weak(joint, factor):
    return FaultSet((Fault(joint, FaultMode.WEAK, factor),))


def locked(*joints):
    return FaultSet.locked(joints)


# ---- texts -----------------------------------------------------------------------------------

TEXTS = {
    "3@50": (50.0, locked(2)),
    "3,4@50": (50.0, locked(2, 3)),
    "joint3@50": (50.0, locked(2)),
    "joint4, 3 @ 0.5": (0.5, locked(2, 3)),
    "locked:3@50": (50.0, locked(2)),
    "free:2@10": (10.0, free(1)),
    "free:2,joint5@1e1": (10.0, free(1, 4)),
    " Free : 2@10 ": (10.0, free(1)),
    "weak:3:0.5@5": (5.0, weak(2, 0.5)),
    "weak:joint3:0@5": (5.0, weak(2, 0.0)),
    "weak:3:0.5,5:0.1@5": (5.0, FaultSet(weak(2, 0.5).faults + weak(4, 0.1).faults)),
    "3@0": (0.0, locked(2)),
    "3@-0": (0.0, locked(2)),
}


@pytest.mark.parametrize(("text", "wanted"), TEXTS.items(), ids=TEXTS)
def test_texts(dh5, text, wanted):
    assert read_events(dh5, text) == (wanted,)
    assert read_events(dh5, [text]) == (wanted,)


def test_events_in_other_forms(dh5):
    one = FaultEvent(1.0, locked(2))
    for form in (one, (text for text in ("3@1",)), [FaultEvent(np.float64(1.0), locked(2))]):
        assert read_events(dh5, form) == (one,)
    assert read_events(dh5, ()) == read_events(dh5, []) == ()


def test_events_are_sorted_and_those_of_one_time_are_one(dh5):
    given = ["5@7", "free:1@2", FaultEvent(0.5, locked(2)), "weak:4:0.5@2"]
    times = [(event.time, event.faults) for event in read_events(dh5, given)]
    both = FaultSet((*free(0).faults, *weak(3, 0.5).faults))
    assert times == [(0.5, locked(2)), (2.0, both), (7.0, locked(4))]


@pytest.mark.parametrize("name", ["left elbow", "a@b", "a:b", "free", "weak"])
def test_names_of_any_kind(tmp_path, name):
    robot = load(tmp_path, arm(j2=joint(name, "l1", "l2")), tip="tool")
    assert read_events(robot, f"locked:{name}@3") == ((3.0, locked(1)),)
    assert read_events(robot, f"free:{name}@3") == ((3.0, free(1)),)
    assert read_events(robot, f"weak:{name}:0.5@3") == ((3.0, weak(1, 0.5)),)
    assert read_events(robot, f"{name}@3") == ((3.0, locked(1)),)


AGAIN = [
    (["free:3@1", "3@2"], locked(2)),
    (["weak:3:0.5@1", "3@2"], locked(2)),
    (["weak:3:0.5@1", "weak:3:0.2@2"], weak(2, 0.2)),
    (["weak:3:0.5@1", "free:3@2"], free(2)),
    (["weak:3:0.5@1", "free:3@2", "3@3"], locked(2)),
    (["free:3@1", "weak:3:0.5@2"], weak(2, 0.5)),
    (["free:3@1", "3@1"], locked(2)),
]


@pytest.mark.parametrize(("events", "last"), AGAIN, ids=str)
def test_what_is_not_locked_can_fail_once_more(dh5, events, last):
    assert phases(read_events(dh5, events), 0.0)[-1] == (
        phases(read_events(dh5, events), INF)[-1].start, last, last,
    )  # fmt: skip


# ---- texts that are none ---------------------------------------------------------------------

SUCH = "3,4@50, free:2@10 or weak:3:0.5@5"
MODES = f"available: locked, free, weak, e.g. {SUCH}"
NEEDS = f"a fault event needs joints and a time, e.g. {SUCH}; got"
BAD = {
    "": f"{NEEDS} ''",
    "3": f"{NEEDS} '3'",
    "@5": f"{NEEDS} '@5'",
    " @5": f"{NEEDS} ' @5'",
    "3@": "a fault event needs joints and a time, e.g. ",
    "3@soon": "the time of the fault '3@soon': 'soon' is not a number; give it in s",
    "3@nan": "the time of the fault '3@nan': 'nan' is not finite; give it in s",
    "3@1e300": "the time of the fault '3@1e300': '1e300' is too large",
    "3@-1": "the time of a fault must be 0 s or later, got -1 s",
    "bogus:3@1": f"unknown fault mode 'bogus' in 'bogus:3@1'; {MODES}",
    ":3@1": f"unknown fault mode '' in ':3@1'; {MODES}",
    "3:0.5@1": f"unknown fault mode '3' in '3:0.5@1'; {MODES}",
    "weak:3@1": "a weak joint needs a factor after a colon, e.g. 3:0.5 for half of its torque",
    "weak:3:@1": "the factor of weak joint '3': '': expected 1 number, got 0",
    "weak:3:1.5@1": "the factor of weak joint 3 must lie between 0 (no torque) and 1 (full torque)",
    "weak::0.5@1": "no joint before ':0.5'; give the weak joint, e.g. 3:0.5",
    "free:3:0.5@1": "unknown joint '3:0.5' in the chain of 'dh5'; available: joint1, joint2, ",
    "jont3@1": "unknown joint 'jont3' in the chain of 'dh5'; available: joint1, joint2, joint3, "
    "joint4, joint5; did you mean 'joint3'?",
    "3,3@1": "joint 3 (joint3) appears twice",
    "free:@1": f"the fault at 1 s has no joints; give one, e.g. {SUCH}",
    "3@1,4@2": "unknown joint '3@1' in the chain of 'dh5'; available: joint1, joint2, ",
}


@pytest.mark.parametrize(("text", "message"), BAD.items(), ids=BAD)
def test_texts_that_are_no_events(dh5, text, message):
    with pytest.raises(InputError) as caught:
        read_events(dh5, text)
    assert str(caught.value).startswith(message)
    with pytest.raises(InputError):
        read_events(dh5, ["2@0", text])


TEXTUAL = f"a fault event is a string such as {SUCH}; got"
EVENTS = f"fault events are strings such as {SUCH}; got"
LATER = "the time of a fault must be 0 s or later, got"
BAD_OBJECTS = {
    "nothing": (None, f"{EVENTS} None"),
    "a number": (3, f"{EVENTS} 3"),
    "a truth": (True, f"{EVENTS} True"),
    "bytes": (b"3@1", f"{TEXTUAL} 51"),
    "numbers": ([3, 4], f"{TEXTUAL} 3"),
    "a pair": ([(1.0, locked(2))], f"{TEXTUAL} (1.0, FaultSet("),
    "None within": (["3@1", None], f"{TEXTUAL} None"),
    "a phase": ([Phase(0.0, NOTHING, NOTHING)], f"{TEXTUAL} Phase("),
    "before": (FaultEvent(-1.0, locked(2)), f"{LATER} -1 s"),
    "NaN": (FaultEvent(NAN, locked(2)), f"{LATER} nan s"),
    "never": (FaultEvent(INF, locked(2)), f"{LATER} inf s"),
    "text as time": (FaultEvent("1", locked(2)), f"{LATER} '1'"),
    "truth as time": (FaultEvent(True, locked(2)), f"{LATER} True"),
    "list as time": (FaultEvent([1.0], locked(2)), f"{LATER} [1.0]"),
    "no time": (FaultEvent(None, locked(2)), f"{LATER} None"),
    "huge": (FaultEvent(10**400, locked(2)), f"{LATER} 1000"),
    "joints": (FaultEvent(1.0, [3]), "a fault event needs a FaultSet, got [3]"),
    "text": (FaultEvent(1.0, "3"), "a fault event needs a FaultSet, got '3'"),
    "one fault": (FaultEvent(1.0, Fault(2)), "a fault event needs a FaultSet, got Fault("),
    "no joints": (FaultEvent(1.0, NOTHING), "the fault at 1 s has no joints; give one, e.g."),
    "beyond": (FaultEvent(1.0, locked(5)), "a joint of the fault at 1 s is out of range; the"),
}  # fmt: skip


@pytest.mark.parametrize(("events", "message"), BAD_OBJECTS.values(), ids=BAD_OBJECTS)
def test_objects_that_are_no_events(dh5, events, message):
    with pytest.raises(InputError) as caught:
        read_events(dh5, events)
    assert str(caught.value).startswith(message)


ONCE = "only a free or weak joint can fail again, in another mode"
TWICE = [
    (["3@5", "3@6"], "joint 3 (joint3) has already failed (locked) by 6 s"),
    (["3@6", "3@5"], "joint 3 (joint3) has already failed (locked) by 6 s"),
    (["3@5", "3@5"], "joint 3 (joint3) has already failed (locked) by 5 s"),
    (["3@5", "free:2,3@6"], "joint 3 (joint3) has already failed (locked) by 6 s"),
    (["3@5", "weak:3:0.5@6"], "joint 3 (joint3) has already failed (locked) by 6 s"),
    (["free:3@5", "free:3@6"], "joint 3 (joint3) has already failed (free) by 6 s"),
    (["weak:3:0.5@5", "weak:3:0.5@6"], "joint 3 (joint3) has already failed (weak 0.5) by 6 s"),
]


@pytest.mark.parametrize(("events", "message"), TWICE, ids=str)
def test_a_joint_that_has_failed_already(dh5, events, message):
    with pytest.raises(InputError) as caught:
        read_events(dh5, events)
    assert str(caught.value) == f"{message}; {ONCE}"


# ---- phases ----------------------------------------------------------------------------------


def test_phases_by_hand():
    events = (FaultEvent(1.0, locked(2)), FaultEvent(1.5, free(0)))
    assert phases(events, 1.0) == (
        (0.0, NOTHING, NOTHING),
        (1.0, locked(2), NOTHING),
        (1.5, FaultSet(locked(2).faults + free(0).faults), NOTHING),
        (2.0, FaultSet(locked(2).faults + free(0).faults), locked(2)),
        (2.5, *[FaultSet(locked(2).faults + free(0).faults)] * 2),
    )


def test_no_delay_and_no_remap():
    events = (FaultEvent(1.0, locked(2)),)
    assert phases(events, 0.0) == ((0.0, NOTHING, NOTHING), (1.0, locked(2), locked(2)))
    assert phases(events, INF) == ((0.0, NOTHING, NOTHING), (1.0, locked(2), NOTHING))
    assert phases((), 0.0) == phases((), INF) == ((0.0, NOTHING, NOTHING),)


def test_a_fault_from_the_start():
    events = (FaultEvent(0.0, locked(2)),)
    assert phases(events, 0.0) == ((0.0, locked(2), locked(2)),)
    assert phases(events, 2.0) == ((0.0, locked(2), NOTHING), (2.0, locked(2), locked(2)))


timed = st.tuples(st.integers(0, 6), st.integers(0, 4), st.sampled_from(list(FaultMode)))


@given(st.lists(timed, max_size=5), st.sampled_from([0.0, 0.5, 1.0, 2.5, INF]))
@law
def test_phases_at_any_time(drawn, delay):
    """What is true of a phase is what a look at all events says."""
    events = [
        FaultEvent(float(time), FaultSet((Fault(joint, mode),)))
        for time, joint, mode in sorted(drawn)
    ]
    found = phases(events, delay)
    starts = [phase.start for phase in found]
    assert starts == sorted(set(starts))
    assert starts[0] == 0.0
    for t in np.arange(0.0, 10.0, 0.25).tolist():
        phase = max((p for p in found if p.start <= t), key=lambda p: p.start)
        for faults, later in ((phase.actual, 0.0), (phase.known, delay)):
            latest = {
                fault.joint: fault
                for event in events
                for fault in event.faults.faults
                if event.time + later <= t
            }
            assert {fault.joint: fault for fault in faults.faults} == latest
