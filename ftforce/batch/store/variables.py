"""Dimensions, coordinates, units and descriptions of the arrays of a stored sweep.

Units and attributes follow the CF conventions, which xarray and netCDF understand.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.batch.job import PER_POSTURE, PER_SET
from ftforce.batch.kernels.layout import CELL_BINS
from ftforce.batch.result import SweepSetting, sets_to_lists
from ftforce.batch.summary.summary import RANKS, summary_shapes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ftforce.batch.summary.bins import Bins, Workspace
    from ftforce.core.faults import FaultSet

FIRST_VERDICT = 1
"""Stored code of the first verdict: 0, as lost data often reads, is none."""
VERDICTS = ("verdict", "worst_verdict")
"""Names of the arrays of samples that hold verdicts."""
VERDICT_CODES = {"flag_values": [0, 1, 2], "flag_meanings": "tolerated borderline not_tolerated"}
"""Attributes of verdicts as indices of `ftforce.core.verdict.VERDICTS`."""
SUMMARY_PREFIX = "summary_"
"""Prefix of the names of the arrays of the summary."""
SAMPLES = (*PER_POSTURE, *PER_SET, "worst_set", *(f"worst_{name}" for name in PER_SET))
"""Names of all arrays of samples."""
_CELLS = ("cell_x", "cell_y", "cell_z")
_SET = ("fault_set",)

_STORED_CODES = {**VERDICT_CODES, "flag_values": [1, 2, 3]}

# Unit and description; "force" and "joint" stand for units that depend on the task and the joints.
_SAMPLES: dict[str, tuple[str, str]] = {
    "q": ("joint", "joint position"),
    "tip": ("m", "position of the tip in root axes"),
    "healthy_rank": ("1", "rank of the healthy arm's task Jacobian J"),
    "healthy_margin": ("1", "margin of the healthy arm, sigma_min(J)/sigma_max(J)"),
    "verdict": ("1", "verdict"),
    "rank_lost": (
        "1",
        "rank lost, rank(J) - rank(K), with K the columns of J of the healthy joints",
    ),
    "sigma_min": (
        "m/joint",
        "smallest singular value of K, moment rows scaled by the characteristic length",
    ),
    "margin": ("1", "margin, sigma_min(K)/sigma_max(J)"),
    "rho": ("1", "relative manipulability w(K)/w(J); NaN where w(J) = 0"),
    "jump": (
        "force",
        "norm of the force jump; NaN where the arm cannot be held in static equilibrium",
    ),
    "moment_jump": (
        "N m",
        "norm of the moment jump; NaN where the arm cannot be held in static equilibrium",
    ),
    "relative_jump": (
        "1",
        "weighted jump relative to the weighted force; 1 without static equilibrium",
    ),
    "capability": (
        "capability",
        "largest force in the direction; infinite if not limited, NaN if no force is feasible",
    ),
    "worst_set": (
        "1",
        "index from 0 of the fault set with the worst verdict, then relative jump, then margin",
    ),
}

# Dimensions and descriptions of the arrays of the summary.
_COUNTS: dict[str, tuple[tuple[str, ...], str]] = {
    "postures": ((), "number of postures"),
    "outside": ((), "postures whose tip lies outside the cells"),
    "healthy_rank": (("rank",), "postures by rank of the healthy arm"),
    "healthy_margin": (("share_bin",), "postures by margin of the healthy arm"),
    "healthy_unknown": ((), "postures where the margin of the healthy arm is undefined"),
    "tolerated_sets": (
        ("tolerated_set_count",),
        "postures by number of fault sets that they tolerate",
    ),
    "verdicts": ((*_SET, "verdict_code"), "postures by verdict"),
    "rank_lost": ((*_SET, "rank"), "postures by rank lost"),
    "margin": ((*_SET, "share_bin"), "postures by margin"),
    "rho": ((*_SET, "share_bin"), "postures by relative manipulability"),
    "jump": ((*_SET, "jump_bin"), "postures by force jump"),
    "capability": ((*_SET, "capability_bin"), "postures by capability"),
    "margin_unknown": (_SET, "postures whose margin is NaN"),
    "rho_unknown": (_SET, "postures whose relative manipulability is NaN"),
    "jump_unknown": (_SET, "postures without static equilibrium, whose jump is NaN"),
    "capability_unknown": (
        _SET,
        "postures without a feasible force in the direction, whose capability is NaN",
    ),
    "capability_unlimited": (_SET, "postures whose capability is not limited"),
    "cell_postures": (_CELLS, "postures whose tip lies in the cell"),
    "cell_tolerates_all": (_CELLS, "postures of the cell that tolerate every fault set"),
    "cell_tolerated": ((*_CELLS, *_SET), "postures of the cell that tolerate the fault set"),
    "cell_worst_margin": (
        (*_CELLS, "cell_bin"),
        "postures of the cell by smallest margin over the fault sets",
    ),
    "cell_worst_rho": (
        (*_CELLS, "cell_bin"),
        "postures of the cell by smallest relative manipulability over the fault sets",
    ),
    "cell_min_margin": (
        (*_CELLS, *_SET),
        "smallest margin in the cell; infinite if the cell is empty",
    ),
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
    """Return the description of a sample array.

    Parameters
    ----------
    name :
        Name of the array.
    setting :
        The setting of the sweep.
    """
    own = {"q": ("joint",), "tip": ("axis",)}.get(name, ())
    per_set = _SET if setting.keep == "all" and name in PER_SET else ()
    bare = name if name == "worst_set" else name.removeprefix("worst_")
    unit, text = _SAMPLES[bare]
    if bare != name:
        text = f"of the worst fault set: {text}"
    attributes: dict[str, Any] = {**_units(unit, setting), "long_name": text}
    if bare == "verdict":
        attributes |= _STORED_CODES
    if name == "q":
        attributes["coordinates"] = "joint_unit"
    return Variable(("posture", *own, *per_set), attributes)


def counted(name: str, setting: SweepSetting) -> Variable:
    """Return the description of an array of the summary.

    Parameters
    ----------
    name :
        Its name in `Summary`.
    setting :
        The setting of the sweep.
    """
    if name in _COUNTS:
        dimensions, text = _COUNTS[name]
        return Variable(dimensions, {"units": "1", "long_name": text})
    kind, _, measure = name.partition("_")
    measure = measure.removesuffix("_at")
    unit, text = _SAMPLES[measure]
    text = text.partition(",")[0].partition(";")[0]
    if name.endswith("_at"):
        text = f"index from 0 of the first posture with the {_EXTREMES[kind]} {text}; -1 if none"
        return Variable(_SET, {"units": "1", "long_name": text})
    text = f"{_EXTREMES[kind]} {text} over all postures; infinite if undefined"
    return Variable(_SET, _units(unit, setting) | {"long_name": text})


def _units(unit: str, setting: SweepSetting) -> dict[str, str]:
    """Return the unit attribute, or a comment where revolute and prismatic joints are mixed."""
    if unit in {"force", "capability"}:
        named = setting.size_unit if unit == "force" else setting.capability_unit
        return {"units": named.replace("·", " ")}
    if "joint" not in unit:
        return {"units": unit}
    kinds = set(setting.joint_units)
    if kinds == {"rad"}:
        return {"units": unit.replace("joint", "rad")}
    if kinds == {"m"}:
        return {"units": {"joint": "m", "m/joint": "1"}[unit]}
    both = {
        "joint": "rad or m, see joint_unit",
        "m/joint": "dimensionless: columns of revolute joints are divided by the joint length, "
        f"{setting.joint_length:g} m/rad",
    }
    return {"comment": both[unit]}


def coordinates(
    setting: SweepSetting, sets: tuple[FaultSet, ...], bins: Bins, workspace: Workspace
) -> dict[str, tuple[NDArray[Any], Variable]]:
    """Return the coordinates, and the edges of the bins, by name.

    Parameters
    ----------
    setting, sets :
        The setting and the fault sets of the sweep.
    bins, workspace :
        Histogram bins, and workspace cells.
    """
    n = setting.n
    has_failed = np.array([[joint in one.joints for joint in range(n)] for one in sets], np.int8)
    found: dict[str, tuple[NDArray[Any], Variable]] = {
        "joint": _names(setting.joints, "joint", "joint of the chain, from base to tip"),
        "joint_unit": _names(setting.joint_units, "joint", "unit of the joint's position"),
        "axis": _names(("x", "y", "z"), "axis", "root axis"),
        "fault_set": _names(
            [str(one) for one in sets], "fault_set", "set of joints that fail together"
        ),
        "joint_fails": (
            has_failed.reshape(len(sets), n),
            Variable(
                ("fault_set", "joint"),
                {
                    "long_name": "whether the joint fails in the set",
                    "flag_values": [0, 1],
                    "flag_meanings": "works fails",
                },
            ),
        ),
        "verdict_code": _codes("verdict_code", 3, "verdict", _STORED_CODES, FIRST_VERDICT),
        "rank": _codes("rank", RANKS, "rank", {}),
        "tolerated_set_count": _codes("tolerated_set_count", len(sets) + 1, "number of sets", {}),
    }
    for axis, (name, start) in enumerate(zip(_CELLS, workspace.origin, strict=True)):
        centres = start + (np.arange(workspace.shape[axis]) + 0.5) * workspace.edge
        text = {"units": "m", "long_name": f"centre of the cell along the root's {name[-1]} axis"}
        found[name] = (centres, Variable((name,), text | {"axis": name[-1].upper()}))
    return found | _bins(bins, setting)


def _names(values: Any, dimension: str, text: str) -> tuple[NDArray[Any], Variable]:
    return np.array(list(values), np.str_), Variable((dimension,), {"long_name": text})


def _codes(
    name: str, count: int, text: str, more: dict[str, Any], first: int = 0
) -> tuple[NDArray[Any], Variable]:
    about = Variable((name,), {"units": "1", "long_name": text} | more)
    return np.arange(first, first + count), about


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
    for name, (values, unit, text) in edges.items():
        bounds = f"{name}_bounds"
        about = {"units": unit, "long_name": f"lower edge of the bin of {text}"}
        found[name] = (np.array(values[:-1]), Variable((name,), about | {"bounds": bounds}))
        both = np.stack([values[:-1], values[1:]], axis=1)
        found[bounds] = (both, Variable((name, "bound"), {}))
    return found


def description(
    setting: SweepSetting,
    sets: tuple[FaultSet, ...],
    bins: Bins,
    workspace: Workspace,
    *,
    version: int,
    identity: dict[str, Any],
    complete: bool,
) -> dict[str, Any]:
    """Return what ftforce itself has to know of a sweep, in JSON form.

    Parameters
    ----------
    setting, sets :
        The setting and the fault sets of the sweep.
    bins, workspace :
        Histogram bins, and workspace cells.
    version :
        Version of the format.
    identity :
        Everything the sweep depends on, in JSON form.
    complete :
        Whether the sweep is complete.
    """
    return {
        "format": version,
        "complete": complete,
        "identity": identity,
        "setting": setting.to_dict(),
        "sets": sets_to_lists(sets),
        "bins": asdict(bins),
        "workspace": asdict(workspace),
    }


def attributes(setting: SweepSetting) -> dict[str, Any]:
    """Return the attributes of the group, for other programs.

    They do not depend on when, where or by whom the sweep was run.

    Parameters
    ----------
    setting :
        The setting of the sweep.
    """
    axes = f"{setting.axes} axes"
    return {
        "Conventions": "CF-1.11",
        "title": f"fault sweep of {setting.robot}",
        "source": f"ftforce {setting.version}",
        "comment": "Positions are in root axes, m. Forces, exerted by the robot on its "
        f"environment, are in {axes}, N and N m. Postures are numbered from 0. A rank is the "
        "number of singular values above rtol times the largest one of J; a verdict is borderline "
        "if it changes with the tolerance between rtol and wary.",
        "task": setting.task,
        "axes": setting.axes,
        "length": setting.length,
        "joint_length": setting.joint_length,
        "fault_mode": setting.mode,
        "rtol": setting.rtol,
        "wary": setting.wary,
    }


def shapes_of(
    setting: SweepSetting, sets: tuple[FaultSet, ...], bins: Bins, workspace: Workspace
) -> dict[str, tuple[int, ...]]:
    """Return the shape of every array that a sweep may have, by name.

    Parameters
    ----------
    setting, sets :
        The setting and the fault sets of the sweep.
    bins, workspace :
        Histogram bins, and workspace cells.
    """
    sizes = {"posture": setting.count, "joint": setting.n, "axis": 3, "fault_set": len(sets)}
    found = {}
    for name in SAMPLES:
        found[name] = tuple(sizes[key] for key in sample(name, setting).dimensions)
    for name, shape in summary_shapes(len(sets), bins, workspace.cells).items():
        cells = name.startswith("cell_")
        found[f"{SUMMARY_PREFIX}{name}"] = (*workspace.shape, *shape[1:]) if cells else shape
    given = coordinates(setting, sets, bins, workspace)
    return found | {name: values.shape for name, (values, _) in given.items()}


def shaped(name: str, values: NDArray[Any], workspace: Workspace) -> NDArray[Any]:
    """Reshape the cell dimension of a summary array to three dimensions, if it has one.

    Parameters
    ----------
    name, values :
        The array, and its name in `Summary`.
    workspace :
        The cells.
    """
    if not name.startswith("cell_"):
        return values
    return values.reshape(*workspace.shape, *values.shape[1:])


def unshaped(name: str, values: NDArray[Any], workspace: Workspace) -> NDArray[Any]:
    """Reshape an array returned by `shaped` to a single cell dimension.

    Parameters
    ----------
    name, values :
        The array, and its name in `Summary`.
    workspace :
        The cells.
    """
    if not name.startswith("cell_"):
        return values
    return values.reshape(workspace.cells, *values.shape[3:])


def all_coordinates() -> list[str]:
    """Return the names of all coordinates and bin edges that a sweep may have."""
    plain = "joint joint_unit axis fault_set joint_fails verdict_code rank tolerated_set_count"
    bins = (f"{name}{end}" for name in _BINS for end in ("", "_bounds"))
    return [*plain.split(), *_CELLS, *bins]
