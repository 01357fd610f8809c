"""Updates the flight state, which safety functions use, from each message. No I/O."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.autopilot import autopilot_of
from gcs_server.vehicle.px4.modes import LANDED_STATES

_heartbeat = struct.Struct("<I5B")
_current_mode = struct.Struct("<IIB")


@dataclass(frozen=True, slots=True)
class FlightState:
    """The vehicle's last reported state, with its times [s, monotonic]."""

    armed: bool = False
    custom_mode: int = 0
    intended_custom_mode: int | None = None
    landed_state: str = "unknown"
    system_status: int = 0
    vehicle_type: int = 0
    autopilot: int = d.MAV_AUTOPILOT_INVALID
    hil: bool = False
    heartbeat_s: float = float("-inf")
    """Time at which `armed` was last reported."""
    mode_s: float = float("-inf")
    """Time at which `custom_mode` was last reported (HEARTBEAT or CURRENT_MODE)."""
    landed_s: float = float("-inf")

    @property
    def mode_name(self) -> tuple[str, str]:
        """Name in the API, and label, of the mode."""
        return autopilot_of(self.autopilot).mode_name(self.custom_mode)


def heartbeat(flight_state: FlightState, payload: bytes, now_s: float) -> FlightState:
    """Applies a HEARTBEAT of the autopilot.

    A HEARTBEAT has no intended mode. If it reports another mode, the intended mode is unknown until the next
    CURRENT_MODE: the stored one was that of the mode before.
    """
    custom_mode, vehicle_type, autopilot, base_mode, system_status, _version = _heartbeat.unpack(payload)
    is_same_mode = custom_mode == flight_state.custom_mode
    return replace(
        flight_state,
        armed=bool(base_mode & d.MAV_MODE_FLAG_SAFETY_ARMED),
        custom_mode=custom_mode,
        intended_custom_mode=flight_state.intended_custom_mode if is_same_mode else None,
        system_status=system_status,
        vehicle_type=vehicle_type,
        autopilot=autopilot,
        hil=bool(base_mode & d.MAV_MODE_FLAG_HIL_ENABLED),
        heartbeat_s=now_s,
        mode_s=now_s,
    )


def current_mode(flight_state: FlightState, payload: bytes, now_s: float) -> FlightState:
    """Applies CURRENT_MODE. An intended mode of 0 means unknown, unless the current mode is also 0."""
    custom_mode, intended, _standard = _current_mode.unpack(payload)
    return replace(flight_state, custom_mode=custom_mode, intended_custom_mode=intended or None, mode_s=now_s)


def extended_sys_state(flight_state: FlightState, payload: bytes, now_s: float) -> FlightState:
    """Applies EXTENDED_SYS_STATE."""
    return replace(flight_state, landed_state=LANDED_STATES.get(payload[1], "unknown"), landed_s=now_s)


REDUCERS = {
    d.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    d.MAVLINK_MSG_ID_CURRENT_MODE: current_mode,
    d.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
}
