"""Files: read with distrust, written whole or not at all."""

import math
import os
import socket
import stat
import sys
import threading
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftforce.errors import OutputError, SRDFError, URDFError
from ftforce.io import text as source
from ftforce.io.text import read_numbers, read_text, shortened, write_whole
from ftforce.io.xml_text import parse_xml
from urdfs import full_device

AS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


def read(path):
    return read_text(path, URDFError, "a URDF")


def parse(text):
    return parse_xml(text, "arm.urdf", URDFError)


# ---- reading ---------------------------------------------------------------------------------


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["plain", "byte order mark"])
def test_text_is_utf8(tmp_path, mark):
    path = tmp_path / "a.urdf"
    path.write_bytes(mark + "<robot name='ж'/>".encode())
    assert read(path) == "<robot name='ж'/>"
    assert read(str(path)) == "<robot name='ж'/>"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is empty; expected a URDF"),
        (b" \r\n\t", "is empty; expected a URDF"),
        (b"\xef\xbb\xbf", "is empty; expected a URDF"),
        (b"<robot>\0</robot>", "is a binary file; expected a URDF"),
        (bytes(range(256)), r"is not UTF-8 text \(byte 128\); expected a URDF"),
        ("<robot name='ä'/>".encode("latin-1"), r"is not UTF-8 text \(byte 13\)"),
        ("<?xml encoding='latin-1'?><a b='ä'/>".encode("latin-1"), r"is not UTF-8 text"),
        ("<robot/>".encode("utf-16"), r"is not UTF-8 text \(byte 0\)"),
        (b"\x7fELF\2\1\1\0\0", "is a binary file"),
    ],
)
def test_what_is_no_text_is_refused(tmp_path, content, reason):
    path = tmp_path / "a.urdf"
    path.write_bytes(content)
    with pytest.raises(URDFError, match=reason) as caught:
        read(path)
    assert caught.value.path == str(path)


def test_the_callers_error_is_raised(tmp_path):
    with pytest.raises(SRDFError, match="no such file; expected an SRDF"):
        read_text(tmp_path / "a.srdf", SRDFError, "an SRDF")


def test_paths_that_are_no_files(tmp_path):
    (tmp_path / "circle").symlink_to("circle")
    (tmp_path / "dangling").symlink_to("nowhere")
    (tmp_path / "file").touch()
    for name in ("none.urdf", "circle", "dangling", "file/below.urdf", "none\0.urdf", "\udcff"):
        with pytest.raises(URDFError, match="no such file"):
            read(tmp_path / name)
    with pytest.raises(URDFError, match="no such file"):
        read("")
    with pytest.raises(URDFError, match="is a folder"):
        read(tmp_path)
    with pytest.raises(URDFError, match="File name too long"):
        read(tmp_path / ("x" * 5000))


@pytest.mark.parametrize("device", ["/dev/null", "/dev/zero", "/dev/full"])
@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no such devices here")
def test_devices_are_not_read(device):
    with pytest.raises(URDFError, match="is not a regular file"):
        read(device)


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no sockets in files here")
def test_a_socket_is_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a socket's path must be short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("s")
        with pytest.raises(URDFError, match="is not a regular file"):
            read("s")


def test_a_pipe_is_read_like_a_file(tmp_path):
    """`ftforce inspect <(xacro arm.xacro)` hands over a pipe."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    holder = os.open(pipe, os.O_RDWR)  # opens it for the writer, as the shell does
    writer = threading.Timer(0.05, lambda: (os.write(holder, b"<robot/>"), os.close(holder)))
    writer.start()
    assert read(pipe) == "<robot/>"
    writer.join()


def test_a_pipe_without_writer_is_empty_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(URDFError, match="is empty"):
        read(tmp_path / "pipe")


STOP = threading.Event()


def write_for_ever(pipe):
    with suppress(BrokenPipeError), pipe.open("wb", buffering=0) as stream:
        while not STOP.is_set():
            stream.write(b" " * 100_000)


def test_a_file_without_end_is_cut(tmp_path, monkeypatch):
    monkeypatch.setattr(source, "LARGEST_FILE", 1_000_000)
    path = tmp_path / "a.urdf"
    path.write_bytes(b" " * 1_000_000)
    with pytest.raises(URDFError, match="is empty"):
        read(path)
    path.write_bytes(b" " * 2_000_000)
    with pytest.raises(URDFError, match="is larger than 1 MB"):
        read(path)
    pipe = tmp_path / "pipe"  # whose writer never stops
    os.mkfifo(pipe)
    held = os.open(pipe, os.O_RDWR)  # so that it has a writer from the start
    writer = threading.Thread(target=write_for_ever, args=(pipe,))
    writer.start()
    with pytest.raises(URDFError, match="is larger than 1 MB"):
        read(pipe)
    os.set_blocking(held, False)
    while writer.is_alive():  # it writes until nobody reads any more
        with suppress(BlockingIOError):
            os.read(held, 1 << 20)
        STOP.set()
    os.close(held)


@pytest.mark.skipif(AS_ROOT, reason="root may read everything")
def test_a_file_that_may_not_be_read(tmp_path):
    path = tmp_path / "a.urdf"
    path.write_text("<robot/>")
    path.chmod(0)
    with pytest.raises(URDFError, match=r"cannot be read \(Permission denied\)"):
        read(path)


def test_an_error_while_reading_is_told(tmp_path, monkeypatch):
    path = tmp_path / "a.urdf"
    path.write_text("<robot/>")

    def fail(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "open", fail)
    with pytest.raises(URDFError, match=r"cannot be read \(Input/output error\)"):
        read(path)


# ---- XML -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "<!DOCTYPE robot><robot/>",
        "<?xml version='1.0'?><!-- a --><!DOCTYPE robot SYSTEM 'robot.dtd'><robot/>",
        "<!DOCTYPE r [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;'>]><robot name='&b;'/>",
        "<!DOCTYPE r [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><robot>&a;</robot>",
        "<!DOCTYPE r [<!ENTITY % a SYSTEM 'http://localhost/a.dtd'> %a;]><robot/>",
        "<!DOCTYPE r [<!ATTLIST robot name CDATA 'x'>]><robot/>",
    ],
)
def test_a_dtd_is_refused(text):
    with pytest.raises(URDFError, match=r"arm\.urdf: contains a DTD .* not allowed; remove it"):
        parse(text)


def test_a_billion_laughs_are_not_expanded():
    lines = "".join(f"<!ENTITY l{i} '{f'&l{i - 1};' * 10}'>" for i in range(1, 30))
    with pytest.raises(URDFError, match="contains a DTD"):
        parse(f"<!DOCTYPE l [<!ENTITY l0 'ha'>{lines}]><robot>&l29;</robot>")


@pytest.mark.parametrize(
    "text",
    [
        "<robot>",
        "<robot></Robot>",
        "<robot a='1' a='2'/>",
        "<robot/><robot/>",
        "<robot>&lost;</robot>",
        "<robot>&#0;</robot>",
        "<robot>\x1b[31m</robot>",
        "robot:\n  links: []",
        '{"robot": 1}',
    ],
)
def test_broken_xml_is_told_with_its_place(text):
    with pytest.raises(URDFError, match=r"is not well-formed XML \(.*: line [12], col"):
        parse(text)


def test_comments_and_instructions_may_stand_everywhere():
    root = parse("<!-- <!DOCTYPE a> --><?a b?><robot><!-- c --><?d e?><link/></robot><!-- f -->")
    assert [element.tag for element in root] == ["link"]


def test_declared_encodings_do_not_matter_for_utf8():
    for encoding in ("latin-1", "utf-16", "utf-7", "klingon"):
        root = parse(f"<?xml version='1.0' encoding='{encoding}'?><robot name='ж'/>")
        assert root.get("name") == "ж"


def test_the_roots_namespace_is_taken_off_and_others_stay():
    root = parse("<robot xmlns='urn:a' xmlns:g='urn:g'><link/><g:link/></robot>")
    assert [root.tag, *(element.tag for element in root)] == ["robot", "link", "{urn:g}link"]
    plain = parse("<robot xmlns:g='urn:g'><link/><g:link/></robot>")
    assert [plain.tag, *(element.tag for element in plain)] == ["robot", "link", "{urn:g}link"]


def test_deep_nesting_is_no_recursion():
    depth = 20 * sys.getrecursionlimit()
    root = parse("<a>" * depth + "</a>" * depth)
    assert sum(1 for _ in root.iter()) == depth


# ---- numbers ---------------------------------------------------------------------------------


@given(
    st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=4), st.sampled_from([" ", "  ", "\n", "\t"])
)
def test_numbers_are_read_to_the_last_digit(numbers, gap):
    assert read_numbers(gap.join(map(repr, numbers)), len(numbers)) == tuple(numbers)


@pytest.mark.parametrize(
    ("text", "value"),
    [("1", 1.0), ("+.5", 0.5), ("-1.", -1.0), ("1E+3", 1000.0), ("1e-320", 1e-320), (" 7 ", 7.0)],
)
def test_ways_to_write_a_number(text, value):
    assert read_numbers(text, 1) == (value,)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "'': expected 1 number, got 0"),
        ("1 2", "'1 2': expected 1 number, got 2"),
        ("one", "'one' is not a number"),
        ("1,5", "'1,5' is not a number"),
        ("1_000", "'1_000' is not a number"),
        ("0x10", "'0x10' is not a number"),
        ("1d3", "'1d3' is not a number"),
        ("1e", "'1e' is not a number"),
        ("1/2", "'1/2' is not a number"),
        ("١", "'١' is not a number"),
        ("１", "'１' is not a number"),
        ("1\u00a0", "is not a number"),
        ("nan(1)", r"'nan\(1\)' is not a number"),
        ("NaN", "'NaN' is not finite"),
        ("-inf", "'-inf' is not finite"),
        ("Infinity", "'Infinity' is not finite"),
        ("1e400", "'1e400' is not finite"),
        ("1e308", r"'1e308' is too large; the maximum magnitude is 1e\+09"),
        ("-1.1e9", "is too large"),
    ],
)
def test_what_is_no_number(text, reason):
    with pytest.raises(ValueError, match=f"^{reason}" if reason.startswith("'") else reason):
        read_numbers(text, 1)


def test_several_numbers():
    assert read_numbers("1 2 3", 3) == (1.0, 2.0, 3.0)
    with pytest.raises(ValueError, match="'1 2': expected 3 numbers, got 2"):
        read_numbers("1 2", 3)
    with pytest.raises(ValueError, match="is not finite"):
        read_numbers("1 2 nan", 3)


def test_a_caller_may_take_larger_numbers():
    assert read_numbers("1e308", 1, math.inf) == (1e308,)


def test_a_long_text_is_cut_in_messages():
    with pytest.raises(ValueError, match="…: expected 3 numbers, got 100000") as caught:
        read_numbers("0.5 " * 100_000, 3)
    assert len(str(caught.value)) < 120
    assert shortened("x" * 60) == repr("x" * 60)
    assert shortened("x" * 61) == repr("x" * 60) + "…"


# ---- writing ---------------------------------------------------------------------------------


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_written_as_it_is(tmp_path):
    path = tmp_path / "a b.json"
    assert write_whole(path, "σ\n\r\n") == path
    assert path.read_bytes() == "σ\n\r\n".encode()
    assert write_whole(str(path), "2") == path
    assert path.read_bytes() == b"2"
    assert names_in(tmp_path) == ["a b.json"]


def test_permissions_are_the_old_files_or_the_usual_ones(tmp_path):
    before = os.umask(0o027)
    try:
        new = write_whole(tmp_path / "new", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE(new.stat().st_mode) == 0o640
    new.chmod(0o600)
    write_whole(new, "y")
    assert stat.S_IMODE(new.stat().st_mode) == 0o600


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "folder").mkdir()
    link = tmp_path / "link"
    link.symlink_to("folder/target")
    for text in ("first", "second"):  # the target does not exist, then it does
        assert write_whole(link, text) == link
        assert link.is_symlink()
        assert (tmp_path / "folder" / "target").read_text() == text
    assert names_in(tmp_path / "folder") == ["target"]


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("", "not a valid file name"),
        ("a\0b", "not a valid file name"),
        (".", "it is a folder"),
        ("none/a.json", "No such file or directory"),
        ("file/a.json", "Not a directory"),
        ("x" * 5000, "File name too long"),
    ],
)
def test_where_nothing_can_be_written(tmp_path, monkeypatch, path, reason):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    with pytest.raises(OutputError, match=reason):
        write_whole(path, "text")
    assert names_in(tmp_path) == ["file"]


def test_text_that_is_no_utf8(tmp_path):
    (tmp_path / "old").write_text("old")
    for name in ("old", "new"):
        with pytest.raises(OutputError, match="surrogates not allowed"):
            write_whole(tmp_path / name, "\udcff")
    assert names_in(tmp_path) == ["old"]
    assert (tmp_path / "old").read_text() == "old"


def test_a_read_only_file_is_left_alone(tmp_path, monkeypatch):
    path = tmp_path / "old"
    path.write_text("old")
    path.chmod(0o400)
    monkeypatch.setattr(os, "access", lambda file, mode: file != path)  # root may write everything
    with pytest.raises(OutputError, match="it is read-only"):
        write_whole(path, "new")
    assert path.read_text() == "old"


@pytest.mark.skipif(AS_ROOT, reason="root may write everywhere")
def test_a_read_only_folder(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="Permission denied"):
        write_whole(tmp_path / "new", "text")
    assert names_in(tmp_path) == []
    tmp_path.chmod(0o700)


@pytest.mark.parametrize("step", ["write", "chmod", "replace"])
@pytest.mark.parametrize(
    ("error", "raised"),
    [(OSError(28, "No space left on device"), OutputError), (KeyboardInterrupt(), None)],
)
def test_nothing_is_left_of_a_failure(tmp_path, monkeypatch, step, error, raised):
    path = tmp_path / "old"
    path.write_text("old")

    def fail(*_, **__):
        raise error

    if step == "write":
        monkeypatch.setattr(os, "fdopen", fail)
    else:
        monkeypatch.setattr(Path, step, fail)
    with pytest.raises(raised or type(error)):
        write_whole(path, "new")
    monkeypatch.undo()
    assert names_in(tmp_path) == ["old"]
    assert path.read_text() == "old"


def test_devices_are_written_and_not_replaced(tmp_path):
    device = full_device(tmp_path)
    with pytest.raises(OutputError, match=r"full: .*No space left on device"):
        write_whole(device, "text")
    assert device.is_char_device()


def test_a_pipe_is_written_if_someone_reads_it(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OutputError, match="cannot be written"):
        write_whole(pipe, "lost")
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    assert write_whole(pipe, "text") == pipe
    assert os.read(reader, 100) == b"text"
    os.close(reader)
    assert pipe.is_fifo()


def test_written_xml_can_be_read_again(tmp_path):
    path = write_whole(tmp_path / "a.urdf", "<robot name='&lt;ж&gt;'/>")
    assert ElementTree.tostring(parse(read(path))) == ElementTree.tostring(
        ElementTree.fromstring("<robot name='&lt;ж&gt;'/>")
    )
