"""A vehicle whose missions are registered as flight modes, the server's API for this vehicle, and another
ground station."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx

from tests import station
from tests.support.line_mission import MISSION, MODE_NAME
from vehicle_sim.mavlink import generated_dialect as mavlink

DOMAIN = 58
NAMESPACE = f"modes_{os.getpid()}"
LINK = f"ros2://{DOMAIN}/{NAMESPACE}"
SIMULATOR = [sys.executable, "-m", "vehicle_sim", "--ros2", str(DOMAIN), "--ros2-namespace", NAMESPACE]
DISARM_LATE = ["--param", "COM_DISARM_PRFLT=60"]
"""PX4 disarms a vehicle that has not taken off 60 s after arming. The default is 10 s, but on a busy computer
the server may need longer to compile the mission."""
TAKE_OFF_MISSION: dict[str, Any] = {
    **MISSION,
    "steps": [
        {"step": "take_off", "height_m": 4},
        {"step": "fly", "points": [{"offset_ned_m": [6, 0, -4]}], "speed_m_s": 3},
        {"step": "land"},
    ],
}


class OtherStation:
    """Another ground station, connected over MAVLink; the server is connected over ROS 2 only."""

    def __init__(self, port: int) -> None:
        station.wait_until(lambda: self._connected(port), "the simulator's port", 30.0)
        self._socket.settimeout(0.5)
        self._mavlink = mavlink.MAVLink(None, srcSystem=254)
        self._mavlink.robust_parsing = True

    def _connected(self, port: int) -> bool:
        with contextlib.suppress(ConnectionRefusedError):
            self._socket = socket.create_connection(("127.0.0.1", port))
            return True
        return False

    def command(self, command: int, *params: float) -> None:
        seven_params = (*params, *(0.0,) * (7 - len(params)))
        message = mavlink.MAVLink_command_long_message(1, 1, command, 0, *seven_params)
        self._socket.sendall(message.pack(self._mavlink))

    def select_mode(self, mode: str) -> None:
        """Selects a mode by its name, such as external_1, whose sub mode is 11."""
        self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 10 + int(mode.removeprefix("external_")))

    def mode(self) -> int:
        """Custom mode in the last heartbeat that is received within 1.5 s."""
        return [each.custom_mode for each in self._received(1.5) if each.get_type() == "HEARTBEAT"][-1]

    def mode_names(self) -> list[str]:
        """Names of the modes in AVAILABLE_MODES."""
        self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES, 0)
        return [each.mode_name for each in self._received(2.0) if each.get_type() == "AVAILABLE_MODES"]

    def _received(self, seconds: float) -> Iterator[Any]:
        """Messages received within a time, including those already in the buffer."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            with contextlib.suppress(TimeoutError):
                yield from self._mavlink.parse_buffer(self._socket.recv(65536)) or []


class VehicleWithMissionModes:
    """A vehicle with mission modes: the server's API for this vehicle, and the other ground station."""

    def __init__(self, url: str, process: subprocess.Popen[bytes], other_station: OtherStation) -> None:
        self.url, self.process, self.other_station = url, process, other_station
        self._http = httpx.Client(base_url=f"{url}/api/v1", timeout=30, headers={"X-Client": "test"})

    def get(self, path: str) -> Any:
        response = self._http.get(path)
        assert response.status_code == 200, response.text
        return response.json()

    def vehicle(self) -> dict[str, Any]:
        vehicles = self.get("/vehicles")
        return vehicles[0] if vehicles else {"topics": {}, "status": {}}

    @property
    def status(self) -> dict[str, Any]:
        return self.vehicle()["status"]

    def topic_value(self, topic: str) -> dict[str, Any]:
        return self.vehicle()["topics"].get(topic, {}).get("value", {})

    def call(self, name: str, body: dict[str, Any]) -> dict[str, Any]:
        response = self._http.post(f"/vehicles/1/{name}", json=body)
        assert response.status_code == 200, response.text
        return response.json()

    def is_ready(self) -> bool:
        estimates = {"attitude", "local_position", "global_position"}
        return (
            bool(self.topic_value("health").get("ready_to_arm"))
            and estimates <= self.vehicle()["topics"].keys()
        )

    def take_off(self) -> None:
        station.wait_until(self.is_ready, "readiness", 60.0)
        self.call("takeoff", {"alt_home_m": 10})
        station.wait_until(lambda: self.status["mode"] == "hold", "the end of the climb", 40.0)

    def arm(self) -> None:
        """The other station sends arm commands until the vehicle is armed: PX4 refuses while the mission is
        being compiled."""

        def is_armed() -> bool:
            if not self.status["armed"]:
                self.other_station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
                time.sleep(1.0)
            return self.status["armed"]

        station.wait_until(is_armed, "arming")

    def register(self, mission: dict[str, Any]) -> str:
        """Registers the mission when the vehicle is ready; returns the mission's mode."""
        station.wait_until(self.is_ready, "readiness", 60.0)
        (mode,) = self.call("mission_modes/register", {"mission": mission, "name": MODE_NAME})["modes"]
        assert mode["state"] == "registered"
        return mode["mode"]

    def register_and_take_off(self, mission: dict[str, Any] = MISSION) -> str:
        """Registers the mission and takes off; returns the mission's mode."""
        mode = self.register(mission)
        self.take_off()
        return mode

    def start_in_flight(self, mission: dict[str, Any] = MISSION) -> str:
        """Registers the mission and takes off; the other station starts the mission. Returns the mission's
        mode."""
        mode = self.register_and_take_off(mission)
        self.other_station.select_mode(mode)
        self.wait_until_flying_north()
        return mode

    def start_on_ground(self, mission: dict[str, Any]) -> str:
        """The other station selects the mission's mode on the ground and arms. Waits until PX4 takes off;
        returns the mode."""
        mode = self.register(mission)
        self.other_station.select_mode(mode)
        station.wait_until(lambda: self.status["mode"] == mode, "the mode", 5.0)
        self.arm()
        self.wait_for_mission_state("taking_off")
        return mode

    def wait_until_flying_north(self) -> None:
        """Waits until the vehicle flies north in its mission."""
        self.wait_for_mission_state("flying")
        start_north_m = self.north_m()
        station.wait_until(lambda: self.north_m() > start_north_m + 1.5, "the flight north", 15.0)

    def north_m(self) -> float:
        return self.topic_value("local_position")["position_ned_m"][0]

    def mission_state(self) -> str | None:
        return (self.get("/vehicles/1/offboard_mission")["mission"] or {}).get("state")

    def wait_for_mission_state(self, state: str) -> None:
        """Waits until the mission has this state; compiling it takes some seconds on a busy computer."""
        try:
            station.wait_until(lambda: self.mission_state() == state, f"the mission's state {state}", 40.0)
        except TimeoutError as error:
            raise AssertionError(f"{error}; the mission is {self.mission_state()}: {self.texts()}") from None

    def modes(self) -> dict[str, Any]:
        return self.get("/vehicles/1/mission_modes")

    def texts(self) -> str:
        return "\n".join(event["text"] for event in self.get("/vehicles/1/messages")["messages"])


@contextlib.contextmanager
def vehicle_with_mission_modes(version: str = "1.17") -> Iterator[VehicleWithMissionModes]:
    """Runs the simulator as this version of PX4, and a server that is connected to it over ROS 2 only."""
    port = station.free_port()
    ports = ["--tcp-port", str(port), "--gcs-remote-port", "0", "--no-api", "--no-log"]
    with (
        station.running_process([*SIMULATOR, "--px4", version, *ports, *DISARM_LATE]),
        station.running_server([LINK]) as (url, process),
    ):
        yield VehicleWithMissionModes(url, process, OtherStation(port))


def stream_process_pid(server_pid: int) -> int:
    """Process id of the stream process that the server with this process id has started."""
    tasks = Path(f"/proc/{server_pid}/task").iterdir()
    children = [int(pid) for task in tasks for pid in (task / "children").read_text().split()]
    commands = {pid: Path(f"/proc/{pid}/cmdline").read_bytes() for pid in children}
    return next(pid for pid, command in commands.items() if b"streamer.process.worker" in command)
