"""Programs of `missions/examples` fly simulated vehicles through the API."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from gcs_server.client import SyncGcs
from tests.e2e.fast_station import FAST_OPTIONS
from tests.station import free_port, running_server, running_vehicles

pytestmark = pytest.mark.story


@pytest.mark.parametrize(("example", "height_m"), [("first_flight", 5.0), ("hover_and_land", 1.0)])
def test_the_flight_example_reaches_its_height_and_ends_disarmed_on_the_ground(
    station: Any, example: str, height_m: float
) -> None:
    command = [
        sys.executable,
        "-m",
        f"missions.examples.{example}",
        "--server",
        station.url,
        "--vehicle",
        "101",
    ]
    result = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert result.returncode == 0, result.stderr
    assert "Landed and disarmed." in result.stdout

    state = station.drone.show()
    assert not state["status"]["armed"]
    assert state["status"]["landed_state"] == "on_ground"
    history = station.drone.request("GET", "/history?topics=local_position&since_unix_s=0")
    heights_m = [-sample["value"]["position_ned_m"][2] for sample in history["samples"]]
    assert max(heights_m) == pytest.approx(height_m, abs=0.8)


@pytest.mark.parametrize(
    ("example", "flags", "expected_text"),
    [
        ("figure_eight", [], "step 2: Two rounds"),
        ("tower_inspection", ["--yes"], "step 8: Down around the mast"),
        ("survey", [], "Uploaded and verified"),
    ],
)
def test_the_plan_example_flies_its_plan_and_lands(
    station: Any, example: str, flags: list[str], expected_text: str
) -> None:
    module = f"missions.examples.{example}"
    command = [sys.executable, "-m", module, "--server", station.url, "--vehicle", "101", *flags]
    result = subprocess.run(command, capture_output=True, text=True, timeout=280)
    assert result.returncode == 0, result.stderr
    assert expected_text in result.stdout
    assert result.stdout.rstrip().endswith("Landed and disarmed.")
    assert not station.drone.show()["status"]["armed"]


def test_the_obstacle_example_flies_over_the_obstacle_and_lands_behind_it() -> None:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=[*FAST_OPTIONS, "--world", "obstacle-box"]),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        command = [
            sys.executable,
            "-m",
            "missions.examples.obstacle_flight",
            "--server",
            url,
            "--vehicle",
            "101",
        ]
        result = subprocess.run(command, capture_output=True, text=True, timeout=240)
        assert result.returncode == 0, result.stderr
        assert "climbing over" in result.stdout
        assert "Landed behind the box and disarmed." in result.stdout
        assert drone.position_ned_m()[0] > 8.0


def test_the_two_vehicle_show_is_flown_by_the_first_and_the_last_vehicle_until_both_have_landed() -> None:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=4, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drones = [gcs.wait_for_vehicle(each, ready=True, timeout_s=120) for each in ("101", "104")]
        command = [sys.executable, "-m", "missions.examples.two_vehicle_show", "--server", url]
        result = subprocess.run(command, capture_output=True, text=True, timeout=280)
        assert result.returncode == 0, result.stderr
        assert "Vehicle 104 flies the role 'left' of 'Two-vehicle show'." in result.stdout
        assert result.stdout.rstrip().endswith("Landed and disarmed.")
        assert not any(drone.show()["status"]["armed"] for drone in drones)
        heights_m = {drone.id: -min(_down_positions_m(drone)) for drone in drones}
        assert heights_m == {"101": pytest.approx(10.0, abs=2.5), "104": pytest.approx(18.0, abs=2.5)}


def _down_positions_m(drone: Any) -> list[float]:
    history = drone.request("GET", "/history?topics=local_position&since_unix_s=0")
    return [sample["value"]["position_ned_m"][2] for sample in history["samples"]]
