"""Progress of a run on the console: reaches, simulated time, real-time factor."""

import json
import time

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


class ProgressBar:
    """Reach, simulated time and real-time factor."""

    def __init__(self, console: Console, reaches: int, reaches_per_repetition: int = 16) -> None:
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(None),
            TextColumn("reach {task.completed:.0f}/{task.total:.0f}"),
            TextColumn("{task.fields[simulated]}"),
            TimeElapsedColumn(),
            console=console,
            transient=not console.is_terminal,
        )
        self.reaches = reaches
        self.reaches_per_repetition = reaches_per_repetition
        self.task = self.bar.add_task("starting", total=reaches, simulated="")
        self.done: dict[int, tuple[int, float, float]] = {}  # per job: reaches, first time, time
        self.began = time.monotonic()
        self.printed = time.monotonic()
        self.console = console

    def update(self, job: int, line: str) -> None:
        told = json.loads(line)
        first = self.done.get(job, (0, told["simulated_s"], 0.0))[1]
        if not self.done:
            self.began = time.monotonic()
        reaches = told["reach"] + 1 + self.reaches_per_repetition * told["repetition"]
        self.done[job] = (
            max(reaches, self.done.get(job, (0, 0, 0))[0]),
            first,
            told["simulated_s"],
        )
        completed = sum(entry[0] for entry in self.done.values())
        simulated = sum(entry[2] - entry[1] for entry in self.done.values())
        elapsed = max(time.monotonic() - self.began, 1e-3)
        text = f"{simulated:.1f} s simulated, {simulated / elapsed:.2f} x real time"
        self.bar.update(
            self.task, completed=min(completed, self.reaches), simulated=text, description="running"
        )
        if not self.console.is_terminal and time.monotonic() - self.printed > 5.0:
            self.printed = time.monotonic()
            self.console.print(f"reach {completed}/{self.reaches}, {text}")
