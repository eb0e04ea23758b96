"""Excel, LaTeX and Markdown files, and where every file says that it comes from."""

import csv
import hashlib
import io
import itertools
import json
import math
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import openpyxl
import pyarrow.parquet as pq
import pytest
from PIL import Image
from pylatexenc.latexwalker import LatexWalker

import ftforce
from ftforce.errors import InputError
from ftforce.report import spreadsheet
from ftforce.report.files import to_content, to_dict, to_rows, to_text
from ftforce.report.text_tables import to_latex, to_markdown
from ftforce.show.figures import figure_bytes
from test_cli import run
from urdfs import write

NASTY = ["=1+1", "@x", "a_b&c%d#e$f^g~h{i}j\\k", "|pipe|`<b>", "é ü 漢", "+1", "'"]


@pytest.fixture(scope="module")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def results(dh5):
    census = ftforce.census(dh5, force=[80, 50, 10], faults=2)
    path = ftforce.trajectory.path.Path.through([(0.9, 0.3, 0.2), (0.88, 0.31, 0.21)], speed=0.2)
    run = ftforce.simulate(dh5, path, force=[8, 5, 1], faults="3@0.05", rate=50)
    return {
        "robot": dh5,
        "analysis": ftforce.analyze(dh5, locked=[2], force=[80, 50, 10], limits="urdf"),
        "capability": ftforce.capability(dh5, locked=[3]),
        "census": census,
        "timeline": ftforce.timeline(dh5, path, force=[8, 5, 1], rate=20),
        "history": run,
        "sweep": ftforce.sweep(dh5, n=64, force=[8, 5, 1]),
        "comparison": ftforce.compare([dh5, "panda"], n=64),
        "replication": ftforce.analysis.paper.replicate(dh5),
    }


NAMES = ("robot", "analysis", "capability", "census", "timeline", "history", "sweep", "comparison",
         "replication")  # fmt: skip


def sheets_of(content):
    book = openpyxl.load_workbook(io.BytesIO(content))
    return {sheet.title: [list(row) for row in sheet.values] for sheet in book}


@pytest.mark.parametrize("name", NAMES)
def test_a_workbook_holds_the_rows_as_numbers_and_texts(results, name):
    result = results[name]
    content = to_content(result, "xlsx")
    first, *others = sheets_of(content).items()
    title, rows = first
    assert title == type(result).__name__.lower()
    expected = to_rows(result)
    assert len(rows) == len(expected)
    for row, wanted in zip(rows, expected, strict=True):
        for cell, value in zip(row, wanted, strict=True):
            assert cell == (None if value in {None, ""} else value) or cell == pytest.approx(value)
            assert isinstance(cell, (int, float)) == isinstance(value, (int, float))
    about = dict(others[-1][1][1:])
    assert others[-1][0] == "about"
    assert about["version"] == ftforce.__version__
    if name != "replication":
        assert {key for key in about if key.startswith("units ")}
    assert content == to_content(result, "xlsx")  # the same bytes


def test_a_workbook_of_a_history_holds_every_instant(results):
    run = results["history"]
    rows = sheets_of(to_content(run, "xlsx"))["instants"]
    assert len(rows) == 1 + len(run.t) * len(run.runs)
    i = rows[0].index("q_joint2 [rad]")
    healthy = [row[i] for row in rows[1:] if row[0] == "healthy"]
    assert healthy == run.healthy.q[:, 1].tolist()


def test_no_cell_is_a_formula_and_no_text_a_number(tmp_path):
    rows = [("name", "value"), *((name, 1.5) for name in NASTY), ("12", np.nan), ("x", True)]
    content = spreadsheet.workbook([("names", [tuple(row) for row in rows])])
    (sheet,) = openpyxl.load_workbook(io.BytesIO(content)).worksheets
    for row, (name, _) in zip(sheet.iter_rows(min_row=2), rows[1:], strict=True):
        assert (row[0].data_type, row[0].value) == ("s", name)
    assert [sheet["B9"].value, sheet["B10"].value] == [None, True]


def test_a_sheet_that_excel_cannot_read_is_refused(monkeypatch):
    monkeypatch.setattr(spreadsheet, "MAX_ROWS", 2)
    with pytest.raises(InputError, match=r"'x' would have 3 rows and 1 columns.* write \.csv"):
        spreadsheet.workbook([("x", [("a",), (1,), (2,)])])


def test_the_date_of_a_workbook_is_that_of_the_source(monkeypatch):
    rows = [("x", [("a",), (1,)])]
    plain = spreadsheet.workbook(rows)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    dated = spreadsheet.workbook(rows)
    assert openpyxl.load_workbook(io.BytesIO(dated)).properties.created.year == 2023
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "9" * 20)
    assert openpyxl.load_workbook(io.BytesIO(spreadsheet.workbook(rows))).properties.created
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    assert spreadsheet.workbook(rows) == plain


def test_without_xlsxwriter_the_command_is_named(monkeypatch, results):
    monkeypatch.setitem(sys.modules, "xlsxwriter", None)
    with pytest.raises(ftforce.FtforceError, match=r"pip install 'ftforce\[report\]'"):
        to_content(results["census"], "xlsx")


def latex_tables(text):
    """Return the cells of each table, its heading first, and the types of its columns."""
    nodes, _, _ = LatexWalker(text, tolerant_parsing=False).get_latex_nodes()
    tables = []
    for one in nodes:
        if getattr(one, "environmentname", "") == "longtable":
            verbatim = one.latex_verbatim()
            spec = verbatim.removeprefix("\\begin{longtable}{").split("}\n")[0]
            columns = re.findall(r"S\[[^]]*\]|p\{[^}]*\}|l", spec)
            assert "".join(columns) == spec
            lines = [line[:-3] for line in verbatim.splitlines() if line.endswith("\\\\")]
            tables.append((columns, [line.split(" & ") for line in lines]))
    return tables


def compiled(text, folder):
    """Return the log of pdflatex for a page with this text; ``None`` without it or siunitx."""
    compiler, finder = map(shutil.which, ("pdflatex", "kpsewhich"))
    needed = ("siunitx.sty", "booktabs.sty", "longtable.sty")
    if not (compiler and finder and not subprocess.run([finder, *needed], check=False).returncode):
        return None
    head = "\\documentclass{article}\\usepackage[T1]{fontenc}"
    used = "\\usepackage{booktabs,siunitx,textcomp,longtable}"
    page = folder / "page.tex"
    page.write_text(f"{head}{used}\\begin{{document}}{text}\\end{{document}}", "utf-8")
    command = [compiler, "-interaction=nonstopmode", "-halt-on-error", page.name]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return (folder / "page.log").read_text("utf-8", errors="replace")


@pytest.mark.parametrize("name", NAMES)
def test_latex_tables_are_well_formed(results, name, tmp_path):
    """They compile, and fit the page, where there is a LaTeX; else a parser reads them."""
    text = to_text(results[name], "tex")
    tables = latex_tables(text)
    for columns, lines in tables:
        assert {len(line) for line in lines} == {len(columns)}
    if log := compiled(text, tmp_path):
        assert "Overfull" not in log
        assert "Missing character" not in log


@pytest.mark.parametrize("name", NAMES)
def test_further_latex_tables_repeat_what_tells_the_rows_apart(results, name):
    tables = [lines for _, lines in latex_tables(to_text(results[name], "tex"))]
    heads = [head for head, *_ in tables]
    count = len(
        list(itertools.takewhile(lambda cells: len(set(cells)) == 1, zip(*heads, strict=False)))
    )
    if len(tables) == 1:
        count = 1
    first, *others = [[line[:count] for line in lines] for lines in tables]
    assert all(other == first for other in others)
    if name in {"census", "timeline", "capability", "sweep", "history"}:
        assert len(tables) > 1
        assert len({tuple(line) for line in first}) == len(first)
    rows = to_rows(results[name])
    filled = [head for head, *column in zip(*rows, strict=True) if set(column) - {None, ""}]
    shown = [*heads[0][:count], *(cell for head in heads for cell in head[count:])]
    assert len(shown) == len(set(shown))
    assert len(shown) <= len(filled)  # settings stand in the comment
    assert {cell.split(" / ")[0].strip("{}").replace("\\_", "_") for cell in shown} <= {
        head.split(" [")[0] for head in filled
    }


def test_latex_columns_have_room_for_their_numbers(tmp_path):
    numbers = [-123.456, 1e-300, 12345678.0, None, 7]
    rows = [("joint", "x", "count", "none", "long"), *(
        (f"j{i}", x, i, math.inf, "a b " * 20) for i, x in enumerate(numbers)
    )]  # fmt: skip
    text = to_latex(rows, [])
    (columns, lines), (long, _) = latex_tables(text)
    assert columns == ["l", "S[table-format=-3.3e-3]", "S[table-format=1]", "l"]
    assert long == ["l", "p{140pt}"]
    assert [line[1] for line in lines[1:]] == ["-123.5", "1e-300", "1.235e+07", "", "7"]
    if log := compiled(text, tmp_path):
        assert "Overfull" not in log


def test_latex_has_units_of_siunitx_and_escapes_texts():
    rows = [("joint", "torque [N·m]", "x [furlong_1]"), *((name, 1.23456, None) for name in NASTY)]
    text = to_latex(rows, [("robot", "100 % _x")])
    assert text.startswith("% robot: 100 % _x\n")
    assert "{torque / \\unit{\\newton\\metre}}" in text
    assert "furlong" not in text  # a column without a value
    assert "{a\\_b\\&c\\%d\\#e\\$f\\textasciicircum{}g\\textasciitilde{}h\\{i\\}j" in text
    assert "& 1.235 \\\\" in text
    LatexWalker(text, tolerant_parsing=False).get_latex_nodes()


def test_latex_has_the_letters_and_signs_that_pdflatex_lacks(results):
    """So all of our own tables compile; scripts other than Latin need another engine."""
    rows = [("Ẋ", "unit"), ("‖τ₂‖ = Jᵀ −1.5²", "N·m"), ('"é" a--b,,c', None), ("漢", "rad")]
    text = to_latex([tuple(row) for row in rows], [])
    head, first, second, third = [x for x in text.splitlines() if x.endswith("\\\\")]
    assert head == "{\\.{X}} & {unit} \\\\"
    assert "{$\\|$$\\tau$$_{2}$$\\|$ = J$^{T}$ $-$1.5$^{2}$} & {\\unit{\\newton\\metre}}" in first
    assert second == "{{\\char34}\\'{e}{\\char34} a-{}-b,{},c} &  \\\\"
    assert third == "{漢} & {\\unit{\\radian}} \\\\"
    ours = [to_text(result, "tex").splitlines() for result in results.values()]
    assert all(line.isascii() for text in ours for line in text if not line.startswith("%"))


def test_a_result_without_rows_is_a_file_nevertheless():
    assert to_latex([("a", "b")], [("robot", "x")]) == "% robot: x\n% no rows\n"
    assert to_markdown([], [("robot", "x")]) == "robot x\n"


def test_known_robots_are_one_table(dh5):
    (first, *_), (*_, last) = [list(csv.DictReader(io.StringIO(to_text([dh5, dh5], "csv"))))] * 2
    assert (first["robot"], first["joint"]) == ("dh5", dh5.names[0])
    assert last["joint"] == dh5.names[-1]
    with pytest.raises(InputError, match="a list can be written if it is of robots, not int"):
        to_content([1], "xlsx")


def test_markdown_is_a_table_of_pipes():
    rows = [("joint", "torque [N·m]"), *((name, 1.23456) for name in NASTY)]
    head, rule, *body = to_markdown(rows, [("robot", "a|b")]).splitlines()
    assert head == "| joint | torque \\[N·m\\] |"
    assert rule == "| --- | ---: |"
    assert body[0] == "| =1+1 | 1.235 |"
    assert body[3] == "| \\|pipe\\|\\`&lt;b&gt; | 1.235 |"
    assert body[-1] == "robot a\\|b"


def test_rounding_errors_are_zero_in_tables_for_people():
    """A probability, which has no unit, may be as small."""
    rows = [("joint", "a [N]", "b [m]", "c", "d", "P"), ("j", -2.9e-19, 1e-9, -0.0, 12, 1e-15)]
    assert to_markdown(rows, []).splitlines()[2] == "| j | 0 | 1e-09 | 0 | 12 | 1e-15 |"
    assert r"{j} & 0 & 1e-09 & 0 & 12 & 1e-15 \\" in to_latex(rows, [])


def test_the_table_of_a_census_leaves_the_settings_to_the_line_below(results):
    text = to_text(results["census"], "md")
    head, *_, last = text.splitlines()
    assert "rtol" not in head
    assert "rtol 1e-06" in last
    assert "limits none" in last
    assert last.count("limits") == 1


# ---- provenance ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_rows_of_all_results_can_be_pooled(results, name):
    if name == "history":
        return  # see the next test
    rows = list(csv.DictReader(io.StringIO(to_text(results[name], "csv"))))
    for row in rows:
        assert row["version"] == ftforce.__version__
        assert row["limits"] in {"none", "urdf"}
        assert (row["robot"] or row.get("arm")) in {"dh5", "panda"}
        assert {"posture", "command", "robot_sha256"} <= set(row)
    assert len({row["posture"] for row in rows}) == 1


@pytest.mark.parametrize("form", ["csv", "npz", "parquet"])
def test_a_stored_history_tells_where_it_comes_from(results, tmp_path, form):
    run = results["history"]
    path = ftforce.save(run, tmp_path / f"run.{form}")
    if form == "csv":
        about = next(csv.DictReader(io.StringIO(path.read_text("utf-8"))))["about"]
    elif form == "npz":
        about = str(np.load(path)["about"])
    else:
        about = pq.read_schema(path).metadata[b"ftforce"]
    told = json.loads(about)["provenance"]
    assert told == to_dict(run)["provenance"]
    assert told["version"] == ftforce.__version__
    assert to_dict(ftforce.load_history(path)) == to_dict(run)


def test_the_arms_of_a_comparison_have_their_digests(results):
    rows = list(csv.DictReader(io.StringIO(to_text(results["comparison"], "csv"))))
    for row, arm in zip(rows, to_dict(results["comparison"])["arms"], strict=True):
        path = ftforce.load_robot(row["robot"]).path
        assert row["robot_sha256"] == hashlib.sha256(Path(path).read_bytes()).hexdigest()
        assert arm["robot_sha256"] == row["robot_sha256"]
    assert rows[0]["robot_sha256"] not in to_text(results["comparison"], "md")


def test_the_posture_of_pooled_rows_has_all_digits(results):
    (row, *_) = csv.DictReader(io.StringIO(to_text(results["census"], "csv")))
    assert [float(q) for q in row["posture"].split()] == results["census"].posture.q.tolist()


def test_the_file_of_the_robot_is_told_by_its_digest(results, tmp_path):
    digest = hashlib.sha256(Path(results["robot"].path).read_bytes()).hexdigest()
    for name in (name for name in NAMES if name != "comparison"):
        assert to_dict(results[name])["provenance"]["robot_sha256"] == digest
    gone = ftforce.load_robot(write(tmp_path, Path(results["robot"].path).read_text("utf-8")))
    Path(gone.path).unlink()
    assert to_dict(gone)["provenance"]["robot_sha256"] is None
    assert to_dict(replace(gone, path=""))["provenance"]["robot_sha256"] is None


def test_what_is_no_regular_file_has_no_digest(dh5):
    """A pipe, as of ``<(xacro …)``, cannot be read again; neither can a device."""
    assert to_dict(replace(dh5, path="/dev/null"))["provenance"]["robot_sha256"] is None


@pytest.mark.parametrize("program", ["/usr/bin/ftforce", "/x/ftforce/__main__.py"])
def test_the_command_is_told_as_it_was_typed(results, monkeypatch, program):
    assert to_dict(results["census"])["provenance"]["command"] is None
    monkeypatch.setattr(sys, "argv", [program, "census", "my arm.urdf", "--force", "1,2,3"])
    command = "ftforce census 'my arm.urdf' --force 1,2,3"
    assert to_dict(results["census"])["provenance"]["command"] == command


# ---- torques to command ----------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["locked", "free"])
def test_a_census_holds_the_torques_to_command(dh5, mode):
    """Per fault set, those of an analysis of the same set; in JSON and CSV."""
    asked = {"force": [8, 5, 1], "payload": 0.5, "limits": "urdf"}
    census = ftforce.census(dh5, faults=2, mode=mode, **asked)
    sets = to_dict(census)["sets"]
    rows = list(csv.DictReader(io.StringIO(to_text(census, "csv"))))
    for report, one, row in zip(census.sets, sets, rows, strict=False):
        alone = ftforce.analyze(dh5, **{mode: [j + 1 for j in report.faults.joints]}, **asked)
        expected = alone.torque.total_after
        if expected is None:
            assert one["torque"] is None
            continue
        np.testing.assert_allclose(list(one["torque"].values()), expected, atol=1e-9)
        cells = [row[f"torque_{name} [N·m]"] for name in dh5.names]
        np.testing.assert_allclose([float(x) for x in cells], expected, atol=1e-9)
    assert any(one["torque"] is not None for one in sets)


def test_without_a_force_there_is_nothing_to_command(dh5):
    census = ftforce.census(dh5)
    assert {one["torque"] for one in to_dict(census)["sets"]} == {None}
    json.loads(to_text(census, "json"))


# ---- several files ---------------------------------------------------------------------------


def test_files_of_all_kinds_come_with_one_call_and_the_verdict(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = [f"a.{ending}" for ending in ("json", "csv", "xlsx", "tex", "md", "txt", "svg")]
    outputs = [word for name in names for word in ("-o", name)]
    result = run("analyze", "dh5", "--locked", "2,4", "--force", "80,50,10", *outputs)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert "TOLERATED" in result.output.upper()
    assert [line for line in result.output.splitlines() if line.startswith("wrote")] == [
        f"wrote {name}" for name in names
    ]


def test_a_result_too_large_for_excel_is_in_the_other_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(spreadsheet, "MAX_ROWS", 3)
    result = run("census", "dh5", "-o", "a.xlsx", "-o", "a.csv", status=1)
    assert "error: the sheet 'census' would have 7 rows" in result.output
    assert "wrote a.csv" in result.output
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


def test_what_is_missing_for_a_file_is_said_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xlsxwriter", None)
    monkeypatch.setattr("ftforce.analysis.census.census", None)  # would fail in another way
    monkeypatch.chdir(tmp_path)
    result = run("census", "dh5", "-o", "a.csv", "-o", "a.xlsx", status=1)
    assert "pip install 'ftforce[report]'" in result.output
    assert not list(tmp_path.iterdir())


def test_another_arm_has_no_errata_of_the_paper():
    other = ftforce.analysis.paper.paper_tables(ftforce.load_robot("panda"))
    assert {check.erratum for check in other.checks} == {""}
    head = to_text(other, "md").splitlines()[0]
    assert head == "| table | row | column | computed | outcome |"


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_a_plot_tells_where_it_comes_from(results, monkeypatch, form):
    monkeypatch.setattr(sys, "argv", ["/usr/bin/ftforce", "capability", "é<&.urdf"])
    result = results["capability"]
    data = figure_bytes(result, f"a.{form}")
    assert data == figure_bytes(result, f"a.{form}")
    if form == "png":
        told = " ".join(Image.open(io.BytesIO(data)).text.values())
    elif form == "svg":
        told = " ".join(ElementTree.fromstring(data.decode()).itertext())
    else:
        texts = re.findall(rb"\((\xfe\xff(?:\\.|[^\\)])*)\)", data, re.DOTALL)
        told = " ".join(re.sub(rb"\\(.)", rb"\1", one).decode("utf-16") for one in texts)
        assert b"(ftforce 0" in data
    assert f"version: {ftforce.__version__}" in told
    assert "command: ftforce capability 'é<&.urdf'" in told
    assert to_dict(result)["provenance"]["robot_sha256"] in told


def test_a_picture_of_the_terminal_tells_where_it_comes_from(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["/usr/bin/ftforce", "inspect", '<&">--'])
    run("inspect", "dh5", "-o", "a.svg", "-o", "a.html")
    image = ElementTree.parse("a.svg").getroot()
    (told,) = [one.text for one in image.iter() if one.tag.endswith("metadata")]
    assert "command: ftforce inspect '<&\">--'" in told
    page = Path("a.html").read_text("utf-8")
    assert "command: ftforce inspect &#x27;&lt;&amp;&quot;&gt;--&#x27;" in page
