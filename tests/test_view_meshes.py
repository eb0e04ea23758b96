"""What an arm looks like: against coal and Pinocchio's own geometry, and with meshes missing."""

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial import cKDTree

from ftforce import known_robots, load_robot
from ftforce.errors import FileError
from ftforce.robot.posture import choose_posture
from ftforce.view.geometry import mesh_files, meshes, shapes
from ftforce.view.geometry.mesh_files import read_mesh
from ftforce.view.geometry.meshes import MAX_SHOWN, load_geometry
from ftforce.view.geometry.visuals import read_visuals
from helpers import KNOWN, assert_close
from urdfs import BODY, arm, link, write

pytestmark = pytest.mark.thorough


# ---- simple solids ---------------------------------------------------------------------------

SIDES = shapes.SEGMENTS
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
    closed = solid.copy()
    closed.merge_vertices()
    assert closed.is_watertight
    assert closed.is_winding_consistent
    assert_close(solid.extents, size)
    assert_close(solid.bounds.mean(axis=0), np.zeros(3) if wanted != 2.0944 else [0, 0, 1])
    assert solid.volume == pytest.approx(wanted, rel=tolerance)


def test_edges_of_boxes_and_cylinders_stay_sharp():
    # The page shades triangles that share a vertex as one smooth surface.
    assert shapes.box(1, 2, 3).body_count == 6
    assert shapes.cylinder(1, 2).body_count == 3
    assert shapes.sphere(1).body_count == 1


@pytest.mark.parametrize("end", [(0, 0, 1), (0, 0, -2), (1, 0, 0), (0.3, -2, 1)])
def test_a_rod_goes_from_one_point_to_another(end):
    start, end = np.array([1.0, 2.0, 3.0]), np.array(end, dtype=float)
    rod = shapes.between(start, start + end, 0.1)
    from_start = np.linalg.norm(rod.vertices - start, axis=1)
    from_end = np.linalg.norm(rod.vertices - start - end, axis=1)
    assert_close([from_start.min(), from_end.min()], [0.1, 0.1])
    assert from_start.max() == pytest.approx(np.linalg.norm(end) + 0.1)


def test_a_coarser_mesh_stays_within_a_cell():
    solid = shapes.sphere(1.0)
    coarse = shapes.decimated(solid, np.full(3, 0.2))
    assert 8 < len(coarse.faces) < len(solid.faces)
    assert np.abs(np.linalg.norm(coarse.vertices, axis=1) - 1.0).max() < 0.2
    assert coarse.volume == pytest.approx(solid.volume, rel=0.1)
    corners = np.sort(coarse.faces, axis=1)
    assert (np.diff(corners, axis=1) > 0).all()
    assert len(np.unique(corners, axis=0)) == len(corners)
    assert len(shapes.decimated(solid, np.full(3, 10.0)).faces) == 0


# ---- files -----------------------------------------------------------------------------------


def stl(corners):
    """Return a binary STL of corners (f, 3, 3)."""
    soup = trimesh.Trimesh(**trimesh.triangles.to_kwargs(corners), process=False)
    return trimesh.exchange.stl.export_stl(soup)


def box_corners(*sides):
    return np.array(shapes.box(*sides).triangles)


@pytest.mark.parametrize("name", ["tiago", "panda", "ur5", "baxter_left"])
def test_files_are_read_as_others_read_them(name):
    paths = {one.path for one in read_visuals(known_robots()[name].urdf).shapes if one.path}
    for path in sorted(paths)[:8]:
        ours = read_mesh(path)
        # coal has the places right, but mixes up triangles where there are several materials.
        model = coal.MeshLoader(coal.NODE_TYPE.BV_AABB).load(str(path), np.ones(3))
        vertices = np.array(model.vertices())
        bounds = [vertices.min(axis=0), vertices.max(axis=0)]
        assert_close(ours.bounds, bounds, scale=1.0, tol=1e-6)
        theirs = trimesh.load_mesh(path)
        assert len(ours.faces) == pytest.approx(len(theirs.faces), rel=0.01)
        assert ours.area == pytest.approx(theirs.area, rel=1e-4)
        if theirs.is_watertight:
            assert ours.volume == pytest.approx(theirs.volume, rel=1e-3)


PARAMS = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")


def source(name, numbers):
    return f"""<source id="{name}"><float_array id="{name}a">{numbers}</float_array>
    <technique_common><accessor source="#{name}a" stride="3">{PARAMS}</accessor>
    </technique_common></source>"""


def collada(nodes, unit="", library="", shapes="", more=""):
    """Return a COLLADA file of a triangle and a square, both in one geometry."""
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
    <asset>{unit}<up_axis>Y_UP</up_axis></asset>{more}
    <library_geometries><geometry id="g"><mesh>
    {source("p", "0 0 0 1 0 0 1 1 0 0 1 0")}{source("n", "0 0 1")}
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    {shapes or TRIANGLE + SQUARE}</mesh></geometry></library_geometries>
    <library_nodes>{library}</library_nodes>
    <library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
    <scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


CORNER = '<input semantic="VERTEX" source="#v" offset="{}"/>'
NORMAL = '<input semantic="NORMAL" source="#n" offset="{}"/>'


FIRST = CORNER.format(0)


def triangles(corners, inputs=FIRST):
    return f"<triangles>{inputs}<p>{corners}</p></triangles>"


def polylist(counts, corners, inputs=FIRST):
    return f"<polylist>{inputs}<vcount>{counts}</vcount><p>{corners}</p></polylist>"


TRIANGLE = triangles("0 0 1 0 2 0", CORNER.format(0) + NORMAL.format(1))
SQUARE = polylist("4", "0 0 0 1 0 2 0 3", NORMAL.format(0) + CORNER.format(1))
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
    assert mesh.area == pytest.approx(1.5)
    assert (mesh.face_normals[:, 2] > 0).all()


@pytest.mark.parametrize(
    ("one", "count"),
    [
        (f"<polygons>{CORNER.format(0)}<p>0 1 2 3</p><p>0 1 2</p></polygons>", 3),
        (polylist("3 4 2 3", "0 1 2 0 1 2 3 0 1 1 2 3"), 4),
    ],
)
def test_polygons_become_fans(dae, one, count):
    mesh = dae(f"<node>{HERE}</node>", shapes=one)
    assert (len(mesh.faces), mesh.area) == (count, pytest.approx(count / 2))


def test_nodes_turn_shift_and_scale_one_after_the_other(dae):
    turn = "<translate>1 0 0</translate><rotate>0 0 2 90</rotate><scale>2 1 1</scale>"
    matrix = "<matrix>1 0 0 0 0 1 0 0 0 0 1 5 0 0 0 1</matrix>"
    mesh = dae(f"<node>{turn}<node>{matrix}{HERE}</node></node>")
    assert_close(mesh.bounds, [[0, 0, 5], [1, 2, 5]], tol=1e-6)  # pycollada has single precision


def test_a_mirrored_node_still_faces_outwards(dae):
    mesh = dae(f"<node><scale>1 1 -1</scale>{HERE}</node>")
    assert (mesh.face_normals[:, 2] < 0).all()


def test_a_unit_counts_and_the_up_axis_does_not(dae):
    mesh = dae(f"<node>{HERE}</node>", unit='<unit name="millimeter" meter="0.001"/>')
    assert_close(mesh.extents, [0.001, 0.001, 0.0])


def test_nodes_of_the_library_are_used_as_often_as_they_are_named(dae):
    library = f'<node id="n"><translate>0 0 1</translate>{HERE}</node>'
    named = '<instance_node url="#n"/>'
    mesh = dae(
        f"<node>{named}</node><node><translate>0 0 1</translate>{named}</node>", library=library
    )
    assert len(mesh.faces) == 6
    assert set(mesh.vertices[:, 2]) == {1.0, 2.0}


def test_what_is_not_shown_is_not_read(dae):
    image = "<library_images><image><init_from>/dev/zero</init_from></image></library_images>"
    bound = '<bind_material><technique_common><instance_material target="#none"/>'
    bound += "</technique_common></bind_material>"
    camera = '<instance_camera url="#none"/>'
    here = HERE.replace("/>", f">{bound}</instance_geometry>")
    assert len(dae(f"<node>{camera}{here}</node>", more=image).faces) == 3


@pytest.mark.parametrize("scene", ["<scene/>", ""])
def test_a_file_without_a_chosen_scene_is_shown(tmp_path, scene):
    text = collada(f"<node><translate>0 0 1</translate>{HERE}</node>")
    text = text.replace('<scene><instance_visual_scene url="#s"/></scene>', scene)
    (tmp_path / "a.dae").write_text(text)
    assert_close(read_mesh(tmp_path / "a.dae").vertices[:, 2], np.ones(7))
    text = text.replace("library_visual_scenes", "library_else")
    (tmp_path / "a.dae").write_text(text)
    assert_close(read_mesh(tmp_path / "a.dae").vertices[:, 2], np.zeros(7))


LATE = "".join(f'<node id="n{i}"><instance_node url="#n{i + 1}"/></node>' for i in range(1000))
DOUBLED = "".join(
    f'<node id="n{i}">{2 * f"""<instance_node url="#n{i - 1}"/>"""}</node>' for i in range(1, 41)
)
LAST = '<node><instance_node url="#n40"/></node>'


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"nodes": HERE.replace("#g", "#x").join(["<node>", "</node>"])}, "x not found"),
        ({"nodes": HERE.replace("#", "http://a#").join(["<node>", "</node>"])}, "Invalid url"),
        ({"nodes": '<node id="l"><instance_node url="#l"/></node>'}, "l not found"),
        ({"nodes": LAST, "library": f'<node id="n0">{HERE}</node>{DOUBLED}'}, "too many nodes"),
        ({"library": f'{LATE}<node id="n1000">{HERE}</node>'}, "too many nodes"),
        ({"nodes": "<node>" * 5000 + "</node>" * 5000}, "recursion"),
        ({"nodes": "<node/>"}, "no triangles"),
        ({"nodes": f"<node><matrix>1 2</matrix>{HERE}</node>"}, "matrix"),
        ({"nodes": f"<node><matrix>{'nan ' * 16}</matrix>{HERE}</node>"}, "not finite"),
        ({"unit": '<unit meter="0"/>'}, "not a positive length"),
        ({"unit": '<unit meter="inf"/>'}, "not a positive length"),
        ({"shapes": triangles("0 1 4")}, "a.dae"),
        ({"shapes": triangles("0 1 -1")}, "does not exist"),
        ({"shapes": triangles("0 1 2 x")}, "cannot be read"),
        ({"shapes": triangles("0 1")}, "cannot be read"),
        ({"shapes": triangles("0 0 0", NORMAL.format(0))}, "cannot be read"),
        ({"shapes": polylist("2000000000", "0")}, "more corners"),
        ({"shapes": polylist("-3 4", "0")}, "more corners"),
    ],
)
def test_what_is_wrong_in_a_collada_file_is_said(dae, parts, words):
    with pytest.raises(FileError, match=words):
        dae(**{"nodes": f"<node>{HERE}</node>", **parts})


def test_every_form_of_a_file_gives_the_same_mesh(tmp_path):
    corners = box_corners(1, 2, 3) - [0.5, 0, 0]  # has zeros
    corners[0][corners[0] == 0] = -0.0
    corners = np.concatenate([corners, corners[:1, [0, 0, 1]]])  # and a triangle without area
    solid = trimesh.Trimesh(**trimesh.triangles.to_kwargs(corners), process=False)
    (tmp_path / "binary.stl").write_bytes(stl(corners))
    (tmp_path / "text.STL").write_text(trimesh.exchange.stl.export_stl_ascii(solid))
    lines = ["mtllib /dev/zero", *("v {} {} {}".format(*v) for v in solid.vertices)]
    lines += [f"f {a + 1}/1/1 {b + 1}//2 -{39 - c}" for a, b, c in solid.faces[:12]]
    (tmp_path / "box.obj").write_text("\n".join(lines) + "\n")
    for name in ("binary.stl", "text.STL", "box.obj"):
        mesh = read_mesh(tmp_path / name)
        assert len(mesh.faces) == 12, name
        assert len(mesh.vertices) == (39 if name == "box.obj" else 8), name
        assert mesh.volume == pytest.approx(6.0), name
        assert_close(mesh.extents, [1, 2, 3])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", b""),
        ("a.stl", b"\x00" * 84),
        ("a.stl", stl(box_corners(1, 1, 1))[:-7]),
        ("a.stl", stl(np.where(np.arange(3) == 0, np.nan, box_corners(1, 1, 1)))),
        ("a.stl", stl(1e30 * box_corners(1, 1, 1))),
        ("a.stl", stl(np.zeros((4, 3, 3)))),
        ("a.dae", b"<COLLADA>"),
        ("a.dae", b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><COLLADA>&a;</COLLADA>'),
        ("a.dae", b"<robot/>"),
        ("a.obj", b"v 1 2 3\nv 1 2 3\nf 1 2 3\n"),
        ("a.obj", b"v 1 2 3\nv 1 2 3\nf 0 1 2\n"),
        ("a.obj", b"v 1 2 3\nf 1/1/1\n"),
        ("a.stl", b"solid a\nvertex 1 2 x\nendsolid a"),
        ("a.stl", b"solid a\nvertex 1 2 3\nvertex 1 2 3\nendsolid a"),
        ("a.stl", b"solid a\nfacet\n" + b"vertex 1 2 1e300\n" * 3 + b"endsolid a"),
        ("a.stl", b"solid\nendsolid\n" * 10_000),
        ("a.obj", b"\xff" * 100),
    ],
)
def test_a_file_that_is_no_mesh_is_an_error_and_nothing_is_printed(tmp_path, capfd, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError):
        read_mesh(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_files_that_are_too_large_are_refused(tmp_path, monkeypatch, dae):
    path = tmp_path / "a.stl"
    path.write_bytes(stl(box_corners(1, 1, 1)))
    monkeypatch.setattr(mesh_files, "MAX_TRIANGLES", 11)
    with pytest.raises(FileError, match="12 triangles, more than the maximum of 11"):
        read_mesh(path)
    for most in (5, 2):  # instances count, and a geometry does before it is made
        monkeypatch.setattr(mesh_files, "MAX_TRIANGLES", most)
        with pytest.raises(FileError, match=f"more than {most} triangles"):
            dae(f"<node>{2 * HERE}</node>")
    monkeypatch.setattr(mesh_files, "MAX_BYTES", 100)
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


@pytest.mark.parametrize("name", ["panda", "ur5", "tiago", "pr2_left"])
def test_links_are_where_pinocchio_has_them(name, monkeypatch):
    monkeypatch.setattr(meshes, "MAX_SHOWN", 10**9)  # as their files have them
    robot = load_robot(name)
    geometry = load_geometry(robot)
    q = choose_posture(robot, None, None).q + np.linspace(-0.3, 0.2, robot.n)
    points, centres = in_the_world(robot, geometry, q)
    their_points, their_centres = by_pinocchio(robot, q)
    assert cKDTree(points).query(their_points)[0].max() < 2e-6
    if not any(one.shape != "mesh" for one in read_visuals(robot.path).shapes):
        assert cKDTree(their_points).query(points)[0].max() < 2e-6
    if name != "ur5":  # of which coal mixes up the triangles
        assert cKDTree(centres).query(their_centres)[0].max() < 1e-5  # slivers are gone


def test_a_robot_with_many_triangles_is_shown_with_fewer():
    robot = load_robot("panda")
    geometry = load_geometry(robot)
    q = choose_posture(robot, None, None).q
    ours, theirs = in_the_world(robot, geometry, q)[0], by_pinocchio(robot, q)[0]
    assert all(part.flat for part in geometry.parts)
    assert 0.3 * MAX_SHOWN < sum(len(part.faces) for part in geometry.parts) <= MAX_SHOWN
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
    assert sum(len(part.faces) for part in geometry.parts) <= MAX_SHOWN


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


@pytest.mark.parametrize("content", [None, b"rubbish"])
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


@pytest.mark.parametrize("scale", ["0.001 0.001 0.001", "0.001 -0.001 0.001"])
def test_a_mesh_is_scaled_and_put_where_its_origin_says(tmp_path, shown, scale):
    (tmp_path / "a.stl").write_bytes(stl(1000.0 * box_corners(1, 2, 3)))
    origin = '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'
    _, geometry = shown(mesh_visual("a.stl", scale=scale).replace("<visual>", f"<visual>{origin}"))
    (part,) = geometry.parts
    assert geometry.notes == ()
    assert_close(part.vertices.max(axis=0), [2.0, 0.5, 1.5], tol=1e-6)
    assert_close(part.vertices.min(axis=0), [0.0, -0.5, -1.5], tol=1e-6)
    assert trimesh.Trimesh(part.vertices, part.faces).volume == pytest.approx(6.0)  # not inside out


def test_few_triangles_of_a_mesh_are_scaled_too(tmp_path, shown, monkeypatch):
    (tmp_path / "a.stl").write_bytes(stl(1000.0 * np.array(shapes.sphere(1.0).triangles)))
    monkeypatch.setattr(meshes, "MAX_SHOWN", 600)
    _, geometry = shown(mesh_visual("a.stl", scale="0.001 -0.002 0.001"))
    (part,) = geometry.parts
    assert 200 < len(part.faces) <= 600
    assert_close(np.ptp(part.vertices, axis=0), [2, 4, 2], tol=0.1)
    assert trimesh.Trimesh(part.vertices, part.faces).volume > 0
    _, flat = shown(mesh_visual("a.stl", scale="0.001 0.001 0"))
    assert not flat.parts or np.ptp(flat.parts[0].vertices, axis=0).min() == 0


def test_a_mesh_that_is_no_part_of_an_arm_is_left_out(tmp_path, shown):
    (tmp_path / "a.stl").write_bytes(stl(1000.0 * box_corners(1, 2, 3)))
    _, geometry = shown(mesh_visual("a.stl", scale="10 10 10"))
    assert "too large" in geometry.notes[0]
    assert np.abs(geometry.parts[0].vertices).max() < 1.0


def test_files_are_not_read_beyond_all_bounds(tmp_path, shown, monkeypatch):
    for name in ("a.stl", "b.stl"):
        (tmp_path / name).write_bytes(stl(box_corners(1, 2, 3)))
    monkeypatch.setattr(meshes, "MAX_TOTAL", 1000)
    _, geometry = shown(mesh_visual("a.stl"), mesh_visual("b.stl"))
    (note,) = geometry.notes
    assert "b.stl" in note


def test_an_arm_without_any_look_is_shown_as_rods(shown):
    robot, geometry = shown()
    assert "no visual geometry" in geometry.notes[0]
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
