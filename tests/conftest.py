"""Lets `build/venv/bin/python -m pytest tests/...` find the tools without any setting."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "build" / "host" / "lcm_types" / "python")]
