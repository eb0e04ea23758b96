"""Bags that are built to cost more memory or time than they seem to: refused, in one line."""

import bz2
import sqlite3
import struct
from contextlib import closing
from zlib import crc32

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType
from mcap.writer import Writer as WriterM
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from test_bags import COUNT, JOINTS, STATE, STATES, STORE, Q, state_of, write

from ftforce.errors import InputError
from ftforce.io import bag, bag_files
from ftforce.io.bag import read_motion
from helpers import peak_memory

KIND = STATE[1]
RAW = [bytes(STORE.serialize_cdr(message, KIND)) for message in STATES]
PACK = {
    "zstd": zstandard.ZstdCompressor().compress,
    "lz4": lz4.frame.compress,
    "bz2": bz2.compress,
}
ZEROS = bytes(30_000_000)


def record(kind, body):
    return bytes([kind]) + struct.pack("<Q", len(body)) + body


def text(content):
    return struct.pack("<I", len(content)) + content


def mcap(path, *, chunks, definition=None, form=b"ros2msg", encoding=b"cdr"):
    """Write an MCAP file without a summary, of chunks: compression, stated size, content, CRC."""
    if definition is None:
        definition = STORE.generate_msgdef(KIND, ros_version=2)[0].encode()
    schema = struct.pack("<H", 1) + text(KIND.encode()) + text(form) + text(definition)
    channel = struct.pack("<HH", 1, 1) + text(b"/joint_states") + text(encoding)
    records = [record(1, text(b"ros2") + text(b"")), record(3, schema)]
    records.append(record(4, channel + struct.pack("<I", 0)))
    for compression, size, content, checksum in chunks:
        head = struct.pack("<QQQI", 1, 2, size, checksum) + text(compression.encode())
        records.append(record(6, head + struct.pack("<Q", len(content)) + content))
    records.append(record(2, struct.pack("<QQI", 0, 0, 0)))
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + b"".join(records) + magic)
    return path


def inside(raws=RAW):
    """Return what is inside a chunk with these messages."""
    return b"".join(
        record(5, struct.pack("<HIQQ", 1, i, 10**9 + i, 0) + raw) for i, raw in enumerate(raws)
    )


def ros1(path, compression="none", stated=None, content=None):
    """Write a bag of ROS 1; its chunk may be replaced by another one."""
    path.unlink(missing_ok=True)
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer1(path)
    if compression != "none":
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    with writer:
        connection = writer.add_connection(*STATE, typestore=store)
        for i in range(COUNT):
            message = state_of(store, i)
            writer.write(connection, 10**9 + i, store.serialize_ros1(message, KIND))
    data = path.read_bytes()
    if content is None:
        return path
    start = 13 + 4096  # after the header of the file, which is padded
    (length,) = struct.unpack_from("<I", data, start)
    (size,) = struct.unpack_from("<I", data, start + 4 + length)
    fields = [
        b"compression=" + compression.encode(),
        b"op=\x05",
        b"size=" + struct.pack("<I", stated),
    ]
    head = b"".join(map(text, fields))
    chunk = text(head) + text(content)
    new = data[:start] + chunk + data[start + 8 + length + size :]
    at = new.index(b"index_pos=") + 10
    (index,) = struct.unpack_from("<Q", new, at)
    moved = index + len(chunk) - (8 + length + size)
    path.write_bytes(new[:at] + struct.pack("<Q", moved) + new[at + 8 :])
    return path


def refused(path, problem, *, memory=8_000_000):
    """Check what is said of a bag, and that it takes little memory."""

    def read():
        with pytest.raises(InputError, match=problem):
            read_motion(path, JOINTS)

    read()  # what is imported counts too
    assert peak_memory(read) < memory


# ---- compression -----------------------------------------------------------------------------


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_chunks_of_mcap(tmp_path, compression):
    path = tmp_path / "run.mcap"
    content = inside()
    packed = PACK[compression](content)
    good = (compression, len(content), packed, crc32(content))
    np.testing.assert_array_equal(read_motion(mcap(path, chunks=[good]), JOINTS).q, Q)
    mcap(path, chunks=[(*good[:3], 1)])
    refused(path, "is damaged: the checksum of a chunk is wrong")
    bomb = PACK[compression](ZEROS)
    for stated in (0, 500, len(ZEROS) - 1):
        mcap(path, chunks=[(compression, stated, bomb, 0)])
        refused(path, "a chunk is not as large as it is said to be", memory=2 * stated + 8_000_000)
    mcap(path, chunks=[(compression, 1 << 40, bomb, 0)])
    refused(path, r"is refused: a chunk is larger than 500 MB")
    mcap(path, chunks=[("brotli", 5, b"abcde", 0)])
    refused(path, "chunks are compressed by brotli; only zstd, lz4 and bz2 are read")


def test_frames_in_a_row_are_one_chunk(tmp_path):
    """Each frame states a size of its own, which is only that of the frame."""
    path, content = tmp_path / "run.mcap", inside()
    frames = PACK["zstd"](content[:999]) + PACK["zstd"](content[999:])
    mcap(path, chunks=[("zstd", len(content), frames, 0)])
    np.testing.assert_array_equal(read_motion(path, JOINTS).q, Q)
    mcap(path, chunks=[("zstd", len(content), frames + PACK["zstd"](ZEROS), 0)])
    refused(path, "a chunk is not as large as it is said to be")


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_chunks_of_ros_1(tmp_path, compression):
    path = tmp_path / "run.bag"
    for good in ("none", compression):
        np.testing.assert_array_equal(read_motion(ros1(path, good), JOINTS).q, Q)
    bomb = PACK[compression](ZEROS)
    ros1(path, compression, 500, bomb)
    refused(path, "a chunk is not as large as it is said to be")
    ros1(path, compression, (1 << 32) - 1, bomb)
    refused(path, r"is refused: a chunk is larger than 500 MB")


def test_many_chunks_unpack_to_a_multiple_of_the_file(tmp_path, monkeypatch):
    """A chunk within bounds may be repeated; all of them together have a bound too."""
    monkeypatch.setattr(bag_files, "_UNPACKED", 3_000_000)
    part = ("zstd", 1_000_000, PACK["zstd"](record(0x7F, bytes(999_991))), 0)
    path = mcap(tmp_path / "run.mcap", chunks=[part] * 3)
    refused(path, "no message has all joints")
    monkeypatch.setattr(bag_files, "_RATIO", 1)
    path = mcap(tmp_path / "run.mcap", chunks=[part] * 4)
    refused(path, "is refused: it unpacks to more than 1 times its size")


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_messages_compressed_one_by_one(tmp_path, plugin, monkeypatch):
    """A file of such a bag does not say that they are; the content does."""

    def packed(raws):
        with Writer(tmp_path / "run", version=9, storage_plugin=plugin) as writer:
            connection = writer.add_connection(*STATE, typestore=STORE)
            for i, raw in enumerate(raws):
                writer.write(connection, 10**9 + i, PACK["zstd"](raw))
        (file,) = (tmp_path / "run").glob("run.*")
        return file.rename(tmp_path / f"one{len(raws)}{file.suffix}")

    np.testing.assert_array_equal(read_motion(packed(RAW), JOINTS).q, Q)
    monkeypatch.setattr(bag_files, "LARGEST_MESSAGE", 1_000_000)
    (tmp_path / "run" / "metadata.yaml").unlink()
    (tmp_path / "run").rmdir()
    refused(packed([ZEROS]), "is refused: a message is larger than 1 MB")


def test_files_compressed_as_a_whole(tmp_path):
    path = tmp_path / "run.db3.zstd"
    path.write_bytes(PACK["zstd"](b"x"))
    assert bag.is_bag(path)
    refused(path, r"compressed as a whole; unpack it first: zstd -d run\.db3\.zstd")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (record(0x7F, b"") * 100_000, "it unpacks to more than 1,000 times its size"),
        (inside(RAW[:1]) * 2_000, "its messages are more than 100 times as large as it is"),
    ],
    ids=["records", "messages"],
)
def test_small_files_of_very_many(tmp_path, content, problem, monkeypatch):
    """What takes its time in Python is counted, too: records, and messages to decode."""
    monkeypatch.setattr(bag_files, "_UNPACKED", 20_000_000)
    monkeypatch.setattr(bag_files, "_ASKED", 100_000)
    chunk = ("zstd", len(content), PACK["zstd"](content), 0)
    path = mcap(tmp_path / "run.mcap", chunks=[chunk])
    refused(path, problem, memory=2 * len(content) + 8_000_000)


def test_a_file_is_listed_once(tmp_path):
    path = write(tmp_path / "run", {STATE: STATES})
    meta = path / "metadata.yaml"
    line = next(one for one in meta.read_text("utf-8").splitlines() if one.endswith("- run.mcap"))
    meta.write_text(meta.read_text("utf-8").replace(line, f"{line}\n{line}", 1), "utf-8")
    refused(path, r"is refused: metadata\.yaml lists a file twice")


# ---- databases -------------------------------------------------------------------------------

TOPICS = (
    "create table topics(id integer primary key, name text, type text, serialization_format text)"
)
MESSAGES = (
    "create table messages(id integer primary key, topic_id integer, timestamp integer, data)"
)
TOPIC = f"insert into topics values(1, '/joint_states', '{KIND}', 'cdr')"
MANY = f"select x, '/t' || x, '{KIND}', 'cdr' from c"
ENDLESS = "select x id, 1 topic_id, x timestamp, x'00' data from c"
COMPUTED = MESSAGES.replace("data)", "data as (zeroblob(topic_id * 1e9)))")
COUNTED = "with recursive c(x) as (select 1 union all select x + 1 from c where x < {}) "


def database(path, *commands):
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as found, found:
        for command in commands:
            found.execute(*command) if isinstance(command, tuple) else found.execute(command)
    return path


ROWS = [
    ("insert into messages values(?, 1, ?, ?)", (i, 10**9 + i, raw)) for i, raw in enumerate(RAW)
]


def test_a_database_without_definitions(tmp_path):
    path = database(tmp_path / "run.db3", TOPICS, MESSAGES, TOPIC, *ROWS)
    np.testing.assert_array_equal(read_motion(path, JOINTS).q, Q)
    cut = tmp_path / "cut.db3"
    cut.write_bytes(path.read_bytes()[:-100])
    refused(cut, "is cut off: the file is shorter than its database")


@pytest.mark.parametrize(
    ("commands", "problem"),
    [
        (
            (TOPICS, MESSAGES, f"{COUNTED.format(10_001)} insert into topics {MANY}"),
            "is refused: it has more than 10,000 topics",
        ),
        (
            (TOPICS, MESSAGES, TOPIC, "insert into messages values(1, 1, 1, zeroblob(30000000))"),
            "is refused: a message is larger than 1 MB, or is not binary",
        ),
        ((TOPICS, MESSAGES, TOPIC, "insert into messages values(1, 1, 'x', 'y')"), "is not binary"),
        (
            (TOPICS, TOPIC, f"create view messages as {COUNTED.format('1e18')} {ENDLESS}"),
            "it has no tables of topics and messages",
        ),
        (
            (TOPICS, TOPIC, "create virtual table messages using fts5(topic_id, timestamp, data)"),
            "it has no tables of topics and messages",
        ),
        (
            (TOPICS, TOPIC, COMPUTED, "insert into messages values(1, 1, 1)"),
            "is refused: it computes what it holds",
        ),
    ],
    ids=["topics", "blob", "text", "view", "virtual", "computed"],
)  # fmt: skip
def test_databases_that_are_refused(tmp_path, commands, problem, monkeypatch):
    monkeypatch.setattr(bag_files, "LARGEST_MESSAGE", 1_000_000)
    refused(database(tmp_path / "run.db3", *commands), problem)


def test_work_in_a_database_is_in_proportion_to_its_size(tmp_path, monkeypatch):
    """Pages that refer to each other could make any number of rows of a few."""
    filler = f"{COUNTED.format(50_000)} insert into messages select x + 100, 2, 1, x'' from c"
    path = database(tmp_path / "run.db3", TOPICS, MESSAGES, TOPIC, filler, *ROWS)
    np.testing.assert_array_equal(read_motion(path, JOINTS).q, Q)
    monkeypatch.setattr(bag_files, "_STEPS", -2 * path.stat().st_size)
    refused(path, "is damaged or not a bag: more work than its size can need")


# ---- definitions and messages ------------------------------------------------------------------

HEADER = b"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
SECTION = b"=" * 80 + b"\nMSG: "


@pytest.mark.parametrize(
    ("definition", "problem"),
    [
        (b"int32 x\n" * 20_000, "definition of sensor_msgs/msg/JointState has more than 50,000"),
        (HEADER + b"a/B[] all\n" + SECTION + b"a/B\n", r"has a list of a/msg/B, which is empty"),
        (HEADER + b"a/B[9] all\n" + SECTION + b"a/B\nfloat64[0] x\n", r"has a list of a/msg/B, "),
        (b"string[] x = 'a'\n(", r"is damaged: the definition of sensor_msgs/msg/JointState: "),
        (HEADER, r"the message at 1000000000 ns: its definition does not say what"),
        (b"int32 name\n", r"the message at 1000000000 ns: "),
        (
            b"sensor_msgs/JointState name\n",
            r"the message at 1000000000 ns: maximum recursion depth|nested too deeply",
        ),
    ],
    ids=["long", "empty", "of zero", "malformed", "partial", "other", "recursive"],
)  # fmt: skip
def test_definitions(tmp_path, definition, problem):
    path = mcap(
        tmp_path / "run.mcap", chunks=[("", len(inside()), inside(), 0)], definition=definition
    )
    refused(path, problem)


def test_messages_that_are_not_cdr(tmp_path):
    path = mcap(tmp_path / "run.mcap", chunks=[("", len(inside()), inside(), 0)], encoding=b"json")
    refused(path, "the messages of /joint_states are encoded as json; only cdr and ros1 are read")


def test_a_definition_in_idl(tmp_path):
    """As recorders that are not of ROS write it, each type under a line of its own."""
    mark = "=" * 80 + "\n"
    parts = {
        "builtin_interfaces/msg/Time": "int32 sec; uint32 nanosec;",
        "std_msgs/msg/Header": "builtin_interfaces::msg::Time stamp; string frame_id;",
        "sensor_msgs/msg/JointState": "std_msgs::msg::Header header; sequence<string> name; "
        "sequence<double> position; sequence<double> velocity; sequence<double> effort;",
    }
    texts = []
    for name, fields in parts.items():
        package, _, kind = name.split("/")
        idl = f"module {package} {{ module msg {{ struct {kind} {{ {fields} }}; }}; }};\n"
        texts.append(f"{mark}IDL: {name}\n{idl}")
    path = mcap(
        tmp_path / "run.mcap",
        chunks=[("", len(inside()), inside(), 0)],
        definition="".join(texts).encode(),
        form=b"ros2idl",
    )
    np.testing.assert_array_equal(read_motion(path, JOINTS).q, Q)


def test_a_cut_file_says_what_restores_it(tmp_path):
    path = mcap(tmp_path / "run.mcap", chunks=[("", len(inside()), inside(), 0)])
    path.write_bytes(path.read_bytes()[:-50])
    refused(path, "is cut off: its recorder did not finish, .*; mcap recover restores")


def test_files_without_chunks(tmp_path):
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = WriterM(stream, compression=CompressionType.NONE, use_chunking=False)
        writer.start(profile="ros2", library="x")
        definition = STORE.generate_msgdef(KIND, ros_version=2)[0].encode()
        schema = writer.register_schema(KIND, "ros2msg", definition)
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for i, raw in reversed(list(enumerate(RAW))):  # in another order than received
            writer.add_message(channel, log_time=10**9 + i, data=raw, publish_time=0)
        writer.finish()
    np.testing.assert_array_equal(read_motion(path, JOINTS).q, Q)


def test_samples_take_the_memory_of_their_numbers():
    """Two times, five positions and five velocities of 8 bytes, and the growth of arrays."""
    track = bag._Track(tuple(range(5)))
    sample = bag._Sample(0, 0, list(JOINTS), np.zeros(5), np.zeros(5))

    def fill():
        for i in range(5_000):
            track.add(sample._replace(received=i), JOINTS)
        return track.sorted(by_stamps=False)

    assert peak_memory(fill) < 2 * 5_000 * 12 * 8


def test_a_mistake_of_our_own_is_not_told_as_damage(tmp_path, monkeypatch):
    def wrong(*_):
        raise ZeroDivisionError

    path = write(tmp_path / "run", {STATE: STATES})
    monkeypatch.setattr(bag, "_places", wrong)
    with pytest.raises(ZeroDivisionError):
        read_motion(path, JOINTS)
