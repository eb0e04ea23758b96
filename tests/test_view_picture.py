"""The scene as arrays: what stands where, how long arrows are, which colour means what."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

import ftforce
from ftforce.core.faults import FaultMode
from ftforce.core.task import Task
from ftforce.robot.kinematics import tip_pose
from ftforce.view.model.answer import answer
from ftforce.view.scene.arrow_nodes import along
from ftforce.view.scene.arrows import (
    ARROW_KINDS,
    Scales,
    TipAxes,
    arrows_of,
    nice_scale,
    scales_for,
)
from ftforce.view.scene.colours import FAULT_COLOURS, FIXED, NEUTRAL, RAMP, colour_of
from ftforce.view.scene.force_sets import ellipsoid, triangles
from ftforce.view.scene.picture import (
    _line,
    chain_joints,
    dragged_wrench,
    joint_poses,
    picture,
    requested_of,
    rotation,
    scene_size,
)
from ftforce.view.scene.stage import viewpoint
from helpers import KNOWN, assert_close, initial_state
from urdfs import arm, followed


@pytest.fixture(scope="module")
def panda():
    return ftforce.load_robot("panda")


def shown(robot, *, like=None, show=None, **options):
    state = initial_state(robot, **options).showing(**(show or {}))
    # At its own posture panda's tip is turned by half a turn: its rotation is its own inverse.
    found = answer(robot, state.at(state.q + np.linspace(-0.3, 0.2, robot.n)))
    return found, picture(found, like)


@pytest.mark.parametrize("axes", ["tool", "world"])
def test_arrows_are_the_forces_in_one_scale(panda, axes):
    found, scene = shown(panda, locked=[2, 4], force=[10, 20, -60], axes=axes)
    R, place = tip_pose(panda, found.analysis.posture.q)
    R = R if axes == "tool" else np.eye(3)
    force = found.analysis.force
    for arrow, F in zip(scene.arrows, (force.requested, force.after, force.jump), strict=True):
        assert_close(arrow.start, place)
        assert_close((arrow.end - arrow.start) / scene.scales.force, R @ F, tol=1e-9)
    assert [arrow.kind for arrow in scene.arrows] == ["requested", "kept", "lost"]
    assert scene.arrows[2].label == f"lost {force.jump_norm:.1f} N"
    assert_close(rotation(scene.tip.wxyz), R)


def test_an_arrow_that_lies_on_another_has_no_mark(panda):
    _, scene = shown(panda, locked=[2], force=[0, 0, 30])
    assert [arrow.mark for arrow in scene.arrows] == ["", "all kept 30.0 N", ""]
    assert scene.arrows[2].length == 0.0
    _, nothing = shown(panda, force=[0, 0, 0])
    assert all(arrow.length == 0.0 and not arrow.mark for arrow in nothing.arrows)
    unasked = picture(answer(panda, initial_state(panda, locked=[2]).loaded("every direction")))
    assert unasked.arrows == ()
    assert not any("0.1 m is" in note for note in unasked.notes)


def test_moments_are_arrows_in_a_scale_of_their_own(panda):
    found, scene = shown(panda, locked=[2, 4], task="wrench", force=[0, 6, 8, 100, 0, 30])
    R, place = tip_pose(panda, found.analysis.posture.q)
    force = found.analysis.force
    kinds = [(arrow.kind, arrow.is_moment) for arrow in scene.arrows]
    assert kinds == [(kind, moment) for moment in (False, True) for kind in ARROW_KINDS]
    for arrow, F in zip(scene.arrows, 2 * [force.requested, force.after, force.jump], strict=True):
        scale = scene.scales.moment if arrow.is_moment else scene.scales.force
        part = F[3:] if arrow.is_moment else F[:3]
        assert_close(arrow.start, place)
        assert_close((arrow.end - arrow.start) / scale, R @ part, tol=1e-9)
    labels = [arrow.label for arrow in scene.arrows]
    assert labels[0] == "force requested 10.0 N"
    assert labels[3] == "moment requested 104.4 N·m"
    assert scene.scales.force != scene.scales.moment
    assert [note.split(":")[0] for note in scene.notes] == ["force arrows", "moment arrows"]


def test_moments_alone_are_the_arrows(panda):
    _, scene = shown(panda, task="mx,mz", force=[3, 4])
    assert [arrow.is_moment for arrow in scene.arrows] == [True] * 3
    assert scene.arrows[0].label == "requested 5.0 N·m"
    assert math.isnan(scene.scales.force)
    found, scene = shown(panda, task="fz,fx", force=[3, 4])
    R, _ = tip_pose(panda, found.analysis.posture.q)
    arrow = scene.arrows[0]
    assert_close((arrow.end - arrow.start) / scene.scales.force, R @ [4, 0, 3], tol=1e-9)


def test_a_force_that_is_kept_hides_no_moment_that_is_lost():
    task = Task.parse("wrench", "tool", 1.0)
    requested, lost = np.array([0, 0, 5.0, 1, 0, 0]), np.array([0, 0, 0, 0.6, 0, 0.0])
    vectors = {"requested": requested, "kept": requested - lost, "lost": lost}
    arrows = arrows_of(task, vectors, TipAxes(np.zeros(3), np.eye(3)), Scales(0.1, 0.2))
    assert [arrow.mark for arrow in arrows[:3]] == ["", "force all kept 5.0 N", ""]
    moments = ["moment requested 1.0 N·m", "moment kept 0.4 N·m", "moment lost 0.6 N·m"]
    assert [arrow.mark for arrow in arrows[3:]] == moments
    assert_close(arrows[5].end, [0.12, 0, 0])


def test_scales_are_those_of_the_largest_and_pass_over_what_is_unknown():
    task = Task.parse("fx,my", "tool", 1.0)
    known = np.array([[3.0, -200.0], [np.nan, 1e9], [-70.0, 4.0]])
    scales = scales_for(task, [known, np.array([5.0, 6.0])], 2.0)
    assert scales == (nice_scale(70.0, 2.0), nice_scale(200.0, 2.0))
    assert math.isnan(scales_for(Task.parse("fx", "tool", 1.0), [], 2.0).moment)


@pytest.mark.parametrize(
    ("direction", "label"),
    [
        ([0, 1, 0, 0, 0, 0], "lost direction of forces"),
        ([0, 0, 0, 0, 0, 2], "lost direction of moments"),
        ([0, 1, 0, 0, 0, 2], "lost direction, force part"),
    ],
)
def test_a_line_says_what_it_is_a_direction_of(direction, label):
    task = Task.parse("wrench", "tool", 0.5)
    axes = TipAxes(np.ones(3), np.eye(3))
    ends, whose = _line(task, np.array(direction, dtype=float), axes, 0.3, -0.3)
    assert f"lost direction{whose}" == label
    along_y = direction[1] != 0
    assert_close(ends[1] - ends[0], [0, 0.6, 0] if along_y else [0, 0, 0.6])


def test_an_arm_that_cannot_stand_still_keeps_nothing(panda):
    _, scene = shown(panda, free=[2, 3, 4, 5, 6], force=[1, 0, 0])
    assert [arrow.length > 0.0 for arrow in scene.arrows] == [True, False, False]
    assert scene.arrows[1].label == "kept: no static equilibrium"
    assert scene.arrows[2].label == "lost: no static equilibrium"


def test_torques_are_pulled_as_the_force_they_mean(panda):
    torque = [1.0, -8.0, 3.0, 6.0, -1.0, 2.0, 0.5]
    found = answer(panda, initial_state(panda, torque=torque, task="wrench"))
    scene, means = picture(found), requested_of(found)
    assert np.abs(means[3:]).max() > 0.1
    wrench = dragged_wrench(scene, found, scene.arrows[0].end)
    assert_close(wrench[:3], means[:3], tol=0.005 / scene.scales.force, scale=1.0)
    assert_close(wrench[3:], means[3:])


def test_what_has_no_surface_is_said(panda):
    for solid in ("ellipsoid", "polytope"):
        _, scene = shown(panda, task="fx", limits="urdf", show={"solid": solid})
        assert not scene.solids
        assert sum("a line segment, not drawn" in note for note in scene.notes) == 2
    everything = range(1, 8)
    _, scene = shown(panda, locked=everything, limits="urdf", show={"solid": "ellipsoid"})
    assert "ellipsoid after the fault: no force can be commanded" in scene.notes
    assert len(scene.solids) == 1


def test_no_direction_is_the_weakest_where_nothing_limits(panda):
    _, scene = shown(panda, limits="none", show={"weakest": True})
    assert not any("weakest" in line.label for line in scene.lines)
    _, scene = shown(panda, task="wrench", limits="urdf", show={"weakest": True})
    assert scene.lines[-1].label.endswith(" weighted N")


@pytest.mark.parametrize("largest", [1e-12, 1e-3, 0.99, 1.0, 34.6, 5e4])
def test_the_longest_arrow_fits_and_is_no_dwarf(largest):
    length = largest * nice_scale(largest, 1.5)
    assert length <= 0.45 * 1.5 * (1 + 1e-9)
    if largest > 1e-9:
        assert length > 0.45 * 1.5 / 2.51
    mantissa = 1.0 / nice_scale(largest, 1.5)
    mantissa /= 10.0 ** math.floor(math.log10(mantissa) + 1e-9)
    assert min(abs(mantissa - step) for step in (1, 2, 5)) < 1e-6


@pytest.mark.parametrize("name", KNOWN)
def test_the_tip_is_where_the_joints_put_it(name):
    robot = ftforce.load_robot(name)
    q = initial_state(robot).q
    poses, (R, place) = joint_poses(robot, q)
    frame = robot.model.frames[robot.tip_frame]
    last = poses[frame.parentJoint]
    turn = rotation(last.wxyz)
    assert_close(turn @ frame.placement.translation + last.position, place)
    assert_close(turn @ frame.placement.rotation, R)
    moves = chain_joints(robot)
    assert len(moves) == len(poses) == robot.model.njoints
    assert moves[0] is None
    assert set(moves[1:]) == set(range(robot.n))
    assert scene_size(robot) > 0.3


def test_a_follower_has_the_colour_of_its_leader(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm(j3=followed(3, "j1", -2, 0.1)))
    robot = ftforce.load_robot(path)
    by_name = dict(zip(robot.model.names, chain_joints(robot), strict=True))
    assert by_name["j3"] == by_name["j1"] == robot.names.index("j1")
    _, scene = shown(robot, locked=["j1"])
    colours = dict(zip(robot.model.names, scene.colours, strict=True))
    assert colours["j3"] == colours["j1"] == FAULT_COLOURS[FaultMode.LOCKED]


def test_colours_say_fault_load_or_nothing(panda):
    _, scene = shown(panda, locked=[1], free=[3], weak={5: 0.5}, limits="urdf")
    assert scene.colours[0] == FIXED
    assert [scene.colours[j] for j in (1, 3, 5)] == [FAULT_COLOURS[m] for m in FaultMode]
    assert colour_of(None, math.nan) == NEUTRAL
    assert colour_of(None, 0.0) == RAMP[0]
    assert colour_of(None, 1.0) == colour_of(None, 7.0) == RAMP[-1]
    assert colour_of(None, 1.0 / 3.0) == RAMP[1]


def test_the_ramp_darkens_evenly_for_every_eye():
    light = [sum(colour_of(None, share)) for share in np.linspace(0.0, 1.0, 101)]
    assert all(a >= b for a, b in pairwise(light))
    assert light[0] - light[-1] > 400
    everything = [*FAULT_COLOURS.values(), NEUTRAL, RAMP[0], RAMP[-1]]
    for i, one in enumerate(everything):  # told apart in brightness or by blue against yellow
        for other in everything[:i]:
            assert np.abs(np.subtract(one, other)).max() > 25


def test_lost_directions_are_lines_through_the_tip(panda):
    found, scene = shown(panda, locked=[1, 2, 3, 4, 7], force=[10, 20, -60])
    R, place = tip_pose(panda, found.analysis.posture.q)
    (line,) = scene.lines
    (lost,) = found.analysis.lost_directions
    assert_close(line.ends.mean(axis=0), place)
    way = line.ends[1] - line.ends[0]
    assert_close(np.linalg.norm(np.cross(way, R @ lost)), 0.0, scale=np.linalg.norm(way))


def test_the_weakest_direction_is_a_line_from_the_tip(panda):
    found, scene = shown(panda, locked=[2], limits="urdf", show={"weakest": True})
    line = scene.lines[-1]
    R, place = tip_pose(panda, found.analysis.posture.q)
    assert_close(line.ends[0], place)
    way = line.ends[1] - line.ends[0]
    assert_close(way / np.linalg.norm(way), R @ found.weakest[1].direction)
    assert line.label == f"weakest direction: {found.weakest[1].maximum:.1f} N"


def test_the_ellipsoid_takes_joint_torques_of_norm_one(panda):
    found, scene = shown(panda, locked=[2], show={"solid": "ellipsoid"})
    R, place = tip_pose(panda, found.analysis.posture.q)
    reduced = found.analysis.reduced
    longest = 1.0 / min(reduced.healthy.s[-1], reduced.damaged.s[-1])
    size = 0.45 * scene_size(panda)
    for solid, J in zip(scene.solids, (reduced.J, reduced.K), strict=True):
        F = (solid.vertices - place) @ R / size * longest
        assert_close(np.linalg.norm(F @ J, axis=1), np.ones(len(F)))
        assert solid.faces.max() == len(F) - 1


def test_an_ellipsoid_that_lost_a_direction_is_a_disk(panda):
    found, scene = shown(panda, locked=[1, 2, 3, 4, 7], show={"solid": "ellipsoid"})
    R, place = tip_pose(panda, found.analysis.posture.q)
    disk = scene.solids[1]
    aside = (disk.vertices - place) @ R @ found.analysis.lost_directions[0]
    assert_close(aside, np.zeros(len(aside)), scale=scene_size(panda))
    assert len(disk.vertices) == 25


def test_the_polytope_is_drawn_in_the_scale_of_the_arrows(panda):
    found, scene = shown(
        panda, locked=[2], limits="urdf", force=[0, 0, 30], show={"solid": "polytope"}
    )
    R, place = tip_pose(panda, found.analysis.posture.q)
    for solid, after in zip(scene.solids, (False, True), strict=True):
        F = (solid.vertices - place) @ R / scene.scales.force
        wanted = found.capability.polytope(after=after).vertices
        assert_close(F, wanted)
        lengths = np.linalg.norm(solid.vertices - place, axis=1)
        assert lengths.max() <= 0.45 * scene_size(panda) * (1 + 1e-9)


def test_what_cannot_be_drawn_is_said(panda):
    for options, word in (
        ({"task": "wrench"}, "only for tasks of forces or of moments"),
        ({}, "known limits do not bound the forces"),
        ({"task": "wrench", "solid": "ellipsoid"}, "only for tasks of forces or of moments"),
    ):
        solid = options.pop("solid", "polytope")
        _, scene = shown(panda, show={"solid": solid}, **options)
        assert not scene.solids
        assert any(word in note for note in scene.notes)


def test_a_pulled_force_ends_where_the_hand_is(panda):
    found, scene = shown(panda, locked=[4], force=[10, 20, -60])
    end = scene.arrows[0].end + np.array([0.03, -0.02, 0.05])
    wrench = dragged_wrench(scene, found, end)
    again = picture(answer(panda, found.state.pushing(wrench)), scene)
    assert again.scales == scene.scales
    assert np.abs(again.arrows[0].end - end).max() <= 0.005
    assert (wrench[3:] == 0.0).all()
    found, scene = shown(panda, task="fx,fz", force=[10, 20])
    assert dragged_wrench(scene, found, end)[1] == found.state.wrench[1]  # no part of the task


def test_polygons_become_triangles():
    assert triangles(((4, 1, 2, 3), (0, 1))).tolist() == [[4, 1, 2], [4, 2, 3]]
    assert triangles(()).shape == (0, 3)


def test_the_surface_of_an_ellipsoid_is_closed():
    vertices, faces = ellipsoid(np.diag([1.0, 2.0, 3.0]))
    assert_close(np.linalg.norm(vertices / [1.0, 2.0, 3.0], axis=1), np.ones(len(vertices)))
    assert faces.max() == len(vertices) - 1
    edges = np.sort(np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_is_turned_along_an_arrow(axis):
    for vector in (*np.eye(3), *-np.eye(3), np.array([1.0, -2.0, 0.5])):
        R = rotation(along(vector, axis))
        assert_close(R[:, axis], vector / np.linalg.norm(vector))
        assert_close(R.T @ R, np.eye(3))
        assert np.linalg.det(R) > 0.0


def test_the_camera_sees_every_point():
    rng = np.random.default_rng(3)
    for _ in range(20):
        points = rng.normal(size=(50, 3)) * rng.uniform(0.1, 2.0, 3)
        eye, target = viewpoint(points, 0.02)
        towards = (eye - target) / np.linalg.norm(eye - target)
        right = np.cross([0, 0, 1], towards)
        right /= np.linalg.norm(right)
        depth = np.linalg.norm(eye - target) - (points - target) @ towards
        slope = math.tan(math.radians(20.0))
        assert (np.abs((points - target) @ np.cross(towards, right)) < depth * slope).all()
        assert (np.abs((points - target) @ right) < 0.66 * depth * slope).all()
