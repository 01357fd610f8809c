"""A vehicle that is connected over ROS 2 only; server and simulator are real processes, in real time."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests import station

pytest.importorskip("cyclonedds")

DOMAIN = 52
NAMESPACE = f"server_{os.getpid()}"
SIMULATOR = [sys.executable, "-m", "vehicle_sim", "--ros2", str(DOMAIN), "--ros2-namespace", NAMESPACE]
NO_MAVLINK = ["--gcs-remote-port", "0", "--no-api", "--no-log"]
SETPOINTS_OF_EVERY_TYPE: list[dict[str, Any]] = [
    {"type": "velocity", "velocity_ned_m_s": [1, 1, 0]},
    {"type": "velocity_body", "velocity_frd_m_s": [1, 0, 0]},
    {"type": "position_global", "lat_deg": 47.39775, "lon_deg": 8.5456, "alt_home_m": 10},
    {"type": "acceleration", "acceleration_ned_m_s2": [0, 0, 0]},
    {"type": "attitude", "q_ned_frd": [1, 0, 0, 0], "thrust": 0.5},
    {"type": "rates", "rates_frd_rad_s": [0, 0, 0.3], "thrust": 0.5},
    {"type": "thrust_torque", "thrust_frd": [0, 0, -0.5], "torque_frd": [0, 0, 0]},
    {"type": "actuators", "motors": [0.7, 0.7, 0.7, 0.7]},
    {"type": "position", "position_ned_m": [3, 0, -10]},
]


class VehicleApi:
    """The server's API for the vehicle."""

    def __init__(self, url: str, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self._http = httpx.Client(base_url=f"{url}/api/v1", timeout=30, headers={"X-Client": "test"})

    def vehicle(self) -> dict[str, Any]:
        vehicles = self._http.get("/vehicles").json()
        return vehicles[0] if vehicles else {"topics": {}, "status": {}}

    def value(self, topic: str) -> dict[str, Any]:
        return self.vehicle()["topics"].get(topic, {}).get("value", {})

    def call(self, name: str, body: dict[str, Any], status: int = 200) -> dict[str, Any]:
        response = self._http.post(f"/vehicles/1/{name}", json=body)
        assert response.status_code == status, response.text
        return response.json()

    def start(self, setpoint: dict[str, Any]) -> None:
        body = {"setpoint": setpoint, "valid_for_s": 20, "on_expiry": {"action": "hold"}}
        self.call("offboard/start", body)

    def ready(self) -> bool:
        return bool(self.value("health").get("ready_to_arm") and self.value("global_position"))

    def take_off(self) -> None:
        station.wait_until(self.ready, "readiness", 60.0)
        self.call("takeoff", {"alt_home_m": 10})
        station.wait_until(lambda: self.value("global_position")["alt_home_m"] > 8.5, "the climb")


@pytest.fixture
def flight() -> Iterator[VehicleApi]:
    ports = ["--tcp-port", str(station.free_port())]
    with (
        station.running([*SIMULATOR, *NO_MAVLINK, *ports]),
        station.server([f"ros2://{DOMAIN}/{NAMESPACE}"]) as (url, process),
    ):
        yield VehicleApi(url, process)


@pytest.mark.realtime
def test_a_vehicle_connected_over_ros_2_only_flies_every_kind_of_setpoint_and_lands(
    flight: VehicleApi,
) -> None:
    flight.take_off()
    assert "not possible now" in flight.call("disarm", {}, 409)["detail"]
    assert "no mission on the vehicle" in flight.call("mode", {"mode": "mission"}, 409)["detail"]
    flight.start({"type": "position", "position_ned_m": [0, 0, -11]})
    assert flight.vehicle()["offboard"]["sends_failed"] < 100
    for setpoint in SETPOINTS_OF_EVERY_TYPE:
        body = {"setpoint": setpoint, "valid_for_s": 20, "on_expiry": {"action": "hold"}}
        flight.call("offboard/setpoint", body)
        station.wait_until(lambda: flight.vehicle()["offboard"]["age_s"] > 0.5, "half a second")
        vehicle = flight.vehicle()
        assert (vehicle["status"]["mode"], vehicle["offboard"]["state"]) == ("offboard", "streaming")
    target = (3.0, 0.0, -10.0)
    station.wait_until(
        lambda: math.dist(flight.value("local_position")["position_ned_m"], target) < 1.0, "the last position"
    )
    flight.call("land", {})
    station.wait_until(lambda: not flight.vehicle()["offboard"]["streaming"], "the end of the stream", 2.0)
    station.wait_until(lambda: not flight.vehicle()["status"]["armed"], "the landing", 60.0)


@pytest.mark.realtime
def test_a_killed_server_leaves_the_vehicle_to_its_failsafe(flight: VehicleApi) -> None:
    flight.take_off()
    flight.start({"type": "position", "position_ned_m": [0, 0, -11]})
    flight.process.send_signal(signal.SIGKILL)
    with station.server([f"ros2://{DOMAIN}/{NAMESPACE}"]) as (url, process):
        restarted = VehicleApi(url, process)
        station.wait_until(lambda: restarted.vehicle()["status"].get("mode"), "the vehicle's messages")
        status = restarted.vehicle()["status"]
        assert status["mode"] != "offboard"
        assert status["armed"]
