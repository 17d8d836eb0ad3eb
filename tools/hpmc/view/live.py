"""A run that is going on: finds it, and takes in what telemetry_relay hands out of it."""

import asyncio
import contextlib
import os
import re
import struct
from collections.abc import AsyncIterator
from pathlib import Path

from hpmc.layout import PROGRAMS, WITH_VCAN
from hpmc.lcm_log import SYNC_WORD

_HEADER = struct.Struct(">Iqqii")  # of an event in a log
_CHUNK_BYTES = 1 << 16
_LONGEST_EVENT = 1 << 16
_START_S = 20.0
_END_S = 5.0


class LiveError(RuntimeError):
    """The run cannot be listened to; one line that says why."""


def sandboxes() -> list[str]:
    """Names of the sandboxes of this user's vcan runs, as `./rig run` makes them."""
    prefix = rf"@with-vcan/{os.geteuid()}/(run-\d+)$"
    found = re.findall(prefix, Path("/proc/net/unix").read_text(), re.MULTILINE)
    return sorted(set(found), key=lambda name: int(name.removeprefix("run-")))


def relay_command(sandbox: str | None, url: str) -> list[str]:
    """The relay, inside the sandbox of a run or here."""
    relay = [str(PROGRAMS["telemetry_relay"]), "--lcm-url", url]
    return [str(WITH_VCAN), "--join", sandbox, *relay] if sandbox else relay


def split_events(buffer: bytearray) -> list[tuple[str, bytes]]:
    """Takes whole events off the front of the buffer: channel and message."""
    events = []
    while len(buffer) >= _HEADER.size:
        sync, _, _, name_bytes, data_bytes = _HEADER.unpack_from(buffer)
        if sync != SYNC_WORD or not 0 <= name_bytes + data_bytes <= _LONGEST_EVENT:
            raise LiveError("the relay's stream is damaged")
        begin = _HEADER.size + name_bytes
        end = begin + data_bytes
        if len(buffer) < end:
            break
        events.append((buffer[_HEADER.size : begin].decode(), bytes(buffer[begin:end])))
        del buffer[:end]
    return events


class Relay:
    """The relay's process. Its stream ends when the run's sandbox does."""

    def __init__(self, command: list[str]) -> None:
        self._command = command
        self._process: asyncio.subprocess.Process | None = None
        self._errors = b""

    async def __aenter__(self) -> "Relay":
        pipe = asyncio.subprocess.PIPE
        self._process = await asyncio.create_subprocess_exec(
            *self._command, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True
        )
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._process is not None and self._process.stdin is not None
        # It ends when its input does; inside a sandbox too.
        self._process.stdin.close()
        try:
            await asyncio.wait_for(self._process.wait(), _END_S)
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
            await self._process.wait()

    async def batches(self) -> AsyncIterator[list[tuple[str, bytes]]]:
        """Channels and messages as they come, until the run's sandbox or the relay ends."""
        assert self._process is not None
        assert self._process.stdout is not None and self._process.stderr is not None
        buffer = bytearray()
        while chunk := await self._process.stdout.read(_CHUNK_BYTES):
            buffer += chunk
            if events := split_events(buffer):
                yield events
        self._errors = await self._process.stderr.read()

    def complaint(self) -> str:
        """The last line that the relay said on standard error, after its end."""
        return (self._errors.decode(errors="replace").strip().splitlines() or [""])[-1]

    def send_target(self, x_m: float, y_m: float) -> None:
        """Asks the run for a new target of the hand."""
        assert self._process is not None and self._process.stdin is not None
        if not self._process.stdin.is_closing():
            self._process.stdin.write(f"{x_m:.6f} {y_m:.6f}\n".encode())


async def telemetry_flows(url: str, patience_s: float) -> bool:
    """Whether somebody publishes a run's telemetry on this machine's LCM address."""
    async with Relay(relay_command(None, url)) as relay:
        listening = False
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_START_S) as limit:
                async for events in relay.batches():
                    if any(channel == "HPMC_STATE" for channel, _ in events):
                        return True
                    if not listening:
                        # The relay says something at once: patience counts from there.
                        listening = True
                        limit.reschedule(asyncio.get_running_loop().time() + patience_s)
                raise LiveError(relay.complaint() or "the relay ended")
    return False
