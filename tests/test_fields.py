"""Declared fields: JSON members, CSV columns, and what stands in neither."""

import math
from operator import itemgetter
from types import SimpleNamespace as Result

import numpy as np
import pytest

from ftforce.core.verdict import Verdict
from ftforce.report.analysis import ANALYSIS
from ftforce.report.capability import CAPABILITY_FIELDS
from ftforce.report.census import CENSUS
from ftforce.report.comparison import COMPARISON
from ftforce.report.fields import MISSING, Field, columns, constants, document, rows_of, under
from ftforce.report.history import HISTORY
from ftforce.report.map import MAP
from ftforce.report.robot import REPLICATION, ROBOT_FIELDS
from ftforce.report.sweep import SWEEP
from ftforce.report.timeline import TIMELINE

JOINTS = ("hip", "knee")
PAIR = (Field("low", get=itemgetter(0)), Field("high", get=itemgetter(1)))


@pytest.mark.parametrize(
    ("field", "value", "member", "record"),
    [
        (Field("x"), np.float64(0.5), 0.5, {"x": 0.5}),
        (Field("x", unit="N"), math.inf, None, {"x [N]": None}),
        (Field("x", unit="1"), math.nan, None, {"x": None}),
        (Field("x", unit="N·m, N"), 2.0, 2.0, {"x": 2.0}),
        (Field("x"), Verdict.TOLERATED, "tolerated", {"x": "tolerated"}),
        (Field("x", shape="name"), 1, "knee", {"x": "knee"}),
        (Field("x", shape="names"), (1, 0), ["knee", "hip"], {"x": "knee hip"}),
        (Field("x", shape="by joint"), np.array([1.0, math.nan]), {"hip": 1.0, "knee": None}, None),
        (Field("x", shape="by failed joint"), {1: 0.5}, {"knee": 0.5}, None),
        (Field("x", "", "N, N·m", "m"), [1.0, 2.0], [1.0, 2.0],
         {"x_fx [N]": 1.0, "x_my [N·m]": 2.0}),
        (Field("x", "", "1", "m"), None, None, {"x_fx": None, "x_my": None}),
        (Field("x", unit="m", parts=PAIR), (1, 2), {"low": 1, "high": 2},
         {"x_low [m]": 1, "x_high [m]": 2}),
        (Field("x", parts=PAIR), None, None, {"x_low": None, "x_high": None}),
        (Field("x", shape="list", parts=PAIR), [(1, 2)], [{"low": 1, "high": 2}], None),
        (Field("x", parts=(Field("value"),)), Result(value=3.0), {"value": 3.0}, {"x": 3.0}),
    ],
    ids=str,
)  # fmt: skip
def test_values_as_json_and_csv(field, value, member, record):
    got = document((field,), Result(x=value), JOINTS)["x"]
    assert got == member
    assert type(got) is not np.float64
    if record is not None:
        assert columns((field,), Result(x=value), JOINTS, {"fx": "N", "my": "N·m"}) == record


def test_paths_stop_where_there_is_nothing():
    assert Field("z", get="x.y").value(Result(x=Result(y=3))) == 3
    assert Field("z", get="x.y").value(Result(x=None)) is None
    assert Field("z", get=math.sqrt).value(None) is None
    (inner,) = under("x", [Field("y", get=lambda x: x.y + 1)])
    assert (inner.key, inner.value(Result(x=Result(y=3)))) == ("y", 4)
    assert inner.value(Result(x=None)) is None
    assert document((Field("a"), Field("b")), MISSING) == {"a": None, "b": None}


def test_optional_keys_are_left_out_without_a_value():
    field = Field("x", optional=True, shape="list")
    assert document((field,), Result(x=[])) == {}
    assert document((field,), Result(x=[1])) == {"x": [1]}


def test_constants_describe_themselves():
    (field,) = constants({"length": "m"})
    assert (field.meaning, document((field,), Result())) == ("m", {"length": "m"})


def test_rows_have_a_header_unless_there_are_none():
    assert rows_of([]) == []
    assert rows_of([{"a": 1}, {"a": 2}]) == [("a",), (1,), (2,)]


ALL = (ANALYSIS, CAPABILITY_FIELDS, CENSUS, COMPARISON, HISTORY, MAP, REPLICATION, ROBOT_FIELDS,
       SWEEP, TIMELINE)  # fmt: skip


@pytest.mark.parametrize("declared", ALL, ids=range(len(ALL)))
def test_every_key_says_what_it_means(declared):
    """As far as the reference lists it."""
    stack = list(declared)
    while stack:
        field = stack.pop()
        assert field.meaning, field.key
        if not field.shape or field.shape.startswith("list"):
            keys = [part.key for part in field.parts]
            assert len(set(keys)) == len(keys)
            stack += field.parts
