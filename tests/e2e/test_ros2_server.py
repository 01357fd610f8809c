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
WITHOUT_MAVLINK = ["--gcs-remote-port", "0", "--no-api", "--no-log"]
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
    """The server's API for the vehicle, which has the id 1."""

    def __init__(self, url: str, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self._http = httpx.Client(base_url=f"{url}/api/v1", timeout=30, headers={"X-Client": "test"})

    def vehicle(self) -> dict[str, Any]:
        vehicles = self._http.get("/vehicles").json()
        return vehicles[0] if vehicles else {"topics": {}, "status": {}}

    def topic_value(self, topic: str) -> dict[str, Any]:
        return self.vehicle()["topics"].get(topic, {}).get("value", {})

    def call(self, name: str, body: dict[str, Any], status: int = 200) -> dict[str, Any]:
        response = self._http.post(f"/vehicles/1/{name}", json=body)
        assert response.status_code == status, response.text
        return response.json()

    def start_stream(self, setpoint: dict[str, Any]) -> None:
        body = {"setpoint": setpoint, "valid_for_s": 20, "on_expiry": {"action": "hold"}}
        self.call("offboard/start", body)

    def is_ready(self) -> bool:
        return bool(self.topic_value("health").get("ready_to_arm") and self.topic_value("global_position"))

    def take_off(self) -> None:
        station.wait_until(self.is_ready, "readiness", 60.0)
        self.call("takeoff", {"alt_home_m": 10})
        station.wait_until(lambda: self.topic_value("global_position")["alt_home_m"] > 8.5, "the climb")


@pytest.fixture(params=["1.17", pytest.param("1.16", marks=pytest.mark.story)])
def api(request: pytest.FixtureRequest) -> Iterator[VehicleApi]:
    ports = ["--tcp-port", str(station.free_port()), "--px4", request.param]
    with (
        station.running_process([*SIMULATOR, *WITHOUT_MAVLINK, *ports]),
        station.running_server([f"ros2://{DOMAIN}/{NAMESPACE}"]) as (url, process),
    ):
        yield VehicleApi(url, process)


@pytest.mark.realtime
def test_a_vehicle_connected_over_ros_2_only_flies_every_type_of_setpoint_and_lands(
    api: VehicleApi,
) -> None:
    api.take_off()
    assert "not possible now" in api.call("disarm", {}, 409)["detail"]
    mission = {"mode": "mission", "despite": ["plan_not_known"]}
    assert "no mission on the vehicle" in api.call("mode", mission, 409)["detail"]
    api.start_stream({"type": "position", "position_ned_m": [0, 0, -11]})
    assert api.vehicle()["offboard"]["sends_failed"] < 100
    for setpoint in SETPOINTS_OF_EVERY_TYPE:
        body = {"setpoint": setpoint, "valid_for_s": 20, "on_expiry": {"action": "hold"}}
        api.call("offboard/setpoint", body)
        station.wait_until(lambda: api.vehicle()["offboard"]["age_s"] > 0.5, "half a second")
        vehicle = api.vehicle()
        assert (vehicle["status"]["mode"], vehicle["offboard"]["state"]) == ("offboard", "streaming")
    last_ned_m = (3.0, 0.0, -10.0)
    station.wait_until(
        lambda: math.dist(api.topic_value("local_position")["position_ned_m"], last_ned_m) < 1.0,
        "the arrival",
    )
    api.call("land", {})
    station.wait_until(lambda: not api.vehicle()["offboard"]["streaming"], "the end of the stream", 2.0)
    station.wait_until(lambda: not api.vehicle()["status"]["armed"], "the landing", 60.0)


@pytest.mark.realtime
def test_after_a_killed_server_the_vehicle_has_left_offboard_and_is_armed(api: VehicleApi) -> None:
    api.take_off()
    api.start_stream({"type": "position", "position_ned_m": [0, 0, -11]})
    api.process.send_signal(signal.SIGKILL)
    with station.running_server([f"ros2://{DOMAIN}/{NAMESPACE}"]) as (url, process):
        restarted = VehicleApi(url, process)
        station.wait_until(lambda: restarted.vehicle()["status"].get("mode"), "the vehicle's messages")
        status = restarted.vehicle()["status"]
        assert status["mode"] != "offboard"
        assert status["armed"]
