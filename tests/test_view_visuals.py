"""What a URDF says its links look like: read, found on the disk, and never a reason to fail."""

import os

import numpy as np
import pinocchio as pin
import pytest

from ftforce.errors import URDFError
from ftforce.view.geometry.visuals import find_mesh, read_visuals
from helpers import assert_close
from urdfs import BODY, arm, link, write


def looks(*visuals, name="l1"):
    """Return an arm one of whose links looks like this."""
    return arm(**{name: link(name, BODY + "".join(visuals))})


def visual(shape, origin=""):
    return f"<visual>{origin}<geometry>{shape}</geometry></visual>"


@pytest.fixture
def read(tmp_path):
    return lambda urdf: read_visuals(write(tmp_path, urdf))


def only(visuals):
    """Return the one shape of visuals without notes."""
    assert visuals.notes == ()
    (shape,) = visuals.shapes
    return shape


@pytest.mark.parametrize(
    ("shape", "kind", "size"),
    [
        ('<box size="1 2 3"/>', "box", (1, 2, 3)),
        ('<cylinder radius="0.1" length="2"/>', "cylinder", (0.1, 2)),
        ('<sphere radius="0.5"/>', "sphere", (0.5,)),
    ],
)
def test_simple_shapes_are_read(read, shape, kind, size):
    found = only(read(looks(visual(shape))))
    assert (found.link, found.shape, found.size) == ("l1", kind, size)
    assert (found.path, found.named) == (None, "")
    assert_close(found.placement, np.eye(4))


def test_a_shape_lies_where_its_origin_says(read):
    origin = '<origin xyz="1 2 3" rpy="0.3 -0.4 2"/>'
    found = only(read(looks(visual('<sphere radius="1"/>', origin))))
    assert_close(found.placement[:3, 3], [1, 2, 3])
    assert_close(found.placement[:3, :3], pin.rpy.rpyToMatrix(0.3, -0.4, 2.0))
    assert_close(found.placement[3], [0, 0, 0, 1])


def test_a_mesh_has_a_scale_and_a_file(tmp_path, read):
    (tmp_path / "part.STL").write_bytes(b"x")
    found = only(read(looks(visual('<mesh filename="part.STL" scale="1 -2 0.001"/>'))))
    assert found.size == (1.0, -2.0, 0.001)
    assert found.path == tmp_path / "part.STL"
    assert found.named == "part.STL"
    missing = only(read(looks(visual('<mesh filename="package://a/none.dae"/>'))))
    assert (missing.path, missing.named) == (None, "package://a/none.dae")


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ("", "it has no box, cylinder, sphere or mesh"),
        ('<box size="1 2"/>', "expected 3 numbers"),
        ('<box size="1 1e9 2"/>', "too large"),
        ('<box size="1 -1 2"/>', "must be positive"),
        ('<cylinder radius="1"/>', "length"),
        ('<mesh filename="http://example.org/a.stl"/>', "not a local file"),
        ('<mesh filename="/etc/passwd"/>', "unknown mesh format"),
        ('<mesh filename="package://a/../../b.stl"/>', "outside its package"),
        ('<mesh filename="package:///etc/b.stl"/>', "outside its package"),
        ('<mesh filename="a.stl" scale="x"/>', "not a number"),
    ],
)
def test_what_is_wrong_with_a_shape_is_a_note_and_the_rest_is_shown(read, shape, words):
    found = read(looks(visual(shape), visual('<sphere radius="1"/>')))
    assert [one.shape for one in found.shapes] == ["sphere"]
    (note,) = found.notes
    assert words in note
    assert "link 'l1'" in note


def test_a_visual_without_geometry_or_with_a_wrong_origin_is_a_note(read):
    assert read(looks("<visual/>")).notes
    (note,) = read(looks(visual('<sphere radius="1"/>', '<origin rpy="1 2"/>'))).notes
    assert "origin rpy" in note


def test_what_cannot_be_read_at_all_is_an_error(tmp_path):
    with pytest.raises(URDFError, match="no such file"):
        read_visuals(tmp_path / "none.urdf")
    bomb = '<!DOCTYPE x [<!ENTITY a "aaaa">]><robot name="x"><link name="&a;"/></robot>'
    with pytest.raises(URDFError, match="DTD"):
        read_visuals(write(tmp_path, bomb))


# ---- where meshes are ------------------------------------------------------------------------


@pytest.fixture
def packages(tmp_path):
    """Make a package with a URDF and a mesh, and another one beside it."""
    for place in ("src/mine/meshes/a.stl", "src/other/b.dae", "src/mine/urdf/c.obj"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_bytes(b"x")
    urdf = tmp_path / "src/mine/urdf/arm.urdf"
    urdf.write_text("<robot/>")
    return tmp_path / "src", urdf


@pytest.mark.parametrize(
    ("named", "place"),
    [
        ("package://mine/meshes/a.stl", "mine/meshes/a.stl"),
        ("package://called_otherwise/meshes/a.stl", "mine/meshes/a.stl"),
        ("package://other/b.dae", "other/b.dae"),
        ("model://other/b.dae", "other/b.dae"),
        ("../meshes/a.stl", "mine/meshes/a.stl"),
        ("c.obj", "mine/urdf/c.obj"),
        ("meshes/a.stl", "mine/meshes/a.stl"),
    ],
)
def test_meshes_are_found_above_the_urdf(packages, named, place):
    folder, urdf = packages
    found = find_mesh(named, urdf)
    assert found is not None
    assert found.resolve() == (folder / place).resolve()


def test_the_urdfs_path_may_be_relative(packages, monkeypatch):
    folder, urdf = packages
    monkeypatch.chdir(folder / "mine")
    found = find_mesh("package://other/b.dae", urdf.relative_to(folder / "mine"))
    assert found == folder / "other/b.dae"


def test_absolute_paths_and_file_urls_are_taken_as_they_are(packages, tmp_path):
    folder, urdf = packages
    spaced = folder / "with space.stl"
    spaced.write_bytes(b"x")
    assert find_mesh(str(spaced), urdf) == spaced
    assert find_mesh(f"file://{folder}/with%20space.stl", urdf) == spaced
    assert find_mesh(str(folder / "none.stl"), urdf) is None


@pytest.mark.parametrize(
    ("variable", "below"), [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")]
)
def test_ros_is_asked_last(packages, tmp_path, monkeypatch, variable, below):
    _, urdf = packages
    place = tmp_path / "ros" / below / "far" / "d.stl"
    place.parent.mkdir(parents=True)
    place.write_bytes(b"x")
    assert find_mesh("package://far/d.stl", urdf) is None
    monkeypatch.setenv(variable, os.pathsep.join(["", str(tmp_path / "ros")]))
    assert find_mesh("package://far/d.stl", urdf) == place


def test_a_folder_or_a_pipe_is_no_mesh(packages):
    folder, urdf = packages
    (folder / "folder.stl").mkdir()
    os.mkfifo(folder / "pipe.stl")
    for name in ("folder.stl", "pipe.stl", "x" * 400 + ".stl"):
        assert find_mesh(str(folder / name), urdf) is None
