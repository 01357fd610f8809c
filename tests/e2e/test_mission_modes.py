"""Offboard missions as flight modes of PX4 over ROS 2; server and simulator are processes, in real time."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import expect

from tests import station
from tests.e2e.browser import REPOSITORY, chromium, hold_space, in_both_themes, opened
from tests.e2e.plan_page import plan_room
from tools import build_page
from vehicle_sim.mavlink import generated_dialect as mavlink

pytest.importorskip("cyclonedds")

DOMAIN = 58
NAMESPACE = f"modes_{os.getpid()}"
SIMULATOR = [sys.executable, "-m", "vehicle_sim", "--ros2", str(DOMAIN), "--ros2-namespace", NAMESPACE]
NAME = "Short line"
MISSION: dict[str, Any] = {
    "format": "offboard-gcs-mission",
    "version": 1,
    "name": "Line",
    "steps": [
        {"step": "fly", "points": [{"offset_ned_m": [8, 0, 0]}], "speed_m_s": 3},
        {"step": "hold", "duration_s": 2},
    ],
}


TAKES_OFF: dict[str, Any] = {
    **MISSION,
    "steps": [
        {"step": "take_off", "height_m": 4},
        {"step": "fly", "points": [{"offset_ned_m": [6, 0, -4]}], "speed_m_s": 3},
        {"step": "land"},
    ],
}


class OtherStation:
    """Another ground station, or a transmitter: it reaches the vehicle over MAVLink, the server does not."""

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
        filled = (*params, *(0.0,) * (7 - len(params)))
        message = mavlink.MAVLink_command_long_message(1, 1, command, 0, *filled)
        self._socket.sendall(message.pack(self._mavlink))

    def choose(self, mode: str) -> None:
        """Selects a mode like external_1."""
        self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 10 + int(mode.removeprefix("external_")))

    def mode(self) -> int:
        """Custom mode of the newest heartbeat, after a second."""
        return [each.custom_mode for each in self._received(1.5) if each.get_type() == "HEARTBEAT"][-1]

    def names(self) -> list[str]:
        """Names in AVAILABLE_MODES."""
        self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES, 0)
        return [each.mode_name for each in self._received(2.0) if each.get_type() == "AVAILABLE_MODES"]

    def _received(self, seconds: float) -> Iterator[Any]:
        """Messages received within a time, and those that wait already."""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            with contextlib.suppress(TimeoutError):
                yield from self._mavlink.parse_buffer(self._socket.recv(65536)) or []


class Vehicle:
    """The server's API for the vehicle, and another station."""

    def __init__(self, url: str, process: subprocess.Popen[bytes], other: OtherStation) -> None:
        self.url, self.process, self.other = url, process, other
        self._http = httpx.Client(base_url=f"{url}/api/v1", timeout=30, headers={"X-Client": "test"})

    def get(self, path: str) -> Any:
        answer = self._http.get(path)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def all(self) -> dict[str, Any]:
        vehicles = self.get("/vehicles")
        return vehicles[0] if vehicles else {"topics": {}, "status": {}}

    @property
    def status(self) -> dict[str, Any]:
        return self.all()["status"]

    def value(self, topic: str) -> dict[str, Any]:
        return self.all()["topics"].get(topic, {}).get("value", {})

    def call(self, name: str, body: dict[str, Any]) -> dict[str, Any]:
        answer = self._http.post(f"/vehicles/1/{name}", json=body)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def ready(self) -> bool:
        return bool(self.value("health").get("ready_to_arm") and self.value("global_position"))

    def take_off(self) -> None:
        station.wait_until(self.ready, "readiness", 60.0)
        self.call("takeoff", {"alt_home_m": 10})
        station.wait_until(lambda: self.status["mode"] == "hold", "the end of the climb", 40.0)

    def in_air(self) -> str:
        """Registers the mission and takes off; returns its mode."""
        station.wait_until(self.ready, "readiness", 60.0)
        (mode,) = self.call("mission_modes/register", {"mission": MISSION, "name": NAME})["modes"]
        assert mode["state"] == "registered"
        self.take_off()
        return mode["mode"]

    def flying(self) -> str:
        """The same, then another station starts it; returns its mode on the way."""
        mode = self.in_air()
        self.other.choose(mode)
        self.until_mission("flying")
        begun_m = self.north_m()
        station.wait_until(lambda: self.north_m() > begun_m + 1.5, "the flight north", 15.0)
        return mode

    def north_m(self) -> float:
        return self.value("local_position")["position_ned_m"][0]

    def mission(self) -> str | None:
        return (self.get("/vehicles/1/offboard_mission")["mission"] or {}).get("state")

    def until_mission(self, state: str) -> None:
        """Waits until the mission has this state; compiling it takes some seconds on a busy computer."""
        try:
            station.wait_until(lambda: self.mission() == state, f"the mission's state {state}", 40.0)
        except TimeoutError as error:
            raise AssertionError(f"{error}; it is {self.mission()}: {self.texts()}") from None

    def modes(self) -> dict[str, Any]:
        return self.get("/vehicles/1/mission_modes")

    def texts(self) -> str:
        return "\n".join(event["text"] for event in self.get("/vehicles/1/messages")["messages"])


@pytest.fixture
def vehicle() -> Iterator[Vehicle]:
    port = station.free_port()
    ports = ["--tcp-port", str(port), "--gcs-remote-port", "0", "--no-api", "--no-log"]
    with (
        station.running([*SIMULATOR, *ports]),
        station.server([f"ros2://{DOMAIN}/{NAMESPACE}"]) as (url, process),
    ):
        yield Vehicle(url, process, OtherStation(port))


def streams_process(server: int) -> int:
    """Process id of the setpoint streams' process of a server."""
    tasks = Path(f"/proc/{server}/task").iterdir()
    children = [int(pid) for task in tasks for pid in (task / "children").read_text().split()]
    commands = {pid: Path(f"/proc/{pid}/cmdline").read_bytes() for pid in children}
    return next(pid for pid, command in commands.items() if b"streamer.process.worker" in command)


@pytest.mark.realtime
def test_a_registered_mission_is_a_mode_of_another_station_and_both_can_start_it(vehicle: Vehicle) -> None:
    mode = vehicle.in_air()
    assert NAME in vehicle.other.names()
    vehicle.other.choose(mode)
    station.wait_until(lambda: vehicle.status["mode"] == mode, "the mode", 5.0)
    assert vehicle.status["mode_label"] == NAME
    for start in (None, {"mode": mode}):
        if start is not None:
            vehicle.call("mode", start)
        vehicle.until_mission("flying")
        vehicle.until_mission("done")
        station.wait_until(lambda: vehicle.status["mode"] == "hold", "Hold", 5.0)
    assert vehicle.north_m() == pytest.approx(16.0, abs=2.0)
    assert vehicle.modes()["modes"][0]["state"] == "registered"
    assert vehicle.call("mission_modes/unregister", {"name": NAME})["modes"] == []
    station.wait_until(lambda: NAME not in vehicle.other.names(), "its removal", 10.0)


@pytest.mark.realtime
def test_a_mission_selected_on_the_ground_takes_off_when_armed_lands_and_hands_over_to_hold(
    vehicle: Vehicle,
) -> None:
    station.wait_until(vehicle.ready, "readiness", 60.0)
    body = {"mission": TAKES_OFF, "name": NAME}
    (mode,) = vehicle.call("mission_modes/register", body)["modes"]
    assert (mode["state"], mode["takes_off"]) == ("registered", True)
    vehicle.other.choose(mode["mode"])
    station.wait_until(lambda: vehicle.status["mode"] == mode["mode"], "the mode", 5.0)
    assert (vehicle.status["armed"], vehicle.mission()) == (False, None)
    begun_m = vehicle.north_m()
    vehicle.other.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    vehicle.until_mission("taking_off")
    mission = vehicle.get("/vehicles/1/offboard_mission")["mission"]
    assert (mission["mode"], mission["executor_in_charge"]) == (mode["mode"], True)
    vehicle.until_mission("flying")
    vehicle.until_mission("landing")
    assert vehicle.north_m() == pytest.approx(begun_m + 6.0, abs=1.5)
    vehicle.until_mission("done")
    station.wait_until(lambda: vehicle.status["mode"] == "hold", "Hold", 5.0)
    assert vehicle.status["armed"] is False
    assert vehicle.modes()["modes"][0]["state"] == "registered"


@pytest.mark.realtime
def test_a_killed_stream_process_ends_the_mode_and_the_operator_is_informed(vehicle: Vehicle) -> None:
    vehicle.flying()
    os.kill(streams_process(vehicle.process.pid), signal.SIGKILL)
    station.wait_until(lambda: vehicle.status["mode"] in ("hold", "rtl"), "the end of the mode", 5.0)
    assert vehicle.mission() == "suspended"
    station.wait_until(lambda: "is no longer registered" in vehicle.texts(), "the message", 5.0)
    assert vehicle.status["mode"] == "hold", vehicle.texts()
    modes = vehicle.modes()
    assert modes["possible"] is True
    assert modes["modes"][0]["state"] == "lost"
    vehicle.call("mission_modes/register", {"mission": MISSION, "name": NAME})
    vehicle.call("mode", {"mode": vehicle.modes()["modes"][0]["mode"]})
    vehicle.until_mission("flying")


@pytest.mark.realtime
def test_a_killed_server_makes_px4_return(vehicle: Vehicle) -> None:
    vehicle.flying()
    streams = streams_process(vehicle.process.pid)
    for pid in (streams, vehicle.process.pid):
        os.kill(pid, signal.SIGSTOP)
    for pid in (streams, vehicle.process.pid):
        os.kill(pid, signal.SIGKILL)
    station.wait_until(lambda: vehicle.other.mode() == 5 << 24 | 4 << 16, "RTL", 4.0)


@pytest.mark.realtime
@pytest.mark.browser
def test_in_the_plan_room_a_mission_is_registered_started_and_removed(vehicle: Vehicle) -> None:
    build_page.build(REPOSITORY)
    vehicle.take_off()
    file = {"name": "line.json", "mimeType": "application/json", "buffer": json.dumps(MISSION).encode()}
    with chromium() as browser, opened(browser, vehicle.url, scene=False) as page:
        room = plan_room(page)
        page.get_by_label("File to import").set_input_files(file)  # type: ignore[arg-type]
        expect(room.get_by_label("Name of the plan")).to_have_value("Line")
        room.get_by_text("Flight modes of PX4", exact=True).click()
        modes = room.get_by_role("group", name="Flight modes of PX4")
        modes.get_by_label("Name of the flight mode").fill(NAME)
        deferral = modes.get_by_label("Defer failsafes")
        register = modes.get_by_role("button", name="egister")
        deferral.fill("500")
        expect(register).to_be_disabled()
        expect(modes).to_contain_text("from 0 (never) to 120")
        deferral.fill("20")
        register.click()
        expect(modes).to_contain_text("ready to be selected")
        assert NAME in vehicle.other.names()
        assert vehicle.modes()["modes"][0]["defer_failsafes_s"] == 20
        assert in_both_themes(page) == []
        modes.get_by_role("button", name=f"Start {NAME}…").click()
        hold_space(page)
        expect(page.locator(".pill b")).to_have_text(NAME)
        expect(modes).to_contain_text("selected")
        expect(modes.get_by_role("button", name=f"Remove {NAME}")).to_have_count(0)
        vehicle.until_mission("done")
        modes.get_by_role("button", name=f"Remove {NAME}").click()
        expect(modes.get_by_role("listitem")).to_have_count(0)
