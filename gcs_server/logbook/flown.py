"""Takes a part of a ULog for a rerun (`missions.what_if`): its topics, at the steps of the simulation.

Between two samples states and setpoints are interpolated; flags, levels and NaN keep the last value.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.columns import Columns, UnknownField
from missions.frames import yaw_from_q
from missions.geodesy import LocalOrigin
from missions.what_if.flight import (
    LEAD_S,
    STREAM_STEP_S,
    Battery,
    LoggedAutopilot,
    LoggedFlight,
    LoggedStream,
    MissionBegin,
    NotFlyable,
)

Values = NDArray[np.float64]

STEP_S = 0.004
"""Step of the simulation."""
_DISARMED, _MOTORS, _RATES, _ATTITUDE, _TRAJECTORY = 0, 1, 3, 4, 5
"""`vehicle_sim.control.setpoints.ControlLevel`."""
_TRAJECTORY_FLAGS = ("position", "velocity", "altitude", "climb_rate", "acceleration")
MOTOR_COUNT = 4
_MISSION, OFFBOARD = 3, 14
"""`vehicle_sim.autopilot.modes.NavState`."""
MAX_BEGINS = 4
"""So many of the last changes to Offboard may have been the begin of a mission."""
_ARMED = 2
"""`vehicle_status.arming_state`."""
MIN_DISCHARGE = 0.01
"""A smaller part of the charge says nothing of the time to empty."""


def flown(columns: Columns, parameters: Mapping[str, float], from_s: float, to_s: float) -> LoggedFlight:
    """The flight from `LEAD_S` before `from_s` to `to_s`.

    Raises:
        NotFlyable: the log lacks what a rerun needs, or the vehicle is no quadrotor.
    """
    try:
        end_s = min(to_s, float(columns.times("vehicle_local_position:0")[-1]))
        if end_s - from_s < STEP_S:
            raise NotFlyable(f"The log ends at {end_s:.1f} s.")
        part = _Part(columns, np.arange(max(0.0, from_s - LEAD_S), end_s, STEP_S))
        return _flight(part, parameters)
    except UnknownField as error:
        raise NotFlyable(f"{error.args[0][:1].upper()}{error.args[0][1:]}; a rerun needs it.") from error


def autopilot_at(columns: Columns, firmware: str | None, from_s: float, to_s: float) -> LoggedAutopilot:
    """What the autopilot was doing at `from_s`.

    Args:
        columns: the log.
        firmware: as in its overview.
        from_s: the moment [s since the log's start].
        to_s: until then the battery's discharge and later modes count.

    Raises:
        NotFlyable: the log lacks what is needed.
    """
    try:
        home = _At(columns, "home_position", from_s)
        status = _At(columns, "vehicle_status", from_s)
        if not (home.flag("valid_hpos") and home.flag("valid_alt") and home.flag("valid_lpos")):
            raise NotFlyable("The vehicle has no home position then.")
        target_ned_m, next_target_s = _target(columns, from_s, to_s)
        return LoggedAutopilot(
            nav_state=int(status.value("nav_state")),
            home_lat_deg=home.value("lat"),
            home_lon_deg=home.value("lon"),
            home_alt_amsl_m=home.value("alt"),
            home_ned_m=np.array([home.value(axis) for axis in "xyz"]),
            battery=_battery(columns, from_s, to_s),
            mission_item=_mission_item(columns, from_s),
            release=_release(firmware),
            switched=_switched(columns, from_s, to_s),
            target_ned_m=target_ned_m,
            next_target_s=next_target_s,
        )
    except UnknownField as error:
        raise NotFlyable(f"{error.args[0][:1].upper()}{error.args[0][1:]}; a rerun needs it.") from error


def stream_at(columns: Columns, from_s: float) -> LoggedStream:
    """The setpoints that the vehicle followed in Offboard until `from_s`.

    Raises:
        NotFlyable: the log lacks what is needed.
    """
    try:
        status_s = columns.times("vehicle_status:0")
        modes = np.asarray(columns.column("vehicle_status:0", "nav_state")[0])
        entries_s = status_s[1:][(modes[1:] == OFFBOARD) & (modes[:-1] != OFFBOARD)].tolist()
        if len(modes) and modes[0] == OFFBOARD:
            entries_s.insert(0, float(status_s[0]))
        entries_s = [each for each in entries_s if each <= from_s]
        if not entries_s:
            raise NotFlyable("The log has no Offboard before.")
        count = int((from_s - entries_s[0]) / STREAM_STEP_S)
        part = _Part(columns, from_s - STREAM_STEP_S * np.arange(count, -1, -1.0))
        followed = part.held("vehicle_status", "nav_state") == OFFBOARD
        target = part.smooth("trajectory_setpoint", [*_three("position"), *_three("velocity")])
        target[_levels(part) != _TRAJECTORY] = math.nan
        frame = _At(columns, "vehicle_local_position", from_s)
        north, east, down = target[-1, 3:].tolist()
        return LoggedStream(
            t_s=part.t_s[followed],
            setpoint_ned_m=target[followed, :3],
            velocity_ned_m_s=(north, east, down),
            begins=tuple(each for t_s in entries_s[-MAX_BEGINS:] for each in _begins(columns, t_s)),
            origin=LocalOrigin(frame.value("ref_lat"), frame.value("ref_lon"), frame.value("ref_alt")),
        )
    except UnknownField as error:
        raise NotFlyable(f"{error.args[0][:1].upper()}{error.args[0][1:]}; a rerun needs it.") from error


def _begins(columns: Columns, entry_s: float) -> list[MissionBegin]:
    """Where a mission may have begun whose Offboard began then: there, or where it stood before."""
    landed_s = columns.times("vehicle_land_detected:0")
    landed = np.asarray(columns.column("vehicle_land_detected:0", "landed")[0]).astype(np.bool_)
    left = np.flatnonzero(landed[:-1] & ~landed[1:] & (landed_s[1:] <= entry_s))
    places = [(entry_s, True)]
    if len(left):
        places.append((float(landed_s[left[-1]]), False))
    return [_begin(columns, entry_s, *each) for each in places]


def _begin(columns: Columns, entry_s: float, t_s: float, in_air: bool) -> MissionBegin:
    local, attitude = _At(columns, "vehicle_local_position", t_s), _At(columns, "vehicle_attitude", t_s)
    w, x, y, z = (attitude.value(f"q[{k}]") for k in range(4))
    yaw_ned_rad = yaw_from_q((w, x, y, z))
    position_ned_m = local.value("x"), local.value("y"), local.value("z")
    return MissionBegin(entry_s, position_ned_m, yaw_ned_rad, in_air)


class _At:
    """The values of a topic at a time: those before it, or else the first. Raises UnknownField."""

    def __init__(self, columns: Columns, topic: str, t_s: float) -> None:
        self._columns, self._topic = columns, f"{topic}:0"
        self.row = max(0, int(np.searchsorted(columns.times(self._topic), t_s, side="right")) - 1)

    def value(self, field: str) -> float:
        return float(self._columns.column(self._topic, field)[0][self.row])

    def flag(self, field: str) -> bool:
        return self.value(field) > 0.0


def _battery(columns: Columns, from_s: float, to_s: float) -> Battery | None:
    """None: not logged."""
    try:
        begin, end = (_At(columns, "battery_status", t_s) for t_s in (from_s, to_s))
        share, left = begin.value("remaining"), end.value("remaining")
    except UnknownField:
        return None
    if not 0.0 <= share <= 1.0:
        return None
    times_s = columns.times("battery_status:0")
    seconds, used = float(times_s[end.row] - times_s[begin.row]), share - left
    return Battery(share, seconds / used if used >= MIN_DISCHARGE else None)


def _mission_item(columns: Columns, from_s: float) -> int | None:
    try:
        return int(_At(columns, "mission_result", from_s).value("seq_current"))
    except UnknownField:
        return None


def _target(
    columns: Columns, from_s: float, to_s: float
) -> tuple[tuple[float, float, float] | None, float | None]:
    """The navigator's target, and when it changed within the mode of `from_s`; PX4 logs both."""
    topic = "position_setpoint_triplet"
    try:
        now = _At(columns, topic, from_s)
        if not now.flag("current.valid"):
            return None, None
        frame = _At(columns, "vehicle_local_position", from_s)
        origin = LocalOrigin(frame.value("ref_lat"), frame.value("ref_lon"), frame.value("ref_alt"))
        places = [
            columns.column(f"{topic}:0", f"current.{name}")[0] for name in ("lat", "lon", "alt", "type")
        ]
        times_s, states = columns.times(f"{topic}:0"), _Part(columns, columns.times(f"{topic}:0"))
        modes = states.held("vehicle_status", "nav_state")
    except UnknownField:
        return None, None
    moved = np.any([each != each[now.row] for each in places], axis=0) & (modes == modes[now.row])
    later = np.flatnonzero(moved & (times_s > from_s) & (times_s <= to_s))
    lat_deg, lon_deg, alt_amsl_m = (float(each[now.row]) for each in places[:3])
    target_ned_m = origin.to_ned(lat_deg, lon_deg, alt_amsl_m)
    known = all(map(math.isfinite, target_ned_m))
    return target_ned_m if known else None, float(times_s[later[0]]) if len(later) else None


def _switched(columns: Columns, from_s: float, to_s: float) -> tuple[float, int] | None:
    """The first later change of the intended mode that the autopilot did not make itself: at the end of its
    mission it intends Hold."""
    times_s = columns.times("vehicle_status:0")
    intended = np.asarray(columns.column("vehicle_status:0", "nav_state_user_intention")[0])
    armed = np.asarray(columns.column("vehicle_status:0", "arming_state")[0]) == _ARMED
    later = armed & (times_s > from_s) & (times_s <= to_s)
    for row in np.flatnonzero(later[1:] & (np.diff(intended) != 0)) + 1:
        t_s = float(times_s[row])
        with contextlib.suppress(UnknownField):
            if intended[row - 1] == _MISSION and _At(columns, "mission_result", t_s).flag("finished"):
                continue
        return t_s, int(intended[row])
    return None


def _release(firmware: str | None) -> tuple[int, int] | None:
    found = re.search(r"v(\d+)\.(\d+)", firmware or "")
    return None if found is None else (int(found[1]), int(found[2]))


class _Part:
    """Values of topics at the steps of the rerun."""

    def __init__(self, columns: Columns, t_s: Values) -> None:
        self.t_s = t_s
        self.notes: list[str] = []
        self._columns = columns

    def smooth(self, topic: str, fields: Sequence[str]) -> Values:
        """(N, k) interpolated; NaN beside a sample that is NaN. Raises UnknownField."""
        times_s = self._times(topic)
        columns = [self._column(topic, name) for name in fields]
        return np.column_stack([_interpolated(self.t_s, times_s, column) for column in columns])

    def held(self, topic: str, field: str) -> Values:
        """(N,) the last value. Raises UnknownField."""
        times_s, values = self._times(topic), self._column(topic, field)
        index = np.searchsorted(times_s, self.t_s, side="right") - 1
        return values[np.clip(index, 0, len(values) - 1)]

    def optional(self, topic: str, fields: Sequence[str], what: str) -> Values:
        """(N, k) interpolated; NaN, and a note, without the topic."""
        try:
            return self.smooth(topic, fields)
        except UnknownField:
            self.notes.append(f"The log has no {topic}, so {what}.")
            return np.full((len(self.t_s), len(fields)), np.nan)

    def _times(self, topic: str) -> Values:
        return self._columns.times(f"{topic}:0")

    def _column(self, topic: str, field: str) -> Values:
        return np.asarray(self._columns.column(f"{topic}:0", field)[0]).astype(np.float64)


def _interpolated(t_s: Values, times_s: Values, values: Values) -> Values:
    finite = np.isfinite(values)
    if finite.all():
        return np.interp(t_s, times_s, values)
    before = np.clip(np.searchsorted(times_s, t_s, side="right") - 1, 0, len(values) - 1)
    both = finite[before] & finite[np.minimum(before + 1, len(values) - 1)]
    if not finite.any():
        return np.full(len(t_s), np.nan)
    return np.where(both, np.interp(t_s, times_s[finite], values[finite]), values[before])


def _three(name: str) -> tuple[str, str, str]:
    return f"{name}[0]", f"{name}[1]", f"{name}[2]"


def _flight(part: _Part, parameters: Mapping[str, float]) -> LoggedFlight:
    rotors = part.held("actuator_motors", f"control[{MOTOR_COUNT}]")
    motors = part.smooth("actuator_motors", [f"control[{k}]" for k in range(MOTOR_COUNT)])
    if np.isfinite(rotors).any():
        raise NotFlyable("The vehicle has more than four motors; only quadrotors can be flown again.")
    level = _levels(part)
    attitude = part.smooth("vehicle_attitude_setpoint", ["thrust_body[2]"])[:, 0]
    rates = part.smooth("vehicle_rates_setpoint", ["roll", "pitch", "yaw", "thrust_body[2]"])
    target = part.smooth(
        "trajectory_setpoint", [*_three("position"), *_three("velocity"), *_three("acceleration")]
    )
    yaw = np.unwrap(part.held("trajectory_setpoint", "yaw"))
    return LoggedFlight(
        t_s=part.t_s,
        position_ned_m=part.smooth("vehicle_local_position", ["x", "y", "z"]),
        velocity_ned_m_s=part.smooth("vehicle_local_position", ["vx", "vy", "vz"]),
        q_ned_frd=_attitudes(part, "vehicle_attitude", "q"),
        rates_frd_rad_s=part.smooth("vehicle_angular_velocity", _three("xyz")),
        angular_acceleration_frd_rad_s2=part.smooth("vehicle_angular_velocity", _three("xyz_derivative")),
        force_frd_m_s2=part.optional(
            "vehicle_acceleration", _three("xyz"), "its aircraft and wind cannot be found from it"
        ),
        motors=np.clip(np.nan_to_num(motors), 0.0, 1.0),
        level=level,
        landed=part.held("vehicle_land_detected", "landed") > 0,
        target_position_ned_m=target[:, 0:3],
        target_velocity_ned_m_s=target[:, 3:6],
        target_acceleration_ned_m_s2=target[:, 6:9],
        target_yaw_ned_rad=yaw,
        target_yaw_rate_ned_rad_s=part.smooth("trajectory_setpoint", ["yawspeed"])[:, 0],
        commanded_acceleration_ned_m_s2=part.optional(
            "vehicle_local_position_setpoint", _three("acceleration"), "the first seconds differ more"
        ),
        target_q_ned_frd=_attitudes(part, "vehicle_attitude_setpoint", "q_d"),
        target_rates_frd_rad_s=rates[:, :3],
        thrust=np.where(level == _ATTITUDE, -attitude, -rates[:, 3]),
        rate_integral=part.optional(
            "rate_ctrl_status",
            ["rollspeed_integ", "pitchspeed_integ", "yawspeed_integ"],
            "the rate controllers start without their integrals",
        ),
        hover_thrust=part.optional(
            "hover_thrust_estimate", ["hover_thrust"], "the hover thrust is the one of MPC_THR_HOVER"
        )[:, 0],
        parameters=parameters,
        notes=tuple(part.notes),
    )


def _attitudes(part: _Part, topic: str, field: str) -> Values:
    """(N, 4) unit quaternions, interpolated the short way; level where nothing is known."""
    samples = np.column_stack([part.held(topic, f"{field}[{k}]") for k in range(4)])
    smooth = part.smooth(topic, [f"{field}[{k}]" for k in range(4)])
    # Where the sign flips between two samples, the interpolation passes near zero: there the last is held.
    norm = np.linalg.norm(smooth, axis=1, keepdims=True)
    q = np.where(norm > 0.9, smooth, samples)
    norm = np.linalg.norm(q, axis=1, keepdims=True)
    return np.where(norm > 0.5, q / np.maximum(norm, 1e-9), np.array([1.0, 0.0, 0.0, 0.0]))


def _levels(part: _Part) -> NDArray[np.int64]:
    def flag(name: str) -> NDArray[np.bool_]:
        return part.held("vehicle_control_mode", f"flag_{name}") > 0

    trajectory = np.zeros(len(part.t_s), dtype=np.bool_)
    for name in _TRAJECTORY_FLAGS:
        trajectory |= flag(f"control_{name}_enabled")
    level = np.full(len(part.t_s), _MOTORS, dtype=np.int64)
    level[flag("control_rates_enabled")] = _RATES
    level[flag("control_attitude_enabled")] = _ATTITUDE
    level[trajectory] = _TRAJECTORY
    level[~flag("armed")] = _DISARMED
    return level
