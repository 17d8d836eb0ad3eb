"""`./rig bench`: speed of sil beside that of ODE alone, in the same run. `./rig bench firmware` is
in bench_firmware.py."""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hpmc import bench_firmware
from hpmc.layout import CONFIG, PROGRAMS

RATIO_LIMIT = 2.0
REAL_TIME_LIMIT = 40.0


def main(argv: Sequence[str]) -> int:
    if argv[:1] == ["firmware"]:
        return bench_firmware.main(argv[1:])
    parser = argparse.ArgumentParser(prog="./rig bench", description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="medians of so many (default 7)")
    parser.add_argument("--json", action="store_true", help="one JSON line")
    options = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        answer = subprocess.run(
            [
                str(PROGRAMS["bench"]),
                "--config",
                str(CONFIG / "clock.toml"),
                "--log",
                str(Path(folder) / "run.lcmlog"),
                "--rounds",
                str(options.rounds),
            ],
            capture_output=True,
            text=True,
            timeout=600,
        )
    if answer.returncode != 0:
        print(f"rig bench: {answer.stderr.strip()}", file=sys.stderr)
        return answer.returncode
    if options.json:
        print(answer.stdout.strip())
        return 0
    told = json.loads(answer.stdout)
    table = Table(title=f"16 reaches, {told['ode_steps']} ODE steps, log of the states")
    for column in ("what", "measured", "wanted"):
        table.add_column(column)
    table.add_row("sil", f"{told['sil_s']:.3f} s", "")
    table.add_row("ODE alone", f"{told['ode_alone_s']:.3f} s", "")
    table.add_row("ratio", f"{told['ratio']:.2f}", f"at most {RATIO_LIMIT:.0f}")
    table.add_row(
        "times real time", f"{told['real_time_factor']:.0f}", f"at least {REAL_TIME_LIMIT:.0f}"
    )
    Console().print(table)
    return 0
