"""Reading of YAML as plain data: mappings, lists and texts, nothing that its tags could construct.

Aliases are rejected, since they unfold without bound, and so are duplicate keys and tags, except
for those of ROS that say the unit of an angle.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

from ftforce.errors import InputError
from ftforce.io.text import read_numbers

if TYPE_CHECKING:
    import yaml

_DEEPEST = 20
_PLAIN = {None, "!", *(f"tag:yaml.org,2002:{kind}" for kind in ("float", "int", "str", "bool"))}
_ANGLES = {"!degrees": math.pi / 180.0, "!radians": 1.0}

Plain: TypeAlias = "dict[str, Any] | list[Any] | str"


def read_yaml(text: str) -> Plain:
    """Parse a YAML document; scalars are texts, ``!degrees`` is converted to rad.

    Parameters
    ----------
    text :
        The document.

    Raises
    ------
    InputError
        It is not well-formed, or contains aliases, tags, duplicate keys or several documents, or
        is nested too deeply.
    """
    import yaml

    try:
        _check_events(text)
        node = yaml.compose(text, Loader=yaml.BaseLoader)
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        where = f"line {mark.line + 1}: " if mark else ""
        reason = problem.problem or problem.context
        raise InputError(f"is not well-formed YAML ({where}{reason})") from None
    except yaml.YAMLError as problem:
        raise InputError(f"is not well-formed YAML ({' '.join(str(problem).split())})") from None
    return {} if node is None else _plain(node)


def _check_events(text: str) -> None:
    """Check what `yaml.compose` does not, without recursion."""
    import yaml

    depth = 0
    for event in yaml.parse(text, Loader=yaml.BaseLoader):
        line = f"line {event.start_mark.line + 1}"
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f"{line}: aliases (*{event.anchor}) are not supported")
        if isinstance(event, yaml.NodeEvent) and not isinstance(event, yaml.AliasEvent):
            tag = event.tag
            if tag not in _PLAIN and not (tag in _ANGLES and isinstance(event, yaml.ScalarEvent)):
                raise InputError(f"{line}: the tag {tag} is not supported")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise InputError(f"{line}: is nested more than {_DEEPEST} levels deep")


def _plain(node: yaml.Node) -> Plain:
    import yaml

    if isinstance(node, yaml.SequenceNode):
        return [_plain(item) for item in node.value]
    if isinstance(node, yaml.MappingNode):
        content: dict[str, Any] = {}
        for key, value in node.value:
            line = f"line {key.start_mark.line + 1}"
            if not isinstance(key, yaml.ScalarNode):
                raise InputError(f"{line}: a key must be a plain word")
            if key.value in content:
                raise InputError(f"{line}: the key {key.value!r} appears twice")
            content[key.value] = _plain(value)
        return content
    text: str = node.value
    if node.tag in _ANGLES:
        try:
            return repr(read_numbers(text, 1)[0] * _ANGLES[node.tag])
        except ValueError as problem:
            line = f"line {node.start_mark.line + 1}"
            raise InputError(f"{line}: {node.tag} {text!r}: {problem}") from None
    return text
