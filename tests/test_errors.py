"""Errors: what their messages show, and what they carry as data."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import ftforce
from ftforce.batch.postures import Grid
from ftforce.batch.workspace_map import workspace_map
from ftforce.core.limits import Limits
from ftforce.errors import (
    DHTableError,
    DimensionError,
    FileError,
    FtforceError,
    InputError,
    OutputError,
    SRDFError,
    UnknownNameError,
    URDFError,
    printable,
)
from ftforce.trajectory import Recording
from urdfs import arm, chain, joint, link, robot, write

FILE_ERRORS = (FileError, URDFError, SRDFError, DHTableError, OutputError)


@pytest.mark.parametrize("error", FILE_ERRORS)
@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("a\nb.urdf", r"a\nb.urdf"),
        ("a\r\tb", r"a\r\tb"),
        ("\x1b[31mred", r"\x1b[31mred"),
        ("a\x85b\u2028c", r"a\x85b\u2028c"),  # line breaks of Unicode
        ("\u202egpj.urdf", r"\u202egpj.urdf"),  # turns the rest around
        ("\udcff.urdf", r"\udcff.urdf"),  # a byte that is no UTF-8
        ("\0", r"\x00"),
        ("a b/関節 ж.urdf", "a b/関節 ж.urdf"),
        ("C:\\new\\arm.urdf", "C:\\new\\arm.urdf"),
    ],
)
def test_a_path_is_shown_on_one_line_and_kept_as_it_is(error, path, shown):
    caught = error(path, "is wrong")
    assert str(caught) == f"{shown}: is wrong"
    assert (caught.path, caught.reason) == (path, "is wrong")
    assert error(Path("x"), "is wrong").path == "x"
    str(caught).encode()  # a terminal can show it


BAD_NAME = "a\nb\x1b.urdf"
WRONG = {
    "no URDF": ("<robot>", None, {}),
    "no tip": (arm(), None, {"tip": "nobody"}),
    "tip is root": (arm(), None, {"tip": "base"}),
    "branches": (robot(*map(link, "abc"), joint("x", "a", "b"), joint("y", "a", "c")), None, {}),
    "nothing moves": (robot(link("base")), None, {}),
    "chains": (arm(), robot(chain("base", "l1"), chain("base", "l2")), {}),
    "SRDF": (arm(), "<robot>", {}),
}


@pytest.mark.parametrize(("urdf", "srdf", "options"), WRONG.values(), ids=WRONG)
def test_every_message_about_a_file_is_one_line(tmp_path, urdf, srdf, options):
    path = write(tmp_path, urdf, srdf, name=BAD_NAME)
    with pytest.raises(FtforceError) as caught:
        ftforce.load_robot(path, **options)
    assert printable(path.stem) in str(caught.value)
    assert str(caught.value).isprintable()
    if isinstance(caught.value, FileError):
        assert Path(caught.value.path).stem == path.stem


def test_an_output_with_a_line_break_in_its_name(tmp_path):
    arm_ = ftforce.load_robot("dh5")
    with pytest.raises(InputError, match=r"a\\nb\.txt: the name must end in \.json, \.csv"):
        ftforce.save(ftforce.analyze(arm_), "a\nb.txt")
    with pytest.raises(OutputError, match=r"/a\\nb/c\.json: cannot be written") as caught:
        ftforce.save(ftforce.analyze(arm_), tmp_path / "a\nb" / "c.json")
    assert caught.value.path == str(tmp_path / "a\nb" / "c.json")


@pytest.mark.parametrize(
    "error",
    [
        URDFError("a\nb.urdf", "is wrong"),
        DimensionError("force", (3,), (2,), "fx, fy, fz"),
        UnknownNameError("joint", "elbo", ("shoulder", "elbow")),
        InputError("no"),
    ],
)
def test_errors_come_back_from_other_processes(error):
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))


MALFORMED = {
    "rtol": lambda arm: ftforce.analyze(arm, rtol="1e-6"),
    "wary": lambda arm: ftforce.census(arm, wary=()),
    "length": lambda arm: ftforce.analyze(arm, length=[1.0]),
    "length too large": lambda arm: ftforce.analyze(arm, length=10**400),
    "length of a task": lambda arm: ftforce.Task(length=None),
    "components": lambda arm: ftforce.Task(3),
    "task": lambda arm: ftforce.analyze(arm, task=3),
    "axes": lambda arm: ftforce.analyze(arm, axes=np.zeros(0)),
    "inverse": lambda arm: ftforce.analyze(arm, inverse=[]),
    "ranking": lambda arm: ftforce.census(arm, rank_by={}),
    "posture": lambda arm: ftforce.analyze(arm, posture=np.array(["a"])),
    "payload": lambda arm: ftforce.analyze(arm, payload=10**400),
    "mask": lambda arm: ftforce.remap(np.eye(2), [1, 2], [[True], [True, False]]),
    "limits": lambda arm: Limits.of([1.7e308, 50.0]),
    "unprintable": lambda arm: ftforce.analyze(arm, joint_length="\x00"),
    "joint": lambda arm: ftforce.Fault(1.5),
    "faults": lambda arm: ftforce.FaultSet("nan"),
    "robot of a grid": lambda arm: Grid.of([], 2),
    "robot of a recording": lambda arm: Recording.of("dh5", [0, 1, 2, 3], np.zeros((4, 5))),
    "sweep": lambda arm: workspace_map({}),
    "stored sweep": lambda arm: ftforce.open_sweep("x" * 300),
}


@pytest.mark.parametrize("call", MALFORMED.values(), ids=MALFORMED)
def test_whatever_is_given_the_error_is_ours(dh5, call):
    with pytest.raises(FtforceError) as caught:
        call(dh5)
    assert str(caught.value).isprintable()


def test_messages_are_one_line_and_not_endless(dh5):
    with pytest.raises(InputError, match="position 1") as caught:
        ftforce.analyze(dh5, acceleration=np.full(5, np.nan))
    assert str(caught.value).isprintable()
    with pytest.raises(InputError, match="must not exceed") as caught:
        ftforce.analyze(dh5, acceleration=np.full(5, 1.2345678901e9))
    assert str(caught.value).isprintable()
    with pytest.raises(InputError, match="q needs numbers") as caught:
        ftforce.analyze(dh5, [*range(100_000), "x"])
    assert len(str(caught.value)) < 2000
