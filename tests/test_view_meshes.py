"""What an arm looks like: against coal and Pinocchio's own geometry, and with meshes missing."""

import struct
import time

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial import cKDTree

from ftforce import known_robots, load_robot
from ftforce.errors import FileError
from ftforce.posture import choose_posture
from ftforce.view import mesh_files, meshes, shapes
from ftforce.view.mesh_files import read_mesh
from ftforce.view.meshes import MOST_SHOWN, load_geometry
from ftforce.view.visuals import read_visuals
from helpers import KNOWN, assert_close
from urdfs import BODY, arm, link, write

pytestmark = pytest.mark.thorough


def volume(mesh):
    """Return the volume that triangles enclose, positive if they face outwards."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def is_closed(mesh):
    """Whether every edge is used once in each direction, by places rather than indices."""
    _, same = np.unique(np.round(mesh.vertices, 9), axis=0, return_inverse=True)
    faces = same[mesh.faces]
    edges = [tuple(edge) for face in faces for edge in zip(face, np.roll(face, -1), strict=True)]
    return len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)


# ---- simple solids ---------------------------------------------------------------------------

SIDES = shapes.ROUND
FLAT = SIDES * np.sin(2 * np.pi / SIDES) / 2  # area of the polygon in a circle of radius 1


@pytest.mark.parametrize(
    ("solid", "size", "wanted", "tolerance"),
    [
        (shapes.box(1.0, 2.0, 3.0), (1, 2, 3), 6.0, 1e-12),
        (shapes.cylinder(0.5, 2.0), (1, 1, 2), FLAT * 0.25 * 2, 1e-12),
        (shapes.sphere(0.5), (1, 1, 1), np.pi / 6, 0.02),
        (shapes.capsule(0.5, 2.0), (1, 1, 3), np.pi * (1 / 6 + 0.5), 0.02),
        (shapes.between(np.zeros(3), np.array([0, 0, 2.0]), 0.5), (1, 1, 3), 2.0944, 0.02),
    ],
)
def test_solids_are_closed_face_outwards_and_have_their_size(solid, size, wanted, tolerance):
    assert is_closed(solid)
    assert_close(np.ptp(solid.vertices, axis=0), size)
    assert volume(solid) == pytest.approx(wanted, rel=tolerance)


def test_edges_of_boxes_and_cylinders_stay_sharp():
    # The page shades triangles that share a vertex as one smooth surface.
    for solid, sides in ((shapes.box(1, 2, 3), 6), (shapes.cylinder(1, 2), 3)):
        parent = np.arange(len(solid.vertices))
        for _ in range(len(parent)):
            lowest = parent[solid.faces].min(axis=1)
            before = parent.copy()
            np.minimum.at(parent, solid.faces.ravel(), np.repeat(lowest, 3))
            if np.array_equal(before, parent):
                break
        assert len(np.unique(parent[solid.faces])) == sides


@pytest.mark.parametrize("end", [(0, 0, 1), (0, 0, -2), (1, 0, 0), (0.3, -2, 1)])
def test_a_rod_goes_from_one_point_to_another(end):
    start, end = np.array([1.0, 2.0, 3.0]), np.array(end, dtype=float)
    rod = shapes.between(start, start + end, 0.1)
    from_start = np.linalg.norm(rod.vertices - start, axis=1)
    from_end = np.linalg.norm(rod.vertices - start - end, axis=1)
    assert_close([from_start.min(), from_end.min()], [0.1, 0.1])
    assert from_start.max() == pytest.approx(np.linalg.norm(end) + 0.1)


def test_a_mirror_image_still_faces_outwards():
    assert volume(shapes.scaled(shapes.box(1, 1, 1), (1, -2, 1))) == pytest.approx(2)
    assert volume(shapes.scaled(shapes.box(1, 1, 1), (-1, -2, 1))) == pytest.approx(2)


def test_equal_vertices_become_one():
    solid = shapes.sphere(1.0)
    joined = shapes.joined(solid.vertices[solid.faces].astype(np.float32))
    places = np.unique(solid.vertices.astype(np.float32) + np.float32(0), axis=0)
    assert len(joined.vertices) == len(places)
    assert_close(joined.vertices[joined.faces], solid.vertices[solid.faces], tol=1e-6)
    # A zero and a negative zero are one place, and a triangle without area goes.
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[-0.0, 0, 0], [0, 0, -0.0], [1, 0, 0]]])
    assert [len(x) for x in shapes.joined(corners.astype(np.float32))] == [3, 1]


def test_a_coarser_mesh_stays_within_a_cell():
    solid = shapes.sphere(1.0)
    coarse = shapes.coarser(solid, 0.2)
    assert 8 < len(coarse.faces) < len(solid.faces)
    assert np.abs(np.linalg.norm(coarse.vertices, axis=1) - 1.0).max() < 0.2
    assert coarse.faces.max() < len(coarse.vertices)
    assert volume(coarse) == pytest.approx(volume(solid), rel=0.1)
    assert len(shapes.coarser(solid, 10.0).faces) == 0


# ---- files -----------------------------------------------------------------------------------


def stl(corners, count=None):
    """Return a binary STL of corners (f, 3, 3)."""
    triangles = b"".join(struct.pack("<12fH", 0, 0, 0, *one.ravel(), 0) for one in corners)
    return b" " * 80 + struct.pack("<I", len(corners) if count is None else count) + triangles


def box_corners(*sides):
    solid = shapes.box(*sides)
    return solid.vertices[solid.faces]


def area(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0


@pytest.mark.parametrize("name", ["xarm7", "tiago", "panda", "ur3", "ur5", "baxter_left", "z1"])
def test_files_are_read_as_others_read_them(name):
    paths = {one.path for one in read_visuals(known_robots()[name].urdf).shapes if one.path}
    for path in sorted(paths)[:8]:
        ours = read_mesh(path)
        low, high = ours.vertices.min(axis=0), ours.vertices.max(axis=0)
        # coal has the places right, but mixes up triangles where there are several materials.
        model = coal.MeshLoader(coal.NODE_TYPE.BV_AABB).load(str(path), np.ones(3))
        vertices = np.array(model.vertices())
        assert_close(low, vertices.min(axis=0), scale=1.0, tol=1e-6)
        assert_close(high, vertices.max(axis=0), scale=1.0, tol=1e-6)
        theirs = trimesh.load(path, force="mesh")
        assert len(ours.faces) == pytest.approx(len(theirs.faces), rel=0.01)
        assert area(ours) == pytest.approx(theirs.area, rel=1e-4)
        if theirs.is_watertight:
            assert volume(ours) == pytest.approx(theirs.volume, rel=1e-3)


def collada(nodes, unit="", library="", shapes=""):
    """Return a COLLADA file of a triangle and a square, both in one geometry."""
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
    <asset>{unit}<up_axis>Y_UP</up_axis></asset>
    <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
    <technique_common><accessor source="#pa" count="4" stride="3"/></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    {shapes or TRIANGLE + SQUARE}</mesh></geometry></library_geometries>
    <library_nodes>{library}</library_nodes>
    <library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
    <scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


CORNER = '<input semantic="VERTEX" source="#v" offset="{}"/>'
NORMAL = '<input semantic="NORMAL" source="#n" offset="{}"/>'
TRIANGLE = (
    f'<triangles count="1">{CORNER.format(0)}{NORMAL.format(1)}<p>0 9 1 9 2 9</p></triangles>'
)
SQUARE = (
    f'<polylist count="1">{NORMAL.format(0)}{CORNER.format(1)}'
    "<vcount>4</vcount><p>9 0 9 1 9 2 9 3</p></polylist>"
)
HERE = '<instance_geometry url="#g"/>'


@pytest.fixture
def dae(tmp_path):
    def read(*args, **parts):
        (tmp_path / "a.dae").write_text(collada(*args, **parts))
        return read_mesh(tmp_path / "a.dae")

    return read


def test_all_materials_of_a_collada_file_are_read(dae):
    mesh = dae(f"<node>{HERE}</node>")
    assert len(mesh.faces) == 3
    assert area(mesh) == pytest.approx(1.5)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_polygons_become_fans(dae):
    one = f"<polygons>{CORNER.format(0)}<p>0 1 2 3</p><p>0 1 2</p><p>0 1</p></polygons>"
    mesh = dae(f"<node>{HERE}</node>", shapes=one)
    assert (len(mesh.faces), area(mesh)) == (3, pytest.approx(1.5))
    counts, corners = "<vcount>3 4 2 3</vcount>", "<p>0 1 2 0 1 2 3 0 1 1 2 3</p>"
    mixed = f"<polylist>{CORNER.format(0)}{counts}{corners}</polylist>"
    mesh = dae(f"<node>{HERE}</node>", shapes=mixed)
    assert (len(mesh.faces), area(mesh)) == (4, pytest.approx(2.0))


def test_nodes_turn_shift_and_scale_one_after_the_other(dae):
    turn = "<translate>1 0 0</translate><rotate>0 0 2 90</rotate><scale>2 1 1</scale>"
    matrix = "<matrix>1 0 0 0 0 1 0 0 0 0 1 5 0 0 0 1</matrix>"
    mesh = dae(f"<node>{turn}<node>{matrix}{HERE}</node></node>")
    assert_close(mesh.vertices.min(axis=0), [0, 0, 5])
    assert_close(mesh.vertices.max(axis=0), [1, 2, 5])


def test_a_mirrored_node_still_faces_outwards(dae):
    mesh = dae(f"<node><scale>1 1 -1</scale>{HERE}</node>")
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] < 0).all()


def test_a_unit_counts_and_the_up_axis_does_not(dae):
    mesh = dae(f"<node>{HERE}</node>", unit='<unit name="millimeter" meter="0.001"/>')
    assert_close(np.ptp(mesh.vertices, axis=0), [0.001, 0.001, 0.0])


def test_nodes_of_the_library_are_used_as_often_as_they_are_named(dae):
    library = f'<node id="n"><translate>0 0 1</translate>{HERE}</node>'
    named = '<instance_node url="#n"/>'
    mesh = dae(
        f"<node>{named}</node><node><translate>0 0 1</translate>{named}</node>", library=library
    )
    assert len(mesh.faces) == 6
    assert set(mesh.vertices[:, 2]) == {1.0, 2.0}


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"nodes": '<node><instance_geometry url="#x"/></node>'}, "does not hold"),
        ({"nodes": '<node><instance_geometry url="http://a/b.dae#g"/></node>'}, "does not hold"),
        ({"nodes": '<node id="l"><instance_node url="#l"/></node>'}, "too many nodes"),
        ({"nodes": "<node/>"}, "no triangles"),
        ({"nodes": f"<node><matrix>1 2</matrix>{HERE}</node>"}, "reshape"),
        ({"nodes": f"<node><matrix>{'nan ' * 16}</matrix>{HERE}</node>"}, "not finite"),
        ({"nodes": f"<node>{HERE}</node>", "unit": '<unit meter="0"/>'}, "no length"),
        ({"nodes": f"<node>{HERE}</node>", "unit": '<unit meter="inf"/>'}, "no length"),
        ({"shapes": f"<triangles>{CORNER.format(0)}<p>0 1 4</p></triangles>"}, "do not exist"),
        ({"shapes": f"<triangles>{CORNER.format(0)}<p>0 1 -1</p></triangles>"}, "do not exist"),
        ({"shapes": f"<triangles>{CORNER.format(0)}<p>0 1 x</p></triangles>"}, "invalid"),
        ({"shapes": f"<triangles>{CORNER.format(0)}<p>0 1</p></triangles>"}, "reshape"),
        ({"shapes": f"<triangles>{CORNER.format(10**9)}<p>0 1 2</p></triangles>"}, "offsets"),
        ({"shapes": f"<triangles>{NORMAL.format(0)}<p>0 1 2</p></triangles>"}, "no vertices"),
        ({"shapes": f"<polylist>{CORNER.format(0)}<vcount>9</vcount><p>0</p></polylist>"}, "more"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_collada_file_is_said(dae, parts, words):
    with pytest.raises(FileError, match=words):
        dae(**{"nodes": f"<node>{HERE}</node>", **parts})


def test_nodes_that_multiply_are_stopped(dae):
    doubled = [
        f'<node id="n{i}">{2 * f"""<instance_node url="#n{i + 1}"/>"""}</node>' for i in range(40)
    ]
    started = time.monotonic()
    with pytest.raises(FileError, match="too many nodes"):
        dae(
            '<node><instance_node url="#n0"/></node>',
            library="".join(doubled) + f'<node id="n40">{HERE}</node>',
        )
    assert time.monotonic() - started < 5.0


def test_every_form_of_a_file_gives_the_same_mesh(tmp_path):
    corners = box_corners(1, 2, 3)
    (tmp_path / "binary.stl").write_bytes(stl(corners))
    text = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*corner) for corner in one)
        + "endloop\nendfacet\n"
        for one in corners
    )
    (tmp_path / "text.STL").write_text(f"solid a\n{text}endsolid a\n")
    solid = shapes.box(1, 2, 3)
    lines = ["v {} {} {}".format(*v) for v in solid.vertices]
    lines += ["f {}/1/1 {}//2 {} # a".format(*(f + 1)).split(" #")[0] for f in solid.faces]
    (tmp_path / "box.obj").write_text("\n".join(lines) + "\n")
    for name in ("binary.stl", "text.STL", "box.obj"):
        mesh = read_mesh(tmp_path / name)
        assert len(mesh.faces) == 12, name
        assert volume(mesh) == pytest.approx(6.0), name
        assert_close(np.ptp(mesh.vertices, axis=0), [1, 2, 3])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", b""),
        ("a.stl", b"\x00" * 84),
        ("a.stl", stl(box_corners(1, 1, 1))[:-7]),
        ("a.stl", stl(box_corners(1, 1, 1), count=10**9)),
        ("a.stl", stl(np.full((2, 3, 3), np.nan))),
        ("a.stl", stl(1e30 * box_corners(1, 1, 1))),
        ("a.stl", stl(np.zeros((4, 3, 3)))),
        ("a.stl", b"solid a\nfacet\n"),
        ("a.dae", b"<COLLADA>"),
        ("a.dae", b"no xml"),
        ("a.dae", b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><COLLADA>&a;</COLLADA>'),
        ("a.dae", b"<robot/>"),
        ("a.obj", b"v 1 2\nf 1 2 3\n"),
        ("a.obj", b"v 1 2 3\nv 1 2 3\nf 1 2 3\n"),
        ("a.obj", b"v 1 2 3\nv 1 2 3\nf 0 1 2\n"),
        ("a.obj", b"v 1 2 x\n"),
        ("a.obj", b"v 1 2 3\nf 1/1/1\n"),
        ("a.stl", b"solid a vertex 1 2 x"),
        ("a.stl", b"solid a vertex 1 2 3 vertex 1 2 3"),
        ("a.stl", b"solid a" + b" vertex 1 2 1e300" * 3),
        ("a.obj", b"\xff" * 100),
    ],
)
def test_a_file_that_is_no_mesh_is_an_error_and_nothing_is_printed(tmp_path, capfd, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError):
        read_mesh(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_files_that_are_too_large_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.stl"
    path.write_bytes(stl(box_corners(1, 1, 1)))
    monkeypatch.setattr(mesh_files, "MOST_TRIANGLES", 11)
    with pytest.raises(FileError, match="12 triangles; at most 11"):
        read_mesh(path)
    monkeypatch.setattr(mesh_files, "LARGEST_MESH", 100)
    with pytest.raises(FileError, match="larger than"):
        read_mesh(path)


# ---- where the links are ---------------------------------------------------------------------


def in_the_world(robot, geometry, q):
    """Return vertices and centres of triangles at a posture."""
    pin.forwardKinematics(robot.model, robot.data, robot.to_model(q))
    points, centres = [], []
    for part in geometry.parts:
        pose = robot.data.oMi[part.joint]
        here = part.vertices.astype(float) @ pose.rotation.T + pose.translation
        points.append(here)
        centres.append(here[part.faces].mean(axis=1))
    return np.concatenate(points), np.concatenate(centres)


def by_pinocchio(robot, q):
    """Return the same of the meshes that Pinocchio loads, from the whole URDF."""
    share = next(f for f in known_robots()[robot.name].urdf.parents if f.name == "share")
    model = pin.buildModelFromUrdf(robot.path)
    geometry = pin.buildGeomFromUrdf(model, robot.path, pin.GeometryType.VISUAL, None, [str(share)])
    configuration = pin.neutral(model)
    values = dict(robot.held) | dict(zip(robot.names, q, strict=True))
    for name, value in values.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:
            configuration[joint.idx_q] = value
        else:
            configuration[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
    data, placed = model.createData(), geometry.createData()
    pin.forwardKinematics(model, data, configuration)
    pin.updateGeometryPlacements(model, data, geometry, placed)
    points, centres = [], []
    for shape, pose in zip(geometry.geometryObjects, placed.oMg, strict=True):
        if hasattr(shape.geometry, "vertices"):
            here = np.array(shape.geometry.vertices()) @ pose.rotation.T + pose.translation
            faces = [shape.geometry.tri_indices(i) for i in range(shape.geometry.num_tris)]
            points.append(here)
            centres.append(here[[[f[0], f[1], f[2]] for f in faces]].mean(axis=1))
    return np.concatenate(points), np.concatenate(centres)


@pytest.mark.parametrize("name", ["panda", "ur5", "xarm7", "tiago", "kinova", "pr2_left"])
def test_links_are_where_pinocchio_has_them(name, monkeypatch):
    monkeypatch.setattr(meshes, "MOST_SHOWN", 10**9)  # as their files have them
    robot = load_robot(name)
    geometry = load_geometry(robot)
    q = choose_posture(robot, None, None).q + np.linspace(-0.3, 0.2, robot.n)
    (points, centres), (their_points, their_centres) = (
        in_the_world(robot, geometry, q), by_pinocchio(robot, q)
    )  # fmt: skip
    assert cKDTree(points).query(their_points)[0].max() < 2e-6
    if not any(one.shape != "mesh" for one in read_visuals(robot.path).shapes):
        assert cKDTree(their_points).query(points)[0].max() < 2e-6
    if name != "ur5":  # of which coal mixes up the triangles
        assert cKDTree(centres).query(their_centres)[0].max() < 2e-6


@pytest.mark.parametrize("name", ["z1", "panda"])
def test_a_robot_with_many_triangles_is_shown_with_fewer(name):
    robot = load_robot(name)
    geometry = load_geometry(robot)
    q = choose_posture(robot, None, None).q
    ours, theirs = in_the_world(robot, geometry, q)[0], by_pinocchio(robot, q)[0]
    assert all(part.flat for part in geometry.parts)
    assert 0.3 * MOST_SHOWN < sum(len(part.faces) for part in geometry.parts) <= MOST_SHOWN
    assert cKDTree(theirs).query(ours)[0].max() < 0.004
    assert cKDTree(ours).query(theirs)[0].max() < 0.004


@pytest.mark.parametrize("name", KNOWN)
def test_the_known_robots_are_shown_whole(name):
    robot = load_robot(name)
    geometry = load_geometry(robot)
    assert geometry.notes == ()
    joints = [part.joint for part in geometry.parts]
    assert joints == sorted(set(joints))
    assert set(joints) <= set(range(robot.model.njoints))
    assert len(joints) >= robot.n
    for part in geometry.parts:
        assert part.vertices.dtype == np.float32
        assert part.faces.dtype == np.uint32
        assert part.vertices.shape[1:] == part.faces.shape[1:] == (3,)
        assert part.faces.max() < len(part.vertices)
        assert np.isfinite(part.vertices).all()
        assert not part.vertices.flags.writeable
    assert sum(len(part.faces) for part in geometry.parts) <= MOST_SHOWN


def test_meshes_of_files_are_shaded_flat_and_simple_shapes_smoothly():
    assert all(part.flat for part in load_geometry(load_robot("panda")).parts)
    assert not any(part.flat for part in load_geometry(load_robot("dh5")).parts)


def test_each_file_is_read_once(monkeypatch):
    read = []
    monkeypatch.setattr(meshes, "read_mesh", lambda path: read.append(path) or read_mesh(path))
    load_geometry(load_robot("panda"))
    assert len(read) == len(set(read)) == 10  # eleven visuals: the fingers share theirs


# ---- what is missing -------------------------------------------------------------------------


def mesh_visual(filename, **attributes):
    more = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<visual><geometry><mesh filename="{filename}"{more}/></geometry></visual>'


@pytest.fixture
def shown(tmp_path):
    """Return an arm, and its look, with something in the link between its first two joints."""

    def make(*visuals):
        robot = load_robot(write(tmp_path, arm(l1=link("l1", BODY + "".join(visuals)))))
        return robot, load_geometry(robot)

    return make


def reaches(part, point, radius=0.1):
    return np.linalg.norm(part.vertices - point, axis=1).min() < radius


@pytest.mark.parametrize("content", [None, b"rubbish", b""])
def test_a_link_whose_mesh_cannot_be_had_is_a_rod_to_the_next_joint(tmp_path, shown, content):
    if content is not None:
        (tmp_path / "a.stl").write_bytes(content)
    robot, geometry = shown(mesh_visual("a.stl"))
    (note,) = geometry.notes
    assert "a.stl" in note
    (part,) = geometry.parts
    assert part.joint == 1
    assert reaches(part, np.zeros(3))
    assert reaches(part, robot.model.jointPlacements[2].translation)
    assert np.linalg.norm(part.vertices, axis=1).max() < 0.6


def test_a_mesh_is_scaled_and_put_where_its_origin_says(tmp_path, shown):
    (tmp_path / "a.stl").write_bytes(stl(1000.0 * box_corners(1, 2, 3)))
    origin = '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'
    one = mesh_visual("a.stl", scale="0.001 0.001 0.001").replace("<visual>", f"<visual>{origin}")
    _, geometry = shown(one)
    (part,) = geometry.parts
    assert geometry.notes == ()
    assert_close(part.vertices.max(axis=0), [2.0, 0.5, 1.5], tol=1e-6)
    assert_close(part.vertices.min(axis=0), [0.0, -0.5, -1.5], tol=1e-6)


def test_a_mesh_that_is_no_part_of_an_arm_is_left_out(tmp_path, shown):
    (tmp_path / "a.stl").write_bytes(stl(1000.0 * box_corners(1, 2, 3)))
    _, geometry = shown(mesh_visual("a.stl", scale="10 10 10"))
    assert "too large" in geometry.notes[0]
    assert np.abs(geometry.parts[0].vertices).max() < 1.0


def test_files_are_not_read_beyond_all_bounds(tmp_path, shown, monkeypatch):
    for name in ("a.stl", "b.stl"):
        (tmp_path / name).write_bytes(stl(box_corners(1, 2, 3)))
    monkeypatch.setattr(meshes, "LARGEST_TOTAL", 1000)
    _, geometry = shown(mesh_visual("a.stl"), mesh_visual("b.stl"))
    (note,) = geometry.notes
    assert "b.stl" in note


def test_an_arm_without_any_look_is_shown_as_rods(shown):
    robot, geometry = shown()
    assert "does not say" in geometry.notes[0]
    assert [part.joint for part in geometry.parts] == list(range(robot.model.njoints))
    for part in geometry.parts[:-1]:
        assert reaches(part, robot.model.jointPlacements[part.joint + 1].translation)
    assert reaches(geometry.parts[-1], robot.model.frames[robot.tip_frame].placement.translation)


def test_an_arm_whose_file_has_gone_is_shown_as_rods(tmp_path):
    path = write(tmp_path, arm())
    robot = load_robot(path)
    path.unlink()
    geometry = load_geometry(robot)
    assert "no such file" in geometry.notes[0]
    assert len(geometry.parts) == robot.model.njoints


def test_notes_show_names_as_they_can_be_printed(shown):
    _, geometry = shown(mesh_visual("&#x9b;31m&#x202e;.stl"))
    assert geometry.notes
    assert all(note.isprintable() for note in geometry.notes)
