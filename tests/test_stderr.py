"""What C++ prints on stderr: caught, whole, and never anybody else's for long."""

import os
import threading
from pathlib import Path

import pytest

from ftforce.robot.stderr import captured_stderr


def test_what_is_printed_below_python_is_caught(capfd):
    with captured_stderr() as printed:
        os.write(2, "σ 1\n".encode())
        assert str(printed) == ""
        os.write(2, b"\xff 2\n")
    os.write(2, b"after")
    assert str(printed) == printed.text == "σ 1\n\ufffd 2\n"
    assert capfd.readouterr().err == "after"


def test_much_can_be_printed(capfd):
    with captured_stderr() as printed:  # a pipe would be full and block
        os.write(2, b"x" * 1_000_000)
    assert len(printed.text) == 1_000_000
    assert capfd.readouterr().err == ""


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


def test_threads_wait_for_each_other(capfd):
    """The descriptor belongs to the whole process."""
    found = []

    def work():
        with captured_stderr() as printed:
            os.write(2, b"theirs")
        found.append(printed.text)

    thread = threading.Thread(target=work)
    with captured_stderr() as printed:
        thread.start()
        thread.join(0.1)
        assert thread.is_alive()
        os.write(2, b"mine")
    thread.join()
    os.write(2, b"after")
    assert (printed.text, found) == ("mine", ["theirs"])
    assert capfd.readouterr().err == "after"


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="descriptors cannot be counted here")
def test_no_descriptor_stays_open():
    before = len(list(Path("/dev/fd").iterdir()))
    for _ in range(5):
        with captured_stderr():
            pass
    assert len(list(Path("/dev/fd").iterdir())) == before


def test_systems_without_files_in_memory(monkeypatch, capfd):
    monkeypatch.delattr(os, "memfd_create", raising=False)
    with captured_stderr() as printed:
        os.write(2, b"caught")
    assert printed.text == "caught"
    assert capfd.readouterr().err == ""
