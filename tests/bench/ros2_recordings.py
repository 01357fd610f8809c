"""Flights of a real PX4 commanded over ROS 2, converted to messages for the simulated vehicle.

A stream of setpoints consists of two topics: OffboardControlMode, which keeps Offboard active and selects the
control level, and the setpoint. Each OffboardControlMode becomes one message with the setpoint valid at that
time: a MAVLink message, or a call of the internal interface (`INTERNAL`) if there is no MAVLink message.
"""

from __future__ import annotations

import bisect
import dataclasses
import gzip
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .flight_recordings import Recording, spread_of

FLIGHTS = Path(__file__).resolve().parents[3] / "shared" / "px4" / "dds" / "flights"

TimedMessage = tuple[float, str, dict[str, Any]]

THRUST_TORQUE, ACTUATORS = "thrust_torque", "actuators"
INTERNAL = frozenset({THRUST_TORQUE, ACTUATORS})
"""Methods of the simulated Offboard for setpoints without a MAVLink message."""
TOPICS = {
    "position": "trajectory_setpoint",
    "velocity": "trajectory_setpoint",
    "acceleration": "trajectory_setpoint",
    "attitude": "vehicle_attitude_setpoint",
    "body_rate": "vehicle_rates_setpoint",
    "thrust_and_torque": "vehicle_thrust_setpoint",
    "direct_actuator": "actuator_motors",
}
"""The setpoint topic for each flag of OffboardControlMode, the highest level first."""
MODES = {2: 0x30000, 4: 0x3040000, 5: 0x5040000, 14: 0x60000, 17: 0x2040000, 18: 0x6040000}
"""The custom_mode of each nav_state."""
ARMED = 2
ATTITUDE_ONLY_MASK, RATES_ONLY_MASK = 7, 128
SETPOINT_LAG_S = 0.01
"""A setpoint may be recorded this much later than its OffboardControlMode."""
MOTOR_COUNT = 4


def load(name: str, reference: str, folder: Path = FLIGHTS) -> Recording:
    """Reads one flight; its spread is that of the flight `reference`."""
    raw = json.loads(gzip.decompress((folder / f"{name}.json.gz").read_bytes()))
    table = np.array([[math.nan if v is None else v for v in row] for row in raw["rows"]], dtype=float)
    columns = {column: table[:, k] for k, column in enumerate(raw["columns"])}
    columns["custom_mode"] = np.array(
        [MODES.get(int(state), 0) for state in columns["nav_state"]], dtype=float
    )
    columns["armed"] = (columns["arming_state"] == ARMED).astype(float)
    setpoint = _TopicHistory(raw["stimulus"], "trajectory_setpoint").at(0.0)
    for axis, value in zip(("sx", "sy", "sz"), setpoint.get("position", [math.nan] * 3), strict=True):
        columns[axis] = np.full(len(table), value)
    columns["syaw"] = np.zeros(len(table))
    messages: list[dict[str, Any]] = [
        dict(zip(("t_s", "message", "fields"), message, strict=True))
        for message in _messages(raw["stimulus"])
    ]
    return Recording(
        name,
        raw["header"]["note"] or raw["header"]["precondition"],
        raw["header"]["parameters"],
        messages,
        columns["t_s"],
        columns,
        dataclasses.replace(spread_of(reference), comparable=False),
        _control_change_s(raw["messages"]),
    )


def _control_change_s(messages: list[dict[str, Any]]) -> float:
    """Time at which PX4 first published a change of position control; its controllers then react to it."""
    changes = (m["dt_s"] for m in messages if "flag_control_position_enabled" in m.get("changed", {}))
    return next(changes, math.nan)


class _TopicHistory:
    """The newest fields of a topic as a function of time."""

    def __init__(self, stimulus: list[dict[str, Any]], topic: str) -> None:
        timed_fields: list[tuple[float, dict[str, Any]]] = []
        for entry in stimulus:
            if entry["topic"].endswith(f"/{topic}"):
                timed_fields += entry.get("setpoints") or [(entry["dt_s"], entry["fields"])]
        timed_fields.sort(key=lambda each: each[0])
        self._times = [each[0] for each in timed_fields]
        self._fields = [each[1] for each in timed_fields]

    def at(self, t_s: float) -> dict[str, Any]:
        k = bisect.bisect_right(self._times, t_s) - 1
        return {key: _with_nan(value) for key, value in self._fields[k].items()} if k >= 0 else {}


def _with_nan(value: Any) -> Any:
    """The value, with NaN for each null of the recording."""
    if isinstance(value, list):
        return [_with_nan(each) for each in value]
    return math.nan if value is None else value


def _messages(stimulus: list[dict[str, Any]]) -> list[TimedMessage]:
    histories = {
        topic: _TopicHistory(stimulus, topic) for topic in {*TOPICS.values(), "vehicle_torque_setpoint"}
    }
    messages: list[TimedMessage] = []
    for entry in stimulus:
        topic = entry["topic"].rsplit("/", 1)[1]
        if topic == "vehicle_command":
            fields = {f"param{n}": _with_nan(entry["fields"].get(f"param{n}", 0.0)) for n in range(1, 8)}
            messages.append((entry["dt_s"], "COMMAND_LONG", fields | {"command": entry["fields"]["command"]}))
        elif topic == "offboard_control_mode":
            messages += _stream_messages(entry, histories)
    return sorted(messages, key=lambda message: message[0])


def _stream_messages(entry: dict[str, Any], histories: dict[str, _TopicHistory]) -> Iterator[TimedMessage]:
    topic = next(TOPICS[flag] for flag in TOPICS if entry["fields"].get(flag))
    for k in range(entry["count"]):
        t_s = entry["dt_s"] + k / entry["streamed_hz"]
        if t_s >= 0.0:
            at_s = t_s + SETPOINT_LAG_S
            fields = histories[topic].at(at_s)
            if topic == "vehicle_thrust_setpoint":
                torque = histories["vehicle_torque_setpoint"].at(at_s).get("xyz", [0.0, 0.0, 0.0])
                yield t_s, THRUST_TORQUE, {"thrust_frd": fields["xyz"], "torque_frd": torque}
            else:
                yield t_s, *_message(topic, fields)


def _message(topic: str, fields: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    if topic == "trajectory_setpoint":
        return "SET_POSITION_TARGET_LOCAL_NED", _trajectory_fields(fields)
    if topic == "actuator_motors":
        return ACTUATORS, {"motors": fields["control"][:MOTOR_COUNT]}
    thrust = -fields["thrust_body"][2]
    if topic == "vehicle_attitude_setpoint":
        return "SET_ATTITUDE_TARGET", {"type_mask": ATTITUDE_ONLY_MASK, "q": fields["q_d"], "thrust": thrust}
    rates = {f"body_{axis}_rate": fields.get(axis, 0.0) for axis in ("roll", "pitch", "yaw")}
    return "SET_ATTITUDE_TARGET", rates | {
        "type_mask": RATES_ONLY_MASK, "q": [1.0, 0.0, 0.0, 0.0], "thrust": thrust,
    }  # fmt: skip


def _trajectory_fields(fields: dict[str, Any]) -> dict[str, Any]:
    """NaN sets the bit of its field in the mask; fields missing in the recording were zero."""
    values: dict[str, Any] = {"coordinate_frame": 1}
    axes = (("x", "y", "z"), ("vx", "vy", "vz"), ("afx", "afy", "afz"))
    kinds = ("position", "velocity", "acceleration")
    for names, kind in zip(axes, kinds, strict=True):
        values |= zip(names, fields.get(kind, [0.0, 0.0, 0.0]), strict=True)
    values |= {"yaw": fields.get("yaw", 0.0), "yaw_rate": fields.get("yawspeed", 0.0)}
    mask = 0
    for bit, name in enumerate((*axes[0], *axes[1], *axes[2], None, "yaw", "yaw_rate")):
        if name is not None and math.isnan(values[name]):
            mask, values[name] = mask | 1 << bit, 0.0
    return values | {"type_mask": mask}
