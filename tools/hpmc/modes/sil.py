"""The rig in one process, or repetitions spread over several."""

import json
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path

from hpmc.configuration import Configuration, ConfigurationError
from hpmc.experiment import Experiment
from hpmc.layout import DEFAULT_TELEMETRY_URL, PROGRAMS
from hpmc.modes.job import Job, Outcome
from hpmc.processes import Child, Watch
from hpmc.run_progress import ProgressBar

LCM_URL = re.compile(r"udpm://(\d{1,3}\.){3}\d{1,3}:\d{1,5}(\?ttl=\d{1,3})?")


def check(experiment: Experiment, _: Configuration) -> None:
    check_one_process_rig(experiment)
    if experiment.jobs > 1 and (experiment.lcm_url or experiment.targets):
        raise ConfigurationError("--jobs: one process only with --lcm-url and --targets")
    if experiment.jobs > 1 and experiment.pace == "realtime":
        raise ConfigurationError("--jobs: one process only with --pace realtime")


def check_one_process_rig(experiment: Experiment) -> None:
    """What holds for the program sil in each mode that runs it."""
    if experiment.uml:
        raise ConfigurationError("--uml: goes with --mode vcan")
    if experiment.lcm_url is not None and not LCM_URL.fullmatch(experiment.lcm_url):
        raise ConfigurationError(
            f"--lcm-url {experiment.lcm_url}: must be like {DEFAULT_TELEMETRY_URL}"
        )


def program(job: Job, log: Path) -> list[str]:
    """The program sil with the options that each of its modes takes."""
    return [
        str(PROGRAMS["sil"]),
        "--config", str(job.config_file),
        "--log", str(log),
        "--log-level", job.log_level,
        *(["--realtime"] if job.realtime else []),
        *(["--lcm-url", job.lcm_url] if job.lcm_url else []),
        *job.targets_option(),
    ]  # fmt: skip


def spread(repetitions: int, jobs: int) -> list[tuple[int, int]]:
    """First repetition and number of repetitions of each job."""
    jobs = min(jobs, repetitions)
    share, rest = divmod(repetitions, jobs)
    parts, first = [], 0
    for job in range(jobs):
        count = share + (job < rest)
        parts.append((first, count))
        first += count
    return parts


def run(job: Job) -> Outcome:
    parts = spread(job.configuration.repetitions, job.jobs)
    outcome = Outcome()
    began = time.monotonic()
    with Watch() as watch:
        for number, (first, count) in enumerate(parts):
            log = job.folder / ("run.lcmlog" if len(parts) == 1 else f"run-{number:02d}.lcmlog")
            outcome.logs.append(log)
            command = [
                *program(job, log),
                "--first-repetition", str(first),
                "--repetitions", str(count),
            ]  # fmt: skip
            watch.add(Child(command, line_reader(outcome, job.bar, number, first)))
        watch.wait()
    outcome.interrupted = watch.interrupted
    outcome.wall_s = time.monotonic() - began
    if watch.failed:
        outcome.reason = "; ".join(watch.failed.errors[-1:]) or describe_status(
            watch.failed.process.returncode
        )
    return outcome


def line_reader(outcome: Outcome, bar: ProgressBar, job: int, first: int) -> Callable[[str], None]:
    def on_line(line: str) -> None:
        if line.startswith("PROGRESS "):
            told = json.loads(line.removeprefix("PROGRESS "))
            told["repetition"] -= first
            bar.update(job, json.dumps(told))
        elif line.startswith("STATS "):
            outcome.stats.append(json.loads(line.removeprefix("STATS ")))

    return on_line


def describe_status(status: int) -> str:
    if status < 0:
        return f"sil was killed by {signal.Signals(-status).name}"
    return f"sil ended with status {status}"
