"""The page and its WebSocket, on this machine's loopback only.

Every other origin is refused: a page of somebody else's that a browser has open must neither read a
run nor move its target. Checked are the Host header (against DNS rebinding), for the WebSocket also
Origin. All data goes over one WebSocket a page, as JSON; page/link.js lists the messages.
"""

import asyncio
import contextlib
import json
import math
from collections import deque
from collections.abc import AsyncIterator, Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from hpmc.lcm_types import load_type
from hpmc.view.live import Relay
from hpmc.view.pictures import PictureError, node_picture, record, rig_picture, state_picture
from hpmc.view.replay import Replay

ADDRESS = "127.0.0.1"
PAGE = Path(__file__).parent / "page"
SOCKET_PATH = "/ws"
_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}
_FRAME_S = 0.02
_TRACE_S = 4.0  # what the page shows of the past
_TRACE_STATES = 400
_STATES_PER_FRAME = 4
_WAITING_MAX = 8  # messages for a slow page; older ones are skipped, and counted
_SPEEDS = (0.01, 100.0)
_COMMAND_BYTES = 4096

Send = Callable[[dict[str, Any]], None]


class Outbox:
    """Messages on their way to one page: when it is slow, the oldest pictures are skipped."""

    def __init__(self) -> None:
        self._waiting: deque[dict[str, Any]] = deque()
        self._something = asyncio.Event()
        self.skipped = 0

    def put(self, message: dict[str, Any]) -> None:
        pictures = [old for old in self._waiting if old["type"] == "states"]
        if message["type"] == "states" and message.get("reset"):
            for old in pictures:  # of before the jump
                self._waiting.remove(old)
        elif message["type"] == "states" and len(pictures) >= _WAITING_MAX:
            oldest = next((old for old in pictures if not old.get("reset")), None)
            if oldest is not None:
                self._waiting.remove(oldest)
                self.skipped += 1
        self._waiting.append(message)
        self._something.set()

    async def messages(self) -> AsyncIterator[str]:
        while True:
            await self._something.wait()
            self._something.clear()
            while self._waiting:
                message = self._waiting.popleft()
                yield json.dumps({**message, "skipped": self.skipped}, separators=(",", ":"))


def command_of(text: str | bytes) -> dict[str, Any]:
    """A page's command, its numbers checked; ValueError when it is none."""
    try:
        command = json.loads(text)
    except RecursionError:
        raise ValueError("nested too deep") from None
    if not isinstance(command, dict) or not isinstance(command.get("do"), str):
        raise ValueError("no command")
    numbers = {"target": ("x", "y"), "seek": ("t",), "speed": ("value",)}.get(command["do"], ())
    for name in numbers:
        value = command.get(name)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            raise ValueError(f"{command['do']}: {name} is no finite number")
    return command


class LiveShow:
    """A run that is going on, to all pages at once."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._relay: Relay | None = None
        self._outboxes: set[Outbox] = set()
        self._hello: dict[str, Any] | None = None
        self._nodes: dict[str, dict[str, Any]] = {}
        self._lost = 0

    async def follow(self, relay: Relay) -> None:
        """Passes the run on until it ends."""
        self._relay = relay
        async for events in relay.batches():
            self._take(events)

    def _take(self, events: list[tuple[str, bytes]]) -> None:
        states = []
        for channel, payload in events:
            if channel == "HPMC_STATE":
                states.append(state_picture(record("hpmc_state_t", payload)))
            elif channel.startswith("NODE_STATUS"):
                self._nodes[channel] = node_picture(record("node_status_t", payload))
            elif channel == "RUN_INFO":
                self._take_info(load_type("run_info_t").decode(payload))
            elif channel == "RELAY":
                self._lost = json.loads(payload)["lost"]
        if states:
            message = {
                "type": "states",
                "states": states,
                "nodes": list(self._nodes.values()),
                "lost": self._lost,
            }
            for outbox in self._outboxes:
                outbox.put(message)

    def _take_info(self, info: dict[str, Any]) -> None:
        rig = rig_picture(info)
        if self._hello is None or self._hello["rig"] != rig:
            if self._hello is not None:
                self._nodes.clear()  # those of another run on the same address
            self._hello = {"type": "hello", "kind": "live", "name": self.name, "rig": rig}
            for outbox in self._outboxes:
                outbox.put(self._hello)

    async def serve(self, outbox: Outbox, commands: AsyncIterator[dict[str, Any]]) -> None:
        self._outboxes.add(outbox)
        if self._hello is not None:
            outbox.put(self._hello)
        try:
            async for command in commands:
                if command["do"] == "target" and self._relay is not None:
                    self._relay.send_target(float(command["x"]), float(command["y"]))
        finally:
            self._outboxes.discard(outbox)


class ReplayShow:
    """A run from its log; each page has its own playhead."""

    def __init__(self, name: str, replay: Replay) -> None:
        self.name = name
        self.replay = replay
        self._hello = {
            "type": "hello",
            "kind": "replay",
            "name": name,
            "rig": replay.rig,
            "begin": replay.begin_s,
            "end": replay.end_s,
            "marks": replay.marks(),
            "damage": replay.damage,
        }

    async def serve(self, outbox: Outbox, commands: AsyncIterator[dict[str, Any]]) -> None:
        outbox.put(self._hello)
        player = Player(self.replay, outbox.put)
        playing = asyncio.create_task(player.run())
        try:
            async for command in commands:
                player.obey(command)
        finally:
            playing.cancel()


class Player:
    """The playhead of one page."""

    def __init__(self, replay: Replay, send: Send) -> None:
        self._replay = replay
        self._send = send
        self._t = replay.begin_s
        self._speed = 1.0
        self._playing = True
        self._show(reset=True)

    def obey(self, command: dict[str, Any]) -> None:
        match command["do"]:
            case "play":
                if self._t >= self._replay.end_s:
                    self._seek(self._replay.begin_s)
                self._playing = True
            case "pause":
                self._playing = False
            case "speed":
                self._speed = min(max(float(command["value"]), _SPEEDS[0]), _SPEEDS[1])
            case "seek":
                self._seek(float(command["t"]))
        self._show()

    def _seek(self, t: float) -> None:
        self._t = min(max(t, self._replay.begin_s), self._replay.end_s)
        self._show(reset=True)

    async def run(self) -> None:
        clock = asyncio.get_running_loop().time
        before = clock()
        while True:
            await asyncio.sleep(_FRAME_S)
            now = clock()
            if self._playing:
                begin = self._t
                self._t = min(begin + (now - before) * self._speed, self._replay.end_s)
                self._playing = self._t < self._replay.end_s
                states = self._replay.states(begin, self._t, _STATES_PER_FRAME)
                self._show(states=states)
            before = now

    def _show(self, states: list[dict[str, Any]] | None = None, reset: bool = False) -> None:
        if reset:
            # What led here, down to the instant itself.
            states = self._replay.states(self._t - _TRACE_S, self._t, _TRACE_STATES)
        self._send(
            {
                "type": "states",
                "states": states or [],
                "nodes": self._replay.nodes(self._t),
                "reset": reset,
                "playhead": self._t,
                "playing": self._playing,
                "speed": self._speed,
            }
        )


class Web:
    """The HTTP side: files of the page, and who may come in."""

    def __init__(self, show: LiveShow | ReplayShow) -> None:
        self._show = show
        self._hosts: set[str] = set()
        self.refused = 0

    async def start(self, port: int) -> Server:
        """Listens; port 0 takes a free one. OSError when that cannot be."""
        server = await serve(
            self._serve,
            ADDRESS,
            port,
            process_request=self._request,
            max_size=_COMMAND_BYTES,
            compression=None,  # all on one machine
            server_header=None,
        )
        port = server.sockets[0].getsockname()[1]
        self._hosts = {f"{ADDRESS}:{port}", f"localhost:{port}"}
        return server

    def _request(self, _: ServerConnection, request: Request) -> Response | None:
        """A refusal or a file; None lets a WebSocket in."""
        hosts = request.headers.get_all("Host")
        origins = request.headers.get_all("Origin")
        ours = len(hosts) == 1 and hosts[0] in self._hosts
        # A browser names the page's origin when it opens a WebSocket; only the page itself may.
        if request.path == SOCKET_PATH:
            ours = ours and origins == [f"http://{hosts[0]}"]
        else:
            ours = ours and origins in ([], [f"http://{hosts[0]}"])
        if not ours:
            self.refused += 1
            return _answer(HTTPStatus.FORBIDDEN, b"only for the viewer's own page\n")
        return None if request.path == SOCKET_PATH else _file(request.path)

    async def _serve(self, connection: ServerConnection) -> None:
        outbox = Outbox()
        sending = asyncio.create_task(_send_all(connection, outbox))
        try:
            await self._show.serve(outbox, _commands(connection))
        except ConnectionClosed:
            pass
        finally:
            sending.cancel()


async def _commands(connection: ServerConnection) -> AsyncIterator[dict[str, Any]]:
    async for text in connection:
        try:
            yield command_of(text)
        except ValueError:
            await connection.close(1008, "no command of the viewer's page")


async def _send_all(connection: ServerConnection, outbox: Outbox) -> None:
    with contextlib.suppress(ConnectionClosed):
        async for text in outbox.messages():
            await connection.send(text)


def _file(path: str) -> Response:
    name = "index.html" if path == "/" else path.removeprefix("/")
    # One flat folder; nothing else of the machine has a name here.
    files = {file.name: file for file in PAGE.iterdir() if file.suffix in _TYPES}
    if name not in files:
        return _answer(HTTPStatus.NOT_FOUND, b"no such file\n")
    return _answer(HTTPStatus.OK, files[name].read_bytes(), _TYPES[files[name].suffix])


def _answer(status: HTTPStatus, body: bytes, kind: str = "text/plain") -> Response:
    headers = Headers(
        {
            "Content-Type": f"{kind}; charset=utf-8",
            "Content-Length": str(len(body)),
            "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'",
            "Cross-Origin-Resource-Policy": "same-origin",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
    )
    return Response(status.value, status.phrase, headers, body)


__all__ = ["ADDRESS", "LiveShow", "PictureError", "ReplayShow", "Web"]
