"""Tables in CSV files: every way to write the same one, and the place of every mistake."""

import math
import sys

import numpy as np
import pytest

from ftforce.errors import InputError, UnknownNameError
from ftforce.io import csv_table as module
from ftforce.io.csv_table import POSITION_UNITS, Table, find_columns, split_unit

PLAIN = "t,j1,j2\n0.1,1,-2.5\n0.2,3,4e1\n"
SAME = {
    "plain": PLAIN,
    "byte order": PLAIN.replace("0.1,1,", "+.1,01.0,"),
    "CRLF": PLAIN.replace("\n", "\r\n"),
    "CR": PLAIN.replace("\n", "\r"),
    "quotes": PLAIN.replace("j1", '"j1"').replace("3", '"3"'),
    "blank lines": "\n\n" + PLAIN.replace("\n", "\n\n ,, \n  \n"),
    "blanks": PLAIN.replace(",", " ,\t"),
    "no line break at the end": PLAIN.rstrip("\n"),
}


@pytest.fixture(autouse=True, params=["NumPy", "Arrow"])
def reader(request, monkeypatch):
    """Arrow reads long tables only."""
    monkeypatch.setattr(module, "_LONG", 0 if request.param == "Arrow" else math.inf)


@pytest.mark.parametrize("one_line", [True, False])
@pytest.mark.parametrize("content", SAME.values(), ids=SAME)
def test_forms_of_the_same_table(content, one_line):
    table = Table.of(content, one_line=one_line)
    assert table.header == ("t", "j1", "j2")
    np.testing.assert_array_equal(table.numbers([0, 1, 2]), [[0.1, 1, -2.5], [0.2, 3, 40]])
    np.testing.assert_array_equal(table.numbers([2, 0]), [[-2.5, 0.1], [40, 0.2]])
    assert [[cell.strip() for cell in cells] for _, cells in table.rows()][1][1] == "3"


@pytest.mark.parametrize("form", [repr, "{:.6f}".format, "{:+.17e}".format, "{:.3g}".format])
def test_every_digit_counts(monkeypatch, form):
    monkeypatch.setattr(module, "_PIECE", 1000)
    numbers = np.random.default_rng(0).normal(size=(200, 3)) * 10.0 ** np.arange(-3, 6, 3)
    cells = [[form(x) for x in row] for row in numbers.tolist()]
    text = "\n".join(map(",".join, [["a", "b", "c"], *cells]))
    wanted = [[float(cell) for cell in row] for row in cells]
    np.testing.assert_array_equal(Table.of(text).numbers([0, 1, 2]), wanted)


def test_without_arrow_numpy_reads(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert Table.of("a,b\n1,x\n2,y\n").numbers([0]).tolist() == [[1.0], [2.0]]


def test_rows_know_their_lines():
    table = Table.of('\n\na,b\n1,2\n\n"3\n\n",4\n5,6\n')
    assert table.line == 4
    assert list(table.rows()) == [(4, ["1", "2"]), (8, ["3\n\n", "4"]), (9, ["5", "6"])]


@pytest.mark.parametrize("text", ["", "\n \n", ",,\n"])
def test_no_header(text):
    assert Table.of(text) is None


@pytest.mark.parametrize("below", ["", "\n", " \n,,\n"])
def test_no_rows(below):
    assert Table.of("a,b,c\n" + below).numbers([0, 2]).shape == (0, 2)


@pytest.mark.parametrize("text", ["x,é,1", 'x,"é, y",1', "_,#,1", ",nan,1"])
def test_other_columns_may_hold_anything(text):
    assert Table.of(f"a,b,c\n{text}\n").numbers([2]).tolist() == [[1.0]]


@pytest.mark.parametrize(
    ("below", "message"),
    [
        ("1,2\n3\n", "line 3: expected 2 cells, got 1"),
        ("1,2\n\n3,4,5\n", "line 4: expected 2 cells, got 3"),
        ("1,2\n3, \n", "line 3, 'b': empty cell; every row needs a value for every joint"),
        ("1,1_0\n", "line 2, 'b': '1_0' is not a number"),
        ("1,１\n", "line 2, 'b': '１' is not a number"),
        ("1,2\u00a0\n", r"line 2, 'b': '2\xa0' is not a number"),
        ("1,nan\n", "line 2, 'b': 'nan' is not finite"),
        ("1,1e400\n", "line 2, 'b': '1e400' is not finite"),
        ("1,1 2\n", "line 2, 'b': '1 2': expected 1 number, got 2"),
        ("1,2\n101,2\n", "line 3, 'a': '101' is too large; the maximum magnitude is 100"),
        ('1,2\n"open,2\n3,4\n', "line 3: not valid CSV: unexpected end of data"),
        ('"1"1,2\n', "line 2: not valid CSV: ',' expected after '\"'"),
        ("1," + "1" * 200_000, "line 2: not valid CSV: field larger than field limit (131072)"),
    ],
)
def test_mistakes_have_a_place(below, message):
    for text in (f"a,b\n{below}", f"a,b\r\n{below}"):
        with pytest.raises(InputError) as caught:
            Table.of(text).numbers([0, 1], 100.0)
        assert str(caught.value) == message


def test_cells_with_line_breaks_may_be_refused():
    text = 'a,b\n1,2\n3,"x\ny"\n'
    assert Table.of(text).numbers([0]).tolist() == [[1.0], [3.0]]
    with pytest.raises(InputError, match=r"^line 3: a cell continues on the next line$"):
        Table.of(text, one_line=True).numbers([0])
    with pytest.raises(InputError, match=r"^line 1: a cell continues on"):
        Table.of('"a\n",b\n', one_line=True)


@pytest.mark.parametrize(
    ("cell", "wanted"),
    [
        ("elbow [deg]", ("elbow", "deg")),
        ("elbow[ deg ]", ("elbow", "deg")),
        ("elbow []", ("elbow", "")),
        ("elbow", ("elbow", "")),
        ("x [m] y", ("x [m] y", "")),
        ("a]", ("a]", "")),
        ("a [rad] [deg]", ("a [rad]", "deg")),
    ],
)
def test_units_stand_in_brackets(cell, wanted):
    assert split_unit(cell) == wanted


def test_columns_are_found_by_name():
    units = {"j1": POSITION_UNITS["rad"], "x [m]": POSITION_UNITS["m"]}
    degree = math.pi / 180.0
    assert find_columns(("t", "x [m]", "j1 [deg]"), units) == {"x [m]": (1, 1.0), "j1": (2, degree)}
    with pytest.raises(UnknownNameError, match="unknown column 't'; available: j1, j2"):
        find_columns(("t", "j1"), units, ("j1", "j2"))
    with pytest.raises(InputError, match="column 'j1' appears twice"):
        find_columns(("j1", "j1 [deg]"), units)
    with pytest.raises(InputError, match=r"column 'j1 \[m\]': unknown unit; use rad or deg"):
        find_columns(("j1 [m]",), units)


@pytest.mark.parametrize(
    "text",
    [
        "# recorder v1\n# robot: é\na,b\n1,2\n",
        "# recorder v1\r\n# a,b\r\n1,2\r\n",
        "#a,b\n1,2\n",
    ],
)
def test_comments_above_the_header(text):
    """As recorders and `numpy.savetxt` write them; lines are still counted from the first."""
    table = Table.of(text)
    assert table.header == ("a", "b")
    np.testing.assert_array_equal(table.numbers([0, 1]), [[1.0, 2.0]])
    lines = text.count("\n")
    with pytest.raises(InputError, match=f"line {lines + 1}, 'b'"):
        Table.of(text + "3,x\n").numbers([0, 1])
    assert Table.of("# only a comment\n") is None
