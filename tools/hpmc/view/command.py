"""`./rig view`: a run, live or from its log, in the browser."""

import argparse
import asyncio
import contextlib
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from hpmc.layout import DEFAULT_TELEMETRY_URL, RUNS
from hpmc.lcm_log import LogError
from hpmc.view.live import (
    LiveError,
    Relay,
    relay_command,
    sandboxes,
    telemetry_flows,
)
from hpmc.view.pictures import PictureError
from hpmc.view.replay import Replay
from hpmc.view.server import ADDRESS, LiveShow, ReplayShow, Web

EXIT_USAGE = 2
EXIT_ENDED = 3
_PATIENCE_S = 1.5


class UsageError(ValueError):
    """One line: what is wrong, where, and what would be right."""


class Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see ./rig view --help)")


def parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(
        prog="./rig view",
        allow_abbrev=False,
        description="Shows a run in the browser: the one that is going on, or one from its log.",
    )
    parser.add_argument(
        "run",
        nargs="?",
        metavar="RUN",
        help="folder or log of a run, to replay; sandbox of a vcan run that is going on (run-PID); "
        "left out: whatever run is going on",
    )
    parser.add_argument(
        "--port", type=int, default=0, help="TCP port on 127.0.0.1 (default: one that is free)"
    )
    parser.add_argument(
        "--lcm-url",
        default=DEFAULT_TELEMETRY_URL,
        metavar="URL",
        help="telemetry of a run outside a sandbox (default: %(default)s)",
    )
    options = parser.parse_args(argv)
    if not 0 <= options.port <= 65535:
        raise UsageError(f"--port {options.port}: must be 0 to 65535")
    return options


def find_replay(run: str) -> Replay | None:
    """The log that RUN names; None when it names the sandbox of a live run."""
    for folder in (Path(run), RUNS / run):
        if folder.exists():
            return Replay(folder)
    if run in sandboxes():
        return None
    raise UsageError(f"{run}: is neither the folder of a run nor the sandbox of one going on")


async def find_live(run: str | None, url: str) -> tuple[str, list[str]]:
    """Name and relay command of the live run."""
    names = [run] if run else sandboxes()
    if len(names) > 1:
        raise UsageError(f"several runs are going on: say which of {', '.join(names)}")
    if names:
        return names[0], relay_command(names[0], DEFAULT_TELEMETRY_URL)
    if await telemetry_flows(url, _PATIENCE_S):
        return "sil" if url == DEFAULT_TELEMETRY_URL else url, relay_command(None, url)
    raise UsageError(
        "no run is going on: neither a vcan run of yours nor telemetry on "
        f"{url} (./rig run NAME --mode sil --lcm-url URL sends it); to replay one: ./rig view RUN"
    )


async def show(options: argparse.Namespace) -> int:
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    replay = find_replay(options.run) if options.run else None
    if replay is not None:
        name = Path(options.run).resolve().name
        async with await listening(Web(ReplayShow(name, replay)), options.port):
            await stop.wait()
        return 0
    name, command = await find_live(options.run, options.lcm_url)
    live = LiveShow(name)
    async with Relay(command) as relay, await listening(Web(live), options.port):
        following = asyncio.create_task(live.follow(relay))
        waiting = asyncio.create_task(stop.wait())
        await asyncio.wait((following, waiting), return_when=asyncio.FIRST_COMPLETED)
        for task in (following, waiting):
            if not task.done():
                task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await following
        if not stop.is_set():
            print("the run has ended", flush=True)
    return 0


async def listening(web: Web, port: int) -> contextlib.AbstractAsyncContextManager[object]:
    try:
        server = await web.start(port)
    except OSError as error:
        raise UsageError(f"--port {port}: {ADDRESS}:{port}: {error.strerror}") from None
    port = server.sockets[0].getsockname()[1]
    print(f"open http://{ADDRESS}:{port}/   (Ctrl-C ends)", flush=True)
    return server


def main(argv: Sequence[str]) -> int:
    try:
        return asyncio.run(show(parse(argv)))
    except (UsageError, LogError) as error:
        print(f"rig view: {error}", file=sys.stderr)
        return EXIT_USAGE
    except (LiveError, PictureError) as error:
        print(f"rig view: {error}", file=sys.stderr)
        return EXIT_ENDED
