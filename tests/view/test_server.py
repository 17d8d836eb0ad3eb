"""Who may talk to the viewer's server, and what it says to those who may."""

import http.client
import json
import socket
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from hpmc.view.server import Outbox, command_of


def get(url: str, path: str = "/", **headers: str) -> tuple[int, bytes]:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection("127.0.0.1", parts.port, timeout=20)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, answer.read()


def socket_to(url: str, origin: str | None, host: str | None = None) -> ClientConnection:
    parts = urlsplit(url)
    address = f"ws://{host or parts.netloc}/ws"
    raw = socket.create_connection(("127.0.0.1", parts.port), timeout=20)
    return connect(address, sock=raw, origin=origin, proxy=None, compression=None)


def test_only_the_own_page_may_connect(replay_url: str) -> None:
    port = urlsplit(replay_url).port
    own = replay_url.rstrip("/")
    assert get(replay_url)[0] == 200
    for name in ("main.js", "arm.js", "style.css", "icon.svg"):
        assert get(replay_url, f"/{name}")[0] == 200
    assert get(replay_url, "/", Origin=own)[0] == 200
    with socket_to(replay_url, own) as page:
        assert json.loads(page.recv(timeout=20))["type"] == "hello"
    with socket_to(replay_url, f"http://localhost:{port}", f"localhost:{port}") as page:
        assert json.loads(page.recv(timeout=20))["type"] == "hello"

    for origin in (
        None, "null", "http://evil.example", f"https://127.0.0.1:{port}", "http://127.0.0.1",
        f"http://127.0.0.1:{port}.evil.example", f"http://localhost:{port}",
    ):  # fmt: skip
        with pytest.raises(InvalidStatus) as refusal:
            socket_to(replay_url, origin)
        assert refusal.value.response.status_code == 403
    # A name of somebody else's that now points here (DNS rebinding).
    for host in (f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port}.evil.example"):
        assert get(replay_url, "/", Host=host)[0] == 403
    with pytest.raises(InvalidStatus) as refusal:
        socket_to(replay_url, f"http://evil.example:{port}", f"evil.example:{port}")
    assert refusal.value.response.status_code == 403
    assert get(replay_url, "/", Origin="http://evil.example")[0] == 403


def test_only_files_of_the_page_are_given(replay_url: str) -> None:
    for path in ("/server.py", "/../server.py", "/%2e%2e/server.py", "//etc/passwd", "/page"):
        assert get(replay_url, path)[0] == 404


def test_it_listens_on_this_machine_only(replay_url: str) -> None:
    port = f"{urlsplit(replay_url).port:04X}"
    for table in ("tcp", "tcp6"):
        rows = [row.split() for row in Path(f"/proc/net/{table}").read_text().splitlines()[1:]]
        listening = [row[1] for row in rows if row[3] == "0A" and row[1].endswith(f":{port}")]
        assert listening == (["0100007F:" + port] if table == "tcp" else [])


@pytest.mark.parametrize("text", [
    "x", "[]", "{}", '{"do": "seek"}', '{"do": "seek", "t": "1"}', '{"do": "seek", "t": 1e999}',
    '{"do": "target", "x": 0.1}', '{"do": "target", "x": NaN, "y": 0}',
    '{"do": "speed", "value": true}', "[" * 2000,
])  # fmt: skip
def test_what_is_no_command_is_told_apart(text: str) -> None:
    with pytest.raises(ValueError):
        command_of(text)


def test_what_is_no_command_closes_that_page_only(replay_url: str) -> None:
    own = replay_url.rstrip("/")
    with socket_to(replay_url, own) as good, socket_to(replay_url, own) as bad:
        bad.send("rubbish")
        with pytest.raises(ConnectionClosed):
            while True:
                bad.recv(timeout=20)
        good.send('{"do": "seek", "t": 5.0}')
        while not json.loads(good.recv(timeout=20)).get("playhead", 0) >= 5.0:
            pass


def test_a_slow_page_skips_pictures_and_counts_them() -> None:
    outbox = Outbox()
    outbox.put({"type": "hello"})
    for number in range(20):
        outbox.put({"type": "states", "number": number})
    waiting = list(outbox._waiting)
    assert waiting[0] == {"type": "hello"}
    assert [message["number"] for message in waiting[1:]] == list(range(12, 20))
    assert outbox.skipped == 12
