"""Bags of ROS: motions read from them, trajectories written to them; CSV of plotting tools."""

import os
import sqlite3
import sys
from contextlib import suppress

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import ftforce
from ftforce.batch.postures.files import postures_from_file
from ftforce.errors import FtforceError, InputError, TrajectoryError
from ftforce.io import bag
from ftforce.io.bag import read_motion, trajectory_bag
from ftforce.trajectory import Recording

JOINTS = tuple(f"joint{i}" for i in range(1, 6))
NAMES = ("finger", *reversed(JOINTS))
COUNT = 12
T = 0.05 * np.arange(COUNT)
Q = np.random.default_rng(3).uniform(-0.3, 0.3, (COUNT, 5)).cumsum(axis=0) * 0.2
STORE = get_typestore(Stores.ROS2_HUMBLE)
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
STORE.register(get_types_from_msg(bag._CONTROLLER_DEFINITION, CONTROLLER))


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


def state_of(store, i, *, names=NAMES, q=None, stamped=True, v=True):
    """Return the message of one instant; its names are those of NAMES in their order."""
    types = store.types
    second, rest = divmod(round(T[i] * 1e9), 1_000_000_000)
    time = types["builtin_interfaces/msg/Time"](
        *((1_700_000_000 + second, rest) if stamped else (0, 0))
    )
    fields = (i, time, "") if store is not STORE else (time, "")
    q = np.array([0.02, *reversed(Q[i])]) if q is None else np.array(q, float)
    header = types["std_msgs/msg/Header"](*fields)
    velocity = np.full(len(q), 0.5) if v else np.empty(0)
    return types["sensor_msgs/msg/JointState"](header, list(names), q, velocity, np.empty(0))


def write(path, topics, plugin=StoragePlugin.MCAP):
    """Write a bag of ROS 2 from messages by topic and type; return its folder."""
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        for (topic, kind), messages in topics.items():
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for i, message in enumerate(messages):
                writer.write(connection, 10**9 + i * 50_000_000, STORE.serialize_cdr(message, kind))
    return path


STATE = ("/joint_states", "sensor_msgs/msg/JointState")
STATES = [state_of(STORE, i) for i in range(COUNT)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write(tmp_path_factory.mktemp("bags") / "run", {STATE: STATES})


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_joint_states_of_both_storages(tmp_path, dh5, plugin):
    """Columns are matched by the names in each message; a folder and its file are one bag."""
    bagged = write(tmp_path / "run", {STATE: STATES}, plugin)
    for path in (bagged, *bagged.glob("run.*")):
        found = Recording.read(dh5, path)
        np.testing.assert_allclose(found.t, T, atol=1e-9)
        np.testing.assert_array_equal(found.q, Q)
        assert (found.v == 0.5).all()
        assert found.notes[:2] == (
            "the motion is that of topic /joint_states", "the times are the stamps of the messages"
        )  # fmt: skip


def test_a_bag_of_ros_1(tmp_path, dh5):
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(tmp_path / "run.bag") as writer:
        connection = writer.add_connection(*STATE, typestore=store)
        for i in range(COUNT):
            message = state_of(store, i, stamped=False, v=False)
            raw = store.serialize_ros1(message, STATE[1])
            writer.write(connection, 5 + i * 50_000_000, raw)
    found = Recording.read(dh5, tmp_path / "run.bag")
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_allclose(found.t, T, atol=1e-9)
    assert found.v is None
    assert "received; they have no stamps" in found.notes[1]


def point(i, *fields):
    duration = STORE.types["builtin_interfaces/msg/Duration"]
    since = duration(*divmod(round(T[i] * 1e9), 1_000_000_000))
    values = [Q[i] if name in fields else np.empty(0) for name in "qvae"]
    return STORE.types["trajectory_msgs/msg/JointTrajectoryPoint"](*values, since)


def test_the_measured_motion_of_a_controller(tmp_path, dh5):
    kind = STORE.types[CONTROLLER]
    messages = [
        kind(state_of(STORE, i).header, list(JOINTS), point(0, "q"), point(i, "q"), point(0, "q"))
        for i in range(COUNT)
    ]
    path = write(tmp_path / "run", {("/arm/state", CONTROLLER): messages})
    np.testing.assert_array_equal(Recording.read(dh5, path).q, Q)


def test_of_several_trajectories_the_last_is_taken(tmp_path):
    kind = "trajectory_msgs/msg/JointTrajectory"
    header = state_of(STORE, 0).header
    first, last = (
        STORE.types[kind](header, list(JOINTS), [point(i, "q") for i in range(*part)])
        for part in ((4, 9), (0, 6))
    )
    path = write(tmp_path / "run", {("/plan", kind): [first, last]})
    found = read_motion(path, JOINTS)
    np.testing.assert_array_equal(found.q, Q[:6])
    assert found.notes == (
        "the motion is that of topic /plan",
        "2 trajectories; the last one is taken",
    )


def test_a_trajectory_that_stands_still_is_no_second_one(tmp_path, dh5):
    kind = "trajectory_msgs/msg/JointTrajectory"
    points = [point(i, "q") for i in (0, 1, 1, 2, 3)]
    message = STORE.types[kind](state_of(STORE, 0).header, list(JOINTS), points)
    path = write(tmp_path / "run", {("/plan", kind): [message]})
    found = Recording.read(dh5, path)
    np.testing.assert_array_equal(found.q, Q[:4])
    assert found.notes[1] == (
        "one sample that repeats time and positions of the one before (first at sample 3) left out"
    )


def test_messages_of_other_drivers_in_the_topic_are_left_out(tmp_path):
    fingers = [state_of(STORE, i, names=("finger",), q=[0.1]) for i in range(3)]
    mixed = [message for pair in zip(STATES, fingers, strict=False) for message in pair]
    path = write(tmp_path / "run", {STATE: [*mixed, *STATES[3:]]})
    found = read_motion(path, JOINTS)
    np.testing.assert_array_equal(found.q, Q)
    assert "3 messages without all joints of the chain are left out" in found.notes


# Two drivers, of joints 1 to 3 and of 4 and 5, that move evenly: what lies between is known.
SLOPES = np.array([0.5, -0.25, 1.0, 2.0, -1.0])


def drivers(t, u, *, jump=0.0):
    """Return messages at times t of the first three joints, and at u of the other two."""
    time = STORE.types["builtin_interfaces/msg/Time"]
    messages = []
    for instant, places in sorted([(x, (0, 1, 2)) for x in t] + [(x, (4, 3)) for x in u]):
        q = [SLOPES[i] * instant + jump * (i == 3 and instant > 0.5) for i in places]
        message = state_of(STORE, 0, names=[JOINTS[i] for i in places], q=q)
        message.header.stamp = time(*divmod(round((5 + instant) * 1e9), 10**9))
        message.velocity = SLOPES[list(places)]
        messages.append(message)
    return messages


def test_drivers_of_some_joints_each_are_put_together(tmp_path, dh5):
    t, u = 0.04 * np.arange(26), 0.01 + 0.1 * np.arange(11)
    found = Recording.read(dh5, write(tmp_path / "run", {STATE: drivers(t, u)}))
    inner = t[(t >= u[0]) & (t <= u[-1])]
    np.testing.assert_allclose(found.t, inner - inner[0], atol=1e-9)
    np.testing.assert_allclose(found.q, np.outer(inner, SLOPES), atol=1e-12)
    np.testing.assert_allclose(found.v, np.tile(SLOPES, (len(inner), 1)), atol=1e-12)
    assert found.notes[2] == (
        "the joints are in different messages: joint4, joint5 are interpolated linearly at the "
        "times of those with joint1, joint2, joint3, 1 of which are left out, as the others are "
        "missing there"
    )
    # Half way, no angle between the two of a wrapped one is invented.
    wrapped = read_motion(write(tmp_path / "w", {STATE: drivers(t, u, jump=-6.0)}), JOINTS)
    rest = wrapped.q[:, 3] - SLOPES[3] * inner
    assert (np.minimum(np.abs(rest), np.abs(rest + 6.0)) < 0.11).all()
    # Where the other driver was silent, nothing is invented either.
    often, silent = 0.01 * np.arange(101), 0.02 * np.arange(51)
    silent = silent[(silent < 0.31) | (silent > 0.59)]
    some = read_motion(write(tmp_path / "s", {STATE: drivers(often, silent)}), JOINTS)
    kept = often[(often < 0.301) | (often > 0.599)]
    np.testing.assert_allclose(some.q, np.outer(kept, SLOPES), atol=1e-12)
    with pytest.raises(InputError, match="in different messages, which do not overlap in time"):
        read_motion(write(tmp_path / "d", {STATE: drivers(t, 3.0 + u)}), JOINTS)


def test_drivers_that_cannot_be_put_together(tmp_path):
    part = [state_of(STORE, i, names=JOINTS[:4], q=Q[i, :4]) for i in range(4)]
    other = [state_of(STORE, i, names=JOINTS[3:], q=Q[i, 3:]) for i in range(4)]
    path = write(tmp_path / "both", {STATE: [*part, *other]})
    with pytest.raises(InputError, match="and joint4 are in messages with different other joints"):
        read_motion(path, JOINTS)
    path = write(tmp_path / "part", {STATE: part})
    with pytest.raises(InputError, match=r"has all joints of the chain, .*; none has joint5"):
        read_motion(path, JOINTS, "/joint_states")


def test_samples_that_are_repeated(tmp_path, dh5):
    """Two publishers of the same, or a recorder that was subscribed twice."""
    path = write(tmp_path / "run", {STATE: [one for one in STATES for _ in (0, 1)]})
    found = Recording.read(dh5, path)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.v, np.full((COUNT, 5), 0.5))
    assert found.notes[2].startswith("12 samples that repeat time and positions of the one before")
    other = state_of(STORE, 3, q=[0.02, *reversed(Q[3] + [0, 0.25, 0, 0, 0])])
    path = write(tmp_path / "other", {STATE: [*STATES[:4], other, *STATES[4:]]})
    with pytest.raises(
        TrajectoryError,
        match=r"sample 5: the time 0\.15 s appears twice; .* positions differ \(joint2: ",
    ):
        Recording.read(dh5, path)


def test_the_topic_is_chosen_or_asked_for(tmp_path, dh5):
    other = [state_of(STORE, i, q=np.zeros(6)) for i in range(COUNT)]
    wheels = [state_of(STORE, i, names=("wheel",), q=[0.1]) for i in range(COUNT)]
    topics = {STATE: STATES, ("/wheels", STATE[1]): wheels}
    path = write(tmp_path / "one", topics)
    assert read_motion(path, JOINTS).notes[0].endswith("/joint_states; others: /wheels")
    path = write(tmp_path / "two", {**topics, ("/sim/joint_states", STATE[1]): other})
    with pytest.raises(
        TrajectoryError, match=r"several topics have the joints: /joint_states, /sim/"
    ):
        Recording.read(dh5, path)
    assert not Recording.read(dh5, path, topic="/sim/joint_states").q.any()
    with pytest.raises(
        InputError, match=r"has no topic '/x'.*its topics are: /joint_states \(sensor"
    ):
        read_motion(path, JOINTS, "/x")
    with pytest.raises(InputError, match=r"no message of /wheels has all joints of the chain"):
        read_motion(path, JOINTS, "/wheels")
    with pytest.raises(
        InputError,
        match=r"^no message has all joints of the chain, elbow; the topics are: /joint_states \(",
    ):
        read_motion(path, ["elbow"])


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        ({"q": [0.0, np.nan, 0, 0, 0, 0]}, "the position of joint5 is nan"),
        ({"q": [0.0, 1.0]}, "names 6 joints and has 2 positions"),
        ({"names": ("joint1",) * 6}, "names 'joint1' twice"),
    ],
    ids=["nan", "positions", "names"],
)
def test_messages_that_are_malformed(tmp_path, message, problem):
    broken = [*STATES[:5], state_of(STORE, 5, **message)]
    with pytest.raises(InputError, match=f"the message at 1250000000 ns.*{problem}"):
        read_motion(write(tmp_path / "run", {STATE: broken}), JOINTS)


@pytest.mark.parametrize("ending", ["mcap", "db3", "bag"])
def test_damaged_bags_are_read_or_refused(tmp_path, dh5, folder, ending):
    data = next(folder.glob("*.mcap")).read_bytes()
    if ending == "db3":
        write(tmp_path / "run", {STATE: STATES}, StoragePlugin.SQLITE3)
        data = next((tmp_path / "run").glob("*.db3")).read_bytes()
    path = tmp_path / f"run.{ending}"
    noise = np.random.default_rng(0)
    contents = [b"", b"x", data[: len(data) // 2], data[:50], data[::-1]]
    for _ in range(20):
        damaged = bytearray(data)
        for i in noise.integers(0, len(data), 30):
            damaged[i] = noise.integers(256)
        contents.append(bytes(damaged))
    for content in contents:
        path.write_bytes(content)
        with suppress(TrajectoryError):  # the damage may be elsewhere, but is never a traceback
            assert Recording.read(dh5, path).q.shape[1] == 5


def test_a_database_of_something_else(tmp_path):
    path = tmp_path / "run.db3"
    with sqlite3.connect(path) as database:
        database.execute("create table topics (id integer)")
    with pytest.raises(InputError, match="is damaged or not a bag"):
        read_motion(path, JOINTS)


def test_nothing_outside_of_the_folder_is_opened(tmp_path, folder):
    inside = tmp_path / "run"
    inside.mkdir()
    meta = (folder / "metadata.yaml").read_text("utf-8")
    file = next(folder.glob("*.mcap"))
    for named in (f"../{file.name}", str(file)):
        (inside / "metadata.yaml").write_text(meta.replace(file.name, named), "utf-8")
        with pytest.raises(InputError, match="names a file outside of the bag's folder"):
            read_motion(inside, JOINTS)
    (inside / "metadata.yaml").write_text("[1, 2]", "utf-8")
    with pytest.raises(InputError, match=r"metadata\.yaml does not list its files"):
        read_motion(inside, JOINTS)


def test_bags_that_are_not_whole(tmp_path, folder):
    path = write(tmp_path / "run", {STATE: STATES}, StoragePlugin.SQLITE3)
    file = next(path.glob("*.db3"))
    (path / f"{file.name}-wal").write_bytes(b"x")
    for one in (path, file):
        with pytest.raises(InputError, match=r"run\.db3-wal holds messages that would be missing"):
            read_motion(one, JOINTS)
    (path / f"{file.name}-wal").unlink()
    meta = path / "metadata.yaml"
    text = meta.read_text("utf-8")
    meta.write_text(text.replace("compression_mode: ''", "compression_mode: FILE"), "utf-8")
    with pytest.raises(InputError, match="compressed as a whole; unpack them first"):
        read_motion(path, JOINTS)
    upper = tmp_path / "run.MCAP"
    upper.write_bytes(next(folder.glob("*.mcap")).read_bytes())
    np.testing.assert_array_equal(read_motion(upper, JOINTS).q, Q)
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(InputError, match="is not a regular file"):
        read_motion(tmp_path / "pipe.mcap", JOINTS)


def test_what_is_no_bag(tmp_path, dh5, monkeypatch, folder):
    with pytest.raises(TrajectoryError, match=r"no\.mcap: no such file; expected a bag"):
        Recording.read(dh5, tmp_path / "no.mcap")
    (tmp_path / "a.csv").write_text("t,joint1\n0,0\n", "utf-8")
    with pytest.raises(TrajectoryError, match="is not a bag, so it has no topic '/x'"):
        Recording.read(dh5, tmp_path / "a.csv", topic="/x")
    empty = write(tmp_path / "empty", {("/a", "std_msgs/msg/String"): []})
    with pytest.raises(
        InputError, match=r"holds no joint states or trajectories; its topics are: /a"
    ):
        read_motion(empty, JOINTS)
    with pytest.raises(InputError, match="topic to a file of a recorded motion"):
        ftforce.timeline(dh5, Recording.of(dh5, T, Q), topic="/x")
    monkeypatch.setattr(bag, "MAX_MESSAGES", 5)
    with pytest.raises(InputError, match="has more than 5 messages"):
        read_motion(folder, JOINTS)
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(FtforceError, match=r"pip install 'ftforce\[bag\]'"):
        read_motion(folder, JOINTS)


def test_simulations_timelines_and_sweeps_read_bags(dh5, folder):
    file = next(folder.glob("*.mcap"))
    run = ftforce.simulate(dh5, folder, force=[8, 5, 1], faults="3@0.2", smooth="none")
    np.testing.assert_allclose(run.healthy.q[0], Q[0], atol=1e-12)
    line = ftforce.timeline(dh5, file, force=[8, 5, 1], topic="/joint_states", smooth="none")
    assert len(line.t) == COUNT
    postures = postures_from_file(dh5, file)
    np.testing.assert_array_equal(postures.block(2, 7), Q[2:7])
    assert ftforce.sweep(dh5, file, force=[8, 5, 1]).done == COUNT
    whole = postures_from_file(dh5, folder)
    np.testing.assert_array_equal(whole.block(0, COUNT), Q)
    assert whole.sha256 != postures.sha256
    with pytest.raises(InputError, match="the folder of a bag has no degrees"):
        postures_from_file(dh5, folder, degrees=True)
    for options, message in (
        ({"degrees": True}, "degrees"),
        ({"topic": "/x"}, "has no topic '/x'"),
    ):
        with pytest.raises(FtforceError, match=message):
            postures_from_file(dh5, file, **options)
    with pytest.raises(InputError, match=r"a \.npy file has no topic"):
        postures_from_file(dh5, "q.npy", topic="/x")


# ---- trajectories written --------------------------------------------------------------------


def test_a_simulation_becomes_a_trajectory_for_ros(dh5, folder, tmp_path):
    """What another reader finds in it is what was simulated, with the torques to command."""
    run = ftforce.simulate(dh5, folder, force=[8, 5, 1], faults="2@0.2", smooth="none")
    path = ftforce.save(run, tmp_path / "plan.mcap")
    with path.open("rb") as stream:
        ((schema, channel, raw),) = make_reader(stream).iter_messages()
    assert (schema.name, channel.topic) == (
        "trajectory_msgs/msg/JointTrajectory",
        "/joint_trajectory",
    )
    message = STORE.deserialize_cdr(raw.data, schema.name)
    assert tuple(message.joint_names) == JOINTS
    for name, values in (("positions", "q"), ("velocities", "v"), ("effort", "motor")):
        found = np.array([getattr(one, name) for one in message.points])
        np.testing.assert_array_equal(found, getattr(run.answer, values))
    since = [one.time_from_start.sec + 1e-9 * one.time_from_start.nanosec for one in message.points]
    np.testing.assert_allclose(since, run.t, atol=1e-9)
    assert path.read_bytes() == ftforce.save(run, tmp_path / "again.mcap").read_bytes()
    np.testing.assert_array_equal(Recording.read(dh5, path).q, run.answer.q)
    again = ftforce.simulate(dh5, path, force=[8, 5, 1], smooth="none")
    np.testing.assert_allclose(again.healthy.q[0], run.answer.q[0], atol=1e-12)
    line = ftforce.timeline(dh5, path, force=[8, 5, 1], smooth="none")
    np.testing.assert_allclose(line.t, run.t, atol=1e-9)


def test_what_only_positions_say(tmp_path):
    (tmp_path / "p.mcap").write_bytes(trajectory_bag(JOINTS, T, {"positions": Q}))
    found = read_motion(tmp_path / "p.mcap", JOINTS[::-1])
    np.testing.assert_array_equal(found.q, Q[:, ::-1])
    assert found.v is None


# ---- CSV of plotting tools and drivers ---------------------------------------------------------


def table(header, *columns, mark=","):
    rows = zip(*(np.asarray(column).tolist() for column in columns), strict=True)
    lines = [mark.join(map(str, row)) for row in rows]
    return "\n".join([mark.join(header), *lines, ""])


NUMBERED = [f"/joint_states/position[{i}]" for i in range(5)]
NAMED = [f"/joint_states/name[{i}]" for i in range(5)]
SINCE = np.int64(1_700_000_000_000_000_000)
NS = (np.round(T * 1e9)).astype(np.int64)
FORMS = {
    "PlotJuggler": (
        ["__time", *(f"/joint_states/{j}/position" for j in JOINTS)],
        [T + 1.7e9, *Q.T],
    ),
    "Foxglove": (["time", *(f"/joint_states.{j}.position" for j in JOINTS)], [T, *Q.T]),
    "a history": (["t [s]", *(f"q_{j} [rad]" for j in JOINTS)], [T, *Q.T]),
    "words": (["t", *(f"{j}_position" for j in JOINTS)], [T, *Q.T]),
    "all of PlotJuggler": (
        [
            "__time",
            *(f"/joint_states/{j}/{k}" for k in ("effort", "position", "velocity") for j in JOINTS),
        ],
        [T + 1.7e9, *np.full((5, COUNT), 9.0), *Q.T, *np.full((5, COUNT), 0.5)],
    ),
    "rostopic": (
        ["time", *(f"field.name{i}" for i in range(5)), *(f"field.position{i}" for i in range(5))],
        [T, *(np.repeat(name, COUNT) for name in reversed(JOINTS)), *Q[:, ::-1].T],
    ),
    "numbers": (["/joint_states/header/stamp", *NUMBERED], [T, *Q.T]),
    "brackets and units": (["t [ms]", *(f"q[{i}] [rad]" for i in range(1, 6))], [1e3 * T, *Q.T]),
    "a row of names": (
        ["time", *NAMED, *NUMBERED],
        [T, *(np.repeat(name, COUNT) for name in reversed(JOINTS)), *Q[:, ::-1].T],
    ),
    "velocities": (
        ["t", *(f"a/{j}/velocity" for j in JOINTS), *(f"a/{j}/position" for j in JOINTS)],
        [T, *np.full((5, COUNT), 0.5), *Q.T],
    ),
    "wishes": (
        ["t", *(f"c/{kind}/{j}/position" for kind in ("desired", "actual") for j in JOINTS)],
        [T, *np.zeros((5, COUNT)), *Q.T],
    ),
    "nanoseconds since 1970": (["timestamp", *JOINTS], [SINCE + NS, *Q.T]),
    "nanoseconds": (["timestamp", *JOINTS], [NS, *Q.T]),
    "milliseconds since 1970": (["timestamp", *JOINTS], [SINCE // 10**6 + NS // 10**6, *Q.T]),
    "microseconds in the name": (["time_us", *JOINTS], [NS // 1000, *Q.T]),
    "seconds and nanoseconds": (
        ["header.stamp.sec", "header.stamp.nanosec", *JOINTS],
        [(SINCE + NS) // 10**9, (SINCE + NS) % 10**9, *Q.T],
    ),
}


SLICES = [f'"/joint_states.position[:]{{name==""{j}""}}"' for j in JOINTS]
ECHO = [(SINCE + NS) // 10**9, (SINCE + NS) % 10**9, np.repeat("base", COUNT)]
NAMES_OF = [np.repeat(name, COUNT) for name in reversed(JOINTS)]
DATES = [f"2026-11-01T12:00:{x:012.9f}Z" for x in T]
OTHER_FORMS = {
    "decimal commas": table(["time (s)", *JOINTS], T, *Q.T, mark=";").replace(".", ","),
    "units in parentheses": table(
        ["Time [sec]", *(f"{j} (degrees)" for j in JOINTS)], T, *np.rad2deg(Q).T
    ),
    "a row of units": table(["t", *JOINTS], *np.vstack([1e3 * T, Q.T])).replace(
        "\n", "\n[ms],rad,rad,rad,-,\n", 1
    ),
    "Foxglove's paths": table(["timestamp (receive)", *SLICES], T, *Q.T),
    "dates": table(["time", *JOINTS], DATES, *Q.T),
    "dates with an offset": table(
        ["time", *JOINTS], [x.replace("Z", "+01:00").replace("T", " ") for x in DATES], *Q.T
    ),
    "ros2 topic echo --csv": table(
        *[[str(column[0]) for column in (*ECHO, *NAMES_OF, *Q.T[::-1])]],
        *[column[1:] for column in (*ECHO, *NAMES_OF, *Q.T[::-1])],
    ),
    "for Excel": "sep=;\n" + table(["t", *JOINTS], T, *Q.T, mark=";"),
    "numpy.savetxt": table(["# t", *JOINTS], T, *Q.T, mark=" "),
    "Franka": table(
        ["time", *(f"{x}[{i}]" for x in ("q", "q_d", "dq", "tau_J") for i in range(5))],
        T, *np.vstack([Q.T, 9 + Q.T, 9 + Q.T, 9 + Q.T]),
    ),
}  # fmt: skip


@pytest.mark.parametrize("form", OTHER_FORMS)
def test_other_forms_of_csv(tmp_path, dh5, form):
    path = tmp_path / "run.csv"
    path.write_text(OTHER_FORMS[form], "utf-8")
    found = Recording.read(dh5, path)
    np.testing.assert_allclose(found.t - found.t[0], T, atol=1e-9)
    np.testing.assert_allclose(found.q, Q, atol=1e-15)
    np.testing.assert_allclose(postures_from_file(dh5, path).block(0, COUNT), Q, atol=1e-15)
    assert ("decimals are separated by commas" in " ".join(found.notes)) == ("commas" in form)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (OTHER_FORMS["dates"].replace(DATES[5], "soon"), "line 7, 'time': 'soon' is no date"),
        (OTHER_FORMS["dates"].replace(DATES[3], DATES[3].replace("-11-", "-13-")), "line 5"),
        (table(["t", *JOINTS], T, *Q.T, mark=";").replace("0.05;", "0,05;"), "'0,05' is not a"),
        (table([f"c{i}" for i in range(10_001)], *np.zeros((10_001, 1))), "has 10,001 columns"),
        (OTHER_FORMS["ros2 topic echo --csv"].replace("joint5", "joint9", 1), "'joint5' instead"),
    ],
    ids=["word", "month", "point and comma", "columns", "names"],
)  # fmt: skip
def test_other_forms_that_are_refused(tmp_path, dh5, content, problem):
    (tmp_path / "run.csv").write_text(content, "utf-8")
    with pytest.raises(TrajectoryError, match=problem):
        Recording.read(dh5, tmp_path / "run.csv")


ROUNDED = (
    "PlotJuggler",
    "all of PlotJuggler",
    "nanoseconds since 1970",
)  # doubles hold no more digits


@pytest.mark.parametrize("mark", [",", ";", "\t", " "], ids=["comma", "semicolon", "tab", "blank"])
@pytest.mark.parametrize("form", FORMS)
def test_columns_as_plotting_tools_write_them(tmp_path, dh5, form, mark):
    header, columns = FORMS[form]
    if mark == " ":
        header = ["time_ms" if "[ms]" in name else name.partition(" ")[0] for name in header]
    path = tmp_path / "run.csv"
    path.write_text(table(header, *columns, mark=mark), "utf-8")
    found = Recording.read(dh5, path)
    np.testing.assert_allclose(found.t - found.t[0], T, atol=6e-7 if form in ROUNDED else 1e-9)
    np.testing.assert_array_equal(found.q, Q)
    assert (found.v is None) == (form not in {"velocities", "all of PlotJuggler"})
    said = " ".join(found.notes)
    for unit in ("ns", "ms"):
        is_guessed = (
            form.startswith(("nano", "milli")) and {"ns": "nano", "ms": "milli"}[unit] in form
        )
        assert (f"taken for {unit}" in said) == (is_guessed and form != "seconds and nanoseconds")


def test_a_sweep_takes_the_same_columns(tmp_path, dh5):
    path = tmp_path / "run.csv"
    for form in ("PlotJuggler", "numbers", "rostopic", "a row of names"):
        path.write_text(table(FORMS[form][0], *FORMS[form][1], mark=";"), "utf-8")
        postures = postures_from_file(dh5, path)
        np.testing.assert_array_equal(postures.block(0, COUNT), Q)
        assert "from run.csv (" in str(postures)


@pytest.mark.parametrize(
    "header",
    [
        [f"/joint_states/{j}/effort" for j in JOINTS],
        [f"/joint_torques/{j}" for j in JOINTS],
        [f"/joint_states/{j}/position/stddev" for j in JOINTS],
        [f"/joint_states/{j}/position_deg" for j in JOINTS],
        [f"tcp_position_{i}" for i in range(5)],
        [f"motor_position[{i}]" for i in range(5)],
        [f"q{'9' * 5000}", *JOINTS[1:]],
    ],
    ids=lambda header: header[0][:30],
)
def test_other_quantities_are_no_positions(tmp_path, dh5, header):
    (tmp_path / "run.csv").write_text(table(["t", *header], T, *Q.T), "utf-8")
    with pytest.raises(TrajectoryError, match="missing columns: joint1"):
        Recording.read(dh5, tmp_path / "run.csv")


def test_two_columns_for_a_joint_are_not_guessed(tmp_path, dh5):
    header = ["t", *(f"{arm}/{j}/position" for arm in "ab" for j in JOINTS)]
    (tmp_path / "run.csv").write_text(table(header, T, *Q.T, *Q.T), "utf-8")
    with pytest.raises(
        TrajectoryError, match="'a/joint1/position' and 'b/joint1/position' both hold"
    ):
        Recording.read(dh5, tmp_path / "run.csv")


def test_names_that_change_are_an_error(tmp_path, dh5):
    header, columns = FORMS["a row of names"]
    text = table(header, *columns).replace("joint5", "finger", 1)
    (tmp_path / "run.csv").write_text(text, "utf-8")
    with pytest.raises(
        TrajectoryError, match=r"line 3, '/joint_states/name\[0\]': 'joint5' instead"
    ):
        Recording.read(dh5, tmp_path / "run.csv")
