"""A name is a text and nothing else, wherever it comes from and wherever it is shown."""

from __future__ import annotations

import csv
import io
import json
import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

import ftforce
from ftforce.batch.workspace_map import workspace_map
from ftforce.errors import TrajectoryError
from ftforce.report.files import as_cell, to_content, to_text
from ftforce.show import plots, render
from ftforce.show.figures import figure, figure_bytes
from ftforce.trajectory.path import Path as TipPath
from ftforce.view.model.answer import answer
from ftforce.view.page.answer import static_page
from ftforce.view.scene.picture import picture
from helpers import CAMPAIGN, initial_state
from test_cli import run

pytestmark = pytest.mark.thorough  # fifty names through every output

TEXTS = (
    *("<script>alert(1)</script>", "</code></pre><b>x", "&lt;b&gt;", '" onload="alert(1)', "]]>"),
    *("[bold red]x[/]", "[/]", "[link=file:///etc]x[/link]", ":warning:", "{0}{name}", "%s%n"),
    *("$x$", "$\\frac{", "a$b", "\\$x\\$", "a\\nb", "_hidden", "'quoted'", 'a"b', "a,b;c"),
    *("=1+1", '=HYPERLINK("http://x")', "+cmd|' /C calc'!A0", "-2+3", "@SUM(1)", " =1+1", "＝1+1"),
    *("../../etc/passwd", "--help", "NaN", "-1", "שלום", "关节", "é" * 200),
)
CONTROLS = (
    *("a\nb", "a\tb", "a\rb", "\x1b[31m", "\x9b31m", "\x07", "\x7f", "\x00", "\u202eabc"),
    *("a\u200bb", "a\u2028b", "\ufeffa", "\ue000", "a\u00a0b", "\ud800"),
)
assert len(TEXTS) + len(CONTROLS) >= 30
IN_XML = [x for x in CONTROLS if not re.search("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800]", x)]
TAME = "plain"


def arm_xml(name):
    """Return the URDF of a planar arm whose robot, links and joints have names with ``name``."""
    robot = ElementTree.Element("robot", name=name)
    links = [f"{name} base", *(f"{name} link {i}" for i in range(3)), f"{name} tip"]
    for link in links:
        body = ElementTree.SubElement(ElementTree.SubElement(robot, "link", name=link), "inertial")
        ElementTree.SubElement(body, "mass", value="1")
        ElementTree.SubElement(body, "inertia", ixx="1e-3", iyy="1e-3", izz="1e-3")
    for i, (parent, child) in enumerate(pairwise(links)):
        kind = "revolute" if i < 3 else "fixed"
        joint = ElementTree.SubElement(robot, "joint", name=name if not i else f"{name}{i}")
        joint.set("type", kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        ElementTree.SubElement(joint, "origin", xyz="0.4 0 0" if i else "0 0 0")
        ElementTree.SubElement(joint, "axis", xyz="0 1 0")
        ElementTree.SubElement(joint, "limit", lower="-2", upper="2", effort="40", velocity="2")
    return robot


def arm(folder, name):
    path = Path(folder, "arm.urdf")
    ElementTree.ElementTree(arm_xml(name)).write(path, encoding="utf-8")
    return ftforce.load_robot(path)


def results(robot):
    q, asked = [0.3, 0.4, 0.5], {"task": "fx,fz"}
    yield robot
    yield ftforce.analyze(robot, q, locked="2", force=[1, 2], limits="urdf", **asked)
    yield ftforce.census(robot, q, faults=2, limits="urdf", **asked)
    yield ftforce.capability(robot, q, free="3", **asked)


class Tags(HTMLParser):
    """Collect the tags and attributes of a page."""

    def __init__(self, source):
        super().__init__()
        self.found = set()
        self.feed(source)

    def handle_starttag(self, tag, attrs):
        self.found |= {tag, *(f"{tag} {key}" for key, _ in attrs)}


def tags(robot):
    """Return the kinds of elements and attributes in each kind of markup."""
    found = set()
    for result in results(robot):
        shown = render.render(result)
        svg = ElementTree.fromstring(
            render.to_svg(shown, f"ftforce {robot.name}", origin=robot.name)
        )
        found |= {(one.tag, key) for one in svg.iter() for key in ("", *one.attrib)}
        found |= Tags(render.to_page(shown, f"ftforce {robot.name}", robot.name)).found
    state = initial_state(robot).failing(0, "locked")
    given = answer(robot, state)
    return found | Tags(static_page(given, picture(given), robot.name, (robot.name,))).found


@pytest.fixture(scope="module")
def tame(tmp_path_factory):
    return tags(arm(tmp_path_factory.mktemp("tame"), TAME))


@pytest.mark.parametrize("name", TEXTS)
def test_a_name_is_text_in_every_output(tmp_path, tame, name):
    robot = arm(tmp_path, name)
    assert robot.names == (name, f"{name}1", f"{name}2")
    assert tags(robot) <= tame
    for result in results(robot):
        text = render.to_text(render.render(result))
        assert all(line.isprintable() for line in text.split("\n"))
        assert any(name in text for text in strings(json.loads(to_text(result, "json"))))
        cells = [cell for row in csv.reader(io.StringIO(to_text(result, "csv"))) for cell in row]
        assert not [cell for cell in cells if is_formula(cell)]
    assert name in cells or f"'{name}" in cells or f"{name}1" in " ".join(cells)


def as_text(content):
    return content if isinstance(content, str) else content.decode()


def strings(content):
    """Yield all texts of a JSON document."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for key, value in content.items():
            yield key
            yield from strings(value)
    elif isinstance(content, list):
        for value in content:
            yield from strings(value)


def is_formula(cell):
    """Return whether a spreadsheet calculates a cell, by the rules of OWASP's CSV injection."""
    if cell[:1] in {"\t", "\r"}:
        return True
    return cell.lstrip()[:1] in set("=+-@＝＋－＠") and not re.fullmatch(
        r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-][fm][xyz]", cell, re.IGNORECASE
    )


def test_cells_keep_numbers_and_mark_formulas():
    numbers = [-1.5, 3, None, True, "-35.01", "1e-3", "+2", "+fx", "-mz"]
    assert [as_cell(x) for x in numbers] == numbers
    assert as_cell("=1+1") == "'=1+1"
    assert as_cell("\t=1+1") == "'\\t=1+1"
    assert as_cell("elbow") == "elbow"
    assert as_cell("a\x1b[31m") == "a\\x1b[31m"


def test_json_has_no_control_characters_and_the_same_data(tmp_path):
    robot = arm(tmp_path, TAME)
    path = tmp_path / "li\x9bmits\u202e.toml"
    path.write_text(f"[{TAME}]\neffort = 3\n", encoding="utf-8")
    result = ftforce.capability(robot, [0.3, 0.4, 0.5], task="fx,fz", limits=path)
    content = to_text(result, "json")
    assert all(line.isprintable() for line in content.split("\n"))
    assert any(str(path) in text for text in strings(json.loads(content)))


# ---- plots -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [x for x in TEXTS if "$" in x])
def test_a_dollar_sign_is_drawn(tmp_path, name):
    robot = arm(tmp_path, name)
    found = ftforce.census(robot, [0.3, 0.4, 0.5], limits="urdf", task="fx,fz")
    drawn = figure(found)
    drawn.draw_without_rendering()
    axes = Figure().add_subplot()
    axes.set_title("$x$")
    plots.census(found, ax=axes)
    axes.get_figure().draw_without_rendering()
    for one in (drawn, axes.get_figure()):
        words = [text for text in one.findobj(Text) if name in text.get_text()]
        assert words
        for text in words:  # Matplotlib's own decision whether to read a formula
            assert text._preprocess_math(text.get_text()) == (text.get_text(), False)
    assert axes.xaxis.label.get_parse_math() or "$" not in axes.get_xlabel()


@pytest.mark.thorough
def test_every_figure_draws_dollar_signs(tmp_path):
    name = "$x$ <b>"
    robot, q = arm(tmp_path, name), [0.3, 0.4, 0.5]
    asked = {"task": "fx,fz", "force": [1, 0]}
    path = TipPath.through([[1, 0, -0.3], [0.9, 0, -0.3]], speed=1.0)
    history = ftforce.simulate(robot, path, faults="2@0.05", q=q, rate=50, **asked)
    sweep = ftforce.sweep(robot, n=200, **asked)
    timeline = ftforce.timeline(robot, path, q=q, rate=50, **asked)
    capability = ftforce.capability(robot, q, locked="2", task="fx,fz")
    compared = ftforce.compare([robot, robot], n=200, **asked)
    for result in (history, sweep, timeline, capability, compared):
        drawn = figure(result)
        drawn.draw_without_rendering()
        for text in drawn.findobj(Text):
            is_plain = "$" not in text.get_text() or not text.get_parse_math()
            assert is_plain or "mathdefault" in text.get_text()
        rows = csv.reader(io.StringIO(as_text(to_content(result, "csv"))))
        cells = [cell for row in rows for cell in row]
        assert not [cell for cell in cells if is_formula(cell)]


# ---- results over time and over postures -----------------------------------------------------


def larger_results(robot, folder):
    """Yield a result of each other type, and those of files as they are read back."""
    q, asked = [0.3, 0.4, 0.5], {"task": "fx,fz", "force": [1, 0]}
    path = TipPath.through([[1, 0, -0.3], [0.98, 0, -0.3]], speed=1.0)
    history = ftforce.simulate(robot, path, faults="2@0.02", q=q, rate=100, limits="urdf", **asked)
    yield history
    for form in ("npz", "csv", "parquet"):
        yield ftforce.load_history(ftforce.save(history, folder / f"run.{form}"))
    yield ftforce.timeline(robot, path, q=q, rate=100, limits="urdf", **asked)
    sweep = ftforce.sweep(robot, n=64, limits="urdf", output=folder / "s.zarr", threads=1, **asked)
    assert list(sweep.dataset.joint.values) == list(robot.names)
    yield sweep
    yield ftforce.open_sweep(folder / "s.zarr")
    yield workspace_map(sweep, plane="xz")
    yield ftforce.compare([robot, robot], n=64, threads=1, **asked)
    yield ftforce.remap([[1.0, 2, 3]], [1, 2, 3], [True, False, False])


def outputs_of(result, robot, *, is_drawn):
    """Return the kinds of elements in the pages and pictures of a result, perhaps in its plot."""
    shown, title = render.render(result), f"ftforce {robot.name}"
    pictures = [render.to_svg(shown, title).encode()]
    if is_drawn:
        pictures.append(figure_bytes(result, "plot.svg"))
    found = Tags(render.to_page(shown, title)).found
    for one in pictures:
        found |= {(e.tag, key) for e in ElementTree.fromstring(one).iter() for key in e.attrib}
    return found


PLOTTED = (0, 4, 5, 7, 8)  # the first of each type


@pytest.fixture(scope="module")
def tame_results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tame")
    robot = arm(folder, TAME)
    return robot, list(larger_results(robot, folder))


@pytest.mark.filterwarnings("ignore:the plot shows boxes")  # for letters that no font has
@pytest.mark.parametrize("part", range(3))
def test_a_name_is_text_in_every_larger_output(tmp_path_factory, tame_results, part, tally):
    tame_robot, tame = tame_results
    for number in tally.numbers("names through every output", len(TEXTS), part, 3):
        name, folder = TEXTS[number], tmp_path_factory.mktemp("names")
        robot = arm(folder, name)
        for i, result in enumerate(larger_results(robot, folder)):
            tally.tried()
            case = f"{number}: {name!r} in {type(result).__name__}"
            # A plot takes a second: one for each name, in the campaign all of them.
            is_drawn = i in (PLOTTED if CAMPAIGN else [PLOTTED[number % 5]])
            found = outputs_of(result, robot, is_drawn=is_drawn)
            if more := found - outputs_of(tame[i], tame_robot, is_drawn=is_drawn):
                tally.fails("lost bytes", case, more)
            text = render.to_text(render.render(result)) + repr(result)
            if not all(line.isprintable() for line in text.split("\n")):
                tally.fails("unclear messages", case, text)
            if isinstance(result, ftforce.Remap):
                continue
            if not any(name in one for one in strings(json.loads(to_text(result, "json")))):
                tally.fails("lost bytes", case, "the name is not in the JSON")
            rows = csv.reader(io.StringIO(as_text(to_content(result, "csv"))))
            if formulas := [cell for row in rows for cell in row if is_formula(cell)]:
                tally.fails("lost bytes", case, formulas)


# ---- sources ---------------------------------------------------------------------------------


def refused(*arguments):
    result = run(*map(str, arguments), status=1)
    assert result.stdout == ""
    assert result.stderr.endswith("\n")
    assert result.stderr[:-1].isprintable()
    return result.stderr


@pytest.mark.parametrize("name", IN_XML)
def test_urdf_and_srdf_names_are_printable(tmp_path, name):
    path = tmp_path / "arm.urdf"
    for part in ("link", "joint"):
        robot = arm_xml(TAME)
        robot.find(part).set("name", name)
        ElementTree.ElementTree(robot).write(path, encoding="utf-8")
        assert f"the {part} name" in refused("inspect", path)
    ElementTree.ElementTree(arm_xml(TAME)).write(path, encoding="utf-8")
    for tag, key in (
        ("group_state", "name"),
        ("end_effector", "parent_link"),
        ("chain", "base_link"),
        ("chain", "tip_link"),
    ):
        robot = ElementTree.Element("robot")
        given = {"base_link": f"{TAME} base", "tip_link": f"{TAME} tip", key: name}
        ElementTree.SubElement(robot, tag, given)
        ElementTree.ElementTree(robot).write(path.with_suffix(".srdf"), encoding="utf-8")
        assert "contains unprintable characters" in refused("inspect", path)


@pytest.mark.parametrize("name", CONTROLS)
def test_names_in_a_stored_history_are_printable(tmp_path, history, name):
    _, text = history
    rows = list(csv.reader(io.StringIO(text)))
    path = tmp_path / "run.csv"
    for place in (("robot",), ("base",), ("tip",), ("joints", 1, "name"), ("warnings",)):
        about = json.loads(rows[1][-1]) | {"version": 1}  # which has no digest
        inner = about["setting"]
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = [name] if place == ("warnings",) else name
        stream = io.StringIO()
        csv.writer(stream).writerows([rows[0], [*rows[1][:-1], json.dumps(about)], *rows[2:]])
        path.write_text(stream.getvalue())
        if place == ("warnings",):
            words = ftforce.load_history(path).setting.warnings[0]
            assert words.isprintable()
        else:
            with pytest.raises(TrajectoryError, match="unprintable") as caught:
                ftforce.load_history(path)
            assert str(caught.value).isprintable()


@pytest.fixture(scope="module")
def history(tmp_path_factory):
    folder = tmp_path_factory.mktemp("history")
    robot = arm(folder, TAME)
    path = TipPath.through([[1, 0, -0.3], [0.99, 0, -0.3]], speed=1.0)
    found = ftforce.simulate(
        robot, path, force=[0, 0], q=[0.3, 0.4, 0.5], rate=400, task="fx,fz", faults="2@0.005"
    )
    ftforce.save(found, folder / "run.csv")
    return found, (folder / "run.csv").read_text()


def test_names_in_a_stored_sweep_are_printable(tmp_path):
    robot = arm(tmp_path, TAME)
    setting = ftforce.sweep(robot, n=10, task="fx,fz").setting
    for name in CONTROLS:
        for key, value in (("robot", name), ("tip", name), ("joints", [TAME, name, "c"])):
            with pytest.raises(ValueError, match="unprintable characters"):
                type(setting).from_dict(setting.to_dict() | {key: value})
        found = type(setting).from_dict(setting.to_dict() | {"limits": name, "implausible": [name]})
        assert found.limits.isprintable()
        assert found.implausible[0].isprintable()
    with pytest.raises(ValueError, match="is not a text"):
        type(setting).from_dict(setting.to_dict() | {"joints": [1, 2, 3]})


@pytest.mark.parametrize("name", [x for x in CONTROLS if x not in {"\x00", "\ud800"}])
def test_names_in_tables_are_printable_in_messages(tmp_path, name):
    arm(tmp_path, TAME)
    urdf = tmp_path / "arm.urdf"
    files = {
        "q.csv": f'"{name}",b\n1,2\n',
        "l.csv": f'joint,effort\n"{name}",2\n',
        "l.toml": f"[{json.dumps(name)}]\neffort = 2\n",
        "dh.toml": f"name = {json.dumps(name)}\n",
    }
    for file, text in files.items():
        (tmp_path / file).write_text(text, encoding="utf-8", newline="")
    said = [
        refused("sweep", urdf, "--postures", tmp_path / "q.csv"),
        refused("simulate", urdf, tmp_path / "q.csv", "--force", "0,0,0"),
        refused("capability", urdf, "--limits", tmp_path / "l.csv"),
        refused("capability", urdf, "--limits", tmp_path / "l.toml"),
        refused("inspect", tmp_path / "dh.toml"),
    ]
    assert not any(name in one.removesuffix("\n") for one in said)
