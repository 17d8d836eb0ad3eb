"""One process per box of the rig, on a vcan0 of its own."""

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from hpmc.configuration import Configuration, ConfigurationError
from hpmc.experiment import Experiment
from hpmc.layout import LAUNCHER, PROGRAMS, WITH_VCAN
from hpmc.modes.job import Job, Outcome
from hpmc.processes import Child, Watch

LOG = "run.lcmlog"


def check(experiment: Experiment, configuration: Configuration) -> None:
    if experiment.jobs > 1:
        raise ConfigurationError("--jobs: goes with --mode sil")
    if experiment.lcm_url:
        raise ConfigurationError("--lcm-url: goes with --mode sil and emulated")
    if configuration.values["bus"]["command_delay_ms"] > 0:
        raise ConfigurationError("bus.command_delay_ms: goes with --mode sil")


def vcan_plan(job: Job, log: Path) -> dict[str, Any]:
    """What the launcher starts: a command for each process of the rig."""
    config = ["--config", str(job.config_file)]
    log_level = ["--log-level", job.log_level]
    node = [
        str(PROGRAMS["motor_node"]),
        "--joint-ticks",
        str(job.configuration.joint_ticks),
        "--increments-per-revolution",
        str(job.configuration.values["joint"]["increments_per_revolution"]),
    ]
    processes = {
        "run_logger": [str(PROGRAMS["run_logger"]), "--log", str(log), *log_level],
        **{f"motor_node {n}": [*node, "--id", str(n)] for n in (1, 2, 3)},
        "hpmc_host": [
            str(PROGRAMS["hpmc_host"]), *config, *log_level, *job.targets_option()
        ],
        "arm_sim": [str(PROGRAMS["arm_sim"]), *config, *(["--realtime"] if job.realtime else [])],
    }
    return {"processes": processes}


def sandbox_name() -> str:
    """For `tools/with-vcan --join NAME`, from another terminal."""
    return f"run-{os.getpid()}"


def run(job: Job) -> Outcome:
    sandbox = [str(WITH_VCAN), "--name", sandbox_name(), *(["--uml"] if job.uml else [])]
    return run_session(job, vcan_plan(job, job.folder / LOG), sandbox)


def run_session(job: Job, plan_of_job: dict[str, Any], sandbox: list[str]) -> Outcome:
    """The processes of a plan under the launcher, inside a sandbox where one is named."""
    outcome = Outcome(logs=[job.folder / LOG])
    result: dict[str, Any] = {}

    def on_line(line: str) -> None:
        if line.startswith("PROGRESS "):
            job.bar.update(0, line.removeprefix("PROGRESS "))
        elif line.startswith("RESULT "):
            result.update(json.loads(line.removeprefix("RESULT ")))

    with tempfile.NamedTemporaryFile("w", suffix=".json", dir=job.folder) as plan:
        json.dump(plan_of_job, plan)
        plan.flush()
        command = [*sandbox, sys.executable, "-I", "-S", str(LAUNCHER), plan.name]
        with Watch() as watch:
            child = Child(command, on_line)
            watch.add(child)
            watch.wait()
        outcome.interrupted = watch.interrupted
    if not result:
        outcome.reason = " ".join(child.errors[-3:]) or (
            f"the session ended with status {child.process.returncode}"
        )
        return outcome
    outcome.wall_s = result["wall_s"]
    outcome.reason = result["reason"]
    outcome.interrupted = outcome.interrupted or result["interrupted"]
    outcome.stats = list(result["stats"].values())
    return outcome
