"""Small URDFs, whole or broken, as text: every part can be replaced by something else."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from ftforce import load_robot

BODY = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="2"/>'
    '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
LINKS = ("base", "l1", "l2", "l3", "tool")
AXES = ("0 0 1", "0 1 0", "1 0 0", "0 0.6 0.8")


def link(name, inner=BODY):
    return f'<link name="{name}">{inner}</link>'


def joint(name, parent, child, kind="revolute", *, axis="0 1 0", limit=LIMIT, more="", **origin):
    """Return a joint; ``origin``: xyz and rpy; ``limit`` and ``more`` are XML."""
    xyz, rpy = origin.get("xyz", "0.1 0.2 0.3"), origin.get("rpy", "0.3 0.2 0.1")
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}{more}</joint>'
    )


def mimic(leader, multiplier=1, offset=0):
    return f'<mimic joint="{leader}" multiplier="{multiplier}" offset="{offset}"/>'


def robot(*parts, name="arm", attributes=""):
    return f'<robot name="{name}"{attributes}>{"".join(parts)}</robot>'


def parts_of_arm():
    """Return links and joints of an arm of four joints: base j1 l1 j2 l2 j3 l3 j4 tool."""
    parts = {name: link(name) for name in LINKS}
    for i, axis in enumerate(AXES):
        parts[f"j{i + 1}"] = joint(f"j{i + 1}", LINKS[i], LINKS[i + 1], axis=axis)
    return parts


def arm(*more, **changes):
    """Return that arm with some of its parts replaced and others added."""
    return robot(*{**parts_of_arm(), **changes}.values(), *more)


def j2(kind="revolute", **options):
    """Return the arm with another second joint."""
    return arm(j2=joint("j2", "l1", "l2", kind, **options))


def followed(number, leader, *rule, kind="revolute"):
    """Return a joint of the arm that mimics another one."""
    ends = LINKS[number - 1 : number + 1]
    more = mimic(leader, *rule)
    return joint(f"j{number}", *ends, kind, axis=AXES[number - 1], more=more)


def hand(*fingers):
    """Return parts that hang sliding fingers on the tool."""
    parts = [link(finger) for finger in fingers]
    return parts + [joint(f"{finger}_joint", "tool", finger, "prismatic") for finger in fingers]


def state(name, **positions):
    """Return an SRDF's named posture."""
    joints = "".join(f'<joint name="{k}" value="{v}"/>' for k, v in positions.items())
    return f'<group_state name="{name}" group="arm">{joints}</group_state>'


def end_effector(parent_link):
    return f'<end_effector name="hand" parent_link="{parent_link}" group="hand"/>'


def chain(base_link, tip_link):
    return f'<group name="arm"><chain base_link="{base_link}" tip_link="{tip_link}"/></group>'


def write(folder, urdf, srdf=None, name="arm.urdf"):
    """Write the files, given as text or bytes, and return the URDF's path."""
    for path, content in ((folder / name, urdf), ((folder / name).with_suffix(".srdf"), srdf)):
        if content is not None:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder / name


def full_device(folder):
    """Return a device on which every write fails, as on a full disk.

    Root could replace the machine's own ``/dev/full`` if what is tested were broken, so root gets
    one in the folder.
    """
    device = Path("/dev/full")
    if not device.is_char_device():
        pytest.skip("no such device here")
    if os.access(device.parent, os.W_OK):
        number = device.stat().st_rdev
        device = folder / "full"
        try:
            os.mknod(device, stat.S_IFCHR | 0o666, number)
            device.write_bytes(b"")
        except OSError:
            pytest.skip("devices cannot be made or used here")
    return device


def load(folder, urdf, srdf=None, **options):
    """Write the files and load the robot."""
    return load_robot(write(folder, urdf, srdf), **options)
