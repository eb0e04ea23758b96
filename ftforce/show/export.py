"""What a terminal would show, as text, SVG or HTML."""

from __future__ import annotations

import io
from html import escape

from rich.console import Console, RenderableType

WIDTH = 80


def to_text(shown: RenderableType, width: int = WIDTH) -> str:
    """Return plain text without colours."""
    stream = io.StringIO()
    Console(file=stream, width=width, color_system=None).print(shown)
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def to_svg(shown: RenderableType, title: str, width: int = WIDTH) -> str:
    """Return a picture of a terminal window."""
    return _recorded(shown, width).export_svg(title=title, unique_id="ftforce")


def to_html(shown: RenderableType, width: int = 100) -> str:
    """Return a fragment of HTML, for notebooks; texts are escaped."""
    style = "font-family:Menlo,Consolas,'DejaVu Sans Mono',monospace;line-height:1.25"
    return _recorded(shown, width).export_html(
        inline_styles=True, code_format=f'<pre style="{style}"><code>{{code}}</code></pre>'
    )


def to_page(shown: RenderableType, title: str) -> str:
    """Return a page of HTML."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(title)}</title></head>\n<body>{to_html(shown)}</body></html>\n"
    )


def _recorded(shown: RenderableType, width: int) -> Console:
    console = Console(
        file=io.StringIO(), record=True, width=width, force_terminal=True, color_system="truecolor"
    )
    console.print(shown)
    return console
