"""Fields that several results have in common."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from ftforce.core.faults import FaultMode
from ftforce.core.feasible_forces import LockModel
from ftforce.report import text
from ftforce.report.fields import Field, constants, under, whole

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ftforce.analysis.capability import Capability
    from ftforce.analysis.conditions import Conditions
    from ftforce.batch.result import SweepSetting
    from ftforce.core.joint_scale import JointScale
    from ftforce.core.polytope import Polytope
    from ftforce.core.task import Task

TORQUE = "N·m, N"
FORCE = "N, N·m"
SPEED = "rad/s, m/s"
TIP_SPEED = "m/s, rad/s"
TORQUE_UNIT = "N·m (N for prismatic joints)"
POSITION_UNIT = "rad (m for prismatic joints)"
GRAVITY_UNIT = "m/s², in the root's axes"

MOST_DRAWN = 3  # dimensions: polytopes in higher ones have thousands of vertices

# fmt: off
CHAIN = (
    Field("base", "base link"),
    Field("tip", "tip link"),
    Field("tip_source", "why this link is the tip; `null` if an older version stored the result",
        get=lambda arm: arm.tip_source or None),
    Field("other_tips", "other tool frames fixed to the same link: `distance` and `angle` from the "
        "tip", "m, rad", "by link", lambda arm: {
            link: {"distance": distance, "angle": angle}
            for link, (distance, angle) in arm.other_tips.items()
        }),
)
"""Of a robot, and of the setting of a stored result."""
ARM = (
    Field("name", "name"),
    *CHAIN,
    Field("joints", "joints, base to tip", shape="n names", get="names"),
    Field("types", "`revolute`, `continuous` or `prismatic`", shape="n names",
        get=lambda robot: [joint.type for joint in robot.joints]),
)
ROBOT = Field("robot", "the kinematic chain", parts=ARM)
# fmt: on


class Asked(NamedTuple):
    """The question of a result, as the conventions of its document state it."""

    task: Task
    scale: JointScale
    rtol: float
    wary: float
    conditions: Conditions
    inverse: str = ""


# fmt: off
TASK_COLUMNS = (
    Field("axes", "`tool` or `world`", get="task.axes"),
    Field("task", "the task as a word or as components", get=lambda one: str(one.task)),
    Field("length", "characteristic length; `null` if the task has no moments", "m",
        get=lambda one: one.task.length if one.task.moment_rows else None),
    Field("joint_length", "travel of a slide that weighs as much as 1 rad of a hinge; `null` if "
        "the chain does not have both", "m", get="scale.effective_length"),
)


SIGN = Field("sign", "the sign convention in a sentence", get=lambda _: text.SIGN)
# fmt: on


def task_fields(units: dict[str, str]) -> tuple[Field, ...]:
    """Return the fields of a task and of the units of a document."""
    axes, task, *lengths = TASK_COLUMNS
    about = "some of `fx fy fz mx my mz`: the order of the components of all force vectors"
    return (
        axes,
        task,
        Field("components", about, shape="m names", get="task.components"),
        *lengths,
        SIGN,
        Field("units", "the unit of each kind of number", get=whole, parts=constants(units)),
    )


# fmt: off
RTOL = Field("rtol", "rank tolerance", "1")
WARY = Field("wary", "largest tolerance considered for the verdict", "1")
GRAVITY = Field("gravity", "gravity, in the axes of the root", "m/s²", "3")
CONVENTIONS = (
    *task_fields(
        {
            "position": POSITION_UNIT,
            "velocity": "rad/s (m/s for prismatic joints)",
            "torque": TORQUE_UNIT,
            "force": "N",
            "moment": "N·m",
            "length": "m",
            "gravity": GRAVITY_UNIT,
            "mass": "kg",
            "tip_velocity": "m/s, rad/s",
            "matrix": "m/rad, rad/rad (m/m for prismatic joints), unweighted",
            "sigma": "of the weighted Jacobian [J_lin; length * J_ang], the columns of hinges "
            "divided by joint_length unless that is null",
            "lost_directions": "unit vectors of the weighted force [f; moment / length]",
        }
    ),
    *under("conditions", [GRAVITY]),
    Field("payload", "`null` if the tip carries nothing", get="conditions.payload", parts=(
        Field("mass", "mass", "kg"),
        Field("offset", "its centre of mass, in the axes of the tip frame", "m", "3"),
        Field("inertia", "about its centre, in the same axes; absent for a point mass", "kg·m²",
            "3 x 3", get=lambda x: () if x.inertia is None else x.inertia.tolist(), optional=True),
    )),
    Field("drives", "what of the drives is counted, joint friction and rotor inertia; absent if "
        "neither is", get=lambda x: str(x.conditions.drives or ""), optional=True),
    RTOL,
    WARY,
)
POSTURE = Field("posture", "joint positions", parts=(
    Field("q", "joint positions", "rad, m", "n"),
    Field("source", "where they come from"),
))
LIMITS = (
    Field("source", "`urdf`, the file, or `given`"),
    Field("effort", "largest motor torques, healthy; `null` if unknown", TORQUE, "by joint"),
    Field("effort_lower", "lower limits of the motors; `null` if they are those of `effort`",
        TORQUE, "by joint", get="lower"),
    Field("brake", "largest brake torques; `null` if unknown", TORQUE, "by joint"),
    Field("stall_torque", "of torque-speed lines; `null` if there are none", TORQUE, "by joint",
        get="line.stall_torque"),
    Field("no_load_speed", "of torque-speed lines; `null` if there are none", SPEED,
        "by joint", get="line.no_load_speed"),
)
FAULT_SET = Field("fault_set", "numbers of the failed joints, from 1",
    get=lambda one: str(one.faults))
FAILED = Field("joints", "failed joints", shape="names", get="faults.joints")
LIMITS_SOURCE = Field("limits", "source of the torque limits in force, or `none`",
    get=lambda one: "none" if one.limits is None else one.limits.source)
LIMITS_IN_FORCE = under("limits", LIMITS)
LIMITS_MEANING = "torque limits in force; `null` if there are none"
VERDICT = Field("verdict", "`tolerated`, `borderline` or `not tolerated`")
SUMMARY = Field("summary", "a sentence")
WARNINGS = Field("warnings", "sentences", shape="list")
# fmt: on

# fmt: off
RANK = Field("rank", "first and last rank: ties share theirs; `null` for the healthy arm",
    shape="2")
RANK_COLUMNS = (
    Field("rank_first", "first rank, worst is 1; empty for the healthy arm", get="rank.first"),
    Field("rank_last", "last rank: ties share theirs", get="rank.last"),
)
# fmt: on


def limited(result: Any) -> Any:
    """Return a result if torque limits are in force, otherwise ``None``."""
    return None if result.limits is None else result


# fmt: off
LOCKED = Field("locked", "locked joints", shape="names",
    get=lambda x: x.faults.in_mode(FaultMode.LOCKED))
MODES = (
    Field("modes", "`locked`, `free` or `weak`", shape="by failed joint",
        get=lambda x: {fault.joint: fault.mode for fault in x.faults.faults}),
    Field("weak_factors", "remaining share of its largest torque", "1", "by weak joint",
        lambda x: {f.joint: f.factor for f in x.faults.faults if f.mode is FaultMode.WEAK}),
)

JUMP = (
    Field("after", "force that the motors can still command; `null` if the arm cannot be held in "
        "static equilibrium, and so are the values that follow from it", FORCE, "m"),
    Field("jump", "force jump ΔF = before − after", FORCE, "m"),
    Field("jump_norm", "norm of the forces of ΔF; `null` if the task has none", "N"),
    Field("moment_jump_norm", "norm of the moments of ΔF; `null` if the task has none", "N·m"),
)
REQUESTED = Field("requested", "requested force; `null` if none was given", FORCE, "m")
BEFORE = Field("before", "F̂, the part of it that the healthy arm can exert", FORCE, "m")

AMOUNT = (
    Field("most", "largest value; `null` if no known limit bounds it (`end` is `unlimited`) or if "
        "no value can be held", "`unit`", get="maximum"),
    Field("least", "smallest value, nonzero only with free-swinging joints or if weight alone "
        "exceeds a limit; `null` if no value can be held", "`unit`", get="minimum"),
    Field("end", "what limits it: `limit`, `fault`, `weight`, `friction` (of a free-swinging "
        "joint), `unlimited`, or `direction`: even the healthy arm exerts no force in this "
        "direction"),
    Field("stops", "joints that limit it", shape="names", get="limiting_joints"),
)
# fmt: on


def _by_time(parts: tuple[Field, ...], before: Any = "", after: Any = "") -> tuple[Field, ...]:
    """Return the fields of a quantity before and after the fault.

    Parameters
    ----------
    parts :
        Fields of the quantity.
    before, after :
        How to get it, as in `Field`.
    """
    return (
        Field("before", "before the fault", get=before, parts=parts),
        Field("after", "after the fault; keys as `before`", "", "as `before`", after, parts),
    )


def _by_lock(parts: tuple[Field, ...]) -> tuple[Field, ...]:
    """Return the fields of a mapping by lock model."""
    commanded, held = map(itemgetter, (LockModel.COMMANDED, LockModel.HELD))
    about = "what motors and brakes can bear; keys as `commanded`"
    return (
        Field("commanded", "what the motors can exert", get=commanded, parts=parts),
        Field("held", about, "", "as `commanded`", held, parts),
    )


# fmt: off
WEAKEST = Field("direction", "in the axes of the task; differs before and after the fault and "
    "between lock models; `null` if no direction is weaker than another", "1", "m",
    lambda amount: amount.direction if math.isfinite(amount.maximum) else None)
CAPABILITY = (
    Field("directions", "each task axis in both senses, and the requested direction", shape="list",
        parts=(
        Field("name", "`+fx`, `-fx`, …, `direction`"),
        Field("direction", "in the axes of the task", "1", "m",
            lambda report: report.before[LockModel.COMMANDED].direction),
        Field("unit", "`N`, or `N·m` for a pure moment"),
        *_by_time(_by_lock(AMOUNT)),
    )),
    Field("weakest", "the direction in which the least force can be held", get=whole, parts=(
        Field("unit", "`N`, `N·m`, or `weighted N` for a task with forces and moments",
            get=lambda capability: text.unit_of_size(capability.analysis.task)),
        *under("weakest", _by_time(_by_lock((WEAKEST, *AMOUNT)))),
    )),
    Field("payload", "additional payload that the tip can carry", parts=(
        Field("unit", "`kg`", get=lambda _: "kg"),
        *_by_time(AMOUNT, itemgetter(0), itemgetter(1)),
    )),
)
# fmt: on


def _polytopes(capability: Capability, after: bool) -> dict[LockModel, Polytope]:
    return {lock: capability.polytope(after=after, reading=lock) for lock in LockModel}


# fmt: off
POLYTOPE = Field("polytope", "forces that can be held; `null` for a task of more than three "
    "components",
    get=lambda capability: capability if capability.analysis.task.m <= MOST_DRAWN else None,
    parts=_by_time(
    _by_lock((
        Field("vertices", "corners, in the axes of the task; empty if no force can be held", FORCE,
            "k × m"),
        Field("faces", "row numbers of `vertices`, from 0; in three dimensions in order around the "
            "face", shape="list"),
        Field("dimension", "0 for a point, 1 for a segment, 2 for a flat polygon, 3 for a body"),
        Field("is_bounded", "whether known limits bound it in every direction; if not, the corners "
            "are those of a section"),
    )),
    partial(_polytopes, after=False),
    partial(_polytopes, after=True),
))
# fmt: on


def _setting_length(setting: SweepSetting) -> float | None:
    has_moments = any(name[0] == "m" for name in setting.components)
    return setting.length if has_moments else None


# fmt: off
SETTING_ARM = (
    Field("name", "name", get="robot"),
    *CHAIN,
    Field("joints", "joints, base to tip", shape="n names"),
)
"""Of the setting of a sweep."""
SETTING_PAYLOAD = (
    Field("payload", "description; `null` without a payload", get=lambda x: x.payload or None),
    Field("payload_mass", "its mass; `null` without a payload", "kg", get="carried.mass"),
    Field("payload_offset", "its position, in the axes of the tip frame; likewise", "m", "3",
        "carried.offset"),
)
SETTING_TASK = (
    replace(TASK_COLUMNS[0], get=""),
    replace(TASK_COLUMNS[1], get=""),
    replace(TASK_COLUMNS[2], get=_setting_length),
    TASK_COLUMNS[3],
)
SETTING_COMPONENTS = Field("components", "order of the components of all force vectors",
    shape="m names")
SETTING_COLUMNS = (
    *SETTING_TASK,
    replace(LIMITS_SOURCE, get=lambda setting: setting.limits or "none"),
    RTOL,
    WARY,
)
SWEEP_POSTURES = (
    Field("count", "number requested", get="setting.count"),
    Field("done", "number analysed"),
    Field("random", "whether they were drawn at random", get="setting.is_random"),
)

ESTIMATE = (Field("value"), Field("low"), Field("high"))
# fmt: on
"""A number and the ends of its 95 % confidence interval; the shape ``estimate`` stands for it."""


def estimate(key: str, meaning: str = "", unit: str = "1", get: Any = "") -> Field:
    """Return the field of a number with its confidence interval."""
    return Field(key, meaning, unit, "estimate", get, ESTIMATE)


def quantiles(
    field: Field, keys: Sequence[str], get: str = "", parts: tuple[Field, ...] = ()
) -> Field:
    """Return the field of several quantiles of a quantity.

    Parameters
    ----------
    field :
        The quantity.
    keys :
        Names of the quantiles, in the order of the values.
    get :
        Path of the sequence of values.
    parts :
        Fields of each value.
    """
    each = tuple(Field(key, get=itemgetter(i), parts=parts) for i, key in enumerate(keys))
    about = f"quantiles {', '.join(f'`{key}`' for key in keys)} of: {field.meaning}"
    return replace(field, meaning=about, shape="quantiles", get=get, parts=each)
