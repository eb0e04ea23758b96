"""Write the recordings of docs/guides/recordings: a bag of ROS 2, and a CSV as PlotJuggler has it.

``python docs/examples/bench_recording.py`` writes them beside itself, always with the same bytes.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

HERE = Path(__file__).resolve().parent
JOINTS = ("turn", "shoulder", "elbow", "wrist")
START = 1_790_000_000 * 10**9  # ns
KIND = "sensor_msgs/msg/JointState"


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Return times, ns, and positions, rad: a reach forward and back, with encoder noise."""
    t = np.arange(0, 2_000_000_000, 20_000_000)
    s = 0.5 - 0.5 * np.cos(np.pi * t * 1e-9)
    start, end = np.array([0.0, -0.7, 1.6, -0.4]), np.array([0.6, -0.2, 1.0, -0.1])
    noise = np.random.default_rng(7).normal(0.0, 2e-5, (len(t), 4))
    return t, start + np.outer(s, end - start) + noise


def main() -> None:
    """Write both files."""
    t, q = motion()
    store = get_typestore(Stores.ROS2_HUMBLE)
    with (HERE / "bench_run.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="bench")
        definition = store.generate_msgdef(KIND, ros_version=2)[0]
        schema = writer.register_schema(KIND, "ros2msg", definition.encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        types, none = store.types, np.empty(0)
        for time, positions in zip(t.tolist(), q, strict=True):
            stamp = types["builtin_interfaces/msg/Time"](*divmod(START + time, 10**9))
            header = types["std_msgs/msg/Header"](stamp, "")
            names = ["gripper", *JOINTS]
            message = types[KIND](header, names, np.array([0.02, *positions]), none, none)
            data = bytes(store.serialize_cdr(message, KIND))
            writer.add_message(channel, START + time, data, START + time)
        writer.finish()
    with (HERE / "bench_run.csv").open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        paths = (f"/joint_states/{joint}/position" for joint in JOINTS)
        rows.writerow(["__time", *paths, "/joint_states/gripper/position"])
        for time, positions in zip(t.tolist(), q.tolist(), strict=True):
            numbers = (f"{x:.6f}" for x in positions)
            rows.writerow([f"{(START + time) * 1e-9:.3f}", *numbers, "0.02"])


if __name__ == "__main__":
    main()
