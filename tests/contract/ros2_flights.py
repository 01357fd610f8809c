"""Flights of a real PX4 that were commanded over ROS 2, replayed on the topics of the simulated vehicle."""

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

from tests.contract.ros2_dialogues import RECORDED, SLACK_S, STATUS, fields_at, flat_fields
from tests.support.ros2_vehicle import ADDRESSES, NO_TIME_SYNC, Ros2Vehicle
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.ros2.topics import COMMAND

FOLDER = RECORDED.parent / "flights"
POSITION = "/fmu/out/vehicle_local_position"
ARM, TAKEOFF, SET_MODE, OFFBOARD = 400, 22, 176, 14
ARMED = 2
BEFORE_S, OFFBOARD_AT_S = 6.0, -5.0
"""A flight that began in Offboard is replayed from this long before its first event, and enters Offboard."""
STEP_S = 0.004
COMPARED_EVERY_S = 0.5
RETURNING_M = 2.0
"""A vehicle that is recorded further than this from its setpoint, in Offboard, was still flying there."""
RETURNS_FROM = 2.5
"""Where the replay of its return begins, in recorded distances from the setpoint: the simulated vehicle then
passes the first recorded position at the recorded 7.9 m/s."""
SWITCHES_EVERY_S = 0.5
"""PX4 switches its controllers at 2 Hz since the change of mode."""
SAME_PHASE_S = 0.008
CALM_S, MAX_RETURNS = 5.0, 5
FALLS_BEFORE_S = 3.0
NOISY_BOOT_S = 12.0
CONTROL_MODE, TRAJECTORY = "/fmu/in/offboard_control_mode", "/fmu/in/trajectory_setpoint"
SWITCHED = "/fmu/out/vehicle_control_mode"
Place = tuple[float, float, float]
Track = list[tuple[float, Place]]
States = list[tuple[float, int, int]]
"""(time, nav_state, arming_state)."""


@dataclass(frozen=True)
class Flight:
    """A recorded flight."""

    name: str
    header: dict[str, Any]
    stimulus: list[dict[str, Any]]
    track: Track
    states: States
    switched_s: float
    """Time of the first recorded change of the controllers; NaN: none is recorded."""
    fall: list[tuple[float, float, float]]
    """(time, z, vz) of the estimate until the vehicle left the ground [s, m, m/s]."""

    @classmethod
    def load(cls, name: str) -> Flight:
        """Reads one flight."""
        raw = json.loads(gzip.decompress((FOLDER / f"{name}.json.gz").read_bytes()))
        column = {each: number for number, each in enumerate(raw["columns"])}
        rows = [row for row in raw["rows"] if row[column["x"]] is not None]
        at, axes = column["t_s"], [column[axis] for axis in "xyz"]
        track = [(row[at], (row[axes[0]], row[axes[1]], row[axes[2]])) for row in rows]
        states = [(row[at], int(row[column["nav_state"]]), int(row[column["arming_state"]])) for row in rows]
        switched = (each["dt_s"] for each in raw["messages"] if each.get("topic") == SWITCHED)
        grounded = itertools.takewhile(lambda row: row[column["landed"]], rows)
        fall = [(row[at], row[column["z"]], row[column["vz"]]) for row in grounded]
        return cls(name, raw["header"], raw["stimulus"], track, states, next(switched, math.nan), fall)

    @property
    def in_air(self) -> bool:
        """Whether it began in flight."""
        return self.states[0][2] == ARMED

    @property
    def in_offboard(self) -> bool:
        """Whether it began in Offboard."""
        return self.in_air and self.states[0][1] == OFFBOARD

    @property
    def setpoint_ned_m(self) -> Place:
        """The first position setpoint; the first recorded position if there is none."""
        sent = [each.get("fields") or {} for each in self.stimulus if each["topic"] == TRAJECTORY]
        positions = [each["position"] for each in sent if None not in each.get("position", [None])]
        return positions[0] if positions else self.track[0][1]

    @property
    def returns(self) -> bool:
        """Whether it began while the vehicle was flying to its setpoint from far away."""
        away_m = math.dist(self.track[0][1][:2], self.setpoint_ned_m[:2])
        return self.in_offboard and away_m > RETURNING_M

    @property
    def begins_s(self) -> float:
        """When the replay begins."""
        if self.returns:
            return self.track[0][0]
        return -BEFORE_S if self.in_offboard else -1.0

    @property
    def vehicle_seconds_per_s(self) -> float:
        """The recorded vehicle's clock was slower than the recorder's, which the times are of."""
        return self.header["vehicle_seconds_per_wall_second"] or 1.0

    def sends(self) -> Iterator[tuple[float, str, dict[str, Any]]]:
        """(time, topic, fields) of each message to the vehicle, from the beginning of the replay."""
        for sent in self.stimulus:
            topic = sent["topic"]
            for number in range(sent.get("count", 1)):
                at_s = sent["dt_s"] + number / sent.get("streamed_hz", 1)
                if at_s >= self.begins_s:
                    streams = "setpoints" in sent
                    yield (
                        at_s,
                        topic,
                        fields_at(sent["setpoints"], at_s)
                        if streams
                        else flat_fields(sent.get("fields") or {}),
                    )


class _Vehicle(Ros2Vehicle):
    """A vehicle that decodes only the compared topics."""

    switched_s = math.nan
    """When it last published the active controllers."""

    def publish(self, topic: str, data: bytes) -> None:
        if topic == SWITCHED:
            self.switched_s = self.sim.time_s
        if topic in (STATUS, POSITION):
            super().publish(topic, data)


def fly(flight: Flight, *, noise: int | None = None, falls: bool = False) -> tuple[Track, States]:
    """Replays a flight.

    Args:
        flight: what was recorded.
        noise: seed of the sensor noise; None: no noise.
        falls: gives the GPS the error of the recorded estimate, as long as the recorded vehicle stood.

    Returns:
        What the simulated vehicle published.
    """
    parameters = NO_TIME_SYNC | flight.header["parameters"]
    if noise is None:
        vehicle = _Vehicle(parameters=parameters)
    else:
        vehicle = _Vehicle(parameters=parameters, boot_s=NOISY_BOOT_S, sensor_noise=True, seed=noise)
    if flight.in_air:
        _take_off(vehicle, -flight.track[0][1][2])
    sends = sorted(flight.sends(), key=lambda sent: sent[0])
    begins_s = flight.begins_s - (FALLS_BEFORE_S if falls else 0.0)
    if flight.returns:
        _return(vehicle, flight)
    elif flight.in_offboard:
        fields = ADDRESSES | {"command": SET_MODE, "param1": 1.0, "param2": 6.0}
        bisect.insort(sends, (OFFBOARD_AT_S, COMMAND, fields), key=lambda sent: sent[0])
    zero_s = vehicle.sim.time_s - begins_s * flight.vehicle_seconds_per_s
    seen, last_s = len(vehicle.received), flight.track[-1][0]
    while (now_s := (vehicle.sim.time_s - zero_s) / flight.vehicle_seconds_per_s) < last_s:
        while sends and sends[0][0] <= now_s:
            _, topic, fields = sends.pop(0)
            vehicle.send(topic, fields)
        if falls:
            _fall(vehicle, flight, now_s)
        vehicle.run(STEP_S)
    received = [
        ((at_s - zero_s) / flight.vehicle_seconds_per_s, topic, each)
        for at_s, topic, each in vehicle.received[seen:]
    ]
    track = [(at_s, (each["x"], each["y"], each["z"])) for at_s, topic, each in received if topic == POSITION]
    states = [
        (at_s, each["nav_state"], each["arming_state"]) for at_s, topic, each in received if topic == STATUS
    ]
    return track, states


def _fall(vehicle: Ros2Vehicle, flight: Flight, now_s: float) -> None:
    """Gives the GPS the recorded height and vertical speed of a standing vehicle; the height stays then.

    Before the recording the height fell at the first recorded speed.
    """
    first_s, first_m, first_m_s = flight.fall[0]
    at_s, z_m, vz_m_s = (np.array(column) for column in zip(*flight.fall, strict=True))
    before_m = first_m_s * min(0.0, now_s - first_s)
    faults = vehicle.sim.simulation.sensor_faults
    faults.gps_offset_ned_m[0, 2] = before_m + np.interp(now_s, at_s, z_m) - first_m
    faults.gps_offset_ned_m_s[0, 2] = np.interp(now_s, at_s, vz_m_s, right=0.0)


def _take_off(vehicle: Ros2Vehicle, height_m: float) -> None:
    autopilot = vehicle.sim.autopilots[0]
    altitude_m = autopilot.view.estimate.alt_amsl_m + height_m
    vehicle.command(ARM, 1.0)
    vehicle.command(TAKEOFF, *[math.nan] * 6, altitude_m)
    vehicle.run(9.0)
    while autopilot.commander.active is NavState.TAKEOFF:
        vehicle.run(0.5)
    vehicle.run(2.0)


def _return(vehicle: _Vehicle, flight: Flight) -> None:
    """Flies in Offboard to a point far away, and back until the first recorded distance from the setpoint.

    This is repeated until the controllers switch at the recorded times, relative to the first event.
    """
    setpoint, recorded = flight.setpoint_ned_m, flight.track[0][1]
    distance_m = math.dist(recorded[:2], setpoint[:2])
    north_m, east_m = (
        there + RETURNS_FROM * (here - there) for here, there in zip(recorded[:2], setpoint[:2], strict=True)
    )
    far = (north_m, east_m, setpoint[2])
    fields = next(fields for _, topic, fields in flight.sends() if topic == TRAJECTORY)

    def stream_while(going_on: Callable[[], bool], position_ned_m: Place) -> None:
        for step in itertools.count():
            if not going_on():
                return
            if step % round(0.1 / STEP_S) == 0:
                vehicle.send(CONTROL_MODE, position=True)
                vehicle.send(TRAJECTORY, fields, position=position_ned_m)
            vehicle.run(STEP_S)

    def stream_until(at_s: float) -> None:
        stream_while(lambda: vehicle.sim.time_s < at_s, far)

    vehicle.stream(1.0, 10.0, (CONTROL_MODE, {"position": True}), (TRAJECTORY, fields | {"position": far}))
    vehicle.command(SET_MODE, 1.0, 6.0)
    switches_in_s = (flight.switched_s - flight.begins_s) * flight.vehicle_seconds_per_s
    takes_s = 0.0
    for _ in range(MAX_RETURNS):
        stream_while(lambda: math.dist(vehicle.position_ned_m, far) > 0.5, far)
        stream_until(vehicle.sim.time_s + CALM_S)
        switches_s = vehicle.sim.time_s + takes_s + switches_in_s
        stream_until(vehicle.sim.time_s + (vehicle.switched_s - switches_s) % SWITCHES_EVERY_S)
        left_s = vehicle.sim.time_s
        stream_while(lambda: math.dist(vehicle.position_ned_m[:2], setpoint[:2]) > distance_m, setpoint)
        takes_s = vehicle.sim.time_s - left_s
        late_s = vehicle.sim.time_s + switches_in_s - vehicle.switched_s
        if abs(math.remainder(late_s, SWITCHES_EVERY_S)) <= SAME_PHASE_S:
            return
    raise AssertionError(f"{flight.name}: no return with the recorded phase")


def changes(states: States) -> States:
    """The states from the first event on, without repetitions; that at the first event is at 0."""
    before = [each for each in states if each[0] <= 0.0]
    found = [(0.0, *(before or states)[-1][1:])]
    for each in states:
        if each[0] > 0.0 and each[1:] != found[-1][1:]:
            found.append(each)
    return found


def largest_errors(flown: Track, recorded: Track, until_s: float = math.inf) -> tuple[float, float]:
    """Largest horizontal and vertical difference between two motions since the first event [m]."""
    horizontal_m = vertical_m = 0.0
    begins = [_at(track, 0.0) for track in (flown, recorded)]
    for number in itertools.count():
        at_s = number * COMPARED_EVERY_S
        if at_s > min(until_s, flown[-1][0], recorded[-1][0]):
            return horizontal_m, vertical_m
        ours, theirs = (
            [now - begun for now, begun in zip(_at(track, at_s), begin, strict=True)]
            for track, begin in zip((flown, recorded), begins, strict=True)
        )
        horizontal_m = max(horizontal_m, math.dist(ours[:2], theirs[:2]))
        vertical_m = max(vertical_m, abs(ours[2] - theirs[2]))
    raise AssertionError


def largest_excess(flown: Sequence[Track], recorded: Track) -> tuple[float, float]:
    """How far a track since the first event leaves the range of several others [m].

    Args:
        flown: the others; their range is a box around all of them, at each time.
        recorded: the track.

    Returns:
        The largest horizontal and vertical distance from that box.
    """
    horizontal_m = vertical_m = 0.0
    ends_s = min(track[-1][0] for track in (*flown, recorded))
    for number in range(int(ends_s / COMPARED_EVERY_S) + 1):
        theirs, *ours = (_at(track, number * COMPARED_EVERY_S) for track in (recorded, *flown))
        north_m, east_m, down_m = (
            max(0.0, min(range_m) - here_m, here_m - max(range_m))
            for here_m, range_m in zip(theirs, zip(*ours, strict=True), strict=True)
        )
        horizontal_m = max(horizontal_m, math.hypot(north_m, east_m))
        vertical_m = max(vertical_m, down_m)
    return horizontal_m, vertical_m


def farthest_m(track: Track, from_s: float) -> tuple[float, float]:
    """Largest horizontal distance and largest height of a track, relative to its place at a time [m]."""
    north_m, east_m, down_m = _at(track, from_s)
    later = [place for at_s, place in track if at_s > from_s]
    return (
        max(math.hypot(place[0] - north_m, place[1] - east_m) for place in later),
        max(down_m - place[2] for place in later),
    )


def _at(track: Track, at_s: float) -> Place:
    return track[min(bisect.bisect_left(track, at_s, key=lambda each: each[0]), len(track) - 1)][1]


def late_changes(flown: States, recorded: States, disarming_s: float) -> list[str]:
    """Differences between the changes of mode and arming, in words.

    Args:
        flown: the states of the simulated vehicle.
        recorded: those of PX4.
        disarming_s: tolerance of the time of disarming, which depends on the landing [s].
    """
    ours, theirs = changes(flown), changes(recorded)
    if [each[1:] for each in _merged(ours)] != [each[1:] for each in _merged(theirs)]:
        return [f"states {ours}, recorded {theirs}"]
    return [
        f"{mine[1:]} at {mine[0]:.1f} s, recorded {yours[0]:.1f} s"
        for mine, yours in zip(_merged(ours), _merged(theirs), strict=True)
        if abs(mine[0] - yours[0]) > (SLACK_S if mine[2] == ARMED else disarming_s)
    ]


def _merged(states: States) -> States:
    """Without states that lasted only for one message: mode and arming may change in two."""
    pairs = itertools.pairwise(states)
    return [each for each, after in pairs if after[0] - each[0] > 0.1 or each[0] == 0.0] + states[-1:]
