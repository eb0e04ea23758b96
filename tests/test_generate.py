"""URDF and SRDF made from DH tables, read by Pinocchio and yourdfpy and held against oracles."""

import math
import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import typer
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from ftforce.cli.dh import dh
from ftforce.errors import DHTableError, OutputError, URDFError
from ftforce.robot.formats import dh_to_urdf
from ftforce.robot.formats.dh import DHRow, DHTable, MassModel
from ftforce.robot.formats.dh_to_urdf import to_srdf, to_urdf, write_robot
from helpers import campaign

ROBOTS = Path(__file__).parents[1] / "robots"
DH5 = DHTable.from_toml(ROBOTS / "dh5.toml")
BAR = MassModel("solid cylinder", radius=0.03, density=2700.0)
QUARTER = math.pi / 2


def row(a=0.0, alpha=0.0, d=0.0, theta=0.0, kind="revolute", **others):
    return DHRow(a, alpha, d, theta, kind, -9.0, 9.0, **others)


def table_of(*rows, convention="standard", mass=BAR, **others):
    return DHTable("arm", convention, rows, mass, **others)


# Both conventions and joint types; lengths of both signs and none; right and odd angles.
ROWS = (
    row(0.4, QUARTER, 0.2, 0.3),
    row(-0.3, -0.7, 0.0, QUARTER, "prismatic", mass=1.7),
    row(0.0, 0.0, 0.0, -1.1),
    row(0.0, 2.5, -0.25, math.pi, mass=0.4),
    row(0.15, -QUARTER, 0.1, -2.0, "prismatic"),
)
EXAMPLES = [
    table_of(*ROWS, convention=convention, mass=mass)
    for convention in ("standard", "modified")
    for mass in (BAR, replace(BAR, model="thin rod"))
]


def tip_in_pinocchio(urdf, q):
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.asarray(q))
    return data.oMf[model.getFrameId("tool")].homogeneous


# ---- kinematics ------------------------------------------------------------------------------

lengths = st.floats(0.01, 1.0) | st.floats(-1.0, -0.01) | st.just(0.0)
angles = st.floats(-7.0, 7.0) | st.sampled_from([k * QUARTER for k in range(-4, 5)])
rows = st.builds(row, lengths, angles, lengths, angles, st.sampled_from(["revolute", "prismatic"]))


@given(st.data())
@settings(deadline=None, max_examples=campaign(60, 20))
def test_tip_in_pinocchio_equals_closed_form(data):
    convention = data.draw(st.sampled_from(["standard", "modified"]))
    table = table_of(*data.draw(st.lists(rows, min_size=1, max_size=6)), convention=convention)
    n = len(table.rows)
    q = data.draw(st.lists(st.floats(-3.0, 3.0), min_size=n, max_size=n))
    tip = tip_in_pinocchio(to_urdf(table), q)
    np.testing.assert_allclose(tip, table.transforms(q)[-1], atol=1e-12)


def test_steps_close_to_nothing_are_kept():
    # yourdfpy's own forward kinematics (trimesh) drops them, which is no reason to refuse the arm.
    table = table_of(row(a=1.0), row(theta=5e-9))
    tip = tip_in_pinocchio(to_urdf(table), [0.1, 0.2])
    np.testing.assert_allclose(tip, table.transforms([0.1, 0.2])[-1], atol=1e-15)
    assert origin_of(to_urdf(table), "tool_joint") == ("0 0 0", "0 0 5e-09")


def test_pinocchio_finds_the_joints_and_limits_of_the_table():
    first = replace(ROWS[0], lower=-1.25, upper=2.5, effort=42.0, velocity=3.5, joint="shoulder")
    model = pin.buildModelFromXML(to_urdf(table_of(first, ROWS[1])))
    assert list(model.names) == ["universe", "shoulder", "joint2"]
    np.testing.assert_array_equal(model.lowerPositionLimit, [-1.25, -9])
    np.testing.assert_array_equal(model.upperPositionLimit, [2.5, 9])
    np.testing.assert_array_equal(model.upperEffortLimit, [42, 0])  # 0: unknown
    np.testing.assert_array_equal(model.upperVelocityLimit, [3.5, 0])


# ---- inertia ---------------------------------------------------------------------------------


def rod(start, end, mass, model):
    """Return Pinocchio's cylinder; what its thickness adds across the axis, a thin rod lacks."""
    along, length = end - start, np.linalg.norm(end - start)
    body = pin.Inertia.FromCylinder(mass, model.radius, length)
    lacking = np.diag([1.0, 1.0, 0.0]) * mass * model.radius**2 / 4
    inertia = body.inertia - (lacking if model.model == "thin rod" else 0.0)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along).toRotationMatrix()
    return pin.SE3(turn, (start + end) / 2).act(pin.Inertia(mass, np.zeros(3), inertia))


def rods_of(table, i):
    """End points of the rods of link i in the base frame at q = 0, from the DH frames alone."""
    frames = table.transforms(np.zeros(len(table.rows)))
    if table.convention == "standard":  # from the axis of joint i, frame i-1, to frame i
        start = frames[i - 1][:3, 3]
        corner = start + table.rows[i - 1].d * frames[i - 1][:3, 2]
        end = frames[i][:3, 3]
    else:  # back along d from frame i, and on along the a of the next row
        corner = frames[i][:3, 3]
        start = corner - table.rows[i - 1].d * frames[i][:3, 2]
        a = table.rows[i].a if i < len(table.rows) else 0.0
        end = corner + a * frames[i][:3, 0]
    pieces = [(start, corner), (corner, end)]
    return [(p, q) for p, q in pieces if np.linalg.norm(q - p) > 1e-9]


@pytest.mark.parametrize(
    ("mass", "length"),
    [
        (replace(BAR, model="thin rod"), 0.04),  # thicker than long
        (BAR, 1e200),
        (BAR, 1e7),  # its smaller moment vanishes in rounding
        (replace(BAR, radius=1e-200), 0.4),
    ],
)
def test_sizes_that_no_body_has(mass, length):
    with pytest.raises(
        DHTableError, match=r"arm: link 'link1': the inertia of .* m, radius .*longer than"
    ):
        to_urdf(table_of(row(a=length), mass=mass))


@pytest.mark.parametrize("table", EXAMPLES, ids=lambda t: f"{t.convention}, {t.mass.model}")
def test_inertias_are_those_of_the_solids(table):
    model = pin.buildModelFromXML(to_urdf(table))
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(model.nq))
    links = [(i, rods) for i in range(1, len(table.rows) + 1) if (rods := rods_of(table, i))]
    assert len(links) >= 3
    for i, rods in links:
        lengths = np.array([np.linalg.norm(end - start) for start, end in rods])
        masses = 2700.0 * math.pi * table.mass.radius**2 * lengths
        if table.rows[i - 1].mass is not None:
            masses *= table.rows[i - 1].mass / masses.sum()
        wanted = pin.Inertia.Zero()
        for ends, mass in zip(rods, masses, strict=True):
            wanted += rod(*ends, mass, table.mass)
        link = data.oMi[i].act(model.inertias[i])
        np.testing.assert_allclose(
            link.toDynamicParameters(),
            wanted.toDynamicParameters(),
            rtol=0,
            atol=1e-12 * wanted.mass,
        )


def test_link_without_length_is_a_ball():
    bodies = pin.buildModelFromXML(to_urdf(table_of(row(), row(mass=3.0)))).inertias.tolist()[1:]
    for body, mass in zip(bodies, (2700 * 4 / 3 * math.pi * 0.03**3, 3.0), strict=True):
        wanted = pin.Inertia.FromSphere(mass, 0.03).toDynamicParameters()
        np.testing.assert_allclose(body.toDynamicParameters(), wanted, rtol=1e-12, atol=1e-18)


# ---- the text of the URDF --------------------------------------------------------------------


def test_committed_files_are_what_the_command_makes(tmp_path, capsys):
    dh(ROBOTS / "dh5.toml", tmp_path / "dh5.urdf")
    for name in ("dh5.urdf", "dh5.srdf"):
        assert (tmp_path / name).read_bytes() == (ROBOTS / name).read_bytes()
    assert capsys.readouterr().out == (
        f"wrote {tmp_path / 'dh5.urdf'} and {tmp_path / 'dh5.srdf'}: "
        "5 joints, tip 'tool', postures: paper\n"
    )


def origin_of(urdf, joint):
    element = ElementTree.fromstring(urdf.encode()).find(f"joint[@name='{joint}']/origin")
    return element.get("xyz"), element.get("rpy")


@pytest.mark.parametrize("degrees", [90, 30, 70, -90, 180, 270, 10, -135])
def test_angles_are_written_in_full(degrees):
    angle = math.radians(degrees)
    number = repr(angle)
    twisted = to_urdf(table_of(row(a=0.5, alpha=angle, d=0.1)))
    assert origin_of(twisted, "tool_joint") == ("0.5 0 0.1", f"{number} 0 0")
    turned = to_urdf(table_of(row(d=0.1, theta=angle)))
    assert origin_of(turned, "tool_joint") == ("0 0 0.1", f"0 0 {number}")


@pytest.mark.parametrize("quarters", range(-3, 4))
def test_zeros_are_plain(quarters):
    urdf = to_urdf(table_of(row(0.4, 0.0, -0.0, quarters * QUARTER), row(-0.4, -0.0)))
    assert not re.search(r'[" ]-0[" ]|e-|0\.0[" ]', urdf)


def test_modified_convention_puts_the_first_twist_at_the_base():
    urdf = to_urdf(table_of(row(0.4, 0.7, 0.1, 0.3), row(0.2, -0.5), convention="modified"))
    x, y = 0.2 * math.cos(0.3), 0.2 * math.sin(0.3)
    assert origin_of(urdf, "joint1") == ("0.4 0 0", "0.7 0 0")
    assert origin_of(urdf, "joint2") == (f"{x!r} {y!r} 0.1", "-0.5 0 0.3")
    assert origin_of(urdf, "tool_joint") == ("0 0 0", "0 0 0")


@pytest.mark.parametrize("table", [DH5, *EXAMPLES])
def test_yourdfpy_loads_it_strictly(table, tmp_path):
    (tmp_path / "arm.urdf").write_text(to_urdf(table))
    loaded = yourdfpy.URDF.load(str(tmp_path / "arm.urdf"))
    assert loaded.validate(), loaded.errors
    assert tuple(link.name for link in loaded.robot.links) == table.link_names
    assert tuple(loaded.actuated_joint_names) == table.joint_names
    assert [joint.type for joint in loaded.actuated_joints] == [row.type for row in table.rows]
    q = np.linspace(-0.5, 0.6, len(table.rows))
    loaded.update_cfg(q)
    tip = loaded.get_transform("tool", "base")
    np.testing.assert_allclose(tip, table.transforms(q)[-1], atol=1e-12)


@pytest.mark.parametrize("table", EXAMPLES[::2], ids=lambda t: t.convention)
def test_cylinders_are_drawn_along_the_links(table):
    robot = yourdfpy.URDF.load(BytesIO(to_urdf(table).encode()))
    for i, link in enumerate(robot.robot.links[1:-1], start=1):
        drawn = []
        for visual in link.visuals:
            if visual.geometry.sphere is not None:
                assert visual.geometry.sphere.radius == 0.03
                continue
            pose = robot.get_transform(link.name, "base") @ visual.origin
            half = visual.geometry.cylinder.length / 2 * pose[:3, 2]
            ends = (pose[:3, 3] - half, pose[:3, 3] + half)
            drawn.append(sorted(np.round(end, 9).tolist() for end in ends))
            assert visual.geometry.cylinder.radius == 0.03
        rods = rods_of(table, i)
        expected = [sorted(np.round(end, 9).tolist() for end in ends) for ends in rods]
        np.testing.assert_allclose(np.array(drawn), np.array(expected), atol=1e-8)
        assert len(link.visuals) == max(len(rods), 1)  # without rods: a ball


def test_base_is_drawn_only_where_it_has_length():
    modified = table_of(row(a=0.4), row(), convention="modified")
    base = yourdfpy.URDF.load(BytesIO(to_urdf(modified).encode())).robot.links[0]
    assert [visual.geometry.cylinder.length for visual in base.visuals] == [0.4]
    assert base.inertial is None
    base = yourdfpy.URDF.load(BytesIO(to_urdf(DH5).encode())).robot.links[0]
    assert (base.visuals, base.inertial) == ([], None)


def test_names_are_escaped():
    table = table_of(
        row(0.1, link="a<b>&\"c'", joint="größe 1"), row(0.2), postures={"<p>": [0, 0]}
    )
    model = pin.buildModelFromXML(to_urdf(table))
    assert model.names[1] == "größe 1"
    assert model.existFrame("a<b>&\"c'")
    state = ElementTree.fromstring(to_srdf(table).encode()).find("group_state")
    assert (state.get("name"), state[0].get("name")) == ("<p>", "größe 1")


@pytest.mark.parametrize(
    "name", ["my--arm.toml", "a-->b.toml", "line\nbreak.toml", "-", "ärm-.toml"]
)
def test_any_source_name_fits_into_the_comment(name):
    table = table_of(row(0.1), source=Path("folder", name))
    for text in (to_urdf(table), to_srdf(table)):
        declaration, comment, root = text.split("\n")[:3]
        assert declaration.startswith("<?xml")
        assert comment.startswith("<!-- generated by ftforce dh from ")
        assert "folder" not in comment
        assert root == '<robot name="arm">'
        ElementTree.fromstring(text.encode())


def test_a_text_that_yourdfpy_refuses_is_not_returned(monkeypatch):
    monkeypatch.setattr(yourdfpy.Limit, "__init__", _limit_without_upper)
    with pytest.raises(URDFError, match=r"arm\.urdf: yourdfpy rejects it: .*upper"):
        to_urdf(table_of(row(0.1)))


def _limit_without_upper(self, effort=None, velocity=None, lower=None, upper=None):
    self.effort, self.velocity, self.lower, self.upper = effort, velocity, lower, None


def test_a_text_with_another_tip_is_not_returned(monkeypatch):
    monkeypatch.setattr(dh_to_urdf.Body, "end", dh_to_urdf.Origin((0.1, 0.2, 0.3)))
    with pytest.raises(URDFError, match="its tip position differs from that of the DH table"):
        to_urdf(table_of(row(0.1)))


# ---- the SRDF --------------------------------------------------------------------------------


def test_srdf_has_chain_end_effector_and_postures():
    robot = ElementTree.fromstring(to_srdf(DH5).encode())
    assert robot.get("name") == "dh5"
    assert robot.find("group[@name='arm']/chain").attrib == {
        "base_link": "base",
        "tip_link": "tool",
    }
    end = robot.find("end_effector")
    assert end.get("parent_link") == "tool"
    assert robot.find(f"group[@name='{end.get('group')}']/link").get("name") == "tool"
    values = [joint.get("value") for joint in robot.find("group_state[@name='paper']")]
    assert values == [repr(math.radians(x)) for x in (10, 70, 25, 65)] + ["0"]


def test_pinocchio_reads_the_postures():
    table = replace(DH5, postures={"paper": DH5.postures["paper"], "up": [0, 0.1, 0.2, 0.3, 0.4]})
    model = pin.buildModelFromXML(to_urdf(table))
    pin.loadReferenceConfigurationsFromXML(model, to_srdf(table), False)
    for name in ("paper", "up"):
        np.testing.assert_array_equal(model.referenceConfigurations[name], table.postures[name])


# ---- writing ---------------------------------------------------------------------------------


def content(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def test_existing_files_are_replaced(tmp_path):
    (tmp_path / "arm.urdf").write_text("old")
    assert write_robot(DH5, tmp_path / "arm.urdf") == (tmp_path / "arm.urdf", tmp_path / "arm.srdf")
    assert content(tmp_path) == {"arm.urdf": to_urdf(DH5), "arm.srdf": to_srdf(DH5)}


@pytest.mark.parametrize("blocked", ["arm.urdf", "arm.srdf"])
def test_nothing_is_written_if_one_file_cannot_be(tmp_path, blocked):
    (tmp_path / blocked).mkdir()
    with pytest.raises(OutputError, match=f"{blocked}: .* is not a regular file"):
        write_robot(DH5, tmp_path / "arm.urdf")
    assert [path.name for path in tmp_path.iterdir()] == [blocked]


@pytest.mark.parametrize(
    "existing", [{}, {"arm.urdf": "old"}, {"arm.urdf": "a", "arm.srdf": to_srdf(DH5)}]
)
@pytest.mark.parametrize(
    ("problem", "raised"),
    [
        (OSError(28, "No space left on device"), OutputError),
        (KeyboardInterrupt("stopped"), KeyboardInterrupt),
    ],
)
def test_a_failure_half_way_leaves_the_old_files(tmp_path, monkeypatch, existing, problem, raised):
    for name, text in existing.items():
        (tmp_path / name).write_text(text)
    original = Path.replace

    def replace_unless_srdf(self, target):
        if self.name == "new-arm.srdf":
            raise problem
        return original(self, target)

    monkeypatch.setattr(Path, "replace", replace_unless_srdf)
    with pytest.raises(raised, match=r"No space left|stopped"):
        write_robot(DH5, tmp_path / "arm.urdf")
    assert content(tmp_path) == existing
    assert len(list(tmp_path.iterdir())) == len(existing)  # no scratch folder stays behind


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("arm.xml", "must end in .urdf"),
        ("arm", "must end in .urdf"),
        ("none/arm.urdf", "No such file or directory"),
        (300 * "x" + ".urdf", "name too long"),
    ],
)
def test_names_that_cannot_be_written(tmp_path, name, message):
    with pytest.raises(OutputError, match=message):
        write_robot(DH5, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".urdf", ".srdf"])
def test_the_table_is_not_overwritten(tmp_path, suffix):
    source = tmp_path / f"arm{suffix}"
    source.write_text((ROBOTS / "dh5.toml").read_text())
    with pytest.raises(OutputError, match="it is the DH table itself"):
        write_robot(DHTable.from_toml(source), tmp_path / "arm.urdf")
    assert content(tmp_path) == {source.name: (ROBOTS / "dh5.toml").read_text()}


# ---- the command -----------------------------------------------------------------------------


def run(*arguments):
    app = typer.Typer()
    app.command()(dh)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_command_writes_into_the_current_folder_by_default(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(ROBOTS / "dh5.toml")
    assert result.exit_code == 0, result.output
    assert result.output.startswith("wrote dh5.urdf and dh5.srdf: 5 joints")
    assert content(tmp_path)["dh5.urdf"] == (ROBOTS / "dh5.urdf").read_text()


def test_command_says_when_there_are_no_postures(tmp_path):
    text = (ROBOTS / "dh5.toml").read_text()
    (tmp_path / "bare.toml").write_text(text[: text.index("[postures]")])
    result = run(tmp_path / "bare.toml", "-o", tmp_path / "x.urdf")
    assert result.output.rstrip().endswith("tip 'tool', postures: none")
    assert "group_state" not in (tmp_path / "x.srdf").read_text()
