"""Processes are killed while a mission flies as a flight mode, over real DDS and in real time.

The vehicle must leave the mode as the recorded PX4 does. The tests read the mode from the vehicle's own
status messages, because no server is running."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cyclonedds")

from gcs_server.ros2.dds import open_domain
from tests import station
from tests.clients.px4_dds import Node, VehicleLocalPosition, VehicleStatus
from tests.clients.ros2_offboard_node import POSITION_TOPICS
from tests.e2e.mission_modes import (
    DOMAIN,
    LINK,
    MISSION,
    MODE_NAME,
    NAMESPACE,
    VehicleWithMissionModes,
    stream_process_pid,
    vehicle_with_mission_modes,
)
from vehicle_sim.mavlink import generated_dialect as mavlink

pytestmark = pytest.mark.realtime

HOLD, RTL, TAKEOFF = 4, 5, 17
"""VehicleStatus.nav_state."""
ARMED = 2
"""VehicleStatus.arming_state."""
NAV_STATE_BEFORE_EXTERNAL_1 = 22
RETURN_DELAY_S = (0.7, 1.8)
"""Shortest and longest time from the end of the arming check replies until PX4 returns [s]. PX4 returns 1.05
to 1.25 s after the last reply, which was sent up to 0.3 s earlier; a busy machine needs additional time."""
EXECUTOR_RELEASE_S = 1.5
"""Time within which PX4 reports that the executor is no longer in charge; recorded: 0.5 s."""
FAR_MISSION: dict[str, Any] = {
    **MISSION,
    "steps": [{"step": "fly", "points": [{"offset_ned_m": [40, 0, 0]}], "speed_m_s": 2}],
}
TAKE_OFF_FAR_MISSION: dict[str, Any] = {
    **MISSION,
    "steps": [
        {"step": "take_off", "height_m": 8},
        {"step": "fly", "points": [{"offset_ned_m": [40, 0, -8]}], "speed_m_s": 2},
        {"step": "land"},
    ],
}
with_and_without_executor = pytest.mark.parametrize(
    "executor", [False, pytest.param(True, marks=pytest.mark.story)], ids=["mode", "executor"]
)
"""Runs a test with a mode alone, and with a mode that an executor owns."""


class Px4Topics:
    """The status and position that PX4 publishes."""

    def __init__(self) -> None:
        self._domain = open_domain(DOMAIN, None)
        self._node = Node(DOMAIN, NAMESPACE)
        self._status = self._node.subscription(VehicleStatus, "/fmu/out/vehicle_status_v1")
        self.position = self._node.subscription(VehicleLocalPosition, POSITION_TOPICS["1.17"])

    @property
    def status(self) -> Any:
        """The newest status."""
        return self._status.latest

    def wait_until(self, condition: Callable[[Any], bool], what: str, within_s: float) -> Any:
        """The first status for which `condition` is true."""
        end_s = time.monotonic() + within_s
        while (status := self.status) is None or not condition(status):
            assert time.monotonic() < end_s, f"{what} did not happen within {within_s} s: {status}"
            time.sleep(0.005)
        return status


@pytest.fixture
def vehicle(request: pytest.FixtureRequest) -> Iterator[VehicleWithMissionModes]:
    with vehicle_with_mission_modes(getattr(request, "param", "1.17")) as mission_vehicle:
        yield mission_vehicle


@pytest.fixture
def px4() -> Px4Topics:
    return Px4Topics()


def start_mission(vehicle: VehicleWithMissionModes, px4: Px4Topics, *, executor: bool) -> int:
    """Starts the mission and waits until it flies north; returns the mission's nav_state."""
    if executor:
        mode = vehicle.start_on_ground(TAKE_OFF_FAR_MISSION)
        vehicle.wait_until_flying_north()
    else:
        mode = vehicle.start_in_flight(FAR_MISSION)
    mission_nav_state = nav_state(mode)
    status = px4.wait_until(lambda each: each.nav_state == mission_nav_state, "the mission's mode", 5.0)
    assert (status.nav_state_user_intention, status.failsafe) == (mission_nav_state, False)
    assert status.executor_in_charge == (1 if executor else 0)
    return mission_nav_state


def nav_state(mode: str) -> int:
    """The nav_state of a mode such as external_1."""
    return int(mode.removeprefix("external_")) + NAV_STATE_BEFORE_EXTERNAL_1


def kill_together(*processes: int) -> float:
    """Kills processes so that none reacts to the end of another one; returns the time [s, monotonic]."""
    for pid in processes:
        os.kill(pid, signal.SIGSTOP)
    at_s = time.monotonic()
    for pid in processes:
        os.kill(pid, signal.SIGKILL)
    return at_s


def is_selectable(status: Any, mode: int) -> bool:
    """Whether PX4 lists the mode as selectable."""
    return bool(status.can_set_nav_states_mask >> mode & 1)


def is_running(pid: int) -> bool:
    """Whether a process still runs; a zombie does not."""
    with contextlib.suppress(FileNotFoundError):
        return bool(Path(f"/proc/{pid}/cmdline").read_bytes())
    return False


@pytest.mark.parametrize("vehicle", ["1.17", pytest.param("1.16", marks=pytest.mark.story)], indirect=True)
@with_and_without_executor
def test_when_server_and_streams_die_together_px4_returns_until_another_mode_is_selected(
    vehicle: VehicleWithMissionModes, px4: Px4Topics, executor: bool
) -> None:
    mission_nav_state = start_mission(vehicle, px4, executor=executor)
    killed_s = kill_together(vehicle.process.pid, stream_process_pid(vehicle.process.pid))
    after = px4.wait_until(lambda each: each.nav_state != mission_nav_state, "the end of the mode", 5.0)
    assert RETURN_DELAY_S[0] < time.monotonic() - killed_s < RETURN_DELAY_S[1]
    expected = (RTL, mission_nav_state, True)
    assert (after.nav_state, after.nav_state_user_intention, after.failsafe) == expected
    px4.wait_until(lambda each: each.executor_in_charge == 0, "the executor's release", EXECUTOR_RELEASE_S)
    time.sleep(1.5)
    status = px4.status
    assert (status.nav_state, status.failsafe, is_selectable(status, mission_nav_state)) == (RTL, True, True)
    vehicle.other_station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)  # Hold
    hold_status = px4.wait_until(lambda each: each.nav_state == HOLD, "Hold", 2.0)
    assert (hold_status.nav_state_user_intention, hold_status.failsafe) == (HOLD, False)
    px4.wait_until(lambda each: not is_selectable(each, mission_nav_state), "the removal of the mode", 2.0)
    vehicle.other_station.select_mode(f"external_{mission_nav_state - NAV_STATE_BEFORE_EXTERNAL_1}")
    time.sleep(1.0)
    assert (px4.status.nav_state, px4.status.arming_state) == (HOLD, ARMED)


@with_and_without_executor
def test_the_mode_of_a_killed_server_is_removed_and_the_next_server_can_register_it_again(
    vehicle: VehicleWithMissionModes, px4: Px4Topics, executor: bool
) -> None:
    mission_nav_state = start_mission(vehicle, px4, executor=executor)
    stream_pid = stream_process_pid(vehicle.process.pid)
    vehicle.process.kill()
    after = px4.wait_until(
        lambda each: each.nav_state != mission_nav_state, "the end of the mode", RETURN_DELAY_S[1]
    )
    expected = (RTL, mission_nav_state, True)
    assert (after.nav_state, after.nav_state_user_intention, after.failsafe) == expected
    px4.wait_until(lambda each: not is_selectable(each, mission_nav_state), "the removal of the mode", 1.0)
    px4.wait_until(lambda each: each.executor_in_charge == 0, "the executor's release", EXECUTOR_RELEASE_S)
    station.wait_until(lambda: not is_running(stream_pid), "the end of the stream process", 5.0)
    with station.running_server([LINK]) as (url, process):
        restarted = VehicleWithMissionModes(url, process, vehicle.other_station)
        station.wait_until(lambda: restarted.status.get("mode") == "rtl", "the vehicle's return", 20.0)
        assert (restarted.modes()["modes"], restarted.mission_state()) == ([], None)
        restarted.call("mode", {"mode": "hold"})
        estimates = {"attitude", "local_position", "global_position"}
        station.wait_until(
            lambda: estimates <= restarted.vehicle()["topics"].keys(), "the vehicle's estimates", 10.0
        )
        (mode,) = restarted.call("mission_modes/register", {"mission": FAR_MISSION, "name": MODE_NAME})[
            "modes"
        ]
        assert (mode["state"], nav_state(mode["mode"])) == ("registered", mission_nav_state)
        restarted.call("mode", {"mode": mode["mode"]})
        restarted.wait_until_flying_north()


def test_when_server_and_streams_die_during_the_executors_take_off_px4_completes_it_and_holds(
    vehicle: VehicleWithMissionModes, px4: Px4Topics
) -> None:
    mission_nav_state = nav_state(vehicle.start_on_ground(TAKE_OFF_FAR_MISSION))
    take_off = px4.wait_until(lambda each: each.nav_state == TAKEOFF, "the take-off", 5.0)
    assert (take_off.executor_in_charge, is_selectable(take_off, mission_nav_state)) == (1, True)
    ground_down_m = px4.position.latest.z
    kill_together(vehicle.process.pid, stream_process_pid(vehicle.process.pid))
    after = px4.wait_until(
        lambda each: not is_selectable(each, mission_nav_state), "the removal of the mode", 5.0
    )
    assert (after.nav_state, after.failsafe) == (TAKEOFF, False)
    px4.wait_until(lambda each: each.executor_in_charge == 0, "the executor's release", EXECUTOR_RELEASE_S)
    hold_status = px4.wait_until(lambda each: each.nav_state != TAKEOFF, "the end of the take-off", 40.0)
    assert (hold_status.nav_state, hold_status.failsafe, hold_status.arming_state) == (HOLD, False, ARMED)
    assert px4.position.latest.z == pytest.approx(ground_down_m - 8.0, abs=1.5)


@with_and_without_executor
def test_a_killed_stream_process_ends_the_mode_and_the_operator_is_informed(
    vehicle: VehicleWithMissionModes, px4: Px4Topics, executor: bool
) -> None:
    start_mission(vehicle, px4, executor=executor)
    os.kill(stream_process_pid(vehicle.process.pid), signal.SIGKILL)
    station.wait_until(lambda: vehicle.status["mode"] in ("hold", "rtl"), "the end of the mode", 5.0)
    assert vehicle.mission_state() == "suspended"
    station.wait_until(lambda: "is no longer registered" in vehicle.texts(), "the message", 5.0)
    assert vehicle.status["mode"] == "hold", vehicle.texts()
    assert px4.status.executor_in_charge == 0
    modes = vehicle.modes()
    assert modes["possible"] is True
    assert modes["modes"][0]["state"] == "lost"
    vehicle.call("mission_modes/register", {"mission": FAR_MISSION, "name": MODE_NAME})
    vehicle.call("mode", {"mode": vehicle.modes()["modes"][0]["mode"]})
    vehicle.wait_for_mission_state("flying")
