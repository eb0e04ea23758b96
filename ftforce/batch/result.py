"""The result of a sweep: its setting, its summary, and its samples if they were kept."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, get_args

from ftforce.batch.summary.criticality import (
    criticality,
    set_summaries,
    survival,
    tolerating_every_set,
)
from ftforce.batch.summary.intervals import quantile
from ftforce.core.display import Displayed
from ftforce.core.faults import Fault, FaultMode, FaultSet
from ftforce.core.joint_scale import DEFAULT_JOINT_LENGTH, JointScale
from ftforce.core.ranks import Rank, ranks_of_intervals
from ftforce.io.text import check_name, printable_texts
from ftforce.robot.dynamics import CarriedPayload

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import xarray as xr

    from ftforce.batch.summary.criticality import Estimate, JointCriticality, SetSummary, Survival
    from ftforce.batch.summary.summary import Summary

Keep = Literal["all", "worst", "summary"]
KEEPS: tuple[str, ...] = get_args(Keep)


@dataclass(frozen=True)
class SweepSetting(CarriedPayload):
    """Setting of a sweep, as plain numbers and names that are stored with the result.

    Attributes
    ----------
    robot, base, tip :
        Names of the robot, its base link and its tip link.
    tip_source, other_tips :
        How the tip was chosen, and what else could have been meant, as of a `ftforce.Robot`; empty
        if an older version stored the sweep.
    joints :
        Names of the n joints.
    joint_units :
        Unit of each joint position, ``rad`` or ``m``.
    task, components, axes, length :
        The task, its components, its axes, and the characteristic length, m.
    mode, largest :
        Fault mode, and size of the largest fault sets.
    force :
        Requested force in the task's axes, N (N·m), or ``None``.
    direction :
        Direction of the capability in the task's axes, of unit length, or ``None``.
    limits :
        Source of the torque limits of the capability; ``None`` if no limits apply.
    unknown_limits :
        Names of the joints whose motor limit is unknown and treated as infinite.
    gravity :
        In root axes, m/s².
    payload, payload_mass, payload_offset, payload_inertia :
        Description of the payload, its mass, kg, its position in tip axes, m, and its moments of
        inertia, kg·m²; ``None`` and empty without one. `carried` is the payload itself.
    rtol, wary :
        Relative tolerances of the rank and of the borderline verdict.
    postures :
        Description of the postures.
    count :
        Number of postures.
    is_random :
        Whether they were drawn at random, so that confidence intervals are meaningful.
    keep :
        Samples kept: ``all``, ``worst`` or ``summary``.
    chunk :
        Postures per chunk.
    version :
        Version of ftforce.
    friction :
        Friction of free-swinging joints, in words; ``None`` if joints do not swing.
    friction_torques :
        Torque that it bears at each joint, N·m (N), ``None`` where it follows from the weight;
        empty if joints do not swing.
    implausible :
        Warnings about numbers of the URDF that no real arm has and on which the result depends.
    joint_length :
        Travel of a slide that weighs as much as 1 rad of a hinge, m; older sweeps have 1 m.
    robot_sha256 :
        SHA-256 of the robot's file; ``None`` without one, and in older sweeps.
    computed_with :
        ``kernels``, the compiled ones, or ``numpy``; both give the same counts.
    """

    robot: str
    base: str
    tip: str
    joints: tuple[str, ...]
    joint_units: tuple[str, ...]
    task: str
    components: tuple[str, ...]
    axes: str
    length: float
    mode: str
    largest: int
    force: tuple[float, ...] | None
    direction: tuple[float, ...] | None
    limits: str | None
    unknown_limits: tuple[str, ...]
    gravity: tuple[float, ...]
    payload: str | None
    rtol: float
    wary: float
    postures: str
    count: int
    is_random: bool
    keep: str
    chunk: int
    version: str
    friction: str | None = None
    friction_torques: tuple[float | None, ...] = ()
    implausible: tuple[str, ...] = ()
    joint_length: float = DEFAULT_JOINT_LENGTH
    tip_source: str = ""
    other_tips: Mapping[str, tuple[float, float]] = field(default_factory=dict, hash=False)
    payload_mass: float | None = None
    payload_offset: tuple[float, ...] = ()
    payload_inertia: tuple[float, ...] = ()
    robot_sha256: str | None = None
    computed_with: str = "kernels"

    def to_dict(self) -> dict[str, Any]:
        """Return the setting as a JSON-compatible dictionary."""
        return asdict(self)

    @classmethod
    def from_dict(cls, found: dict[str, Any]) -> SweepSetting:
        """Return the setting from a dictionary made by `to_dict`, possibly read from JSON.

        Parameters
        ----------
        found :
            The dictionary; lists become tuples again, and unprintable characters are escaped.

        Raises
        ------
        ValueError
            A name is not a text, or contains unprintable characters.
        """
        for kind in ("robot", "base", "tip", "joints"):
            names = found[kind] if kind == "joints" else [found[kind]]
            for name in names:
                check_name(name, kind.removesuffix("s"))
        known: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in printable_texts(found).items()
        }
        known["other_tips"] = {k: tuple(v) for k, v in known.get("other_tips", {}).items()}
        return cls(**known)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def scale(self) -> JointScale:
        """Weights of hinges against slides."""
        return JointScale.of(self.joint_units, self.joint_length)

    @property
    def size_unit(self) -> str:
        """Unit of the jump: N, or N·m for a task of moments only."""
        return "N" if any(name[0] == "f" for name in self.components) else "N·m"

    @property
    def capability_unit(self) -> str:
        """Unit of the capability: N, or N·m along a direction of pure moment."""
        if self.direction is None:
            return self.size_unit
        pushes = (
            name[0] == "f" and x != 0.0
            for name, x in zip(self.components, self.direction, strict=True)
        )
        return "N" if any(pushes) else "N·m"


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Displayed):
    """Result of a fault analysis over many postures and all fault sets.

    Attributes
    ----------
    setting :
        The setting.
    sets :
        The fault sets, in ascending order of size.
    summary :
        Counts over all postures.
    path :
        Path of the Zarr group; ``None`` if the sweep is in memory only.
    open_dataset :
        Function that opens the store.
    """

    setting: SweepSetting
    sets: tuple[FaultSet, ...]
    summary: Summary
    path: str | None
    open_dataset: Callable[[], xr.Dataset] = field(repr=False)

    @cached_property
    def dataset(self) -> xr.Dataset:
        """All arrays as an xarray Dataset, loaded lazily."""
        return self.open_dataset()

    @cached_property
    def joints(self) -> tuple[JointCriticality, ...]:
        """All joints, most critical first."""
        return criticality(self.summary, self.sets, self.setting.n)

    @cached_property
    def ranked(self) -> tuple[SetSummary, ...]:
        """All fault sets, worst first."""
        return set_summaries(self.summary, self.sets)

    @property
    def joint_ranks(self) -> tuple[Rank, ...]:
        """Ranks of the joints, in their order; joints whose 95 % intervals overlap share theirs."""
        return ranks_of_intervals([one.not_tolerated[1:] for one in self.joints])

    @property
    def set_ranks(self) -> tuple[Rank, ...]:
        """Ranks of the fault sets as in `ranked`, likewise."""
        return ranks_of_intervals([one.not_tolerated[1:] for one in self.ranked])

    @property
    def healthy_margin(self) -> tuple[float, float]:
        """5 % and 50 % quantiles of σ_min(J)/σ_max(J), the baseline of the margins."""
        counts, edges = self.summary.healthy_margin, self.summary.bins.share
        return float(quantile(counts, edges, 0.05)), float(quantile(counts, edges, 0.5))

    @property
    def done(self) -> int:
        """Number of postures analysed so far; less than requested if unfinished."""
        return int(self.summary.postures)

    @property
    def is_complete(self) -> bool:
        """Whether all postures were analysed."""
        return self.done == self.setting.count

    @property
    def every_set(self) -> Estimate:
        """Share of postures that tolerate every fault set."""
        return tolerating_every_set(self.summary)

    def survival(self, joints: tuple[int, ...] | None = None) -> Survival:
        """Return, per workspace cell, the share of postures that tolerate a fault set.

        Parameters
        ----------
        joints :
            Joints that fail together, numbered from 1; ``None`` for postures that tolerate every
            set of the sweep.

        Raises
        ------
        InputError
            The sweep has no such set.
        """
        return survival(self.summary, None if joints is None else self.index_of(joints))

    def index_of(self, joints: tuple[int, ...]) -> int:
        """Return the index of a fault set in ``sets``.

        Parameters
        ----------
        joints :
            Joints of the set, numbered from 1.

        Raises
        ------
        InputError
            The sweep has no such set.
        """
        from ftforce.errors import InputError, listed

        wanted = tuple(sorted(joints))
        for place, one in enumerate(self.sets):
            if tuple(joint + 1 for joint in one.joints) == wanted:
                return place
        raise InputError(
            f"the sweep has no fault set {{{', '.join(map(str, wanted))}}}; available: "
            f"{listed([str(one) for one in self.sets])}"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the result."""
        found = []
        if not self.is_complete:
            found.append(
                f"only {self.done:,} of {self.setting.count:,} postures are done; run the same "
                "command again to resume"
            )
        if self.setting.unknown_limits:
            names = ", ".join(self.setting.unknown_limits)
            found.append(f"unknown effort limits, treated as unlimited: {names}")
        found += self.setting.implausible
        if not self.setting.is_random:
            found.append(
                "the postures were not drawn at random: the confidence intervals only indicate the "
                "effect of the sample size"
            )
        return tuple(found)


def sets_to_lists(sets: tuple[FaultSet, ...]) -> list[list[list[Any]]]:
    """Return fault sets in JSON form: pairs of joint (from 0) and mode."""
    return [[[fault.joint, fault.mode.value] for fault in one.faults] for one in sets]


def sets_from_lists(found: list[list[list[Any]]]) -> tuple[FaultSet, ...]:
    """Return fault sets from their JSON form."""
    return tuple(
        FaultSet(tuple(Fault(joint, FaultMode(mode)) for joint, mode in one)) for one in found
    )
