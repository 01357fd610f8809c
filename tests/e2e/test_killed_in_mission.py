"""The server is killed while PX4 flies a waypoint plan: real processes, killed by signals."""

from __future__ import annotations

import signal
import socket
from pathlib import Path
from typing import Any

import pytest

from gcs_server.client import SyncGcs
from tests.e2e.fast_station import FAST_OPTIONS
from tests.station import (
    end_process,
    free_port,
    is_up,
    running_process,
    running_vehicles,
    server_command,
    wait_until,
)
from vehicle_sim.mavlink import generated_dialect as mavlink

pytestmark = pytest.mark.realtime

HOLD, MISSION, RTL = 3 << 24 | 4 << 16, 4 << 24 | 4 << 16, 5 << 24 | 4 << 16
"""PX4's custom_mode: sub mode in the highest byte, main mode in the next byte."""
LAT, LON = 47.397742, 8.545594
METRE_NORTH_DEG = 1 / 111_195


def item(kind: str, north_m: float, **fields: Any) -> dict[str, Any]:
    altitude = {"value_m": 0 if kind == "land" else 8, "reference": "home"}
    return {
        "kind": kind,
        "lat_deg": LAT + north_m * METRE_NORTH_DEG,
        "lon_deg": LON,
        "altitude": altitude,
        **fields,
    }


PLAN = {
    "items": [item("takeoff", 0), item("waypoint", 40), item("waypoint", 60, hold_s=90), item("land", 60)]
}


def modes_without_server(port: int, last_mode: int) -> list[int]:
    """Receives frames, and sends nothing, until the vehicle is in `last_mode`; returns its modes in order."""
    parser, modes = mavlink.MAVLink(None), list[int]()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.settimeout(30)
        receiver.bind(("127.0.0.1", port))
        while last_mode not in modes:
            for message in parser.parse_buffer(receiver.recv(2048)) or []:
                is_autopilot = message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1
                if is_autopilot and message.custom_mode not in modes:
                    modes.append(message.custom_mode)
    return modes


def upload_and_start(gcs: Any, drone: Any, link_loss_action: int) -> tuple[str, dict[str, Any]]:
    """Uploads the plan and starts it. Returns the server's text about a lost link, and the plan
    that the vehicle has according to the server."""
    for name, value in (("NAV_DLL_ACT", link_loss_action), ("COM_DL_LOSS_T", 10)):
        drone.request("PUT", f"/params/{name}", {"value": value})
    stored = gcs.request("POST", "/plans", {"name": "North", "plan": PLAN})
    drone.mission.upload(plan_id=stored["id"])
    wait_until(lambda: drone.mission.state()["if_link_lost"], "the text about a lost link")
    state_before = drone.mission.state()
    assert state_before["holds"]["plan"] == {"id": stored["id"], "version": 1, "name": "North"}
    drone.mission.start(0)
    wait_until(lambda: drone.mission.state()["mission"]["current"] == 1, "the first leg", 60)
    assert drone.mission.state()["flight"]["client"] == "e2e"
    return state_before["if_link_lost"], state_before["holds"]


@pytest.mark.parametrize(
    ("link_loss_action", "stated_action", "modes"),
    [
        (0, "The vehicle continues the mission (NAV_DLL_ACT 0).", [MISSION]),
        (
            2,
            "After about 10 s without any ground station, the vehicle holds for 5 s, then returns (RTL) "
            "(NAV_DLL_ACT 2).",
            [MISSION, HOLD, RTL],
        ),
    ],
    ids=["continues", "returns"],
)
def test_px4_acts_as_the_killed_server_stated_and_the_next_server_only_monitors_the_flight(
    tmp_path: Path, link_loss_action: int, stated_action: str, modes: list[int]
) -> None:
    port, http_port = free_port(), free_port(socket.SOCK_STREAM)
    url = f"http://127.0.0.1:{http_port}"
    command = server_command(http_port, [f"udpin://127.0.0.1:{port}"], tmp_path)
    with running_vehicles(port, arguments=FAST_OPTIONS):
        with running_process(command) as first_server:
            wait_until(lambda: is_up(url), "the first server")
            with SyncGcs(url, client="e2e") as gcs:
                drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
                if_link_lost, holds = upload_and_start(gcs, drone, link_loss_action)
                assert if_link_lost == stated_action
                end_process(first_server, signal.SIGKILL)
        assert modes_without_server(port, modes[-1]) == modes
        with running_process(command):
            wait_until(lambda: is_up(url), "the second server")
            with SyncGcs(url, client="e2e") as gcs:
                drone = gcs.wait_for_vehicle("101", timeout_s=60)
                wait_until(lambda: drone.mission.state()["holds"] == holds, "the plan on the vehicle")
                status = drone.status()
                assert (status["armed"], status["custom_mode"]) == (True, modes[-1])
                if modes == [MISSION]:
                    check_monitoring_to_the_end(drone)
                assert drone.request("GET", "/control")["holder"] is None
                journal = gcs.request("GET", "/journal")["entries"]
                assert journal[0]["command"] == "mission/start", (
                    "a command was sent after the server was killed"
                )


def check_monitoring_to_the_end(drone: Any) -> None:
    """Checks that the server monitors the flight from its current item to its end."""
    wait_until(lambda: drone.mission.state()["flight"], "the monitored flight")
    wait_until(lambda: drone.mission.state()["flight"]["item"] == 2, "the second leg")
    wait_until(
        lambda: drone.mission.state()["flight"]["deviation_horizontal_m"] is not None, "the flown path", 60
    )
    flight = drone.mission.state()["flight"]
    assert (flight["state"], flight["count"], flight["client"]) == ("flying", 4, None)
    assert flight["deviation_horizontal_m"] < 3.0
    assert 0.0 < flight["remaining_s"] < flight["duration_s"]
    drone.until_disarmed(timeout_s=120)
    wait_until(lambda: drone.mission.state()["flight"]["state"] == "done", "the end of the flight", 10)
