"""The result of a sweep: what was asked, the summary, and the samples if they were kept."""

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
from ftforce.core.display import Displayed
from ftforce.core.faults import Fault, FaultMode, FaultSet

if TYPE_CHECKING:
    from collections.abc import Callable

    import xarray as xr

    from ftforce.batch.summary.criticality import Estimate, JointCriticality, SetSummary, Survival
    from ftforce.batch.summary.summary import Summary

Keep = Literal["all", "worst", "summary"]
KEEPS: tuple[str, ...] = get_args(Keep)


@dataclass(frozen=True)
class SweepSetting:
    """What a sweep asked: plain numbers and names, so that it can be stored beside the result.

    Attributes
    ----------
    robot, base, tip :
        Name of the robot, and its links.
    joints :
        Names of the n joints.
    joint_units :
        ``rad`` or ``m`` each.
    task, components, axes, length :
        The task, its components, its axes, and the characteristic length, m.
    mode, largest :
        How joints fail, and the size of the largest sets.
    force :
        Asked for, in the task's axes, N (N·m); ``None`` without.
    direction :
        Of the capability, in the task's axes, of unit length; ``None`` without.
    limits :
        Where the torque limits of the capability come from; ``None`` if none count.
    unknown_limits :
        Names of the joints whose motor limit is unknown and so counts as none.
    gravity :
        In the root's axes, m/s².
    payload :
        In words; ``None`` without.
    rtol, wary :
        Tolerances.
    postures :
        In words.
    count :
        How many postures.
    is_random :
        Whether they were drawn, so that intervals of confidence mean something.
    keep :
        ``all``, ``worst`` or ``summary``.
    chunk :
        Postures per chunk.
    version :
        Of ftforce.
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

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, found: dict[str, Any]) -> SweepSetting:
        """Return it from what JSON made of it: lists become tuples again."""
        known: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in found.items()
        }
        return cls(**known)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def size_unit(self) -> str:
        """Unit of the jump: N, or of a task of moments alone N·m."""
        return "N" if any(name[0] == "f" for name in self.components) else "N·m"

    @property
    def capability_unit(self) -> str:
        """Unit of the capability: N, or along a direction of moments alone N·m."""
        if self.direction is None:
            return self.size_unit
        pushes = (
            name[0] == "f" and x != 0.0
            for name, x in zip(self.components, self.direction, strict=True)
        )
        return "N" if any(pushes) else "N·m"


@dataclass(frozen=True, eq=False)
class Sweep(Displayed):
    """Many postures, all fault sets.

    Attributes
    ----------
    setting :
        What was asked.
    sets :
        The fault sets, small ones first.
    summary :
        Counts over all postures.
    path :
        Where it is stored; ``None`` if it is not.
    open_dataset :
        What opens the store.
    """

    setting: SweepSetting
    sets: tuple[FaultSet, ...]
    summary: Summary
    path: str | None
    open_dataset: Callable[[], xr.Dataset] = field(repr=False)

    @cached_property
    def dataset(self) -> xr.Dataset:
        """Everything as an xarray Dataset, read when it is looked at."""
        return self.open_dataset()

    @cached_property
    def joints(self) -> tuple[JointCriticality, ...]:
        """Every joint, most critical first."""
        return criticality(self.summary, self.sets, self.setting.n)

    @cached_property
    def ranked(self) -> tuple[SetSummary, ...]:
        """Every fault set, worst first."""
        return set_summaries(self.summary, self.sets)

    @property
    def done(self) -> int:
        """Number of postures that are done: fewer than asked for while it runs or if it stopped."""
        return int(self.summary.postures)

    @property
    def is_complete(self) -> bool:
        """Whether all postures are done."""
        return self.done == self.setting.count

    @property
    def every_set(self) -> Estimate:
        """Share of the postures that tolerate every fault set."""
        return tolerating_every_set(self.summary)

    def survival(self, joints: tuple[int, ...] | None = None) -> Survival:
        """Return the share of postures of each cell of the workspace that tolerate a fault set.

        Parameters
        ----------
        joints :
            Numbers from 1 of the joints that fail together; ``None`` asks for every set of the
            sweep at once.

        Raises
        ------
        InputError
            The sweep has no such set.
        """
        return survival(self.summary, None if joints is None else self.index_of(joints))

    def index_of(self, joints: tuple[int, ...]) -> int:
        """Return the place of the set of these joints (numbers from 1) among the fault sets.

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
            f"the sweep has no fault set {{{', '.join(map(str, wanted))}}}; it has: "
            f"{listed([str(one) for one in self.sets])}"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes the answer doubtful."""
        doubts = []
        if not self.is_complete:
            doubts.append(
                f"only {self.done:,} of {self.setting.count:,} postures are done: the same "
                "command goes on"
            )
        if self.setting.unknown_limits:
            names = ", ".join(self.setting.unknown_limits)
            doubts.append(f"unknown effort limits count as none: {names}")
        if not self.setting.is_random:
            doubts.append(
                "the postures were not drawn at random: intervals hold only as far as they stand "
                "for others"
            )
        return tuple(doubts)


def sets_to_lists(sets: tuple[FaultSet, ...]) -> list[list[list[Any]]]:
    """Return fault sets as JSON has them: pairs of joint (from 0) and mode."""
    return [[[fault.joint, fault.mode.value] for fault in one.faults] for one in sets]


def sets_from_lists(found: list[list[list[Any]]]) -> tuple[FaultSet, ...]:
    """Return fault sets from what JSON made of them."""
    return tuple(
        FaultSet(tuple(Fault(joint, FaultMode(mode)) for joint, mode in one)) for one in found
    )
