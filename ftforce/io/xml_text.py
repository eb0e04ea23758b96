"""Reading of XML as robot description files contain it: more than the standard permits."""

from __future__ import annotations

import codecs
import re
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

from ftforce.errors import listed
from ftforce.io.text import LARGEST_FILE, read_bytes, text_of

if TYPE_CHECKING:
    from os import PathLike

    from ftforce.errors import FileError

_DECLARATION = re.compile(r"<\?xml\s[^>]*\?>")
_BLANK = re.compile(r"\s*")
_UNBOUND_PREFIX = expat.errors.codes[expat.errors.XML_ERROR_UNBOUND_PREFIX]


class XmlFile(NamedTuple):
    """Content of an XML file.

    Attributes
    ----------
    root :
        The root element.
    notes :
        What the file has that the XML standard does not permit.
    """

    root: ElementTree.Element
    notes: tuple[str, ...]


def read_xml(path: str | PathLike[str], error: type[FileError], kind: str) -> XmlFile:
    """Read an XML file in UTF-8 or in the encoding that it declares; see `parse_xml`.

    Blanks and comments before the XML declaration are accepted.

    Parameters
    ----------
    path, error, kind :
        As in `ftforce.io.text.read_text`.

    Raises
    ------
    FileError
        As ``error``: the file is missing, unreadable, empty, too large or not text, or its XML is
        malformed or contains a DTD.
    """
    data = read_bytes(path, error, kind, LARGEST_FILE)
    text, encoding = text_of(data, path, error, kind, _declared_encoding(data))
    notes = [f"the file is {encoding} text, not UTF-8"] if encoding else []
    text, is_late = _without_declaration(text)
    if is_late:
        notes.append("the XML declaration is not at the start of the file")
    root, prefixes = _parse(text, path, error)
    if prefixes:
        notes.append(f"prefixes without an XML namespace: {listed(prefixes)}")
    return XmlFile(root, tuple(notes))


def parse_xml(text: str, path: str | PathLike[str], error: type[FileError]) -> ElementTree.Element:
    """Parse XML, rejecting document type definitions and thereby entity expansion attacks.

    The namespace of the root element (``xmlns="…"``) is stripped from all elements. If prefixes
    are used without a namespace, all names keep the prefixes that the file gives them.

    Parameters
    ----------
    text :
        The document.
    path, error :
        As in `ftforce.io.text.read_text`.

    Raises
    ------
    FileError
        As ``error``: the XML is malformed or contains a DTD.
    """
    return _parse(text, path, error)[0]


def _declared_encoding(data: bytes) -> str:
    """Return the encoding by byte order mark or XML declaration; empty if there is none."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    found = re.search(rb"""<\?xml\s[^>]*?encoding\s*=\s*["']([\w.:-]+)["']""", data[:4096])
    return found[1].decode("ascii") if found else ""


def _without_declaration(text: str) -> tuple[str, bool]:
    """Return the text without its XML declaration, and whether something precedes that.

    Line breaks before it stay, so that line numbers in error messages are those of the file.
    """
    place = _BLANK.match(text).end()  # type: ignore[union-attr] # matches always
    while text.startswith("<!--", place) and (end := text.find("-->", place)) >= 0:
        place = _BLANK.match(text, end + 3).end()  # type: ignore[union-attr]
    found = _DECLARATION.match(text, place)
    if found is None:
        return text, False
    return text[:place] + text[found.end() :], place > 0


def _parse(
    text: str, path: str | PathLike[str], error: type[FileError]
) -> tuple[ElementTree.Element, list[str]]:
    """Return the root element, and the prefixes that have no namespace."""
    try:
        if "<!DOCTYPE" in text:  # perhaps in a comment
            _reject_dtd(text, path, error)
        try:
            return _in_namespace(ElementTree.fromstring(text)), []
        except ElementTree.ParseError as problem:
            if problem.code != _UNBOUND_PREFIX:
                raise
        root = _parse_without_namespaces(text)
    except (expat.ExpatError, ElementTree.ParseError) as problem:
        raise error(path, f"is not well-formed XML ({problem})") from None
    return root, sorted(_prefixes(root))


def _in_namespace(root: ElementTree.Element) -> ElementTree.Element:
    if root.tag.startswith("{"):
        namespace = root.tag[: root.tag.index("}") + 1]
        for element in root.iter():
            if isinstance(element.tag, str):  # the tag of a comment is a function
                element.tag = element.tag.removeprefix(namespace)
    return root


def _parse_without_namespaces(text: str) -> ElementTree.Element:
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(text, True)
    return builder.close()


def _prefixes(root: ElementTree.Element) -> set[str]:
    """Return the prefixes of elements and attributes that no attribute ``xmlns:…`` declares."""
    names = {name for element in root.iter() for name in (element.tag, *element.attrib)}
    pairs = {tuple(name.split(":", 1)) for name in names if ":" in name}
    declared = {rest for prefix, rest in pairs if prefix == "xmlns"} | {"xmlns", "xml"}
    return {prefix for prefix, _ in pairs} - declared


class _RootReachedError(Exception):
    """Stop parsing: a DTD can only precede the root element."""


def _reject_dtd(text: str, path: str | PathLike[str], error: type[FileError]) -> None:
    def on_doctype(*_: object) -> None:
        raise error(path, "contains a DTD (<!DOCTYPE …>), which is not allowed; remove it")

    def on_root(*_: object) -> None:
        raise _RootReachedError

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = on_doctype
    parser.StartElementHandler = on_root
    with suppress(_RootReachedError):
        parser.Parse(text, True)
