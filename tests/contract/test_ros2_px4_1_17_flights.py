"""Flights of a real PX4 v1.17 over ROS 2, flown by the simulated one with the recorded messages.

They are single runs on a loaded machine, in which PX4 also follows the noise of its GPS. So the limits are
a metre of height, and what the two recorded runs of the same attitude setpoints differ by.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.contract.ros2_dialogues import CHECK_REPLY, CHECK_REQUEST, Dialogue, flat_fields
from tests.support.dds_recordings import dds_folder
from tests.support.dds_samples import base_name
from tests.support.ros2_vehicle import Ros2Vehicle
from vehicle_sim.px4_version import V1_17
from vehicle_sim.ros2.messages import MESSAGES

pytestmark = pytest.mark.flight
STEP_S = 0.01
STATUS, LOCAL_POSITION = "/fmu/out/vehicle_status", "/fmu/out/vehicle_local_position"
CONTROL_MODE, TRAJECTORY = "/fmu/in/offboard_control_mode", "/fmu/in/trajectory_setpoint"
NAN3 = (math.nan,) * 3
HOVER: dict[str, Any] = {"position": (0.0, 0.0, -5.0), "velocity": NAN3, "acceleration": NAN3, "yaw": 0.0}
ALL_CONTROLLERS = {
    f"flag_control_{name}_enabled": True
    for name in ("position", "velocity", "altitude", "climb_rate", "acceleration", "attitude", "rates",
                 "allocation")
}  # fmt: skip
SET_MODE, ARM, OFFBOARD, EXTERNAL_1, HOLD, RTL = 176, 400, 14, 23, 4, 5
MAX_HEIGHT_ERROR_M = 1.0
LIFT_OFF_M = 0.3
"""From this height on a flight is compared: before it the recorded estimate drifts with the GPS."""
SIDEWAYS_M = (0.8, 1.7)
"""Range of the largest sideways movement by the recorded attitude setpoints; 1.1 and 1.4 m were recorded."""


def dialogue(group: str, name: str) -> Dialogue:
    path = dds_folder("1.17") / "dialogues" / f"{group}.jsonl"
    lines = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return next(each for each in lines if each["id"] == name)


def track(name: str) -> NDArray[np.float64]:
    """Seconds since the beginning of the flight, and x, y, z (n, 4)."""
    rows = json.loads((dds_folder("1.17") / "tracks.json").read_text(encoding="utf-8"))[name]
    found = np.array([row[:4] for row in rows], dtype=np.float64)
    found[:, 0] -= found[0, 0]
    return found


class Recorder(Ros2Vehicle):
    """A vehicle that decodes only what the tests read, and answers its arming checks."""

    replies: bool = False

    def receive(self, topic: str, data: bytes) -> None:
        if topic in (STATUS, LOCAL_POSITION, CHECK_REQUEST):
            super().receive(topic, data)
        if topic == CHECK_REQUEST and self.replies:
            request_id = self.newest_fields(CHECK_REQUEST)["request_id"]
            self.send(CHECK_REPLY, request_id=request_id, can_arm_and_run=True, mode_req_local_position=True)

    def play(self, sent: list[dict[str, Any]], until_s: float) -> NDArray[np.float64]:
        """Sends recorded messages under their recorded names; returns the flown track as `track` does."""
        messages: list[tuple[float, str, bytes]] = []
        names = {wire: base for base, wire in self.wire_names.items()}
        for each in sent:
            if base_name(each["topic"]) == CHECK_REPLY:
                continue
            fields = {k: v for k, v in flat_fields(each["fields"]).items() if k != "timestamp"}
            base = names.get(each["topic"], base_name(each["topic"]))
            message = self.message_types[base]
            message = MESSAGES["1.16"][message.name] if "layout" in each else message
            count, end_s = each.get("count", 1), each.get("until_dt_s", each["dt_s"])
            for at_s in np.linspace(each["dt_s"], end_s, count):
                messages.append((float(at_s), each["topic"], message.encode(fields)))
        messages.sort(key=lambda each: each[0])
        began_s, rows = self.sim.time_s, list[tuple[float, float, float, float]]()
        while (now_s := self.sim.time_s - began_s) < until_s:
            while messages and messages[0][0] <= now_s:
                _, topic, data = messages.pop(0)
                self.send_bytes(topic, data)
            self.run(STEP_S)
            rows.append((now_s, *self.position_ned_m))
        return np.array(rows)

    def hover_in_offboard(self) -> None:
        """Takes off to 5 m in Offboard."""
        streams = ((CONTROL_MODE, {"position": True}), (TRAJECTORY, HOVER))
        self.stream(0.5, 20, *streams)
        self.command(SET_MODE, 1.0, 6.0)
        self.command(ARM, 1.0)
        self.stream(12.0, 20, *streams)


def height_error_m(flown: NDArray[np.float64], recorded: NDArray[np.float64]) -> float:
    """Largest difference of the heights after the lift-off, each above the height at the beginning."""
    heights = np.interp(flown[:, 0], recorded[:, 0], recorded[0, 3] - recorded[:, 3])
    simulated = flown[0, 3] - flown[:, 3]
    in_air = (heights > LIFT_OFF_M) | (simulated > LIFT_OFF_M)
    assert in_air.sum() * STEP_S > 3.0
    return float(np.abs(heights - simulated)[in_air].max())


def test_a_program_of_v1_17_climbs_in_offboard_as_recorded() -> None:
    recorded = dialogue("offboard", "offboard_flight")
    vehicle = Recorder(px4=V1_17)
    flown = vehicle.play(recorded["send"], recorded["send"][-1]["dt_s"])
    assert vehicle.newest_fields(STATUS)["nav_state"] == OFFBOARD
    assert height_error_m(flown, track("offboard")) < MAX_HEIGHT_ERROR_M


def test_a_mode_of_v1_17_takes_off_and_flies_as_recorded() -> None:
    recorded = dialogue("mode_flight", "mode_flight")
    vehicle = Recorder(px4=V1_17)
    vehicle.replies = True
    mode = {"name": "Fly Mode", "register_arming_check": True, "register_mode": True}
    vehicle.send("/fmu/in/register_ext_component_request", mode)
    vehicle.run(0.1)
    vehicle.send("/fmu/in/config_control_setpoints", {"source_id": EXTERNAL_1} | ALL_CONTROLLERS)
    vehicle.run(1.0)
    flown = vehicle.play(recorded["send"], recorded["send"][-1]["dt_s"])
    assert vehicle.newest_fields(STATUS)["nav_state"] == EXTERNAL_1
    assert height_error_m(flown, track("mode_flight")) < MAX_HEIGHT_ERROR_M


@pytest.mark.parametrize(
    ("name", "flies"),
    [("attitude_right", True), ("attitude_old_name", False), ("attitude_old_layout_new_name", True)],
)
def test_attitude_setpoints_are_read_under_the_name_of_v1_17_only(name: str, flies: bool) -> None:
    recorded = dialogue("attitude", name)
    vehicle = Recorder(px4=V1_17)
    vehicle.hover_in_offboard()
    flown = vehicle.play(recorded["send"], 5.0)
    sideways_m = float(flown[:, 2].max() - flown[0, 2])
    assert vehicle.newest_fields(STATUS)["nav_state"] == OFFBOARD
    if flies:
        assert SIDEWAYS_M[0] < sideways_m < SIDEWAYS_M[1]
    else:
        assert sideways_m < 0.3


def test_a_vehicle_of_v1_17_returns_when_the_stream_stops() -> None:
    recorded = dialogue("offboard", "offboard_lost")["state"]
    vehicle = Recorder(px4=V1_17)
    vehicle.hover_in_offboard()
    vehicle.run(1.4)
    status = vehicle.newest_fields(STATUS)
    names = ("arming_state", "nav_state", "nav_state_user_intention", "failsafe")
    assert {name: status[name] for name in names} == {name: recorded[name] for name in names}
    assert status["nav_state"] == RTL
