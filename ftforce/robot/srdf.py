"""Reading of SRDF files: end effectors, chains and named postures."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ftforce.errors import SRDFError
from ftforce.io.text import check_name, read_numbers
from ftforce.io.xml_text import read_xml

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike
    from xml.etree.ElementTree import Element


class Srdf(NamedTuple):
    """The parts of an SRDF that ftforce uses.

    Attributes
    ----------
    path :
        Path of the file; empty if there is none.
    end_effectors :
        Parent links of the end effectors.
    chains :
        Pairs of base link and tip link.
    states :
        Joint positions (rad, m) of every named posture, by joint name. States of several groups
        with the same name form one posture; where they differ, the last one applies.
    """

    path: str = ""
    end_effectors: tuple[str, ...] = ()
    chains: tuple[tuple[str, str], ...] = ()
    states: Mapping[str, Mapping[str, float]] = MappingProxyType({})


def read_srdf(path: str | PathLike[str]) -> Srdf:
    """Read an SRDF.

    Raises
    ------
    SRDFError
        The file cannot be read, is not an SRDF, or has joint values that are not finite numbers.
    """
    return srdf_of(read_xml(path, SRDFError, "an SRDF").root, path)


def srdf_of(root: Element, path: str | PathLike[str]) -> Srdf:
    """Return the parts of an SRDF, given by its root element, that ftforce uses.

    Raises
    ------
    SRDFError
        As in `read_srdf`.
    """
    if root.tag != "robot":
        raise SRDFError(path, f"is not an SRDF: its root element is <{root.tag}>, not <robot>")
    ends = [e.get("parent_link", "") for e in root.iter("end_effector")]
    chains = [(e.get("base_link", ""), e.get("tip_link", "")) for e in root.iter("chain")]
    states: dict[str, dict[str, float]] = {}
    named = [("link", link) for link in (*ends, *(link for pair in chains for link in pair))]
    named += [("state", state.get("name", "")) for state in root.iter("group_state")]
    try:
        for kind, name in named:
            check_name(name, kind)
    except ValueError as problem:
        raise SRDFError(path, str(problem)) from None
    for state in root.iter("group_state"):
        states.setdefault(state.get("name", ""), {}).update(_values(state, path))
    return Srdf(
        str(path),
        tuple(dict.fromkeys(filter(None, ends))),
        tuple(dict.fromkeys(chain for chain in chains if all(chain))),
        MappingProxyType({name: MappingProxyType(q) for name, q in states.items() if name.strip()}),
    )


def _values(state: Element, path: str | PathLike[str]) -> dict[str, float]:
    values = {}
    for joint in state.iter("joint"):
        name, value = joint.get("name", ""), joint.get("value", "")
        if len(value.split()) > 1:  # a floating or planar joint, which is held fixed
            continue
        try:
            values[name] = read_numbers(value, 1)[0]
        except ValueError as problem:
            where = f"state {state.get('name')!r}, joint {name!r}"
            raise SRDFError(path, f"{where}: value {problem}") from None
    return values
