"""Best postures as text, JSON, table rows and SRDF."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree import ElementTree

from ftforce.report import parts
from ftforce.report.fields import Document, Field, Row, columns, document, rows_of, under, whole
from ftforce.report.text import ratio, set_of, size

if TYPE_CHECKING:
    from ftforce.core.faults import FaultSet
    from ftforce.planning.posture import BestPosture
    from ftforce.planning.self_motion import Component

_SAME = 1e-6  # relative: no gain
BEST = "best"
"""Name of the posture in an SRDF."""


def in_words_of(found: BestPosture, value: float) -> str:
    """Return a value of the objective with its unit.

    Parameters
    ----------
    found :
        The best posture.
    value :
        The value.
    """
    unit = found.objective.unit
    return f"{size(value)} {unit}" if unit else ratio(value)


def worst_before_after(found: BestPosture) -> tuple[tuple[float, FaultSet], tuple[float, FaultSet]]:
    """Return the measure after the worst set, and that set: before and after."""
    both = []
    for measured in (found.measured_before, found.measured_after):
        i = found.worst_set(measured)
        both.append((float(measured[i]), found.sets[i]))
    return both[0], both[1]


def posture_sentence(found: BestPosture) -> str:
    """Say what the best posture keeps, and what the usual one does."""
    (before, set_before), (after, set_after) = worst_before_after(found)
    measure = found.objective.measure
    what = f"the {measure.words} after the worst fault"
    gain = before - after if measure.is_cost else after - before
    if found.self_motion.dimension == 0 and len(found.self_motion.components) == 1:
        return (
            f"One posture was found, so there is nothing to choose: {what} is "
            f"{in_words_of(found, after)}, with {set_of(set_after.joints)}."
        )
    if before == after or gain <= _SAME * abs(before):
        return (
            f"The usual posture is as good as any found: {what} is {in_words_of(found, before)}, "
            f"with {set_of(set_before.joints)}."
        )
    verb = "falls" if measure.is_cost else "rises"
    old = f"{in_words_of(found, before)} ({set_of(set_before.joints)})"
    new = f"{in_words_of(found, after)} ({set_of(set_after.joints)})"
    return f"{what[0].upper()}{what[1:]} {verb} from {old} to {new}."


def pieces_in_words(found: BestPosture) -> str:
    """Say how large the self-motion is and how it was found."""
    motion = found.self_motion
    count, loops = len(motion.components), sum(one.closed for one in motion.components)
    postures = f"{len(motion.q):,} postures" if len(motion.q) > 1 else "1 posture"
    came = f"found by {motion.found_from} of {motion.restarts} starts"
    if motion.dimension == 0:
        return f"{postures}, one per branch ({came}): the arm has no self-motion here"
    pieces = f"{count} pieces" if count > 1 else "1 piece"
    kind = f", {loops} of them {'a loop' if loops == 1 else 'loops'}" if loops else ""
    return (
        f"of dimension {motion.dimension}: {pieces}{kind}, {postures} at most "
        f"{motion.step:.2g} apart ({came})"
    )


class SetGain(NamedTuple):
    """One fault set before and after."""

    faults: FaultSet
    before: float
    after: float
    gain: float


def set_rows(found: BestPosture) -> list[SetGain]:
    """Return the sets, with what is left before and after, in the order of the sets."""
    values = (found.measured_before, found.measured_after, found.gains)
    return [SetGain(*one) for one in zip(found.sets, *(x.tolist() for x in values), strict=True)]


def _objective(found: BestPosture) -> SimpleNamespace:
    (before, set_before), (after, set_after) = worst_before_after(found)
    return SimpleNamespace(
        name=found.objective.name, unit=found.objective.unit, before=before, after=after,
        worst_set_before=set_before.joints, worst_set_after=set_after.joints, bound=found.bound,
    )  # fmt: skip


def _by_joint(found: BestPosture, values: Any) -> dict[str, Any]:
    return dict(zip(found.robot.names, values.tolist(), strict=True))


class _Piece(NamedTuple):
    """A component of the self-motion, with the arm that it is of."""

    piece: Component
    found: BestPosture


def _pieces(found: BestPosture) -> list[_Piece]:
    return [_Piece(piece, found) for piece in found.self_motion.components]


# fmt: off
_SET_MEASURES = (
    Field("before", "the measure in the usual posture"),
    Field("after", "the measure in the best posture"),
    Field("gain", "how much better it is, positive if better"),
)
_RANGES = "least and greatest position of every joint"
POSTURE = (
    replace(parts.ROBOT, shape="as of an analysis"),
    Field("conventions", "as of an analysis", shape="as of an analysis",
        get=lambda x: parts.Asked(x.task, x.scale, x.rtol, x.wary, x.conditions),
        parts=parts.CONVENTIONS),
    Field("target", "what of the tip is kept, in root axes", get="self_motion.target", parts=(
        Field("position", "position of the tip", "m", "3"),
        Field("rotation", "rotation matrix of the tip; `null` if it may turn", "1", "3 x 3"),
    )),
    Field("posture", "joint positions", get=whole, parts=(
        Field("before", "in the given or usual posture", "rad, m", "by joint", "before.q"),
        Field("after", "in the best posture", "rad, m", "by joint", "after.q"),
        Field("source_before", "where the posture before comes from", get="before.source"),
    )),
    Field("mode", "`locked` or `free`"),
    Field("faults", "size of the largest sets", get="largest"),
    Field("limits", parts.LIMITS_MEANING, get=parts.limited, parts=parts.LIMITS_IN_FORCE),
    Field("objective", "what is best after the worst set", get=_objective, parts=(
        Field("name", "`margin`, `rho`, `capability`, `payload` or `jump`, which is minimised"),
        Field("unit", "its unit; empty for none"),
        Field("before", "the measure after the worst set, in the usual posture"),
        Field("after", "likewise, in the best posture"),
        Field("worst_set_before", "joints of the worst set in the usual posture", shape="names"),
        Field("worst_set_after", "likewise, in the best posture", shape="names"),
        Field("bound", "what no posture exceeds; `null` unless the objective is `rho` of locked "
            "joints"),
    )),
    Field("sets", "every fault set", shape="list", get=set_rows, parts=(
        parts.FAILED, *_SET_MEASURES,
    )),
    Field("self_motion", "all postures that were found to reach the target", get=whole, parts=(
        *under("self_motion", (
            Field("dimension", "its dimension, 0 without redundancy"),
            Field("ranges", _RANGES, "rad, m", "by joint"),
        )),
        Field("closed", "whether each piece is a loop", shape="list",
            get=lambda x: [one.closed for one in x.self_motion.components]),
        Field("components", "connected pieces", shape="list", get=_pieces, parts=(
            *under("piece", (
                Field("closed", "whether it is a loop"),
                Field("complete", "whether it is traced or covered whole"),
                Field("count", "number of postures", get=lambda one: len(one.q)),
            )),
            Field("ranges", _RANGES, "rad, m", "by joint",
                get=lambda one: _by_joint(one.found, one.piece.ranges)),
        )),
        *under("self_motion", (
            Field("step", "longest distance between neighbouring postures", "rad, m"),
            Field("found_from", "number of starts that reached the target"),
            Field("restarts", "number of starts"),
            Field("seed", "seed of the random starts"),
            Field("tip_error", "largest error of the tip over all postures", "m, rad"),
        )),
    )),
    Field("tied", "whether other postures are as good, so that the distance to limits chose",
        get="is_tied"),
    replace(parts.SUMMARY, get=posture_sentence),
    Field("notes", "what was chosen", shape="list"),
    parts.WARNINGS,
)
# fmt: on


def posture_document(found: BestPosture) -> Document:
    """Return a best posture as a JSON document."""
    return document(POSTURE, found, found.robot.names)


# fmt: off
SET_COLUMNS = (parts.FAULT_SET, parts.FAILED, *_SET_MEASURES)
# fmt: on


def posture_rows(found: BestPosture) -> list[Row]:
    """Return the fault sets as table rows, with what is left before and after."""
    names, measure = found.robot.names, found.objective
    about = {"objective": measure.name, "unit": measure.unit}
    return rows_of(columns(SET_COLUMNS, one, names) | about for one in set_rows(found))


def posture_srdf(found: BestPosture) -> str:
    """Return an SRDF with the chain, and with the posture ``best`` and the usual one.

    Parameters
    ----------
    found :
        The best posture.
    """
    arm = found.robot
    root = ElementTree.Element("robot", name=arm.name)
    group = ElementTree.SubElement(root, "group", name="arm")
    ElementTree.SubElement(group, "chain", base_link=arm.base, tip_link=arm.tip)
    for name, posture in ((BEST, found.after), ("before", found.before)):
        state = ElementTree.SubElement(root, "group_state", name=name, group="arm")
        for joint, value in zip(arm.names, posture.q.tolist(), strict=True):
            ElementTree.SubElement(state, "joint", name=joint, value=repr(value))
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
