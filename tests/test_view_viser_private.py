"""What the page relies on in viser without being promised it: one test for each such part."""

import asyncio
import re
import time
from pathlib import Path

import msgspec
import pytest
import viser
import websockets

from ftforce.errors import FtforceError
from ftforce.view.server import viser_private
from ftforce.view.server.server import open_server

pytestmark = pytest.mark.thorough

CLIENT = Path(viser.__file__).parent / "client"
SOURCES = [*CLIENT.glob("src/**/*.ts"), *CLIENT.glob("src/**/*.tsx")]


def changed(what):
    tried = viser_private.TESTED
    return f"{what} in viser {viser.__version__}; viser_private.py was tried on {tried}"


@pytest.fixture(scope="module")
def opened():
    opened = open_server(port=0)
    yield opened
    opened.close()


def source_with(text):
    """Return the sources of viser's page in which something stands."""
    found = [path.read_text() for path in SOURCES if text in path.read_text()]
    assert found, changed(f"nothing says {text!r}")
    return found


def connect(opened):
    return websockets.connect(
        opened.address.replace("http", "ws"),
        origin=opened.address.partition("/?")[0],
        subprotocols=[viser_private.protocol()],
        max_size=None,
        proxy=None,
    )


def test_the_page_speaks_the_protocol(opened):
    assert source_with("`viser-v${VISER_VERSION}`")

    async def spoken():
        async with connect(opened) as socket:
            await asyncio.wait_for(socket.recv(), 10)
            return socket.subprotocol

    assert asyncio.run(spoken()) == viser_private.protocol(), changed("another protocol is spoken")


def test_the_page_reads_these_parameters_and_no_others():
    told = " ".join(map(Path.read_text, SOURCES))
    read = set(re.findall(r"searchParams\s*\.\w+\(\s*\"(\w+)\"", told))
    read |= set(re.findall(r"searchParamKey = \"(\w+)\"", told))
    harmless = {
        "darkMode",
        "dummyWindowDimensions",
        "dummyWindowTitle",
        "fixedDpr",
        "forceOrbitOriginTool",
        "hideViserLogo",
        "logCamera",
        "showStats",
    }
    assert read == harmless | viser_private.REDIRECTING, changed("the page reads other parameters")


def test_the_page_has_its_root_title_and_notices():
    page = (CLIENT / "build" / "index.html").read_text()
    assert 'id="root"' in page, changed("the page has another root")
    assert source_with("<Notifications")
    titled = viser_private.titled(page, "a </title>")
    assert "<title>a &lt;/title&gt;</title>" in titled, changed("the page has another title")
    assert titled.index("<title>") < titled.index("<script"), changed("a script comes first")
    assert viser_private.titled("<p>", "a") == "<p>"


def test_a_server_is_started_by_what_is_put_in_place_of_serve():
    seen = []

    def spy(serve, handler, *where, **options):
        seen.append((where, set(options)))
        return serve(handler, *where, **options)

    with viser_private.serving(spy):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    server.stop()
    ((where, options),) = seen or [((), set())]
    assert where[:1] == ("127.0.0.1",), changed("servers are started otherwise")
    assert "process_request" in options, changed("requests are answered otherwise")


def message(one):
    """Return a message as viser's page sends it."""
    return msgspec.msgpack.encode(one.as_serializable_dict([]))


def test_no_page_can_make_the_server_public(opened, monkeypatch):
    messages, asked = viser._messages, []
    monkeypatch.setattr(viser.ViserServer, "request_share_url", lambda *_: asked.append(1))
    camera = messages.ViewerCameraMessage(
        wxyz=(1.0, 0.0, 0.0, 0.0),
        position=(1.0, 0.0, 0.0),
        fov=1.0,
        near=0.1,
        far=10.0,
        image_height=100,
        image_width=100,
        look_at=(0.0, 0.0, 0.0),
        up_direction=(0.0, 0.0, 1.0),
    )

    async def ask():
        async with connect(opened) as socket:
            for one in (messages.ShareUrlRequest(), messages.ShareUrlDisconnect(), camera):
                await socket.send(message(one))
            end = time.monotonic() + 10.0
            while not opened.server.get_clients():  # the camera is read, and so are the others
                assert time.monotonic() < end
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.1)

    asyncio.run(ask())
    assert asked == [], changed("a page can open a tunnel")


def test_a_tunnel_that_cannot_be_closed_is_an_error(monkeypatch):
    monkeypatch.delattr(viser.infra._infra.WebsockMessageHandler, "unregister_handler")
    with pytest.raises(FtforceError, match="tunnel"):
        open_server(port=0)
