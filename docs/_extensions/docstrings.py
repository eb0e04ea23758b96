"""Small repairs between NumPy docstrings, annotations and autodoc."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from sphinx.addnodes import desc_annotation
from sphinx.util.nodes import make_refnode

import ftforce

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.addnodes import pending_xref
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

_ARRAY = re.compile(
    r"(?:~?numpy\.)?ndarray\[tuple\[(?:~?typing\.)?Any, (?:\.\.\.|…)\], "
    r"(?:~?numpy\.)?dtype\[[~.\w]+\]\]"
)


def keep_first_line(_app: Sphinx, what: str, *rest: Any) -> None:
    """Stop napoleon from taking ``Unit of x: N or N·m.`` for a type and its description."""
    lines = rest[-1]
    if what in {"attribute", "data", "property"}:
        lines[:0] = ["..", ""]  # an empty comment, which holds no colon


def shorten_docstring(_app: Sphinx, *rest: Any) -> None:
    """Write ``ndarray`` for the type of an array; the text says its shape."""
    lines = rest[-1]
    lines[:] = [_ARRAY.sub("ndarray", line) for line in lines]


def shorten_signature(_app: Sphinx, what: str, *rest: Any) -> tuple[str, str | None] | None:
    """Do so in a signature; a class shows none, because functions make most objects."""
    signature, returned = rest[-2:]
    if signature is None:
        return None
    if what in {"class", "exception"}:
        return "", None
    return _ARRAY.sub("ndarray", signature), returned and _ARRAY.sub("ndarray", returned)


def shorten_property(_app: Sphinx, _domain: str, _objtype: str, content: nodes.Element) -> None:
    """Do so in the type of a property."""
    for node in list(content.parent.findall(desc_annotation)):
        words = [child.astext() for child in node]
        starts = [i for i, word in enumerate(words) if word.endswith("ndarray")]
        for start in reversed(starts):
            depths = [0]
            for word in words[start + 1 :]:
                depths.append(depths[-1] + (word == "[") - (word == "]"))
                if depths[-1] == 0:
                    break
            if words[start + 1 : start + 2] == ["["]:
                del node[start + 1 : start + len(depths)]


def skip_tuple_fields(_app: Sphinx, _what: str, _name: str, obj: object, *_: Any) -> bool | None:
    """Leave out the fields of named tuples, which the class has under Attributes already."""
    return True if str(obj.__doc__).startswith("Alias for field number") else None


def find_home(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, contnode: nodes.Element
) -> nodes.Element | None:
    """Resolve a bare name, as modules import it from each other, to its only home."""
    if node.get("refdomain") != "py":
        return None
    module, _, name = node["reftarget"].rpartition(".")
    # What stands at the package's face is documented there, and not in its module.
    is_public = module.startswith("ftforce.") and name in ftforce.__all__
    target = name if is_public else node["reftarget"].removeprefix("ftforce.")
    objects = env.domains["py"].objects
    homes = {
        (entry.docname, entry.node_id)
        for name, entry in objects.items()
        if name.endswith(f".{target}") and not entry.aliased
    }
    if len(homes) != 1:
        return None
    docname, anchor = homes.pop()
    return make_refnode(app.builder, node["refdoc"], docname, anchor, contnode)


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("autodoc-process-docstring", keep_first_line, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", shorten_docstring, priority=600)  # after it
    app.connect("autodoc-process-signature", shorten_signature)
    app.connect("object-description-transform", shorten_property)
    app.connect("autodoc-skip-member", skip_tuple_fields)
    app.connect("missing-reference", find_home)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
