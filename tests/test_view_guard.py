"""The page's server: who may talk to it, where it listens, and how it ends."""

import asyncio
import errno
import http.client
import socket
import threading
import time

import pytest
import websockets
from websockets.datastructures import Headers

from ftforce.errors import FtforceError, InputError
from ftforce.view.server import guard, server
from ftforce.view.server.guard import Names, is_loopback, names_of, refusal
from ftforce.view.server.server import exposure, open_server
from ftforce.view.server.viser_private import protocol

pytestmark = pytest.mark.thorough

PROTOCOL = protocol()
LOCAL = Names(frozenset({"127.0.0.1", "localhost", "::1"}))


@pytest.fixture(scope="module")
def opened():
    opened = open_server(port=0, title="ftforce: <arm> & more")
    yield opened
    opened.close()


def get(opened, path="/", **headers):
    """Return status, headers and body of a request."""
    headers = {"Cookie": opened._guard.cookie, **headers}
    connection = http.client.HTTPConnection("127.0.0.1", opened.port, timeout=10)
    try:
        connection.request("GET", path, headers=headers)
        response = connection.getresponse()
        return response.status, response.headers, response.read()
    finally:
        connection.close()


def send(opened, data):
    """Send bytes; return what comes back until the connection ends."""
    with socket.create_connection(("127.0.0.1", opened.port), timeout=10) as connection:
        answer = b""
        try:
            connection.sendall(data)
            while part := connection.recv(65536):
                answer += part
        except ConnectionError:
            pass
        return answer


def connect(opened, origin="own", protocol=PROTOCOL, cookie=None, **options):
    """Return a websocket's connection, to be awaited."""
    cookie = opened._guard.cookie if cookie is None else cookie
    if origin == "own":
        origin = f"http://127.0.0.1:{opened.port}"
    return websockets.connect(
        f"ws://127.0.0.1:{opened.port}/",
        origin=origin,
        subprotocols=[protocol] if protocol else None,
        max_size=None,
        proxy=None,
        additional_headers={"Cookie": cookie} if cookie else None,
        **options,
    )


async def status_of(opened, *args, **options):
    """Return 101 if a websocket is opened, or the status with which it is refused."""
    try:
        async with connect(opened, *args, **options) as socket_:
            await asyncio.wait_for(socket_.recv(), 10)
            return 101
    except websockets.exceptions.InvalidStatus as refused:
        return refused.response.status_code


# ---- the rules -------------------------------------------------------------------------------


def headers(*pairs):
    return Headers(list(pairs))


HOST = ("Host", "127.0.0.1:8080")
OWN = ("Origin", "http://127.0.0.1:8080")
SOCKET = (("Upgrade", "websocket"), ("Sec-WebSocket-Protocol", PROTOCOL))


@pytest.mark.parametrize(
    ("path", "given"),
    [
        ("/", [HOST]),
        ("/", [("Host", "localhost:8080")]),
        ("/", [("Host", "LOCALHOST")]),
        ("/", [("Host", "[::1]:8080")]),
        ("/a/b?x=1&y=websocket", [HOST]),
        ("/", [HOST, OWN]),
        ("/", [HOST, OWN, *SOCKET]),
        ("/", [("Host", "localhost:9"), ("Origin", "http://localhost:9"), *SOCKET]),
    ],
)
def test_the_page_itself_is_answered(path, given):
    assert refusal(path, headers(*given), LOCAL, PROTOCOL) == ""


@pytest.mark.parametrize(
    ("path", "given"),
    [
        ("/", []),
        ("/", [HOST, HOST]),
        ("/", [HOST, ("Host", "evil.example")]),
        ("/", [("Host", "")]),
        ("/", [("Host", "evil.example:8080")]),
        ("/", [("Host", "192.168.1.5:8080")]),
        ("/", [("Host", "localhost.evil.example")]),
        ("/", [("Host", "localhost@evil.example")]),
        ("/", [("Host", "evil.example#localhost")]),
        ("/", [("Host", "localhost; script-src *")]),
        ("/", [("Host", "127.0.0.1:8080/x")]),
        ("/", [("Host", "[::1")]),
        ("/", [("Host", "0.0.0.0:8080")]),
        ("/", [HOST, ("Origin", "http://evil.example")]),
        ("/", [HOST, ("Origin", "null")]),
        ("/", [HOST, *SOCKET]),
        ("/", [HOST, ("Origin", ""), *SOCKET]),
        ("/", [HOST, ("Origin", "null"), *SOCKET]),
        ("/", [HOST, ("Origin", "http://evil.example"), *SOCKET]),
        ("/", [HOST, ("Origin", "https://127.0.0.1:8080"), *SOCKET]),
        ("/", [HOST, ("Origin", "http://127.0.0.1:8081"), *SOCKET]),
        ("/", [HOST, ("Origin", "http://localhost:8080"), *SOCKET]),
        ("/", [HOST, OWN, ("Origin", "http://evil.example"), *SOCKET]),
        ("/", [HOST, OWN, ("Upgrade", "websocket")]),
        ("/", [HOST, OWN, ("Upgrade", "websocket"), ("Sec-WebSocket-Protocol", "viser-v0.0.1")]),
        ("/", [HOST, ("Upgrade", "WebSocket"), SOCKET[1]]),
        ("/?websocket=ws://evil.example", [HOST]),
        ("/?a=1&websocket=", [HOST]),
        ("/?%77ebsocket=ws://evil.example", [HOST]),
        ("/?playbackPath=http://evil.example/a.viser", [HOST]),
    ],
)
def test_everybody_else_is_refused(path, given):
    assert refusal(path, headers(*given), LOCAL, PROTOCOL)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.1.2.3", "LocalHost"])
def test_loopback_needs_no_warning(host):
    assert is_loopback(host)
    assert exposure(host) == ""
    assert names_of(host).accepts(host)
    assert not names_of(host).any_address


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "robot.example"])
def test_other_hosts_are_warned_of(host):
    assert not is_loopback(host)
    assert host in exposure(host)
    names = names_of(host)
    # An address cannot be made to point here by somebody else, as a name can.
    for name in (host, "127.0.0.1", "192.168.1.5", "::1", socket.gethostname()):
        assert names.accepts(name)
    assert not names.accepts("evil.example")


# ---- the server ------------------------------------------------------------------------------


def test_the_page_is_served_with_its_title_and_what_browsers_enforce(opened):
    for coding in ("identity", "gzip"):
        status, found, body = get(opened, **{"Accept-Encoding": coding})
        assert status == 200
        assert b"<title>ftforce: &lt;arm&gt; &amp; more</title>" in body
        assert int(found["Content-Length"]) == len(body)
        assert found["Content-Encoding"] == "identity"
        policy = found["Content-Security-Policy"]
        assert f"connect-src 'self' ws://127.0.0.1:{opened.port} data: blob:;" in policy
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert found["X-Content-Type-Options"] == "nosniff"
        assert found["Cache-Control"] == "no-store"
        assert found["Cross-Origin-Resource-Policy"] == "same-origin"
    assert opened.address == f"http://127.0.0.1:{opened.port}/?token={opened._guard.token}"
    assert opened.warning == ""


def test_strangers_are_refused_by_the_server_too(opened):
    assert get(opened, Host="evil.example")[0] == 403
    assert get(opened, Host=f"evil.example:{opened.port}")[0] == 403
    assert get(opened, Origin="http://evil.example")[0] == 403
    assert get(opened, "/?websocket=ws://evil.example")[0] == 403
    assert get(opened, Host=f"localhost:{opened.port}")[0] == 200


@pytest.mark.parametrize(
    "path",
    ["/../server.py", "/%2e%2e/server.py", "/..%5cserver.py", "//etc/passwd", "/a", "/index.html/"],
)
def test_no_other_file_is_served(opened, path):
    status, _, body = get(opened, path)
    assert status == 404 or b"<title>ftforce" in body


def test_only_the_own_page_can_connect(opened):
    port = opened.port

    async def ask():
        return [
            await status_of(opened),
            await status_of(opened, None),
            await status_of(opened, "null"),
            await status_of(opened, "http://evil.example"),
            await status_of(opened, f"http://127.0.0.1:{port + 1}"),
            await status_of(opened, f"https://127.0.0.1:{port}"),
            await status_of(opened, protocol="viser-v0.0.1"),
            await status_of(opened, protocol=None),
        ]

    assert asyncio.run(ask()) == [101] + 7 * [403]


def test_only_those_who_know_the_token_get_the_page(opened):
    token, name = opened._guard.token, f"ftforce-{opened.port}"
    for path, cookie in (
        ("/", ""),
        ("/?token=", ""),
        ("/?token=" + token[:-1], ""),
        ("/?other=" + token, ""),
        ("/" + token, ""),
        ("/", name),
        ("/", f"{name}="),
        ("/", f"{name}={token}x"),
        ("/", f"ftforce-1={token}"),
        ("/alive", ""),
    ):
        status, found, body = get(opened, path, Cookie=cookie)
        assert status == 403, path
        assert b"open the address that ftforce printed" in body
        assert "Set-Cookie" not in found
        assert token.encode() not in body
    status, found, _ = get(opened, f"/?token={token}", Cookie="")
    assert status == 200
    assert found["Set-Cookie"] == f"{name}={token}; Path=/; HttpOnly; SameSite=Strict"
    assert get(opened, "/", Cookie=f"a=b; {name}={token}")[0] == 200
    assert get(opened, "/alive")[0] == 200
    assert len(token) >= 32


def test_nothing_connects_without_the_cookie(opened):
    wrong = opened._guard.cookie[:-1]
    assert asyncio.run(status_of(opened, cookie="")) == 403
    assert asyncio.run(status_of(opened, cookie=wrong)) == 403
    assert asyncio.run(status_of(opened)) == 101


def test_a_ticket_is_good_for_one_request(opened):
    address = opened.address_for_browser()
    assert opened._guard.token not in address
    path = address.partition(str(opened.port))[2]
    status, found, _ = get(opened, path, Cookie="")
    assert status == 200
    assert found["Set-Cookie"].startswith(opened._guard.cookie)
    assert get(opened, path, Cookie="")[0] == 403


def test_no_two_servers_share_a_token(opened):
    other = open_server(port=0)
    other.close()
    assert other._guard.token != opened._guard.token


def wait_for(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    assert condition()


def test_a_tab_that_vanishes_disturbs_no_other(opened):
    seen = [0] * 4

    async def watch(i, socket_):
        while True:
            seen[i] += len(await socket_.recv())

    async def ask():
        sockets = [await connect(opened) for _ in seen]
        tasks = [asyncio.create_task(watch(i, socket_)) for i, socket_ in enumerate(sockets)]
        await asyncio.to_thread(wait_for, lambda: all(seen))
        sockets[1].transport.abort()  # no closing handshake: the tab's machine is gone
        await asyncio.sleep(0.2)
        before = list(seen)
        opened.server.scene.add_frame("/a")
        await asyncio.to_thread(
            wait_for, lambda: all(seen[i] > before[i] for i in range(4) if i != 1)
        )
        assert seen[1] == before[1]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for socket_ in sockets:
            await socket_.close()

    asyncio.run(ask())
    assert get(opened)[0] == 200


def test_rubbish_is_survived_in_silence(opened, capfd, caplog):
    own = f"127.0.0.1:{opened.port}".encode()
    start = b"GET / HTTP/1.1\r\nHost: " + own + b"\r\n"
    for data in (
        start + b"X: " + b"a" * 100_000 + b"\r\n\r\n",
        start + b"X: a\r\n" * 1000 + b"\r\n",
        b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
        b"\x16\x03\x01" + bytes(300) + b"\r\n",
        b"POST / HTTP/1.1\r\nHost: " + own + b"\r\nContent-Length: 3\r\n\r\nabc",
        start + b"Upgrade: a\r\nUpgrade: b\r\n\r\n",
        start + b"Accept-Encoding: a\r\nAccept-Encoding: b\r\n\r\n",
        start + b"Origin: \xff\r\n\r\n",
        b"GET http://[ HTTP/1.1\r\nHost: " + own + b"\r\n\r\n",
    ):
        answer = send(opened, data)
        status = answer.removeprefix(b"HTTP/1.1 ")[:3]
        assert status in {b"", *b"200 400 403 404 405 414 431 500".split()}, data[:80]
    assert get(opened)[0] == 200
    assert capfd.readouterr() == ("", "")
    assert caplog.records == []


def test_a_message_that_is_none_ends_only_its_own_tab(opened, capfd, caplog):
    async def ask():
        async with connect(opened) as good:
            for data in (b"\xc1", b"\x81\xa4type\xa4None"):  # {"type": "None"}
                async with connect(opened) as bad:
                    await bad.send(data)
                    await asyncio.wait_for(bad.wait_closed(), 10)
            await asyncio.wait_for(await good.ping(), 10)

    asyncio.run(ask())
    assert get(opened)[0] == 200
    assert capfd.readouterr() == ("", "")
    assert caplog.records == []


# ---- where it listens, and its end -----------------------------------------------------------


def test_nothing_is_printed_and_nothing_stays_open(capfd):
    before = set(threading.enumerate())
    first = open_server(port=0)
    assert get(first)[0] == 200
    first.close()
    wait_for(lambda: not any(t.name == "serve" for t in set(threading.enumerate()) - before))
    assert_closed(first.port)
    assert capfd.readouterr() == ("", "")
    second = open_server(port=first.port)  # it is free again
    second.close()
    assert second.port == first.port


def test_a_connection_that_hangs_does_not_keep_the_server():
    opened = open_server(port=0)
    with (
        socket.create_connection(("127.0.0.1", opened.port)) as silent,
        socket.create_connection(("127.0.0.1", opened.port)) as reading,
    ):
        silent.sendall(b"GET / HTTP/1.1\r\n")
        own = f"Host: 127.0.0.1:{opened.port}\r\nCookie: {opened._guard.cookie}\r\n"
        reading.sendall(f"GET / HTTP/1.1\r\n{own}\r\n".encode())
        reading.recv(1)
        started = time.monotonic()
        opened.close()
        assert time.monotonic() - started < 4.0


def test_a_port_that_is_taken_is_an_error_and_another_one_is_found(opened, monkeypatch):
    with pytest.raises(InputError, match=rf"port {opened.port} of 127.0.0.1 is in use.*--port"):
        open_server(port=opened.port)
    monkeypatch.setattr(server, "FIRST_PORT", opened.port)
    other = open_server()
    other.close()
    assert opened.port < other.port < opened.port + 100


@pytest.mark.parametrize("port", [-1, 65536])
def test_what_is_no_port_is_an_error(port):
    with pytest.raises(InputError, match="to 65535"):
        open_server(port=port)


def test_a_port_of_the_administrator_s_is_an_error(monkeypatch):
    def refuse(*_where, **_options):
        raise PermissionError(errno.EACCES, "denied")

    monkeypatch.setattr(socket, "create_server", refuse)
    with pytest.raises(InputError, match="port 80 requires administrator privileges"):
        open_server(port=80)


@pytest.mark.parametrize("host", ["203.0.113.7", "none.invalid", "a b", "x" * 300, "127.0.0.1:80"])
def test_a_host_that_is_not_ours_is_an_error_and_does_not_hang(host):
    with pytest.raises(InputError, match="not an address of this machine"):
        open_server(host)


def test_the_environment_does_not_choose_the_port(opened, monkeypatch):
    monkeypatch.setenv("_VISER_PORT_OVERRIDE", str(opened.port))
    other = open_server(port=0)
    other.close()
    assert other.port == other.server.get_port() not in {opened.port, opened.port + 1}


def test_all_addresses_are_listened_on_when_asked_for():
    opened = open_server("0.0.0.0", 0)
    try:
        assert "anyone who can reach 0.0.0.0" in opened.warning
        assert opened.address.startswith(f"http://127.0.0.1:{opened.port}/?token=")
        assert get(opened)[0] == 200
        assert get(opened, Host="evil.example")[0] == 403
        assert get(opened, Host=f"192.168.7.7:{opened.port}")[0] == 200
    finally:
        opened.close()


def assert_closed(port):
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=1)


@pytest.mark.parametrize(
    ("place", "name", "instead"),
    [
        (guard, "refusal", lambda *_: ""),
        (guard, "_connection_refusal", lambda *_: ""),
        (Names, "accepts", lambda *_: True),
        (guard.Guard, "stranger", lambda *_: ""),
        (guard.Guard, "wrap", lambda _self, answer: answer),  # viser starts otherwise
    ],
)
def test_without_each_part_of_the_guard_nothing_stays_open(monkeypatch, place, name, instead):
    ports, listen = [], server._listening

    def listening(*where):
        found = listen(*where)
        ports.append(found.getsockname()[1])
        return found

    monkeypatch.setattr(server, "_listening", listening)
    monkeypatch.setattr(place, name, instead)
    with pytest.raises(FtforceError, match="cannot be protected"):
        open_server(port=0)
    assert_closed(ports[-1])
