"""Files of bags, read record by record within bounds: MCAP, databases of rosbag2, bags of ROS 1.

What a file says of its own sizes is not believed. Chunks are unpacked one at a time, up to the size
that they state, and all of them up to a multiple of the file's size; the work in a database is in
proportion to its size. Libraries for bags unpack first, and compare sizes afterwards.
"""

from __future__ import annotations

import bz2
import sqlite3
import struct
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, TypeAlias
from zlib import crc32

from ftforce.errors import FileError, FtforceError, InputError, listed, printable
from ftforce.io.text import read_text

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

ENDINGS = (".mcap", ".db3", ".bag")
"""Extensions of bags: rosbag2's two storages, and ROS 1."""

LARGEST_MESSAGE = 200_000_000  # bytes; a trajectory of a million points of seven joints
_LARGEST_CHUNK = 500_000_000  # bytes, unpacked; recorders write about 1 MB, or one message
_UNPACKED = 300_000_000  # bytes that may be unpacked from any file, however small,
_RATIO = 1_000  # and times its size: joint states shrink to a tenth, blank images to a thousandth
_RECORD = 500  # bytes that take as long to unpack as a record of a chunk to read
_RECORD_1 = 3_000  # of ROS 1
_ASKED = 30_000_000  # bytes of the topics that are read, from any file, and
_ASKED_RATIO = 100  # times its size: their times at least differ
_LARGEST_META = 10_000_000  # bytes
_LARGEST_HEADER = 10_000_000  # bytes; a header of ROS 1 may hold the definition of a message
_MOST_TOPICS = 10_000
_STEPS = 20_000_000  # of SQLite's machine, besides two per byte; a row takes about 15
_MAGIC = b"\x89MCAP0\r\n"
_MAGIC_1 = b"#ROSBAG V2.0\n"
_ZSTD = b"\x28\xb5\x2f\xfd"  # a message in CDR begins with 0
_SQLITE = b"SQLite format 3\0"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _FOOTER = 3, 4, 5, 6, 2  # records of MCAP
_DATA_1, _CHUNK_1, _CONNECTION_1 = 2, 5, 7  # records of ROS 1
_CUT = "is cut off or damaged"

Bytes: TypeAlias = "bytes | bytearray | memoryview"


class Connection(NamedTuple):
    """A topic in a file.

    Attributes
    ----------
    id :
        Its number in the file.
    topic :
        Its name.
    type :
        Type of its messages, as ROS 2 writes it.
    encoding :
        How messages are encoded: ``cdr``, ``ros1`` or another.
    form :
        How their definition is written: ``ros2msg``, ``ros2idl``, ``ros1msg``, or empty.
    definition :
        The definition; empty if there is none.
    """

    id: int
    topic: str
    type: str
    encoding: str
    form: str
    definition: str


Message: TypeAlias = "tuple[Connection, int, Bytes]"
"""Its connection, the time at which it was received, ns, and its content."""


class BagFile:
    """One file of a bag.

    Attributes
    ----------
    path :
        The file.
    connections :
        Its topics.
    """

    def __init__(self, path: Path) -> None:
        """Read the topics of a file.

        Parameters
        ----------
        path :
            The file; its extension tells its format.

        Raises
        ------
        InputError
            It is not a bag, or damaged.
        """
        self.path = path
        self._format = _FORMATS[path.suffix.lower()]
        with _told():
            self.connections = self._format.connections(path)
        if len(self.connections) > _MOST_TOPICS:
            raise InputError(f"is refused: it has more than {_MOST_TOPICS:,} topics")

    def messages(self, wanted: Collection[int]) -> Iterator[Message]:
        """Yield the messages of some topics, in the order of the file.

        Parameters
        ----------
        wanted :
            Numbers of their connections.

        Raises
        ------
        InputError
            The file is damaged, or what it unpacks to is too large.
        """
        known = {one.id: one for one in self.connections if one.id in wanted}
        found = self._format.messages(self.path, known)
        left = _ASKED + _ASKED_RATIO * self.path.stat().st_size
        while True:
            with _told():  # not around the yield: what is done with a message is not the file's
                one = next(found, None)
                if one is not None and bytes(one[2][:4]) == _ZSTD:
                    one = one[0], one[1], _unzstd(one[2], LARGEST_MESSAGE)
            if one is None:
                return
            if len(one[2]) > LARGEST_MESSAGE:
                raise InputError(_too_large("a message", LARGEST_MESSAGE))
            left -= len(one[2])
            if left < 0:
                raise InputError(
                    f"is refused: its messages are more than {_ASKED_RATIO} times as large as it is"
                )
            yield one


@contextmanager
def _told() -> Iterator[None]:
    """Turn what goes wrong while a file is read into one error."""
    try:
        yield
    except FtforceError:
        raise
    except sqlite3.OperationalError as problem:
        said = str(problem).replace("interrupted", "more work than its size can need")
        raise InputError(f"is damaged or not a bag: {printable(said)}") from None
    except MemoryError:
        raise InputError("is damaged, or needs more memory than there is") from None
    except Exception as problem:  # damaged files and their decompressors can raise anything
        said = printable(str(problem)) or type(problem).__name__
        raise InputError(f"is damaged or not a bag: {said}") from None


def files_of(path: Path) -> list[Path]:
    """Return the files of a bag, after checking what can be told without opening them.

    Parameters
    ----------
    path :
        A file, or a folder with ``metadata.yaml``.

    Raises
    ------
    InputError
        There is no bag, or not all of it, or it names files outside of its folder.
    """
    if not path.exists():
        raise InputError("no such file; expected a bag (.mcap, .db3, .bag, or a folder of ROS 2)")
    files = _listed_files(path) if path.is_dir() else [path]
    for file in files:
        if not file.is_file():
            what = "is missing" if not file.exists() else "is not a regular file; expected a bag"
            raise InputError(what if file == path else f"{printable(file.name)} {what}")
        if file.suffix.lower() == ".zstd":
            raise InputError(
                f"{printable(file.name)} is compressed as a whole; unpack it first: "
                f"zstd -d {printable(file.name)}"
            )
        if file.suffix.lower() not in ENDINGS:
            raise InputError(f"{printable(file.name)} is not a bag; expected {listed(ENDINGS)}")
        journal = Path(f"{file}-wal")
        if journal.is_file() and journal.stat().st_size:
            raise InputError(
                f"its recorder did not finish: {printable(journal.name)} holds messages that would "
                "be missing; open the database once with sqlite3, which takes them in"
            )
    return files


def _listed_files(folder: Path) -> list[Path]:
    """Return the files that the metadata of a folder name.

    Raises
    ------
    InputError
        One is outside of the folder, or the metadata cannot be read.
    """
    from ftforce.io.yaml_text import read_yaml

    try:
        text = read_text(folder / "metadata.yaml", FileError, "a bag", _LARGEST_META)
        data: Any = read_yaml(text)
        about = data["rosbag2_bagfile_information"]
        files = [folder / str(name) for name in about["relative_file_paths"]]
        mode = str(about.get("compression_mode", ""))
        places = [file.resolve() for file in files]
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError("is damaged or not a bag: metadata.yaml does not list its files") from None
    if mode.upper() == "FILE":  # it would be unpacked whole, however large it is
        raise InputError("its files are compressed as a whole; unpack them first: zstd -d FILE")
    if not files:
        raise InputError("holds nothing: metadata.yaml lists no files")
    if len(set(places)) < len(places):
        raise InputError("is refused: metadata.yaml lists a file twice")
    if any(place.parent != folder.resolve() for place in places):
        raise InputError("is refused: metadata.yaml names a file outside of the bag's folder")
    return files


# ---- compression -----------------------------------------------------------------------------


def _too_large(what: str, largest: int) -> str:
    return f"is refused: {what} is larger than {largest / 1e6:,.0f} MB"


def _unbz2(data: Bytes, size: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, size + 1)


def _unlz4(data: Bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

    unpacked: bytes = LZ4FrameDecompressor().decompress(data, size + 1)
    return unpacked


def _unzstd(data: Bytes, size: int) -> bytearray:
    from zstandard import ZstdDecompressor

    reader = ZstdDecompressor().stream_reader(data, read_across_frames=True)
    found = bytearray()  # grows: read(n) would allocate n bytes
    while len(found) <= size and (piece := reader.read(min(size + 1 - len(found), 1 << 20))):
        found += piece
    return found


# Each unpacks at most one byte more than the size.
_UNPACK: dict[str, Callable[[Bytes, int], Bytes]] = {
    "": lambda data, _: data,
    "none": lambda data, _: data,
    "bz2": _unbz2,
    "lz4": _unlz4,
    "zstd": _unzstd,
}


class _Unpacker:
    """Unpacks the chunks of a file, up to a multiple of its size."""

    def __init__(self, size: int) -> None:
        self._left = _UNPACKED + _RATIO * size

    def __call__(self, data: Bytes, compression: str, size: int) -> memoryview:
        """Return a chunk, which has to be as large as it is said to be.

        Raises
        ------
        InputError
            It is not, or too large, or compressed in another way.
        """
        if compression not in _UNPACK:
            raise InputError(
                f"its chunks are compressed by {printable(compression)}; only zstd, lz4 and bz2 "
                "are read"
            )
        if size > _LARGEST_CHUNK:
            raise InputError(_too_large("a chunk", _LARGEST_CHUNK))
        self.spend(size)
        try:
            unpacked = _UNPACK[compression](data, size)
        except ImportError:
            raise FtforceError("bags need rosbags and mcap: pip install 'ftforce[bag]'") from None
        if len(unpacked) != size:
            raise InputError(f"{_CUT}: a chunk is not as large as it is said to be")
        return memoryview(unpacked)

    def spend(self, size: int) -> None:
        """Count what is unpacked.

        Raises
        ------
        InputError
            It is too much for a file of this size.
        """
        self._left -= size
        if self._left < 0:
            raise InputError(f"is refused: it unpacks to more than {_RATIO:,} times its size")


class _File:
    """A file of which no more is read than there is."""

    def __init__(self, stream: BinaryIO, path: Path) -> None:
        self.stream = stream
        self.size = path.stat().st_size

    def read(self, count: int) -> bytes:
        """Return the next bytes.

        Raises
        ------
        InputError
            There are not as many.
        """
        if count > self.size - self.stream.tell():
            raise InputError(_CUT)
        return self.stream.read(count)


@contextmanager
def _opened(path: Path) -> Iterator[_File]:
    with path.open("rb") as stream:
        yield _File(stream, path)


# ---- MCAP ------------------------------------------------------------------------------------


class _Fields:
    """The fields of a record of MCAP, one after the other."""

    def __init__(self, data: Bytes) -> None:
        self.data = data
        self.at = 0

    def numbers(self, form: str) -> tuple[Any, ...]:
        found = struct.unpack_from(form, self.data, self.at)
        self.at += struct.calcsize(form)
        return found

    def text(self) -> str:
        (size,) = self.numbers("<I")
        return self.bytes(size).decode(errors="replace")

    def bytes(self, size: int) -> bytes:
        if size > len(self.data) - self.at:
            raise InputError(_CUT)
        self.at += size
        return bytes(self.data[self.at - size : self.at])


def _records(file: _File, start: int, end: int) -> Iterator[tuple[int, int]]:
    """Yield the kinds and lengths of the records between two offsets; each is to be read next."""
    while start < end:
        file.stream.seek(start)
        kind, size = struct.unpack("<BQ", file.read(9))
        if size > end - start - 9:
            raise InputError(_CUT)
        yield kind, size
        start += 9 + size


def _inner_records(data: memoryview, unpack: _Unpacker) -> Iterator[tuple[int, memoryview]]:
    """Yield the records of a chunk."""
    at = 0
    while at < len(data):
        unpack.spend(_RECORD)
        kind, size = struct.unpack_from("<BQ", data, at)
        at += 9
        if size > len(data) - at:
            raise InputError(_CUT)
        yield kind, data[at : at + size]
        at += size


class _Mcap:
    """MCAP, see https://mcap.dev/spec."""

    @classmethod
    def connections(cls, path: Path) -> list[Connection]:
        """Return the topics, of the summary if there is one, else of all records."""
        with _opened(path) as file:
            start, end = cls._summary(file)
            schemas: dict[int, tuple[str, str, str]] = {0: ("", "", "")}
            channels: dict[int, tuple[int, str, str]] = {}
            for first in dict.fromkeys((start, len(_MAGIC))):
                for kind, data in cls._all(file, first, end, (_SCHEMA, _CHANNEL)):
                    fields = _Fields(data)
                    if kind == _SCHEMA:
                        (number,) = fields.numbers("<H")
                        schemas[number] = (fields.text(), fields.text(), fields.text())
                    else:
                        number, schema = fields.numbers("<HH")
                        channels[number] = (schema, fields.text(), fields.text())
                if channels and all(schema in schemas for schema, *_ in channels.values()):
                    break
        found = []
        for number, (schema, topic, encoding) in channels.items():
            name, form, definition = schemas.get(schema, schemas[0])
            found.append(Connection(number, topic, ros_2_type(name), encoding, form, definition))
        return found

    @classmethod
    def messages(cls, path: Path, known: dict[int, Connection]) -> Iterator[Message]:
        """Yield the messages of some channels."""
        with _opened(path) as file:
            _, end = cls._summary(file)
            for _, data in cls._all(file, len(_MAGIC), end, (_MESSAGE,)):
                channel, _, received, _ = struct.unpack_from("<HIQQ", data)
                if channel in known:
                    yield known[channel], received, data[22:]

    @staticmethod
    def _summary(file: _File) -> tuple[int, int]:
        """Return where the summary begins, that of the data if there is none, and where it ends."""
        begin = file.read(len(_MAGIC)) if file.size >= 16 else b""
        if begin != _MAGIC:
            raise InputError("is damaged or not a bag: it does not begin as MCAP does")
        footer = file.size - 37  # 9 + 20 bytes, and the magic
        file.stream.seek(max(footer, 0))
        last = file.stream.read()
        if footer < 8 or last[-8:] != _MAGIC or last[0] != _FOOTER:
            raise InputError(
                "is cut off: its recorder did not finish, or the copy is not whole; mcap recover "
                "restores what there is"
            )
        (start,) = struct.unpack_from("<Q", last, 9)
        return start if len(_MAGIC) <= start <= footer else len(_MAGIC), footer

    @staticmethod
    def _all(
        file: _File, start: int, end: int, kinds: tuple[int, ...]
    ) -> Iterator[tuple[int, Bytes]]:
        """Yield the records of some kinds, those in chunks included."""
        unpack = _Unpacker(file.size)
        for kind, size in _records(file, start, end):
            if kind in kinds:
                yield kind, memoryview(file.read(size))
            elif kind == _CHUNK:
                fields = _Fields(file.read(min(size, 1000)))
                _, _, unpacked, checksum = fields.numbers("<QQQI")
                compression = fields.text()
                (packed,) = fields.numbers("<Q")
                if packed != size - fields.at:
                    raise InputError(_CUT)
                if packed > _LARGEST_CHUNK:
                    raise InputError(_too_large("a chunk", _LARGEST_CHUNK))
                file.stream.seek(fields.at - min(size, 1000), 1)
                chunk = unpack(file.read(packed), compression, unpacked)
                if checksum and crc32(chunk) != checksum:
                    raise InputError("is damaged: the checksum of a chunk is wrong")
                yield from (one for one in _inner_records(chunk, unpack) if one[0] in kinds)


# ---- ROS 1 -----------------------------------------------------------------------------------


def _header(data: Bytes) -> dict[bytes, bytes]:
    """Return the fields of a header of ROS 1."""
    found, at = {}, 0
    while at < len(data):
        (size,) = struct.unpack_from("<I", data, at)
        at += 4
        if size > len(data) - at:
            raise InputError(_CUT)
        name, _, value = bytes(data[at : at + size]).partition(b"=")
        found[name] = value
        at += size
    return found


def _number(fields: dict[bytes, bytes], name: bytes, form: str = "<I") -> int:
    if name not in fields:
        raise InputError(f"{_CUT}: a record has no {name.decode()}")
    return int(struct.unpack(form, fields[name])[0])


class _Ros1:
    """Bags of ROS 1, see http://wiki.ros.org/Bags/Format/2.0."""

    @classmethod
    def connections(cls, path: Path) -> list[Connection]:
        """Return the topics of the index."""
        with _opened(path) as file:
            index = cls._index(file)
            found = {}
            for fields, size in cls._records(file, index, file.size):
                if _number(fields, b"op", "<B") != _CONNECTION_1:
                    continue
                about = _header(file.read(size))
                number = _number(fields, b"conn")
                texts = (
                    one.decode(errors="replace")
                    for one in (
                        fields.get(b"topic", b""),
                        about.get(b"type", b""),
                        about.get(b"message_definition", b""),
                    )
                )
                topic, kind, definition = texts
                found[number] = Connection(
                    number, topic, ros_2_type(kind), "ros1", "ros1msg", definition
                )
        return list(found.values())

    @classmethod
    def messages(cls, path: Path, known: dict[int, Connection]) -> Iterator[Message]:
        """Yield the messages of some connections."""
        with _opened(path) as file:
            index, unpack = cls._index(file), _Unpacker(file.size)
            for fields, size in cls._records(file, len(_MAGIC_1), index):
                if _number(fields, b"op", "<B") != _CHUNK_1:
                    continue
                if size > _LARGEST_CHUNK:
                    raise InputError(_too_large("a chunk", _LARGEST_CHUNK))
                compression = fields.get(b"compression", b"none").decode(errors="replace")
                chunk = unpack(file.read(size), compression, _number(fields, b"size"))
                for inner, data in cls._inner(chunk, unpack):
                    number = _number(inner, b"conn")
                    if number in known:
                        seconds, rest = struct.unpack("<II", inner[b"time"])
                        yield known[number], seconds * 1_000_000_000 + rest, data

    @classmethod
    def _index(cls, file: _File) -> int:
        """Return where the index begins."""
        if file.stream.read(len(_MAGIC_1)) != _MAGIC_1:
            raise InputError("is damaged or not a bag: it does not begin as a bag of ROS 1 does")
        fields, _ = next(cls._records(file, len(_MAGIC_1), file.size), ({}, 0))
        index = _number(fields, b"index_pos", "<Q")
        if fields.get(b"encryptor"):
            raise InputError("is encrypted, which is not read")
        if not index:
            raise InputError("has no index: its recorder did not finish; run rosbag reindex on it")
        if not len(_MAGIC_1) < index <= file.size:
            raise InputError(_CUT)
        return index

    @staticmethod
    def _records(file: _File, start: int, end: int) -> Iterator[tuple[dict[bytes, bytes], int]]:
        """Yield the headers of records and the sizes of their data, which is to be read next."""
        while start < end:
            file.stream.seek(start)
            (size,) = struct.unpack("<I", file.read(4))
            if size > _LARGEST_HEADER:
                raise InputError(_CUT)
            fields = _header(file.read(size))
            (data,) = struct.unpack("<I", file.read(4))
            yield fields, data
            start += 8 + size + data

    @staticmethod
    def _inner(
        chunk: memoryview, unpack: _Unpacker
    ) -> Iterator[tuple[dict[bytes, bytes], memoryview]]:
        """Yield the messages of a chunk."""
        at = 0
        while at < len(chunk):
            unpack.spend(_RECORD_1)
            (size,) = struct.unpack_from("<I", chunk, at)
            (length,) = struct.unpack_from("<I", chunk, at + 4 + size)
            fields = _header(chunk[at + 4 : at + 4 + size])
            at += 8 + size + length
            if at > len(chunk):
                raise InputError(_CUT)
            if _number(fields, b"op", "<B") == _DATA_1:
                yield fields, chunk[at - length : at]


# ---- databases -------------------------------------------------------------------------------

# Only tables with pages of their own: views and virtual tables compute what is read.
_TABLES = "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
_TOPICS = "SELECT id, name, type, serialization_format FROM topics LIMIT ?"
_DEFINITIONS = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
# The length of a blob is known without reading it.
_MESSAGES = """
SELECT topic_id, timestamp,
CASE WHEN typeof(data) = 'blob' AND length(data) <= {largest} THEN data END
FROM messages WHERE topic_id IN ({numbers})"""


class _Db3:
    """Databases of rosbag2."""

    @classmethod
    def connections(cls, path: Path) -> list[Connection]:
        """Return the topics."""
        with cls._opened(path) as database:
            tables = {name for (name,) in database.execute(_TABLES)}
            if not {"messages", "topics"} <= tables:
                raise InputError("is damaged or not a bag: it has no tables of topics and messages")
            for table in tables & {"messages", "topics", "message_definitions"}:
                columns = database.execute(f"PRAGMA table_xinfo({table})")
                if any(hidden for *_, hidden in columns):
                    raise InputError("is refused: it computes what it holds")
            definitions = {}
            if "message_definitions" in tables:
                found = database.execute(f"{_DEFINITIONS} LIMIT {_MOST_TOPICS}")
                definitions = {str(name): (str(form), str(text)) for name, form, text in found}
            topics = database.execute(_TOPICS, (_MOST_TOPICS + 1,)).fetchall()
        return [
            Connection(
                int(number), str(topic), str(kind), str(encoding),
                *definitions.get(str(kind), ("", "")),
            )
            for number, topic, kind, encoding in topics
        ]  # fmt: skip

    @classmethod
    def messages(cls, path: Path, known: dict[int, Connection]) -> Iterator[Message]:
        """Yield the messages of some topics."""
        numbers = ",".join(str(int(number)) for number in known)
        query = _MESSAGES.format(largest=LARGEST_MESSAGE, numbers=numbers)
        with cls._opened(path) as database:
            for number, received, data in database.execute(query):
                if data is None:
                    raise InputError(
                        f"is refused: a message is larger than {LARGEST_MESSAGE / 1e6:,.0f} MB, or "
                        "is not binary"
                    )
                yield known[number], int(received), data

    @staticmethod
    @contextmanager
    def _opened(path: Path) -> Iterator[sqlite3.Connection]:
        """Open a database, in which no more is done than its size may need."""
        with path.open("rb") as stream:
            head = stream.read(100)
        if len(head) < 100 or not head.startswith(_SQLITE):
            raise InputError("is damaged or not a bag: it is no database of SQLite")
        page, pages = struct.unpack(">H10xI", head[16:32])
        if pages * (65_536 if page == 1 else page) > path.stat().st_size:
            raise InputError("is cut off: the file is shorter than its database")
        place = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(place, uri=True)) as database:
            database.text_factory = lambda text: text.decode(errors="replace")
            left = _STEPS + 2 * path.stat().st_size

            def spend() -> bool:
                nonlocal left
                left -= 100_000
                return left < 0  # which interrupts it

            database.set_progress_handler(spend, 100_000)
            database.execute("PRAGMA trusted_schema = OFF")
            yield database


_FORMATS: dict[str, Any] = {".mcap": _Mcap, ".db3": _Db3, ".bag": _Ros1}


def ros_2_type(name: str) -> str:
    """Return the name of a type of messages as ROS 2 writes it.

    Parameters
    ----------
    name :
        The name, e.g. ``sensor_msgs/JointState``.
    """
    return name if "/msg/" in name else name.replace("/", "/msg/", 1)
