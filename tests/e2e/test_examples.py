"""The flights of the two documents this project came from, through the API."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize(("example", "height_m"), [("first_flight", 5.0), ("hover_and_land", 1.0)])
def test_example_flies_and_ends_disarmed_on_the_ground(station: Any, example: str, height_m: float) -> None:
    command = [
        sys.executable,
        "-m",
        f"missions.examples.{example}",
        "--server",
        station.url,
        "--vehicle",
        "101",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    assert "Landed and disarmed." in done.stdout

    shown = station.drone.show()
    assert not shown["status"]["armed"]
    assert shown["status"]["landed_state"] == "on_ground"
    history = station.drone.request("GET", "/history?topics=local_position&since_unix_s=0")
    heights = [-sample["value"]["position_ned_m"][2] for sample in history["samples"]]
    assert max(heights) == pytest.approx(height_m, abs=0.8)
