"""The page as one file that needs no server, and asks none for anything."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any, TypeVar

from ftforce.errors import FtforceError
from ftforce.view.guard import content_policy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import viser

PANEL_WIDTH = 340  # px, of the answer beside the scene

_CHANGED = (
    "viser's page is not as expected; install the one that ftforce was tested with: "
    "pip install 'ftforce[view]'"
)
_Frame = TypeVar("_Frame")

# viser's notices (of a browser without a GPU, mostly) would cover the scene.
_STYLE = f"""
#root {{ position: fixed !important; left: {PANEL_WIDTH}px; right: 0; top: 0; bottom: 0;
  width: auto !important; height: auto !important; overflow: hidden; transform: translateZ(0); }}
#ftforce-answer {{ position: fixed; left: 0; top: 0; bottom: 0; width: {PANEL_WIDTH}px;
  box-sizing: border-box; overflow: auto; background: #fff; color: #222;
  font-family: sans-serif; font-size: 13px; }}
.mantine-Notifications-root {{ display: none !important; }}
"""


def scene_html(
    server: viser.ViserServer,
    *,
    title: str,
    answer_html: str,
    recording: Any = None,
    without: Iterable[str] = (),
) -> str:
    """Return the scene, with the answer beside it, as HTML; `write_whole` writes it.

    Parameters
    ----------
    server :
        Whose scene it is. No browser needs to be connected.
    title :
        Of the page, as text.
    answer_html :
        What stands beside the scene, as HTML that is safe.
    recording :
        What `record` returned, to be played; ``None`` for the scene as it is now.
    without :
        Names of nodes that are left out: handles that nobody would answer.

    Raises
    ------
    FtforceError
        viser's page has changed.
    """
    serializer = server.get_scene_serializer() if recording is None else recording
    _leave_out(serializer, set(without))
    page: str = serializer.as_html()
    policy = html.escape(content_policy(""), quote=True)
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    page = _replaced(page, '<meta charset="utf-8" />', f'<meta charset="utf-8" />{head}')
    page = _replaced(
        page, "<title>Viser</title>", f"<title>{html.escape(title)}</title><style>{_STYLE}</style>"
    )
    end = page.rindex("</body>")  # the last one: scripts come before it
    return f'{page[:end]}<aside id="ftforce-answer">{answer_html}</aside>{page[end:]}'


def _leave_out(serializer: Any, names: set[str]) -> None:
    """Take what is told of some nodes out of what a page will show."""
    if not names:
        return
    messages = getattr(serializer, "_messages", None)
    if messages is None:
        raise FtforceError(_CHANGED)
    serializer._messages = [told for told in messages if told[1].get("name") not in names]


def record(
    server: viser.ViserServer,
    frames: Iterable[_Frame],
    dt: float,
    show: Callable[[_Frame], None],
) -> Any:
    """Record what the scene shows, frame by frame, for `scene_html`.

    Parameters
    ----------
    server :
        Whose scene it is.
    frames :
        What is shown, one after the other.
    dt :
        Time from one to the next, s.
    show :
        Puts a frame into the scene.
    """
    serializer = server.get_scene_serializer()
    for frame in frames:
        with server.atomic():
            show(frame)
        serializer.insert_sleep(dt)
    return serializer


def _replaced(page: str, part: str, other: str) -> str:
    head, found, rest = page.partition(part)
    if not found:
        raise FtforceError(_CHANGED)
    return f"{head}{other}{rest}"
