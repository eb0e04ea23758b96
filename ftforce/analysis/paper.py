"""Compare the paper's printed numbers with computed ones, and explain differences by errata.

Abdi & Nahavandi, *Fault Tolerance Force for Redundant Manipulators*: J and ¹J of eqs. (34) and
(35), Tables 2-5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from ftforce.analysis.analyze import Analysis, analyze
from ftforce.core.display import Displayed
from ftforce.robot.load import load_robot
from ftforce.robot.posture import choose_posture

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike

    from ftforce.core.arrays import Matrix, Vector
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot

_FORCE = (80.0, 50.0, 10.0)  # N, section IV
_VELOCITY = (0.05, 0.40, 0.20, 0.10, 0.30)  # rad/s, Table 2
_AXES = ("x", "y", "z")

_PRINTED_J = (
    ("-0.00", "-0.00", "0.16", "0.00", "0.00"),
    ("-0.57", "-0.15", "0.28", "0.20", "0.08"),
    ("-0.64", "-0.48", "0.00", "0.00", "0.00"),
)
_PRINTED_J_1 = (  # without the column of joint 1
    ("0.00", "0.16", "0.00", "0.00"),
    ("-0.15", "0.28", "0.20", "0.08"),
    ("-0.48", "0.00", "0.00", "0.00"),
)
PRINTED_TORQUE = ("-35.01", "-12.33", "26.85", "10.00", "4.00")
_PRINTED_FORCE_SHARE = ("3.18", "1.12", "2.44", "0.91", "0.36")
_PRINTED_VELOCITY_SHARE = ("0.19", "0.89", "0.28", "0.09", "0.11")
_PRINTED_TIP_VELOCITY = ("0.033", "0.01", "-0.23")
# Locked joints, torques to command, force jump.
_PRINTED_SETS = {
    "Eq. (42)": (((1,), ("0", "-12.33", "26.85", "10.00", "4.00"), "0"),),
    "Table 3": (
        ((2,), ("-35.01", "0", "26.85", "10.00", "4.00"), "0.00"),
        ((3,), ("-35.01", "-12.33", "0", "10.00", "4.00"), "80.00"),
        ((4,), ("-35.01", "-12.33", "26.85", "0", "4.00"), "0.00"),
        ((5,), ("-35.01", "-12.33", "26.85", "10.00", "0"), "0.00"),
    ),
    "Table 4": (
        ((2, 3), ("-35.01", "0", "0", "10.00", "4.00"), "80.00"),
        ((2, 4), ("-35.01", "0", "26.85", "0", "4.00"), "0.00"),
    ),
    "Table 5": (
        ((2, 3, 4), ("-35.01", "0", "0", "0", "4.00"), "80"),
        ((2, 4, 5), ("-35.01", "0", "26.85", "0", "0"), "43.66"),
    ),
}

ERRATA = (
    ("(29), (37), (39)", "U = (ᔆJᵀ)†{…}", "U = ᔆJᵀ (Jᵀ)† τ, as in (42)"),
    (
        "(18), (27), (28)",
        "F = (Jᵀ)†τ + (I - Jᵀ(Jᵀ)†) z",
        "dimensions do not match; the free part is τ_N = (I - J†J) τ",
    ),
    ("(19)", "(JJᵀ)⁻¹J", "only for full row rank"),
    (
        "after (33)",
        "F belongs to the null space of ᵏJᵀ",
        "F in range(ᵏJ): no component in that null space",
    ),
    (
        "Table 2",
        "torque contribution ‖(Jᵀ)†_k τ_k‖/‖F‖",
        "the printed numbers are ‖(Jᵀ)†‖₂·|τ_k|/‖F‖",
    ),
    ("section IV", "Ẋ in cm/sec", "m/s"),
    ("Tables 4, 5", "captions: joint velocities, rad/sec", "torques, N·m"),
    ("second (34), (35)", "J and ¹J of the case study", "belong between (40) and (42)"),
    ("Appendix A", "K(KᵀK)⁻¹Kᵀ", "K K†: KᵀK is singular when n - f > m"),
)
"""Location, printed form, correct form."""

_SHARE_ERRATUM = "Table 2: the printed numbers are ‖(Jᵀ)†‖₂·|τ_k|/‖F‖"
_UNIT_ERRATUM = "section IV: the printed numbers are in m/s, not cm/s"


class Outcome(StrEnum):
    """Outcome of comparing a printed number; another arm has none, its numbers are computed."""

    PASS = "pass"
    ERRATUM = "erratum"
    FAIL = "fail"
    COMPUTED = "computed"


@dataclass(frozen=True, slots=True)
class Check:
    """Comparison of one printed number.

    Attributes
    ----------
    table, row, column :
        Position in the paper.
    printed :
        The number as printed; empty for another arm.
    computed :
        Value from the paper's stated formula and unit.
    erratum, explained :
        A known erratum, and the value computed with it taken into account.
    """

    table: str
    row: str
    column: str
    printed: str
    computed: float
    erratum: str = ""
    explained: float = math.nan

    @property
    def decimals(self) -> int:
        """Number of printed decimals."""
        return len(self.printed.partition(".")[2])

    @property
    def outcome(self) -> Outcome:
        """Pass if all printed digits agree; erratum only if the explanation reproduces them."""
        if not self.printed:
            return Outcome.COMPUTED
        if self._agrees(self.computed):
            return Outcome.PASS
        return Outcome.ERRATUM if self._agrees(self.explained) else Outcome.FAIL

    def _agrees(self, value: float) -> bool:
        half_a_digit = 0.5 * 10.0**-self.decimals
        return abs(value - float(self.printed)) <= half_a_digit * (1.0 + 1e-9)


@dataclass(frozen=True, slots=True, repr=False)
class Replication(Displayed):
    """Comparison of all numbers of the paper's case study, or the same tables of another arm.

    Attributes
    ----------
    checks :
        The comparisons, in the order of the paper.
    healthy :
        Analysis of the healthy arm: robot, posture, force and velocity.
    """

    checks: tuple[Check, ...]
    healthy: Analysis

    @property
    def is_of_another_arm(self) -> bool:
        """Whether nothing is printed with which the numbers could be compared."""
        return not any(check.printed for check in self.checks)

    @property
    def is_successful(self) -> bool:
        """Whether no comparison fails."""
        return all(check.outcome is not Outcome.FAIL for check in self.checks)

    def count(self, outcome: Outcome) -> int:
        """Return the number of comparisons with this outcome.

        Parameters
        ----------
        outcome :
            The outcome to count.
        """
        return sum(check.outcome is outcome for check in self.checks)


def replicate(robot: Robot | None = None) -> Replication:
    """Compute every printed number of the paper's case study.

    Parameters
    ----------
    robot :
        The arm of Table 1 with its posture ``paper``; by default the known robot ``dh5``.
    """
    arm = load_robot("dh5") if robot is None else robot
    place = choose_posture(arm, name="paper")

    def with_locked(locked: Sequence[int]) -> Analysis:
        return analyze(arm, place, locked=locked, force=_FORCE, velocity=_VELOCITY)

    table_2 = (PRINTED_TORQUE, _PRINTED_FORCE_SHARE, _PRINTED_VELOCITY_SHARE)
    return _tables(with_locked, _PRINTED_J, _PRINTED_J_1, table_2, _PRINTED_SETS)


def paper_tables(
    robot: Robot,
    q: ArrayLike | Posture | None = None,
    *,
    force: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    posture: str | None = None,
) -> Replication:
    """Compute the tables of the paper's case study for another arm.

    Table 3 has every other joint locked alone; eq. (42) and Tables 4 and 5 have the fault sets of
    the paper, as far as the arm has the joints.

    Parameters
    ----------
    robot :
        The arm.
    q, posture :
        As in `ftforce.analyze`.
    force :
        Force the tool exerts, N, in tool axes, shape (3,); by default the paper's.
    velocity :
        Joint velocities, rad/s or m/s, shape (n,); by default the paper's if the arm has as many
        joints, else 0.1 each.

    Raises
    ------
    InputError
        An argument is invalid, or even the healthy arm cannot exert the force.
    """
    place = choose_posture(robot, q, posture)
    n, usual = robot.n, _VELOCITY if robot.n == len(_VELOCITY) else (0.1,) * robot.n
    F, v = _FORCE if force is None else force, usual if velocity is None else velocity

    def with_locked(locked: Sequence[int]) -> Analysis:
        return analyze(robot, place, locked=locked, force=F, velocity=v)

    sets = {
        table: tuple((joints, ("",) * n, "") for joints in sorted(among) if max(joints) <= n)
        for table, among in (_sets_of(table, n) for table in _PRINTED_SETS)
    }
    blank = ("",) * n
    return _tables(with_locked, (blank,) * 3, (blank[1:],) * 3, (blank,) * 3, sets)


def _sets_of(table: str, n: int) -> tuple[str, list[tuple[int, ...]]]:
    """Return the locked joints of a table; Table 3 has those of the arm."""
    if table == "Table 3":
        return table, [(joint,) for joint in range(2, n + 1)]
    return table, [joints for joints, _, _ in _PRINTED_SETS[table]]


def _tables(
    with_locked: Callable[[Sequence[int]], Analysis],
    J: Sequence[Sequence[str]],
    J_1: Sequence[Sequence[str]],
    table_2: Sequence[Sequence[str]],
    sets: Mapping[str, Sequence[tuple[tuple[int, ...], tuple[str, ...], str]]],
) -> Replication:
    """Return the comparisons with printed numbers, which are empty for another arm."""
    healthy = with_locked(())
    checks = [*_jacobian("J, eq. (34)", J, healthy.J)]
    checks += [*_table_2(healthy, table_2), *_tip_velocity(healthy, bool(J[0][0]))]
    reduced = with_locked((1,)).reduced.K
    checks += _jacobian("¹J, eq. (35)", J_1, reduced[:, 1:], first=2)
    for table, columns in sets.items():
        checks += _remaps(table, columns, with_locked)
    return Replication(tuple(checks), healthy)


def _jacobian(
    table: str, rows: Sequence[Sequence[str]], J: Matrix, *, first: int = 1
) -> Iterator[Check]:
    for axis, printed, computed in zip(_AXES, rows, J.tolist(), strict=True):
        for joint, (text, value) in enumerate(zip(printed, computed, strict=True), start=first):
            yield Check(table, axis, f"joint {joint}", text, value)


def _table_2(healthy: Analysis, printed: Sequence[Sequence[str]]) -> Iterator[Check]:
    torque, force = healthy.torque, healthy.force
    if torque is None or force is None:
        return
    sigma_min = healthy.reduced.healthy.s[-1]
    size = float(np.linalg.norm(force.before))
    with np.errstate(divide="ignore"):  # another arm may be singular; no erratum applies then
        as_printed = np.abs(torque.before) / (sigma_min * size)  # ‖(Jᵀ)†‖₂ = 1/σ_min
    columns: tuple[tuple[str, Sequence[str], Vector | None], ...] = (
        ("torque", printed[0], torque.before),
        ("share of force", printed[1], healthy.force_contributions),
        ("share of velocity", printed[2], healthy.velocity_contributions),
    )
    for column, texts, computed in columns:
        is_share = column == "share of force"
        for i, text in enumerate(texts):
            yield Check(
                "Table 2",
                f"joint {i + 1}",
                column,
                text,
                math.nan if computed is None else float(computed[i]),
                _SHARE_ERRATUM if is_share and text else "",
                float(as_printed[i]) if is_share else math.nan,
            )


def _tip_velocity(healthy: Analysis, is_printed: bool) -> Iterator[Check]:
    if healthy.velocity is None:
        return
    velocity = healthy.velocity.tip_before.tolist()
    if not is_printed:
        for axis, v in zip(_AXES, velocity, strict=True):
            yield Check("Ẋ, section IV", axis, "m/s", "", v)
        return
    for axis, text, v in zip(_AXES, _PRINTED_TIP_VELOCITY, velocity, strict=True):
        yield Check("Ẋ, section IV", axis, "cm/s", text, 100.0 * v, _UNIT_ERRATUM, v)


def _remaps(
    table: str,
    columns: Sequence[tuple[tuple[int, ...], tuple[str, ...], str]],
    with_locked: Callable[[Sequence[int]], Analysis],
) -> Iterator[Check]:
    for locked, torques, jump in columns:
        result = with_locked(locked)
        if result.torque is None or result.torque.after is None or result.force is None:
            continue
        name = "{" + ", ".join(map(str, locked)) + "}"
        after = result.torque.after.tolist()
        for joint, (text, value) in enumerate(zip(torques, after, strict=True), start=1):
            yield Check(table, f"joint {joint}", name, text, value)
        norm = result.force.jump_norm
        yield Check(table, "force jump", name, jump, math.nan if norm is None else norm)
