"""DH tables: checking, and the closed-form transforms against roboticstoolbox."""

import math
import warnings
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ftforce.errors import DimensionError, InputError
from ftforce.robot.formats.dh import DHRow, DHTable, MassModel
from helpers import campaign, dh_tables, toolbox_arm

DH5 = Path(__file__).parents[1] / "robots" / "dh5.toml"
BAR = MassModel("solid cylinder", radius=0.03, density=2700.0)


def toolbox_frames(table, q):
    """Poses of frames 0 to n, shape (n+1, 4, 4)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.array([pose.A for pose in toolbox_arm(table).fkine_all(q)])


@st.composite
def tables_and_positions(draw):
    table = draw(dh_tables)
    n = len(table.rows)
    return table, draw(st.lists(st.floats(-3.0, 3.0), min_size=n, max_size=n))


@given(tables_and_positions())
@settings(deadline=None, max_examples=campaign(60, 20))
def test_transforms_equal_roboticstoolbox(case):
    table, q = case
    np.testing.assert_allclose(table.transforms(q), toolbox_frames(table, q), atol=1e-12)


@given(tables_and_positions())
@settings(deadline=None, max_examples=campaign(30, 10))
def test_joint_variable_adds_to_theta_or_d(case):
    table, q = case
    moved = [
        replace(row, theta=row.theta + x) if row.type == "revolute" else replace(row, d=row.d + x)
        for row, x in zip(table.rows, q, strict=True)
    ]
    at_rest = replace(table, rows=tuple(moved)).transforms(np.zeros(len(q)))
    np.testing.assert_allclose(table.transforms(q), at_rest, atol=1e-12)


def test_quarter_turns_are_exact():
    row = DHRow(0.4, math.pi / 2, 0.1, math.pi, "revolute", -4, 4)
    expected = [[-1, 0, 0, -0.4], [0, 0, 1, 0], [0, 1, 0, 0.1], [0, 0, 0, 1]]
    np.testing.assert_array_equal(
        DHTable("x", "standard", (row,), BAR).transforms([0])[1], expected
    )


def test_transforms_are_read_only_and_checked():
    table = DHTable.from_toml(DH5)
    assert not table.transforms(np.zeros(5)).flags.writeable
    with pytest.raises(DimensionError, match="q needs 5 numbers, got 4 numbers"):
        table.transforms(np.zeros(4))
    with pytest.raises(InputError, match="finite"):
        table.transforms([0, 0, math.nan, 0, 0])


def test_a_table_cannot_be_changed():
    table = DHTable.from_toml(DH5)
    with pytest.raises(FrozenInstanceError):
        table.rows = ()
    with pytest.raises(TypeError):
        table.postures["paper"] = np.zeros(5)
    with pytest.raises(ValueError, match="read-only"):
        table.postures["paper"][0] = 1


def test_tables_built_in_python_are_checked_too():
    row = DHRow(0.1, 0, 0, 0, "revolute", -1, 1)
    with pytest.raises(InputError, match="unknown convention 'craig'"):
        DHTable("x", "craig", (row,), BAR)
    with pytest.raises(InputError, match="alpha needs a finite number"):
        replace(row, alpha=math.inf)
    with pytest.raises(InputError, match="unknown type 'screw'"):
        replace(row, type="screw")
    with pytest.raises(InputError, match="radius must be positive"):
        MassModel("thin rod", radius=-1)
    with pytest.raises(DimensionError, match="posture 'p' needs 1 number"):
        DHTable("x", "standard", (row,), BAR, {"p": [0, 0]})
    with pytest.raises(InputError, match="row 1: missing key 'mass'"):
        DHTable("x", "standard", (row,), MassModel("thin rod", 0.01))
    with pytest.raises(InputError, match="row 2 has a mass, but the table mass is missing"):
        DHTable("x", "standard", (row, replace(row, mass=1.0)))
    assert DHTable("x", "standard", (row,)).mass is None
