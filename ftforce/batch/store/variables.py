"""Dimensions, coordinates, units and descriptions of the arrays of a stored sweep.

Names of units and attributes follow the CF conventions, which xarray and netCDF know.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.batch.job import PER_SET
from ftforce.batch.kernels.layout import CELL_BINS
from ftforce.batch.result import SweepSetting, sets_to_lists
from ftforce.batch.summary.summary import RANKS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.batch.summary.bins import Bins, Workspace
    from ftforce.core.faults import FaultSet

ABOUT = "ftforce"
"""Attribute of the group that holds ftforce's own metadata, as JSON."""
SUMMARY = "summary_"
_CELLS = ("cell_x", "cell_y", "cell_z")
_SET = ("fault_set",)

_VERDICT = {"flag_values": [0, 1, 2], "flag_meanings": "tolerated borderline not_tolerated"}

# Unit and description; "force" and "turn" stand for units that depend on the task and the joints.
_WORDS: dict[str, tuple[str, str]] = {
    "q": ("turn", "joint position"),
    "tip": ("m", "position of the tip in the root's axes"),
    "healthy_rank": ("1", "rank of the healthy arm's task Jacobian J"),
    "healthy_margin": ("1", "margin of the healthy arm, sigma_min(J)/sigma_max(J)"),
    "verdict": ("1", "verdict"),
    "rank_lost": ("1", "rank of J less that of K, J without the failed joints"),
    "sigma_min": ("m/turn", "smallest singular value of K, moment rows weighted with the length"),
    "margin": ("1", "margin, sigma_min(K)/sigma_max(J)"),
    "rho": ("1", "relative manipulability w(K)/w(J); NaN where w(J) = 0"),
    "jump": ("force", "norm of the force jump; NaN where the arm cannot stand still"),
    "moment_jump": ("N m", "norm of the jump of the moments; NaN where the arm cannot stand still"),
    "relative_jump": ("1", "weighted jump over the weighted force; 1 if nothing holds the arm"),
    "capability": (
        "capability",
        "largest force in the direction; infinite if no limit ends it, NaN if none is held",
    ),
    "worst_set": (
        "1",
        "fault set, from 0, with the worst verdict, then relative jump, then margin",
    ),
}

# Dimensions and descriptions of the arrays of the summary.
_COUNTS: dict[str, tuple[tuple[str, ...], str]] = {
    "postures": ((), "postures"),
    "outside": ((), "postures whose tip lies outside the cells"),
    "healthy_rank": (("rank",), "postures by rank of the healthy arm"),
    "healthy_margin": (("share_bin",), "postures by margin of the healthy arm"),
    "healthy_unknown": ((), "postures where the healthy arm has no margin"),
    "tolerated_sets": (("tolerated_set_count",), "postures that tolerate so many fault sets"),
    "verdicts": ((*_SET, "verdict_code"), "postures by verdict"),
    "rank_lost": ((*_SET, "rank"), "postures by ranks lost"),
    "margin": ((*_SET, "share_bin"), "postures by margin"),
    "rho": ((*_SET, "share_bin"), "postures by relative manipulability"),
    "jump": ((*_SET, "jump_bin"), "postures by force jump"),
    "capability": ((*_SET, "capability_bin"), "postures by capability"),
    "margin_unknown": (_SET, "postures whose margin is NaN"),
    "rho_unknown": (_SET, "postures whose relative manipulability is NaN"),
    "jump_unknown": (_SET, "postures whose jump is NaN: the arm cannot stand still"),
    "capability_unknown": (_SET, "postures whose capability is NaN: no force that way"),
    "capability_unlimited": (_SET, "postures whose capability no known limit ends"),
    "cell_postures": (_CELLS, "postures with the tip in the cell"),
    "cell_tolerates_all": (_CELLS, "postures of the cell that tolerate every fault set"),
    "cell_tolerated": ((*_CELLS, *_SET), "postures of the cell that tolerate the fault set"),
    "cell_worst_margin": ((*_CELLS, "cell_bin"), "postures of the cell by their worst margin"),
    "cell_worst_rho": ((*_CELLS, "cell_bin"), "postures of the cell by their worst rho"),
    "cell_min_margin": ((*_CELLS, *_SET), "smallest margin in the cell; infinite if it is empty"),
}
_BINS = ("share_bin", "cell_bin", "jump_bin", "capability_bin")
_EXTREMES = {"min": "smallest", "max": "largest"}


class Variable(NamedTuple):
    """One array.

    Attributes
    ----------
    dimensions :
        Names of the dimensions.
    attributes :
        Attributes of the array, in JSON form.
    """

    dimensions: tuple[str, ...]
    attributes: dict[str, Any]


def sample(name: str, setting: SweepSetting) -> Variable:
    """Return the description of a sample array."""
    own = {"q": ("joint",), "tip": ("axis",)}.get(name, ())
    per_set = _SET if setting.keep == "all" and name in PER_SET else ()
    bare = name if name == "worst_set" else name.removeprefix("worst_")
    unit, words = _WORDS[bare]
    if bare != name:
        words = f"of the worst fault set: {words}"
    attributes: dict[str, Any] = {**_units(unit, setting), "long_name": words}
    if bare == "verdict":
        attributes |= _VERDICT
    if name == "q":
        attributes["coordinates"] = "joint_unit"
    return Variable(("posture", *own, *per_set), attributes)


def counted(name: str, setting: SweepSetting) -> Variable:
    """Return the description of an array of the summary, by its name in `Summary`."""
    if name in _COUNTS:
        dimensions, words = _COUNTS[name]
        return Variable(dimensions, {"units": "1", "long_name": words})
    kind, _, measure = name.partition("_")
    measure = measure.removesuffix("_at")
    unit, words = _WORDS[measure]
    words = words.partition(",")[0].partition(";")[0]
    if name.endswith("_at"):
        words = f"first posture, from 0, with the {_EXTREMES[kind]} {words}; -1 if there is none"
        return Variable(_SET, {"units": "1", "long_name": words})
    words = f"{_EXTREMES[kind]} {words} of all postures; infinite if there is none"
    return Variable(_SET, _units(unit, setting) | {"long_name": words})


def _units(unit: str, setting: SweepSetting) -> dict[str, str]:
    """Return the unit attribute, or a comment where revolute and prismatic joints are mixed."""
    if unit in {"force", "capability"}:
        named = setting.size_unit if unit == "force" else setting.capability_unit
        return {"units": named.replace("·", " ")}
    if "turn" not in unit:
        return {"units": unit}
    kinds = set(setting.joint_units)
    if kinds == {"rad"}:
        return {"units": unit.replace("turn", "rad")}
    if kinds == {"m"}:
        return {"units": {"turn": "m", "m/turn": "1"}[unit]}
    both = {
        "turn": "rad or m, see joint_unit",
        "m/turn": "columns of joints that turn are in m/rad, of joints that slide in m/m",
    }
    return {"comment": both[unit]}


def coordinates(
    setting: SweepSetting, sets: tuple[FaultSet, ...], bins: Bins, workspace: Workspace
) -> dict[str, tuple[NDArray[Any], Variable]]:
    """Return the coordinates, and the edges of the bins, by name."""
    n = setting.n
    fails = np.array([[joint in one.joints for joint in range(n)] for one in sets], np.int8)
    found: dict[str, tuple[NDArray[Any], Variable]] = {
        "joint": _names(setting.joints, "joint", "joint of the chain, from base to tip"),
        "joint_unit": _names(setting.joint_units, "joint", "unit of the joint's position"),
        "axis": _names(("x", "y", "z"), "axis", "axis of the root"),
        "fault_set": _names([str(one) for one in sets], "fault_set", "joints that fail together"),
        "joint_fails": (
            fails.reshape(len(sets), n),
            Variable(
                ("fault_set", "joint"),
                {
                    "long_name": "whether the joint fails in the set",
                    "flag_values": [0, 1],
                    "flag_meanings": "works fails",
                },
            ),
        ),
        "verdict_code": _codes("verdict_code", 3, "verdict", _VERDICT),
        "rank": _codes("rank", RANKS, "rank", {}),
        "tolerated_set_count": _codes("tolerated_set_count", len(sets) + 1, "number of sets", {}),
    }
    for axis, (name, start) in enumerate(zip(_CELLS, workspace.origin, strict=True)):
        centres = start + (np.arange(workspace.shape[axis]) + 0.5) * workspace.edge
        words = {"units": "m", "long_name": f"centre of the cell along {name[-1]} of the root"}
        found[name] = (centres, Variable((name,), words | {"axis": name[-1].upper()}))
    return found | _bins(bins, setting)


def _names(values: Any, dimension: str, words: str) -> tuple[NDArray[Any], Variable]:
    return np.array(list(values), np.str_), Variable((dimension,), {"long_name": words})


def _codes(
    name: str, count: int, words: str, more: dict[str, Any]
) -> tuple[NDArray[Any], Variable]:
    return np.arange(count), Variable((name,), {"units": "1", "long_name": words} | more)


def _bins(bins: Bins, setting: SweepSetting) -> dict[str, tuple[NDArray[Any], Variable]]:
    """Return the lower edge of every bin, and CF bounds with both edges."""
    infinite = [np.inf]
    cell_edges = np.arange(CELL_BINS + 1) / CELL_BINS
    edges = {
        "share_bin": (bins.share, "1", "margin or relative manipulability"),
        "cell_bin": (cell_edges, "1", "margin or relative manipulability"),
    }
    force, capability = (
        unit.replace("·", " ") for unit in (setting.size_unit, setting.capability_unit)
    )
    if bins.jump is not None:
        edges["jump_bin"] = (np.concatenate([bins.jump, infinite]), force, "force jump")
    if bins.capability is not None:
        all_edges = np.concatenate([[0.0], bins.capability, infinite])
        edges["capability_bin"] = (all_edges, capability, "capability")
    found = {}
    for name, (values, unit, words) in edges.items():
        bounds = f"{name}_bounds"
        about = {"units": unit, "long_name": f"lower edge of the bin of the {words}"}
        found[name] = (np.array(values[:-1]), Variable((name,), about | {"bounds": bounds}))
        both = np.stack([values[:-1], values[1:]], axis=1)
        found[bounds] = (both, Variable((name, "bound"), {}))
    return found


def attributes(
    setting: SweepSetting,
    sets: tuple[FaultSet, ...],
    bins: Bins,
    workspace: Workspace,
    *,
    version: int,
    identity: dict[str, Any],
    complete: bool,
) -> dict[str, Any]:
    """Return the attributes of the group, for readers and for ftforce itself.

    They do not depend on when, where or by whom the sweep was run.
    """
    tools = f"{setting.axes} axes"
    own = {
        "format": version,
        "complete": complete,
        "identity": identity,
        "setting": setting.to_dict(),
        "sets": sets_to_lists(sets),
        "bins": asdict(bins),
        "workspace": asdict(workspace),
    }
    return {
        "Conventions": "CF-1.11",
        "title": f"fault sweep of {setting.robot}",
        "source": f"ftforce {setting.version}",
        "comment": f"Positions are in the root's axes, m. Forces are in {tools}, N and N m, and "
        "are what the robot exerts on its environment. A posture's number counts from 0. A rank "
        "counts singular values above rtol times the largest; a verdict is borderline if it "
        "changes with a tolerance between rtol and wary.",
        "task": setting.task,
        "axes": setting.axes,
        "length": setting.length,
        "fault_mode": setting.mode,
        "rtol": setting.rtol,
        "wary": setting.wary,
        ABOUT: json.dumps(own, ensure_ascii=False),
    }


def shaped(name: str, values: NDArray[Any], workspace: Workspace) -> NDArray[Any]:
    """Reshape the cell dimension of a summary array to three dimensions, if it has one."""
    if not name.startswith("cell_"):
        return values
    return values.reshape(*workspace.shape, *values.shape[1:])


def unshaped(name: str, values: NDArray[Any], workspace: Workspace) -> NDArray[Any]:
    """Undo `shaped`."""
    if not name.startswith("cell_"):
        return values
    return values.reshape(workspace.cells, *values.shape[3:])


def all_coordinates() -> list[str]:
    """Return the names of all coordinates and bin edges that a sweep may have."""
    plain = "joint joint_unit axis fault_set joint_fails verdict_code rank tolerated_set_count"
    bins = (f"{name}{end}" for name in _BINS for end in ("", "_bounds"))
    return [*plain.split(), *_CELLS, *bins]
