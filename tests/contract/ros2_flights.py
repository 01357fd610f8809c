"""Replays flights of a real PX4, which were commanded over ROS 2, on the topics of the simulated vehicle."""

from __future__ import annotations

import bisect
import gzip
import itertools
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.contract.ros2_dialogues import (
    RECORDINGS_FOLDER,
    TOLERANCE_S,
    VEHICLE_STATUS,
    fields_at,
    flat_fields,
)
from tests.support.ros2_vehicle import ADDRESSES, NO_TIME_SYNC, Ros2Vehicle
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.px4_version import V1_16
from vehicle_sim.ros2.topics import COMMAND

FOLDER = RECORDINGS_FOLDER.parent / "flights"
LOCAL_POSITION = "/fmu/out/vehicle_local_position"
ARM, TAKEOFF, SET_MODE, OFFBOARD = 400, 22, 176, 14
ARMED = 2
BEFORE_S, OFFBOARD_AT_S = 6.0, -5.0
"""The replay of a flight that began in Offboard starts 6 s before the first event and switches to Offboard
1 s later."""
STEP_S = 0.004
COMPARISON_PERIOD_S = 0.5
FAR_AWAY_M = 2.0
"""A vehicle that was recorded in Offboard at a greater distance from its setpoint was still flying to it."""
FAR_POINT_FACTOR = 2.5
"""The replay of such a flight begins at this multiple of the first recorded distance from the setpoint: the
simulated vehicle then passes the first recorded position at the recorded speed of 7.9 m/s."""
SWITCH_PERIOD_S = 0.5
"""Period with which PX4 switches its controllers, counted from the change of mode."""
PHASE_TOLERANCE_S = 0.008
FAR_POINT_HOVER_S, MAX_ATTEMPTS = 5.0, 5
DRIFT_LEAD_S = 3.0
"""A replay with ground drift starts earlier by this time."""
NOISY_BOOT_S = 12.0
"""Boot time of a vehicle with sensor noise, whose estimator needs longer to be ready."""
OFFBOARD_CONTROL_MODE, TRAJECTORY_SETPOINT = "/fmu/in/offboard_control_mode", "/fmu/in/trajectory_setpoint"
VEHICLE_CONTROL_MODE = "/fmu/out/vehicle_control_mode"
Position = tuple[float, float, float]
Track = list[tuple[float, Position]]
States = list[tuple[float, int, int]]
"""Time, nav_state and arming_state of each message."""


@dataclass(frozen=True)
class Flight:
    """A recorded flight."""

    name: str
    header: dict[str, Any]
    stimulus: list[dict[str, Any]]
    track: Track
    states: States
    switched_s: float
    """Time of the first recorded change of the controllers; NaN: no change is recorded."""
    ground_drift: list[tuple[float, float, float]]
    """Time, z and vz of the estimate until the vehicle left the ground [s, m, m/s; NED]."""

    @classmethod
    def load(cls, name: str) -> Flight:
        """Reads one flight."""
        raw = json.loads(gzip.decompress((FOLDER / f"{name}.json.gz").read_bytes()))
        column = {each: number for number, each in enumerate(raw["columns"])}
        rows = [row for row in raw["rows"] if row[column["x"]] is not None]
        time, axes = column["t_s"], [column[axis] for axis in "xyz"]
        track = [(row[time], (row[axes[0]], row[axes[1]], row[axes[2]])) for row in rows]
        states = [
            (row[time], int(row[column["nav_state"]]), int(row[column["arming_state"]])) for row in rows
        ]
        switched = (
            message["dt_s"] for message in raw["messages"] if message.get("topic") == VEHICLE_CONTROL_MODE
        )
        grounded = itertools.takewhile(lambda row: row[column["landed"]], rows)
        ground_drift = [(row[time], row[column["z"]], row[column["vz"]]) for row in grounded]
        return cls(
            name, raw["header"], raw["stimulus"], track, states, next(switched, math.nan), ground_drift
        )

    @property
    def began_in_air(self) -> bool:
        """Whether the flight began in the air."""
        return self.states[0][2] == ARMED

    @property
    def began_in_offboard(self) -> bool:
        """Whether the flight began in Offboard."""
        return self.began_in_air and self.states[0][1] == OFFBOARD

    @property
    def setpoint_ned_m(self) -> Position:
        """The first position setpoint; the first recorded position if there is none."""
        sent = [
            message.get("fields") or {}
            for message in self.stimulus
            if message["topic"] == TRAJECTORY_SETPOINT
        ]
        positions = [message["position"] for message in sent if None not in message.get("position", [None])]
        return positions[0] if positions else self.track[0][1]

    @property
    def began_far_away(self) -> bool:
        """Whether the flight began in Offboard, far from its setpoint."""
        distance_m = math.dist(self.track[0][1][:2], self.setpoint_ned_m[:2])
        return self.began_in_offboard and distance_m > FAR_AWAY_M

    @property
    def replay_begin_s(self) -> float:
        """Time at which the replay begins."""
        if self.began_far_away:
            return self.track[0][0]
        return -BEFORE_S if self.began_in_offboard else -1.0

    @property
    def vehicle_seconds_per_s(self) -> float:
        """Seconds of the recorded vehicle's clock per second of the recorder's clock, which all times use."""
        return self.header["vehicle_seconds_per_wall_second"] or 1.0

    def messages(self) -> Iterator[tuple[float, str, dict[str, Any]]]:
        """Time, topic and fields of each message to the vehicle, from the beginning of the replay."""
        for sent in self.stimulus:
            topic = sent["topic"]
            for number in range(sent.get("count", 1)):
                at_s = sent["dt_s"] + number / sent.get("streamed_hz", 1)
                if at_s >= self.replay_begin_s:
                    is_stream = "setpoints" in sent
                    yield (
                        at_s,
                        topic,
                        fields_at(sent["setpoints"], at_s)
                        if is_stream
                        else flat_fields(sent.get("fields") or {}),
                    )


class _Vehicle(Ros2Vehicle):
    """A v1.16, as was recorded, that decodes only the compared topics."""

    switched_s = math.nan
    """Time at which the vehicle last published the active controllers."""

    def receive(self, topic: str, data: bytes) -> None:
        if topic == VEHICLE_CONTROL_MODE:
            self.switched_s = self.sim.time_s
        if topic in (VEHICLE_STATUS, LOCAL_POSITION):
            super().receive(topic, data)


def fly(flight: Flight, *, noise: int | None = None, with_ground_drift: bool = False) -> tuple[Track, States]:
    """Replays a flight.

    Args:
        flight: the recorded flight.
        noise: seed of the sensor noise; None: no noise.
        with_ground_drift: gives the GPS the error of the recorded estimate while the recorded vehicle was on
            the ground.

    Returns:
        The positions and states that the simulated vehicle published.
    """
    parameters = NO_TIME_SYNC | flight.header["parameters"]
    if noise is None:
        vehicle = _Vehicle(parameters=parameters, px4=V1_16)
    else:
        vehicle = _Vehicle(
            px4=V1_16, parameters=parameters, time_since_boot_s=NOISY_BOOT_S, sensor_noise=True, seed=noise
        )
    if flight.began_in_air:
        _take_off(vehicle, -flight.track[0][1][2])
    messages = sorted(flight.messages(), key=lambda sent: sent[0])
    replay_begin_s = flight.replay_begin_s - (DRIFT_LEAD_S if with_ground_drift else 0.0)
    if flight.began_far_away:
        _begin_far_away(vehicle, flight)
    elif flight.began_in_offboard:
        fields = ADDRESSES | {"command": SET_MODE, "param1": 1.0, "param2": 6.0}
        bisect.insort(messages, (OFFBOARD_AT_S, COMMAND, fields), key=lambda sent: sent[0])
    zero_s = vehicle.sim.time_s - replay_begin_s * flight.vehicle_seconds_per_s
    received_before, last_s = len(vehicle.received_messages), flight.track[-1][0]
    while (now_s := (vehicle.sim.time_s - zero_s) / flight.vehicle_seconds_per_s) < last_s:
        while messages and messages[0][0] <= now_s:
            _, topic, fields = messages.pop(0)
            vehicle.send(topic, fields)
        if with_ground_drift:
            _apply_ground_drift(vehicle, flight, now_s)
        vehicle.run(STEP_S)
    received = [
        ((at_s - zero_s) / flight.vehicle_seconds_per_s, topic, each)
        for at_s, topic, each in vehicle.received_messages[received_before:]
    ]
    track = [
        (at_s, (each["x"], each["y"], each["z"])) for at_s, topic, each in received if topic == LOCAL_POSITION
    ]
    states = [
        (at_s, each["nav_state"], each["arming_state"])
        for at_s, topic, each in received
        if topic == VEHICLE_STATUS
    ]
    return track, states


def _apply_ground_drift(vehicle: Ros2Vehicle, flight: Flight, now_s: float) -> None:
    """Gives the GPS the recorded altitude error and vertical speed of the vehicle on the ground; in the air
    the altitude error stays constant.

    Before the recording, the estimated altitude is assumed to have changed at the first recorded speed.
    """
    first_s, first_m, first_m_s = flight.ground_drift[0]
    at_s, z_m, vz_m_s = (np.array(column) for column in zip(*flight.ground_drift, strict=True))
    before_m = first_m_s * min(0.0, now_s - first_s)
    faults = vehicle.sim.simulation.sensor_faults
    faults.gps_offset_ned_m[0, 2] = before_m + np.interp(now_s, at_s, z_m) - first_m
    faults.gps_offset_ned_m_s[0, 2] = np.interp(now_s, at_s, vz_m_s, right=0.0)


def _take_off(vehicle: Ros2Vehicle, climb_m: float) -> None:
    autopilot = vehicle.sim.autopilots[0]
    altitude_m = autopilot.view.estimate.alt_amsl_m + climb_m
    vehicle.command(ARM, 1.0)
    vehicle.command(TAKEOFF, *[math.nan] * 6, altitude_m)
    vehicle.run(9.0)
    while autopilot.commander.active is NavState.TAKEOFF:
        vehicle.run(0.5)
    vehicle.run(2.0)


def _begin_far_away(vehicle: _Vehicle, flight: Flight) -> None:
    """Flies in Offboard to a far point, and back to the first recorded distance from the setpoint.

    Repeats this until the controller switches have the recorded phase at the first event.
    """
    setpoint, recorded = flight.setpoint_ned_m, flight.track[0][1]
    distance_m = math.dist(recorded[:2], setpoint[:2])
    north_m, east_m = (
        target + FAR_POINT_FACTOR * (start - target)
        for start, target in zip(recorded[:2], setpoint[:2], strict=True)
    )
    far_point = (north_m, east_m, setpoint[2])
    fields = next(fields for _, topic, fields in flight.messages() if topic == TRAJECTORY_SETPOINT)

    def stream_while(condition: Callable[[], bool], position_ned_m: Position) -> None:
        for step in itertools.count():
            if not condition():
                return
            if step % round(0.1 / STEP_S) == 0:
                vehicle.send(OFFBOARD_CONTROL_MODE, position=True)
                vehicle.send(TRAJECTORY_SETPOINT, fields, position=position_ned_m)
            vehicle.run(STEP_S)

    def stream_until(at_s: float) -> None:
        stream_while(lambda: vehicle.sim.time_s < at_s, far_point)

    vehicle.stream(
        1.0,
        10.0,
        (OFFBOARD_CONTROL_MODE, {"position": True}),
        (TRAJECTORY_SETPOINT, fields | {"position": far_point}),
    )
    vehicle.command(SET_MODE, 1.0, 6.0)
    first_switch_delay_s = (flight.switched_s - flight.replay_begin_s) * flight.vehicle_seconds_per_s
    flight_s = 0.0
    for _ in range(MAX_ATTEMPTS):
        stream_while(lambda: math.dist(vehicle.position_ned_m, far_point) > 0.5, far_point)
        stream_until(vehicle.sim.time_s + FAR_POINT_HOVER_S)
        first_switch_s = vehicle.sim.time_s + flight_s + first_switch_delay_s
        stream_until(vehicle.sim.time_s + (vehicle.switched_s - first_switch_s) % SWITCH_PERIOD_S)
        departure_s = vehicle.sim.time_s
        stream_while(lambda: math.dist(vehicle.position_ned_m[:2], setpoint[:2]) > distance_m, setpoint)
        flight_s = vehicle.sim.time_s - departure_s
        phase_error_s = vehicle.sim.time_s + first_switch_delay_s - vehicle.switched_s
        if abs(math.remainder(phase_error_s, SWITCH_PERIOD_S)) <= PHASE_TOLERANCE_S:
            return
    raise AssertionError(f"{flight.name}: no attempt reached the recorded phase of the controller switches")


def state_changes(states: States) -> States:
    """The states from the first event on, without repetitions; the first state has time 0."""
    before = [each for each in states if each[0] <= 0.0]
    found = [(0.0, *(before or states)[-1][1:])]
    for each in states:
        if each[0] > 0.0 and each[1:] != found[-1][1:]:
            found.append(each)
    return found


def largest_errors(flown: Track, recorded: Track, until_s: float = math.inf) -> tuple[float, float]:
    """Largest horizontal and vertical difference between two motions since the first event [m]."""
    horizontal_m = vertical_m = 0.0
    begins = [_position_at(track, 0.0) for track in (flown, recorded)]
    for number in itertools.count():
        at_s = number * COMPARISON_PERIOD_S
        if at_s > min(until_s, flown[-1][0], recorded[-1][0]):
            return horizontal_m, vertical_m
        simulated, real = (
            [now - begun for now, begun in zip(_position_at(track, at_s), begin, strict=True)]
            for track, begin in zip((flown, recorded), begins, strict=True)
        )
        horizontal_m = max(horizontal_m, math.dist(simulated[:2], real[:2]))
        vertical_m = max(vertical_m, abs(simulated[2] - real[2]))
    raise AssertionError


def largest_excess(flown: Sequence[Track], recorded: Track) -> tuple[float, float]:
    """Distance by which a track leaves the range of several other tracks, since the first event [m].

    Args:
        flown: the other tracks; at each time, their range is a box around all of them.
        recorded: the track.

    Returns:
        The largest horizontal and vertical distance from that box.
    """
    horizontal_m = vertical_m = 0.0
    end_s = min(track[-1][0] for track in (*flown, recorded))
    for number in range(int(end_s / COMPARISON_PERIOD_S) + 1):
        real, *simulated = (_position_at(track, number * COMPARISON_PERIOD_S) for track in (recorded, *flown))
        north_m, east_m, down_m = (
            max(0.0, min(range_m) - real_m, real_m - max(range_m))
            for real_m, range_m in zip(real, zip(*simulated, strict=True), strict=True)
        )
        horizontal_m = max(horizontal_m, math.hypot(north_m, east_m))
        vertical_m = max(vertical_m, down_m)
    return horizontal_m, vertical_m


def farthest_point_m(track: Track, from_s: float) -> tuple[float, float]:
    """Largest horizontal distance and largest altitude of a track after a time, relative to that time [m]."""
    north_m, east_m, down_m = _position_at(track, from_s)
    later = [position for at_s, position in track if at_s > from_s]
    return (
        max(math.hypot(position[0] - north_m, position[1] - east_m) for position in later),
        max(down_m - position[2] for position in later),
    )


def _position_at(track: Track, at_s: float) -> Position:
    return track[min(bisect.bisect_left(track, at_s, key=lambda each: each[0]), len(track) - 1)][1]


def state_differences(flown: States, recorded: States, disarming_s: float) -> list[str]:
    """Descriptions of the differences between the changes of mode and arming.

    Args:
        flown: the states of the simulated vehicle.
        recorded: the states of PX4.
        disarming_s: tolerance of the time of disarming, which depends on the landing [s].
    """
    simulated, real = state_changes(flown), state_changes(recorded)
    if [each[1:] for each in _lasting_states(simulated)] != [each[1:] for each in _lasting_states(real)]:
        return [f"states {simulated}, recorded {real}"]
    return [
        f"{sim[1:]} at {sim[0]:.1f} s, recorded {px4[0]:.1f} s"
        for sim, px4 in zip(_lasting_states(simulated), _lasting_states(real), strict=True)
        if abs(sim[0] - px4[0]) > (TOLERANCE_S if sim[2] == ARMED else disarming_s)
    ]


def _lasting_states(states: States) -> States:
    """The states without those that lasted for one message: mode and arming may change in two messages."""
    pairs = itertools.pairwise(states)
    return [each for each, after in pairs if after[0] - each[0] > 0.1 or each[0] == 0.0] + states[-1:]
