"""Child processes of a command: started, read line by line, ended in order."""

import contextlib
import signal
import subprocess
import threading
from collections.abc import Callable
from typing import IO, Self

WATCH_S = 0.2


class Child:
    """A process of the run and the reader of its lines."""

    def __init__(self, command: list[str], on_line: Callable[[str], None]) -> None:
        self.errors: list[str] = []
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert self.process.stdout is not None and self.process.stderr is not None
        self.readers = [
            threading.Thread(target=read_lines, args=(self.process.stdout, on_line), daemon=True),
            threading.Thread(
                target=read_lines, args=(self.process.stderr, self.errors.append), daemon=True
            ),
        ]
        for reader in self.readers:
            reader.start()

    def wait(self, timeout_s: float | None = None) -> int:
        status = self.process.wait(timeout_s)
        for reader in self.readers:
            reader.join(5.0)
        return status


def read_lines(stream: IO[str], on_line: Callable[[str], None]) -> None:
    for line in stream:
        on_line(line.rstrip("\n"))


class Watch:
    """Waits for the processes of a run; Ctrl-C and SIGTERM are passed on to them as SIGINT.

    To be entered before the first of them starts, so that none outlives an early Ctrl-C.
    """

    def __init__(self) -> None:
        self.interrupted = False
        self.failed: Child | None = None  # the first that ended badly
        self.children: list[Child] = []

    def __enter__(self) -> Self:
        self.previous = {
            number: signal.signal(number, self.on_signal)
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self.previous.items():
            signal.signal(number, handler)

    def on_signal(self, *_: object) -> None:
        self.interrupted = True
        self.stop()

    def stop(self) -> None:
        for child in self.children:
            child.process.send_signal(signal.SIGINT)

    def add(self, child: Child) -> None:
        self.children.append(child)
        if self.interrupted:
            child.process.send_signal(signal.SIGINT)

    def wait(self) -> None:
        """Until all have ended; when one ends badly the others are stopped."""
        while alive := [child for child in self.children if child.process.poll() is None]:
            with contextlib.suppress(subprocess.TimeoutExpired):
                alive[0].process.wait(WATCH_S)
            if self.failed is None:
                ended = [child for child in self.children if child.process.poll()]
                self.failed = next(iter(ended), None)
                if self.failed:
                    self.stop()
        for child in self.children:
            child.wait()
