"""HTML generation; the only module that writes markup, so that no name can inject any.

`element` returns markupsafe's `Markup`, which other elements include verbatim; plain strings are
always escaped.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from markupsafe import Markup, escape

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ftforce.view.scene.colours import Colour

_STYLE = """
.ftf{font:12px/1.35 system-ui,'Noto Sans','DejaVu Sans',sans-serif;color:#1a1a1a;padding:4px 10px}
.ftf h3{font-size:12px;font-weight:600;margin:8px 0 2px}
.ftf table{border-collapse:collapse;width:100%;table-layout:fixed}
.ftf td,.ftf th{padding:1px 3px;text-align:right;white-space:nowrap}
.ftf td,.ftf th{overflow:hidden;text-overflow:ellipsis}
.ftf th{color:#666;font-weight:400}
.ftf .l{text-align:left}
.ftf .w{white-space:normal;overflow-wrap:anywhere}
.ftf .b td{font-weight:600;border-top:1px solid #ddd}
.ftf .bar{position:relative;height:12px;background:#eee;border:1px solid #bbb;box-sizing:border-box}
.ftf .bar i{position:absolute;left:0;top:0;bottom:0}
.ftf .over{color:#aa2814;font-weight:600}
.ftf .verdict{padding:7px 9px;border-radius:5px;color:#fff;font-size:12.5px;overflow-wrap:anywhere}
.ftf .warning{background:#fff4d6;border-left:3px solid #e69f00}
.ftf .warning{padding:2px 6px;margin:4px 0;overflow-wrap:anywhere}
.ftf .key{display:inline-block;width:14px;height:9px;margin-right:5px;border:1px solid #999}
.ftf .line{height:3px;border:0;vertical-align:middle}
.ftf .entry{display:inline-block;margin-right:10px}
.ftf .note{color:#666}
.ftf code{font:11px monospace;overflow-wrap:anywhere;user-select:all}
.ftf button{font:12px system-ui,sans-serif;padding:5px 10px;cursor:pointer;width:100%}
.ftf .plot{position:relative;height:96px;border:1px solid #bbb}
.ftf .plot svg{position:absolute;width:100%;height:100%;left:0;top:0}
.ftf .plot b{position:absolute;top:0;bottom:0;width:2px;margin-left:-1px;background:#000}
.ftf .ends{display:flex;justify-content:space-between;color:#666}
.ftf .names i{display:inline-block;width:14px;height:3px;margin-right:5px;vertical-align:middle}
.ftf-open{position:relative}
.ftf-open .open{position:absolute;top:0;right:12px;padding:1px 6px;background:#fff;color:#aa2814}
.ftf-open .open{font-weight:600;border:1px solid;visibility:hidden}
.ftf-open .open{animation:ftf-open 0s .2s forwards}
.ftf-open .verdict{animation:ftf-earlier 0s .2s forwards}
@keyframes ftf-open{to{visibility:visible}}
@keyframes ftf-earlier{to{background:#888;opacity:.5}}
.ftf summary{cursor:pointer;font-weight:600;margin-top:8px}
"""


def element(name: str, *children: str, **attributes: str) -> Markup:
    """Return an element; plain strings in it and all attributes are escaped.

    Parameters
    ----------
    name :
        Tag name.
    children :
        Text and `Markup`.
    attributes :
        Attributes; ``class_`` stands for class, ``data_testid`` for data-testid. Empty ones are
        omitted.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(str(value))}"'
        for key, value in attributes.items()
        if value
    )
    # `escape` returns markup unchanged, too, but through a slower method in Python.
    inner = "".join(x if isinstance(x, Markup) else escape(x) for x in children)
    return Markup(f"<{name}{given}>{inner}</{name}>")


def style(rules: str = _STYLE) -> Markup:
    """Return a style element with trusted CSS rules, by default those of the page."""
    return Markup(f"<style>{rules}</style>")


def block(*children: str, testid: str = "") -> Markup:
    """Return a section of the page.

    Parameters
    ----------
    children :
        Text and `Markup`.
    testid :
        Identifier for tests.
    """
    return element("div", *children, class_="ftf", data_testid=testid)


def css(colour: Colour) -> str:
    """Return a colour in CSS notation."""
    return f"rgb({colour[0]},{colour[1]},{colour[2]})"


def text_on(colour: Colour) -> str:
    """Return black or white, whichever contrasts better with a colour."""
    return "#000" if sum(colour) > 400 else "#fff"


def table(columns: Sequence[tuple[str, str, str]], rows: Iterable[Markup], testid: str) -> Markup:
    """Return a table.

    Parameters
    ----------
    columns :
        Title, class and CSS width of each column.
    rows :
        Rows made by `row`.
    testid :
        Identifier for tests.
    """
    heads = (
        element("th", title, class_=kind, style=width and f"width:{width}")
        for title, kind, width in columns
    )
    head = element("thead", row(heads))
    return element("table", head, element("tbody", *rows), data_testid=testid)


def row(cells: Iterable[Markup], kind: str = "") -> Markup:
    """Return a table row.

    Parameters
    ----------
    cells :
        Cells made by `cell`.
    kind :
        Class of the row.
    """
    return element("tr", *cells, class_=kind)


def cell(content: str, kind: str = "", title: str = "") -> Markup:
    """Return a table cell.

    Parameters
    ----------
    content :
        Text of the cell.
    kind :
        Its class.
    title :
        Its tooltip.
    """
    return element("td", content, class_=kind, title=title)


def facts(pairs: Iterable[tuple[str, str]], testid: str) -> Markup:
    """Return names and values in two columns.

    Parameters
    ----------
    pairs :
        Names and values.
    testid :
        Identifier for tests.
    """
    rows = (row([cell(name, "l w"), cell(value, "l w")]) for name, value in pairs)
    return table([("", "l", "96px"), ("", "l", "")], rows, testid)
