"""`gcs test` as a program: exit codes, and processes that end with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from tests.station import wait_until
from tests.support.scenario_files import program_scenario, scenario_file

COMMAND = [sys.executable, "-m", "gcs_server", "test"]
MARK = "endless program of a scenario"
ENDLESS = f"""
run: [sh, -c, "{sys.executable} -c 'import time; time.sleep(600)' '{MARK}'; true", "{{port}}"]
must_hold: [{{check: finishes}}]
"""


@pytest.mark.story
def test_the_exit_code_says_whether_all_held(tmp_path: Path) -> None:
    text = "must_hold: [{check: finishes}, {check: reaches, position_ned_m: [-10, 0, -5]}]\n"
    path = scenario_file(tmp_path, text)
    command = [*COMMAND, str(path), "--jobs", "1", "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1, done.stderr
    assert "reaches (-10, 0, -5) within 2 m: comes no nearer than" in done.stdout
    assert (tmp_path / "out" / "report.html").is_file()
    path.write_text(path.read_text().replace("must_hold", "must"))
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert "line 6: must" in done.stderr


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGKILL,
        *(pytest.param(each, marks=pytest.mark.story) for each in (signal.SIGINT, signal.SIGTERM)),
    ],
)
def test_its_processes_end_with_it(number: signal.Signals, tmp_path: Path) -> None:
    path = program_scenario(tmp_path, ENDLESS)
    command = [*COMMAND, str(path), "--jobs", "2"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    started: list[psutil.Process] = []

    def program_runs() -> bool:
        started[:] = psutil.Process(process.pid).children(recursive=True)
        return any(MARK in "".join(each.cmdline()) for each in started if each.is_running())

    try:
        wait_until(program_runs, "the start of the program")
        os.kill(process.pid, number)
        process.wait(10)
        wait_until(lambda: not any(each.is_running() for each in started), "the end of its processes", 10)
    finally:
        process.kill()
