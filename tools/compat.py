"""Prints with which versions of other programs this one works, what is installed here, and what tests it.

`make compat`. The table is also in docs/compatibility.md (a test compares both).
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent


class Row(NamedTuple):
    """One program."""

    name: str
    works: str
    """The versions."""
    tested_by: str
    package: str = ""
    """Its Python package, or the command that prints its version."""


ROWS = (
    Row("Python", "3.11 to 3.13", "all tests, with the version of the environment"),
    Row("PX4 over MAVLink", "1.14 to 1.17; recorded: 1.16, 1.17", "`tests/contract`, `test_px4_1_17.py`"),
    Row(
        "PX4 over ROS 2",
        "see [links](links.md#ros-2-topics); recorded: 1.16, 1.17",
        "`tests/protocol/test_ros2_*.py`, `tests/contract`",
    ),
    Row(
        "MAVSDK (Python)",
        "3 and 4; `from mavsdk import System` needs `mavsdk<4`",
        "`tests/clients`",
        "mavsdk",
    ),
    Row("pymavlink", "2.4.50, pinned", "all tests", "pymavlink"),
    Row("MAVProxy", "1.8.71 or newer", "`tests/clients/test_mavproxy.py`", "MAVProxy"),
    Row("QGroundControl", "its plan files, and beside this server", "`test_qgc_plan.py`, `tests/contract`"),
    Row("Cyclone DDS (Python)", "11", "`tests/integration`, `tests/clients/test_ros2.py`", "cyclonedds"),
    Row("Fast DDS", "2.9", "`tests/clients/test_fast_dds.py`"),
    Row("Node.js (to build the page)", "20.19 or newer", "`make web`", "node --version"),
    Row("browser", "with WebGL 2; the map and all else without it", "`tests/e2e`, in Chromium"),
)


def installed(row: Row) -> str:
    """The version on this computer; a dash if it is not there or not asked for."""
    if row.name == "Python":
        return ".".join(map(str, sys.version_info[:3]))
    if " " in row.package:
        program, *arguments = row.package.split()
        found = shutil.which(program)
        if found is None:
            return "–"
        return subprocess.check_output([found, *arguments], text=True).strip()
    try:
        return version(row.package) if row.package else "–"
    except PackageNotFoundError:
        return "–"


def table() -> str:
    """The table of docs/compatibility.md."""
    lines = ["| program | works with | tested by |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {row.name} | {row.works} | {row.tested_by} |" for row in ROWS)])


def main() -> None:
    """Prints the table with the installed versions."""
    for row in ROWS:
        print(f"{row.name:28} {installed(row):10} works: {row.works}; tested by: {row.tested_by}")
    page = json.loads((ROOT / "web/package.json").read_text())["devDependencies"]
    print("the page:", ", ".join(f"{name} {page[name]}" for name in ("svelte", "maplibre-gl", "vite")))


if __name__ == "__main__":
    main()
