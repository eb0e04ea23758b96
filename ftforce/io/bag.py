"""Joint motions in bags of ROS 1 and ROS 2, decoded by rosbags.

A bag is read message by message, and of the messages only those of one topic. Only definitions of
messages are taken from it, and only those of joint motions; nothing in it is executed.
"""

from __future__ import annotations

import io
import os
from array import array
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ftforce.errors import FtforceError, InputError, listed, printable
from ftforce.io.bag_files import ENDINGS, BagFile, Connection, files_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from os import PathLike

    from numpy.typing import NDArray

    from ftforce.io.bag_files import Bytes

__all__ = ["ENDINGS", "JointMotion", "is_bag", "read_motion", "trajectory_bag"]

MAX_MESSAGES = 5_000_000
_PEEKED = 100_000  # messages of a topic in which joints are looked for
_LARGEST = 1e12  # of positions and velocities
_MANY_JOINTS = 10_000  # names in one message
_LARGEST_DEFINITION = 50_000  # characters; that of a controller's state has 5,000
_MANY_DEFINITIONS = 10  # different ones of joint motions in a bag
_GAP = 10.0  # times the median step; over longer gaps no joint is interpolated
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
_NEEDED = "bags need rosbags and mcap: pip install 'ftforce[bag]'"


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
    """One instant of a message: the times at which it was received and made, ns."""

    received: int
    stamp: int
    names: list[str]
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
    ending = Path(found.stem if found.suffix.lower() == ".zstd" else found.name).suffix
    # Path.is_file raises an error for a name that is too long.
    return ending.lower() in ENDINGS or os.path.isfile(found / "metadata.yaml")  # noqa: PTH113


def read_motion(
    path: str | PathLike[str], joints: Sequence[str], topic: str | None = None
) -> JointMotion:
    """Read the motion of joints from a bag.

    Messages of the topic that lack one of the joints are left out, unless all do: then the
    positions of joints in different messages are interpolated at the times of those that come most
    often. Times are the stamps of the messages, or if one has none, the times at which they were
    received.

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
    try:
        import rosbags.typesys  # noqa: F401
    except ImportError:
        raise FtforceError(_NEEDED) from None
    bag = _Bag([BagFile(file) for file in files_of(Path(path))])
    chosen, notes = _choose(bag, joints, topic)
    return _motion(bag, chosen, joints, notes)


# ---- messages --------------------------------------------------------------------------------


class _Bag:
    """The files of a bag, and decoders of their messages."""

    def __init__(self, files: list[BagFile]) -> None:
        self.files = files
        self.decoders: dict[tuple[str, ...], Callable[[Bytes], Any]] = {}
        everything = [one for file in files for one in file.connections]
        self.topics = sorted({f"{one.topic} ({one.type or 'no type'})" for one in everything})
        self.kinds: dict[str, str] = {}
        for one in everything:
            if one.type in _KINDS:
                self.kinds.setdefault(one.topic, one.type)

    def raw(self, topics: Iterable[str]) -> Iterator[tuple[Connection, int, Bytes]]:
        """Yield the messages of some topics, in the order of the files."""
        chosen = {topic: self.kinds[topic] for topic in topics}
        for file in self.files:
            wanted = {one.id for one in file.connections if chosen.get(one.topic) == one.type}
            if wanted:
                yield from file.messages(wanted)

    def samples(self, one: Connection, received: int, raw: Bytes) -> list[_Sample]:
        """Return the instants in a message; of a trajectory its points."""
        key = one[2:]
        if key not in self.decoders:
            if len(self.decoders) >= _MANY_DEFINITIONS:
                raise InputError(f"has more than {_MANY_DEFINITIONS} definitions of its messages")
            self.decoders[key] = _decoder(one)
        try:
            message = self.decoders[key](raw)
            return list(_instants(one.type, received, message))
        except FtforceError:
            raise
        except MemoryError:
            problem = "a length in it is too large"
        except KeyError as error:
            problem = f"its definition does not say what {printable(error)} is"
        except Exception as error:  # of rosbags, and of a message that its definition does not fit
            problem = printable(str(error)) or type(error).__name__
        raise InputError(f"is damaged: the message at {received} ns: {problem}")


def _decoder(one: Connection) -> Callable[[Bytes], Any]:
    """Return the function that decodes the messages of a connection.

    Raises
    ------
    InputError
        They are encoded in a way that is not read, or defined in a way that no recorder writes.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if one.encoding not in {"cdr", "ros1"}:
        encoding = printable(one.encoding) or "nothing that is known"
        raise InputError(
            f"the messages of {printable(one.topic)} are encoded as {encoding}; only cdr and ros1 "
            "are read"
        )
    if one.definition:
        store: Any = get_typestore(Stores.EMPTY)
        store.register(_definitions(one))
    else:
        is_1 = one.encoding == "ros1"
        store = get_typestore(Stores.ROS1_NOETIC if is_1 else Stores.ROS2_HUMBLE)
        store.register(get_types_from_msg(_CONTROLLER_DEFINITION, _CONTROLLER))
    decode = store.deserialize_ros1 if one.encoding == "ros1" else store.deserialize_cdr
    return lambda raw: decode(raw, one.type)


def _definitions(one: Connection) -> dict[str, Any]:
    """Return the types that a connection defines.

    Raises
    ------
    InputError
        They are too long, cannot be understood, or have a list of elements without a size, of
        which a short message can have any number.
    """
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    where = f"the definition of {printable(one.type)}"
    if len(one.definition) > _LARGEST_DEFINITION:
        raise InputError(f"is refused: {where} has more than {_LARGEST_DEFINITION:,} characters")
    found: dict[str, Any] = {}
    try:
        if one.form == "ros2idl":
            mark = f"{'=' * 80}\n"
            for part in filter(None, one.definition.split(mark)):
                is_named = part.startswith("IDL: ")
                found |= get_types_from_idl(part.partition("\n")[2] if is_named else part)
        else:
            found |= get_types_from_msg(one.definition, one.type)
        empty = _without_size(found)
    except RecursionError:
        raise InputError(f"is damaged: {where} is nested too deeply") from None
    except Exception as problem:  # whatever the parser of rosbags stumbles on
        said = printable(str(problem)) or type(problem).__name__
        raise InputError(f"is damaged: {where}: {said}") from None
    if empty:
        raise InputError(f"is refused: {where} has a list of {printable(empty)}, which is empty")
    return found


def _without_size(types: dict[str, Any]) -> str:
    """Return the first type that is the element of a list and takes no bytes; empty if none is."""

    @cache
    def is_empty(name: str) -> bool:
        return name in types and all(takes_none(field) for _, field in types[name][1])

    def takes_none(field: Any) -> bool:
        node, inside = field
        if isinstance(inside, str):  # a message
            return is_empty(inside)
        if isinstance(inside[0], str):  # a number or text
            return False
        element, count = inside
        return node.name == "ARRAY" and (count == 0 or takes_none(element))

    lists = (
        inside[0]
        for _, fields in types.values()
        for _, (_, inside) in fields
        if not isinstance(inside, str) and not isinstance(inside[0], str)
    )
    return next((str(element[1]) for element in lists if takes_none(element)), "")


def _instants(kind: str, received: int, message: Any) -> Iterator[_Sample]:
    """Yield the instants in a message; of a trajectory its points."""
    names = message.name if kind == _JOINT_STATE else message.joint_names
    _check_names(names, received)
    if kind == _TRAJECTORY:
        for point in message.points:
            since = _nanoseconds(point.time_from_start)
            yield _Sample(received, since, names, point.positions, point.velocities)
        return
    stamp = _nanoseconds(message.header.stamp)
    if kind == _JOINT_STATE:
        yield _Sample(received, stamp, names, message.position, message.velocity)
    else:  # named otherwise since 2023
        point = getattr(message, "feedback", None) or message.actual
        yield _Sample(received, stamp, names, point.positions, point.velocities)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def _check_names(names: list[str], received: int) -> None:
    if len(names) > _MANY_JOINTS:
        raise InputError(f"the message at {received} ns names {len(names):,} joints")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"the message at {received} ns names {printable(twice)!r} twice")


# ---- the topic -------------------------------------------------------------------------------


class _Seen:
    """What the messages of a topic have of the joints."""

    def __init__(self) -> None:
        self.messages = 0
        self.names: dict[str, None] = {}
        self.whole = False

    def add(self, samples: list[_Sample], wanted: set[str]) -> bool:
        """Count a message, and return whether no more are needed."""
        self.messages += 1
        for names in {id(one.names): one.names for one in samples}.values():
            self.whole = self.whole or wanted <= set(names)
            if len(self.names) <= _MANY_JOINTS:
                self.names |= dict.fromkeys(names)
        return self.whole or self.messages >= _PEEKED


def _choose(bag: _Bag, joints: Sequence[str], topic: str | None) -> tuple[str, list[str]]:
    """Return the topic to read, and what was decided."""
    if topic is not None:
        if topic not in bag.kinds:
            raise InputError(
                f"has no topic {printable(topic)!r} of joint states or trajectories; its topics "
                f"are: {listed(map(printable, bag.topics))}"
            )
        return topic, []
    if not bag.kinds:
        raise InputError(
            f"holds no joint states or trajectories; its topics are: "
            f"{listed(map(printable, bag.topics)) or 'none'}"
        )
    seen: dict[str, _Seen] = {}
    for kind in _KINDS:
        among = _seen(bag, [name for name, one in bag.kinds.items() if one == kind], joints)
        seen |= among
        whole = [name for name, one in among.items() if one.whole]
        fitting = whole or [name for name, one in among.items() if set(joints) <= one.names.keys()]
        if len(fitting) > 1:
            raise InputError(
                f"several topics have the joints: {listed(map(printable, fitting))}; choose one "
                "(--topic, topic=)"
            )
        if fitting:
            others = [name for name in bag.kinds if name != fitting[0]]
            rest = f"; others: {listed(map(printable, others))}" if others else ""
            return fitting[0], [f"the motion is that of topic {printable(fitting[0])}{rest}"]
    said = []
    for name, one in seen.items():
        names = [joint for joint in one.names if joint not in joints] or list(one.names)
        said.append(f"{printable(name)} ({listed(map(printable, names)) or 'no names'})")
    most = max(one.messages for one in seen.values())
    which = f"none of the first {_PEEKED:,} messages" if most >= _PEEKED else "no message"
    raise InputError(
        f"{which} has all joints of the chain, {listed(joints)}; the topics are: {listed(said)}"
    )


def _seen(bag: _Bag, topics: list[str], joints: Sequence[str]) -> dict[str, _Seen]:
    """Return what topics have of the joints, in one pass through the bag."""
    seen = {topic: _Seen() for topic in topics}
    wanted, open_ = set(joints), set(topics)
    for one, received, raw in bag.raw(topics):
        if one.topic not in open_:
            continue
        if seen[one.topic].add(bag.samples(one, received, raw), wanted):
            open_.discard(one.topic)
            if not open_:
                break
    return seen


# ---- the motion ------------------------------------------------------------------------------


class _Track:
    """The positions of some joints over time, in arrays that grow."""

    def __init__(self, places: tuple[int, ...]) -> None:
        self.places = places
        self.received, self.stamps = array("q"), array("q")
        self.q, self.v = array("d"), array("d")

    def __len__(self) -> int:
        return len(self.received)

    def add(self, sample: _Sample, joints: Sequence[str]) -> None:
        """Append a sample; its velocities are NaN if it has none.

        Raises
        ------
        InputError
            A position is missing, or is no number of a position.
        """
        where = f"the message at {sample.received} ns"
        if len(sample.q) != len(sample.names):
            raise InputError(
                f"{where} names {len(sample.names)} joints and has {len(sample.q)} positions"
            )
        at = [sample.names.index(joints[i]) for i in self.places]
        q = [float(sample.q[i]) for i in at]
        for i, x in zip(self.places, q, strict=True):
            if not abs(x) <= _LARGEST:
                raise InputError(f"{where}: the position of {joints[i]} is {x:g}")
        has_v = len(sample.v) == len(sample.names)
        v = [float(sample.v[i]) if has_v else np.nan for i in at]
        try:
            self.stamps.append(sample.stamp)
            self.received.append(sample.received)
        except OverflowError:
            raise InputError(f"{where} is at a time that is none") from None
        self.q.extend(q)
        self.v.extend(v)

    def sorted(self, *, by_stamps: bool) -> _Sorted:
        """Return the times, those of messages in the order in which they were received."""
        received = np.frombuffer(self.received, np.int64)
        times = np.frombuffer(self.stamps if by_stamps else self.received, np.int64)
        q, v = (np.frombuffer(x).reshape(-1, len(self.places)) for x in (self.q, self.v))
        if (np.diff(received) < 0).any():
            order = np.argsort(received, kind="stable")
            times, q, v = times[order], q[order], v[order]
        has_v = bool(-_LARGEST <= v.min() <= v.max() <= _LARGEST)  # and no NaN
        return _Sorted(self.places, times, q, v if has_v else None)


class _Sorted(NamedTuple):
    """Positions and velocities of some joints, and their times, ns."""

    places: tuple[int, ...]
    times: NDArray[np.int64]
    q: NDArray[np.float64]
    v: NDArray[np.float64] | None


def _motion(bag: _Bag, topic: str, joints: Sequence[str], notes: list[str]) -> JointMotion:
    """Return the motion of a topic."""
    is_trajectory = bag.kinds[topic] == _TRAJECTORY
    collect = _last_trajectory if is_trajectory else _collected
    tracks, words = collect(bag, topic, joints)
    notes += words
    if not any(len(places) == len(joints) for places in tracks):
        _check_parts(tracks, topic, joints)
    by_stamps = is_trajectory or all(all(track.stamps[1:]) for track in tracks.values())
    parts = [track.sorted(by_stamps=by_stamps) for track in tracks.values()]
    if not is_trajectory:
        notes.append(
            "the times are the stamps of the messages"
            if by_stamps  # simulated time begins with 0
            else "the times are those at which the messages were received; they have no stamps"
        )
    whole, words = (parts[0], []) if len(parts) == 1 else _merged(parts, joints)
    start = 0 if is_trajectory else int(whole.times[0])
    t = 1e-9 * (whole.times - start).astype(np.float64)
    return JointMotion(t, whole.q, whole.v, (*notes, *words))


_Tracks: TypeAlias = "dict[tuple[int, ...], _Track]"


def _collected(bag: _Bag, topic: str, joints: Sequence[str]) -> tuple[_Tracks, list[str]]:
    """Return the samples of messages with all joints, else of those with some, and notes."""
    everything = tuple(range(len(joints)))
    tracks: _Tracks = {}
    left_out = kept = 0
    for one, received, raw in bag.raw([topic]):
        (sample,) = bag.samples(one, received, raw)
        places = _places(sample, joints)
        if places == everything and everything not in tracks:
            left_out, tracks, kept = left_out + kept, {}, 0  # those with some joints only
        if not places or (places != everything and everything in tracks):
            left_out += 1
            continue
        tracks.setdefault(places, _Track(places)).add(sample, joints)
        kept += 1
        _check_count(kept, topic)
        if len(tracks) > len(joints):  # so some of them have a joint in common
            break
    return tracks, _left_out(left_out)


def _last_trajectory(bag: _Bag, topic: str, joints: Sequence[str]) -> tuple[_Tracks, list[str]]:
    """Return the trajectory that was received last, and notes."""
    everything = tuple(range(len(joints)))
    tracks: _Tracks = {}
    count, left_out, last = 0, 0, 0
    for one, received, raw in bag.raw([topic]):
        samples = bag.samples(one, received, raw)
        if samples and _places(samples[0], joints) != everything:
            left_out += 1
        elif samples:
            count += 1
            if not tracks or received >= last:
                last, track = received, _Track(everything)
                _check_count(len(samples), topic)
                for sample in samples:
                    track.add(sample, joints)
                tracks = {everything: track}
    notes = [f"{count} trajectories; the last one is taken"] * (count > 1)
    return tracks, [*_left_out(left_out), *notes]


def _left_out(count: int) -> list[str]:
    what = f"{count:,} messages" if count > 1 else "one message"
    verb = "are" if count > 1 else "is"
    return [f"{what} without all joints of the chain {verb} left out"] * bool(count)


def _places(sample: _Sample, joints: Sequence[str]) -> tuple[int, ...]:
    known = set(sample.names)
    return tuple(i for i, name in enumerate(joints) if name in known)


def _check_count(count: int, topic: str) -> None:
    if count > MAX_MESSAGES:
        raise InputError(f"{printable(topic)} has more than {MAX_MESSAGES:,} messages")


def _check_parts(tracks: dict[tuple[int, ...], _Track], topic: str, joints: Sequence[str]) -> None:
    """Check that the joints are in different messages, each in those of one kind.

    Raises
    ------
    InputError
        A joint is missing, or in messages of several kinds.
    """
    found = sorted(i for places in tracks for i in places)
    if len(set(found)) < len(joints):
        missing = [name for i, name in enumerate(joints) if i not in found]
        but = f"; none has {listed(missing)}" if found else ""
        raise InputError(
            f"no message of {printable(topic)} has all joints of the chain, {listed(joints)}{but}"
        )
    if len(found) > len(joints):
        twice = [joints[i] for i in sorted(set(found)) if found.count(i) > 1]
        raise InputError(
            f"no message of {printable(topic)} has all joints of the chain, and {listed(twice)} "
            "are in messages with different other joints, which cannot be put together"
        )


def _merged(parts: list[_Sorted], joints: Sequence[str]) -> tuple[_Sorted, list[str]]:
    """Return the motion at the times of the part that has most, and a note.

    Joints of other messages are interpolated linearly between two of them; where they jump by more
    than half a turn, as wrapped angles do, the nearer one is taken.
    """
    base = max(parts, key=lambda part: len(part.times))
    others = [part for part in parts if part is not base]
    for part in parts:
        if (np.diff(part.times) < 0).any():
            some = listed(joints[i] for i in part.places)
            raise InputError(f"the times of the messages with {some} do not increase")
    times = base.times
    for part in others:
        times = times[(times >= part.times[0]) & (times <= part.times[-1])]
        steps = np.diff(part.times)
        if len(steps) and len(times):
            after = np.clip(np.searchsorted(part.times, times), 1, len(steps))
            is_near = steps[after - 1] <= _GAP * np.median(steps)
            times = times[is_near | (part.times[after] == times)]
    if not len(times):
        raise InputError("the joints are in different messages, which do not overlap in time")
    q = np.empty((len(times), len(joints)))
    v = np.empty_like(q)
    for part in parts:
        q[:, part.places] = _at(times, part, part.q)
        if part.v is not None:
            v[:, part.places] = _at(times, part, part.v, np.inf)
    has_v = all(part.v is not None for part in parts)
    some = "; ".join(listed(joints[i] for i in part.places) for part in others)
    left = len(base.times) - len(times)
    but = f", {left:,} of which are left out, as the others are missing there" if left else ""
    note = (
        f"the joints are in different messages: {some} are interpolated linearly at the times of "
        f"those with {listed(joints[i] for i in base.places)}{but}"
    )
    places = tuple(range(len(joints)))
    return _Sorted(places, times, q, v if has_v else None), [note]


def _at(
    times: NDArray[np.int64], part: _Sorted, x: NDArray[np.float64], jump: float = np.pi
) -> NDArray[np.float64]:
    """Return values of a part at other times within its own, shape (N, k)."""
    since = part.times - part.times[0]
    asked = times - part.times[0]
    after = np.clip(np.searchsorted(since, asked), 1, max(1, len(since) - 1))
    after = np.minimum(after, len(since) - 1)
    before = np.maximum(after - 1, 0)
    step = np.maximum(since[after] - since[before], 1)
    share = np.clip((asked - since[before]) / step, 0.0, 1.0)[:, None]
    share = np.where(np.abs(x[after] - x[before]) > jump, np.round(share), share)
    result: NDArray[np.float64] = (1.0 - share) * x[before] + share * x[after]
    return result


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
        raise FtforceError(_NEEDED) from None
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
