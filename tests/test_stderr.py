"""What C++ prints on stderr: caught, whole, and never anybody else's."""

import os
import sys
import threading
from pathlib import Path

import pytest

import ftforce
from ftforce.robot import stderr
from ftforce.robot.stderr import captured_stderr


@pytest.fixture
def alone(monkeypatch):
    """Let no thread count that another test has left behind."""
    monkeypatch.setattr(stderr, "_is_alone", lambda: True)


@pytest.mark.usefixtures("alone")
def test_what_is_printed_below_python_is_caught(capfd):
    with captured_stderr() as printed:
        os.write(2, "σ 1\n".encode())
        assert str(printed) == ""
        os.write(2, b"\xff 2\n")
    os.write(2, b"after")
    assert str(printed) == printed.text == "σ 1\n\ufffd 2\n"
    assert capfd.readouterr().err == "after"


@pytest.mark.usefixtures("alone")
def test_much_can_be_printed(capfd):
    with captured_stderr() as printed:  # a pipe would be full and block
        os.write(2, b"x" * 1_000_000)
    assert len(printed.text) == 1_000_000
    assert capfd.readouterr().err == ""


@pytest.mark.usefixtures("alone")
def test_an_error_inside_leaves_stderr_as_it_was(capfd):
    found = []

    def fail():
        with captured_stderr() as printed:
            found.append(printed)
            os.write(2, b"inside")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    os.write(2, b"after")
    assert found[0].text == "inside"
    assert capfd.readouterr().err == "after"


def test_what_other_threads_write_is_not_taken(capfd):
    """The descriptor belongs to the whole process."""
    inside, written = threading.Event(), threading.Event()

    def load():
        with captured_stderr() as printed:
            inside.set()
            written.wait()
        found.append(printed.text)

    found = []
    thread = threading.Thread(target=load)
    thread.start()
    inside.wait()
    os.write(2, b"ours")
    print("and ours", file=sys.stderr)
    written.set()
    thread.join()
    assert found == [""]
    assert capfd.readouterr().err == "oursand ours\n"


def test_loading_in_threads_prints_nothing(capfd):
    """Pinocchio is silent on what passed the checks."""
    names = ("panda", "tiago", "dh5")
    threads = [threading.Thread(target=ftforce.load_robot, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert capfd.readouterr().err == ""


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="descriptors cannot be counted here")
def test_no_descriptor_stays_open():
    before = len(list(Path("/dev/fd").iterdir()))
    for _ in range(5):
        with captured_stderr():
            pass
    assert len(list(Path("/dev/fd").iterdir())) == before


@pytest.mark.usefixtures("alone")
def test_systems_without_files_in_memory(monkeypatch, capfd):
    monkeypatch.delattr(os, "memfd_create", raising=False)
    with captured_stderr() as printed:
        os.write(2, b"caught")
    assert printed.text == "caught"
    assert capfd.readouterr().err == ""
