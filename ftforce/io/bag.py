"""Joint motions in bags of ROS 1 and ROS 2, by rosbags and mcap.

A bag is read message by message, and of the messages only those of one topic. Only definitions of
messages are taken from it; nothing in it is executed.
"""

from __future__ import annotations

import io
import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.errors import FileError, FtforceError, InputError, listed, printable
from ftforce.io.text import read_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from os import PathLike

    from numpy.typing import NDArray

ENDINGS = (".mcap", ".db3", ".bag")
"""Extensions of bags: rosbag2's two storages, and ROS 1."""

MAX_MESSAGES = 5_000_000
_LARGEST_META = 10_000_000  # bytes
_PEEKED = 100_000  # messages of a topic in which joints are looked for
_LARGEST = 1e12  # of positions and velocities
_MANY_JOINTS = 10_000  # names in one message
_JOINT_STATE = "sensor_msgs/msg/JointState"
_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
_CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
_KINDS = (_JOINT_STATE, _CONTROLLER, _TRAJECTORY)  # in this order
_CONTROLLER_DEFINITION = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
"""


class JointMotion(NamedTuple):
    """Positions of joints over time.

    Attributes
    ----------
    t :
        Times, s, shape (N,).
    q :
        Positions of the joints asked for, rad or m, shape (N, n).
    v :
        Their velocities, shape (N, n); ``None`` if not all messages have them.
    notes :
        What was decided.
    """

    t: NDArray[np.float64]
    q: NDArray[np.float64]
    v: NDArray[np.float64] | None
    notes: tuple[str, ...]


class _Sample(NamedTuple):
    """One instant of a message: its number, the times at which it was received and made, ns."""

    message: int
    received: int
    stamp: int
    names: Sequence[str]
    q: Any
    v: Any


def is_bag(path: str | PathLike[str]) -> bool:
    """Return whether a path is that of a bag: by its extension, or a folder with ``metadata.yaml``.

    Parameters
    ----------
    path :
        The file or folder.
    """
    found = Path(path)
    # Path.is_file raises an error for a name that is too long.
    return found.suffix.lower() in ENDINGS or os.path.isfile(found / "metadata.yaml")  # noqa: PTH113


def read_motion(
    path: str | PathLike[str], joints: Sequence[str], topic: str | None = None
) -> JointMotion:
    """Read the motion of joints from a bag.

    Messages of the topic that lack one of the joints are left out. Times are the stamps of the
    messages, or if one has none, the times at which they were received.

    Parameters
    ----------
    path :
        A bag: ``.mcap``, ``.db3``, ``.bag``, or the folder of a bag of ROS 2.
    joints :
        Names of the n joints.
    topic :
        The topic; by default the only one with these joints: of joint states, else of controller
        states, else of trajectories.

    Raises
    ------
    FtforceError
        rosbags is not installed.
    InputError
        The bag cannot be read, no topic or several have the joints, or a number is not finite.
    """
    with _opened(Path(path)) as reader:
        found = _topics(reader)
        chosen, notes = _choose(reader, found, joints, topic)
        return _motion(reader, found[chosen], joints, chosen, notes)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag; everything that goes wrong with it within the context becomes one error."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise FtforceError("bags need rosbags and mcap: pip install 'ftforce[bag]'") from None
    _check_path(path)
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_CONTROLLER_DEFINITION, _CONTROLLER))
    try:
        with AnyReader([path], default_typestore=store) as reader:
            yield reader
    except FtforceError:
        raise
    except MemoryError:  # of a length in the file, which may be anything
        raise InputError("is damaged, or needs more memory than there is") from None
    except Exception as problem:  # damaged bags and databases can raise anything
        said = printable(str(problem)) or type(problem).__name__
        raise InputError(f"is damaged or not a bag: {said}") from None


def _check_path(path: Path) -> None:
    """Check what can be told of a bag without opening it.

    Raises
    ------
    InputError
        There is no bag, or not all of it.
    """
    if not path.exists():
        raise InputError("no such file; expected a bag (.mcap, .db3, .bag, or a folder of ROS 2)")
    if path.is_dir():
        _check_folder(path)
    elif not path.is_file():
        raise InputError("is not a regular file; expected a bag")
    elif path.suffix not in ENDINGS:
        raise InputError(f"its extension must be in lower case: {path.suffix.lower()}")
    for journal in (Path(f"{path}-wal"), *(path.glob("*-wal") if path.is_dir() else ())):
        if journal.is_file() and journal.stat().st_size:
            raise InputError(
                f"its recorder did not finish: {printable(journal.name)} holds messages that would "
                "be missing; open the database once with sqlite3, which takes them in"
            )


def _check_folder(path: Path) -> None:
    """Check that the metadata of a bag name files of its own folder only.

    Raises
    ------
    InputError
        They do not, or cannot be read.
    """
    from ftforce.io.yaml_text import read_yaml

    try:
        data: Any = read_yaml(read_text(path / "metadata.yaml", FileError, "a bag", _LARGEST_META))
        about = data["rosbag2_bagfile_information"]
        files, mode = about["relative_file_paths"], str(about.get("compression_mode", ""))
        inside = [(path / str(name)).resolve().parent == path.resolve() for name in files]
    except (KeyError, TypeError, ValueError):
        raise InputError("is damaged or not a bag: metadata.yaml does not list its files") from None
    if not all(inside):
        raise InputError("is refused: metadata.yaml names a file outside of the bag's folder")
    if mode.upper() == "FILE":  # it would be unpacked whole, however large it is
        raise InputError("its files are compressed as a whole; unpack them first")


def _topics(reader: Any) -> dict[str, list[Any]]:
    """Return the connections of each topic that can hold a joint motion."""
    found: dict[str, list[Any]] = {}
    for one in reader.connections:
        if _kind(one) in _KINDS:
            found.setdefault(one.topic, []).append(one)
    return found


def _kind(connection: Any) -> str:
    """Return the type of a connection's messages, as ROS 2 writes it."""
    name = str(connection.msgtype)
    return name if "/msg/" in name else name.replace("/", "/msg/", 1)


def _choose(
    reader: Any, found: dict[str, list[Any]], joints: Sequence[str], topic: str | None
) -> tuple[str, list[str]]:
    """Return the topic to read, and what was decided."""
    everything = sorted({f"{one.topic} ({_kind(one)})" for one in reader.connections})
    if topic is not None:
        if topic not in found:
            raise InputError(
                f"has no topic {printable(topic)!r} of joint states or trajectories; its topics "
                f"are: {listed(map(printable, everything))}"
            )
        return topic, []
    seen: dict[str, tuple[str, ...]] = {}
    for kind in _KINDS:
        among = [name for name, connections in found.items() if _kind(connections[0]) == kind]
        for name in among:
            seen[name] = _names_in(reader, found[name], joints)
        fitting = [name for name in among if set(joints) <= set(seen[name])]
        if len(fitting) > 1:
            raise InputError(
                f"several topics have the joints: {listed(map(printable, fitting))}; choose one "
                "(--topic, topic=)"
            )
        if fitting:
            others = [name for name in found if name != fitting[0]]
            rest = f"; others: {listed(map(printable, others))}" if others else ""
            return fitting[0], [f"the motion is that of topic {printable(fitting[0])}{rest}"]
    if not seen:
        raise InputError(
            f"holds no joint states or trajectories; its topics are: "
            f"{listed(map(printable, everything)) or 'none'}"
        )
    said = (f"{printable(name)} ({listed(map(printable, names))})" for name, names in seen.items())
    raise InputError(
        f"none of the first {_PEEKED:,} messages has all joints of the chain, {listed(joints)}; "
        f"the topics are: {listed(said)}"
    )


def _names_in(reader: Any, connections: list[Any], joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names in the first message that has all joints, else all names that were seen."""
    names: dict[str, None] = {}
    for count, sample in enumerate(_samples(reader, connections)):
        if set(joints) <= set(sample.names):
            return tuple(sample.names)
        names |= dict.fromkeys(sample.names)
        if count >= _PEEKED or len(names) > _MANY_JOINTS:
            break
    return tuple(name for name in names if name not in joints) or tuple(names)


def _samples(reader: Any, connections: list[Any]) -> Iterator[_Sample]:
    """Yield the instants in the messages of a topic; of a trajectory its points."""
    messages = enumerate(reader.messages(connections=connections))
    for number, (connection, received, raw) in messages:
        message = reader.deserialize(raw, connection.msgtype)
        kind = _kind(connection)
        stamp = _nanoseconds(message.header.stamp)
        if kind == _JOINT_STATE:
            names = _checked(message.name, received)
            yield _Sample(number, received, stamp, names, message.position, message.velocity)
        elif kind == _CONTROLLER:  # named otherwise since 2023
            point = getattr(message, "feedback", None) or message.actual
            names = _checked(message.joint_names, received)
            yield _Sample(number, received, stamp, names, point.positions, point.velocities)
        else:
            names = _checked(message.joint_names, received)
            for point in message.points:
                since = _nanoseconds(point.time_from_start)
                yield _Sample(number, received, since, names, point.positions, point.velocities)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def _checked(names: Sequence[str], received: int) -> Sequence[str]:
    if len(names) > _MANY_JOINTS:
        raise InputError(f"the message at {received} ns names {len(names):,} joints")
    if len(set(names)) < len(names):
        twice = next(name for name in names if list(names).count(name) > 1)
        raise InputError(f"the message at {received} ns names {printable(twice)!r} twice")
    return names


def _motion(
    reader: Any, connections: list[Any], joints: Sequence[str], topic: str, notes: list[str]
) -> JointMotion:
    samples: list[_Sample] = []
    trajectories = 0
    left_out: set[int] = set()
    is_trajectory = _kind(connections[0]) == _TRAJECTORY
    wanted = set(joints)
    for sample in _samples(reader, connections):
        if not wanted <= set(sample.names):
            left_out.add(sample.message)
        elif is_trajectory and samples and sample.message != samples[-1].message:
            trajectories += 1
            samples = [_picked(sample, joints)]
        else:
            samples.append(_picked(sample, joints))
        if len(samples) > MAX_MESSAGES:
            raise InputError(f"{printable(topic)} has more than {MAX_MESSAGES:,} messages")
    if not samples:
        raise InputError(
            f"no message of {printable(topic)} has all joints of the chain, {listed(joints)}"
        )
    if left_out:
        notes.append(f"{len(left_out):,} messages without all joints of the chain are left out")
    if trajectories:
        notes.append(f"{trajectories + 1} trajectories; the last one is taken")
    t, words = _times(samples, is_trajectory=is_trajectory)
    q = np.array([sample.q for sample in samples])
    has_v = all(sample.v is not None for sample in samples)
    v = np.array([sample.v for sample in samples]) if has_v else None
    return JointMotion(t, q, v, (*notes, *words))


def _picked(sample: _Sample, joints: Sequence[str]) -> _Sample:
    """Return a sample with positions and velocities of the joints only, in their order."""
    where = f"the message at {sample.received} ns"
    if len(sample.q) != len(sample.names):
        raise InputError(
            f"{where} names {len(sample.names)} joints and has {len(sample.q)} positions"
        )
    places = [list(sample.names).index(name) for name in joints]
    q = [float(sample.q[i]) for i in places]
    for name, x in zip(joints, q, strict=True):
        if not abs(x) <= _LARGEST:
            raise InputError(f"{where}: the position of {name} is {x:g}")
    v = None
    if len(sample.v) == len(sample.names):
        v = [float(sample.v[i]) for i in places]
        if not all(abs(x) <= _LARGEST for x in v):  # nor NaN
            v = None
    return sample._replace(q=q, v=v, names=())


def _times(
    samples: Sequence[_Sample], *, is_trajectory: bool
) -> tuple[NDArray[np.float64], list[str]]:
    """Return the times, s from the first, and which they are."""
    if is_trajectory:
        return 1e-9 * np.array([float(one.stamp) for one in samples]), []
    if all(one.stamp for one in samples[1:]):  # simulated time begins with 0
        stamps, words = [one.stamp for one in samples], "the times are the stamps of the messages"
    else:
        stamps = [one.received for one in samples]
        words = "the times are those at which the messages were received; they have no stamps"
    return 1e-9 * np.array([float(one - stamps[0]) for one in stamps]), [words]


def trajectory_bag(
    joints: Sequence[str],
    t: NDArray[np.float64],
    points: dict[str, NDArray[np.float64]],
    topic: str = "/joint_trajectory",
) -> bytes:
    """Return an MCAP file with one ``trajectory_msgs/msg/JointTrajectory``.

    Equal motions give equal bytes.

    Parameters
    ----------
    joints :
        Names of the n joints.
    t :
        Times from the start, s, shape (N,).
    points :
        Some of ``positions``, ``velocities``, ``accelerations`` and ``effort``, shape (N, n).
    topic :
        The topic.

    Raises
    ------
    FtforceError
        rosbags or mcap are not installed.
    """
    try:
        from mcap.writer import CompressionType, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise FtforceError("bags need rosbags and mcap: pip install 'ftforce[bag]'") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    fields = ("positions", "velocities", "accelerations", "effort")
    time = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"](time, "")
    none = np.empty(0)
    instants = []
    for i, seconds in enumerate(t.tolist()):
        nanoseconds = round(seconds * 1e9)
        since = types["builtin_interfaces/msg/Duration"](*divmod(nanoseconds, 1_000_000_000))
        values = (
            np.ascontiguousarray(points[name][i]) if name in points else none for name in fields
        )
        instants.append(types["trajectory_msgs/msg/JointTrajectoryPoint"](*values, since))
    message = types[_TRAJECTORY](header, list(joints), instants)
    stream = io.BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE)
    writer.start(profile="ros2", library="ftforce")
    definition = store.generate_msgdef(_TRAJECTORY, ros_version=2)[0]
    schema = writer.register_schema(_TRAJECTORY, "ros2msg", definition.encode())
    channel = writer.register_channel(topic, "cdr", schema)
    data = bytes(store.serialize_cdr(message, _TRAJECTORY))
    writer.add_message(channel, log_time=0, data=data, publish_time=0)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()
