"""The page as a self-contained file that makes no network requests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from markupsafe import Markup

from ftforce.view.page.html import style
from ftforce.view.server import viser_private
from ftforce.view.server.guard import content_policy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import viser

PANEL_WIDTH = 340  # px, of the answer panel

_Frame = TypeVar("_Frame")

# Hides viser's notices (mostly about a missing GPU), which would cover the scene.
_STYLE = f"""
{viser_private.ROOT} {{
  position: fixed !important; left: {PANEL_WIDTH}px; right: 0; top: 0; bottom: 0;
  width: auto !important; height: auto !important; overflow: hidden; transform: translateZ(0);
}}
#ftforce-answer {{
  position: fixed; left: 0; top: 0; bottom: 0; width: {PANEL_WIDTH}px; box-sizing: border-box;
  overflow: auto; background: #fff; color: #222; font-family: sans-serif; font-size: 13px;
}}
{viser_private.NOTICES} {{ display: none !important; }}
"""


def scene_html(
    server: viser.ViserServer, *, title: str, answer: Markup, recording: Any = None
) -> str:
    """Return the scene and the answer beside it as HTML, to be saved with `write_whole`.

    Parameters
    ----------
    server :
        Server of the scene. No browser needs to be connected.
    title :
        Page title, as plain text.
    answer :
        HTML to be placed beside the scene.
    recording :
        Animation returned by `record`; ``None`` for the scene as it is now.

    Raises
    ------
    FtforceError
        viser's page has an unexpected format.
    """
    scene = server.get_scene_serializer() if recording is None else recording
    page: str = scene.as_html()
    policy = Markup('<meta http-equiv="Content-Security-Policy" content="{}">')
    head = policy.format(content_policy("")) + style(_STYLE)
    body, end, rest = viser_private.titled(page, title, head).rpartition("</body>")
    if head not in body:
        raise viser_private.changed("has an unexpected page format")
    aside = Markup('<aside id="ftforce-answer">{}</aside>').format(answer)
    return f"{body}{aside}{end}{rest}"


def record(
    server: viser.ViserServer, frames: Iterable[_Frame], dt: float, show: Callable[[_Frame], None]
) -> Any:
    """Record the scene frame by frame for `scene_html`.

    Parameters
    ----------
    server :
        Server of the scene.
    frames :
        Frames in order.
    dt :
        Time between frames, s.
    show :
        Called with each frame to update the scene.
    """
    serializer = server.get_scene_serializer()
    for frame in frames:
        with server.atomic():
            show(frame)
        serializer.insert_sleep(dt)
    return serializer
