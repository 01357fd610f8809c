"""PX4's EVENT messages without its metadata: our own words for the ones that matter to an operator.

The ids are PX4 v1.16's (component 1 of the event's namespace included in the top byte). Arming checks
carry the modes they concern as a bit mask and the health component as their first arguments.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from gcs_server.vehicle.modes import BY_CUSTOM_MODE, BY_NAV_STATE

_event = struct.Struct("<IIHBBB40s")
_summary = struct.Struct("<BIIII")

ARMING_SUMMARY_ID = 27825120
HEALTH_SUMMARY_ID = 18691879
LEVEL_PROTOCOL = 8
"""Levels from here on are not for people."""
LEVEL_ERROR = 3
ALL_MODES = 0xFFFFFFFF

CHECKS: dict[int, str] = {
    17231145: "there is no transmitter or joystick",
    17154777: "there is no mission to fly",
    19865031: "no offboard setpoints are coming in",
    18648929: "this mode cannot take off from the ground",
    30612409: "there is no position estimate",
    26788467: "there is no global position",
    25316113: "the vehicle is tilted too far",
    21826980: "the battery is low",
    19404811: "the battery is nearly empty",
    28274646: "the GPS altitude still drifts",
    22720449: "too few compasses were found",
    26938432: "the Open Drone ID system is missing",
    22222072: "an accelerometer is not calibrated",
    18103665: "a gyro is not calibrated",
    33493753: "a compass is not calibrated",
    31525953: "the external mode is not registered",
    29532170: "the flight was terminated",
    33420013: "the heading estimate is not stable yet",
}
TEXTS: dict[int, str] = {
    16910493: "Arming denied: the vehicle's checks fail",
    25868725: "Disarming denied: the vehicle has not landed",
    27280279: "The vehicle cannot switch to that mode now",
    19869445: "The vehicle does not know that mode",
    19217309: "The vehicle does not know that arming request",
    26266355: "Armed",
    32794487: "Disarmed",
    21054825: "Take-off detected",
    20656071: "Climbing to the default take-off altitude",
    19098816: "Already above the take-off altitude",
    20099806: "Landing where it is",
    25087420: "Landing precisely",
    20262116: "Returning to launch",
    22161044: "Return has begun",
    16962474: "Landing at the destination",
    22400324: "Transmitter lost",
    27900317: "The onboard computer fell silent",
    31382480: "Failsafe active",
    30481910: "Failsafe: holding first",
    26528394: "Failsafe active",
    29547634: "Failsafe active: the autopilot lost control of the mode",
    28993875: "Battery low: return advised",
    28329281: "A setpoint's frame is not supported",
    22427557: "A setpoint without position, velocity or acceleration was refused",
    27739955: "A global setpoint's frame is not supported",
    32375217: "Mission runs",
    23844490: "Mission not started: there is none",
    24986204: "Climbing before the mission begins",
    18865022: "The orbit's radius is too large",
    27750677: "The fence does not contain home",
    26128688: "The rally point's frame is not supported",
    30930440: "Manual speed was limited by the maximum speed",
}
SWITCH_REFUSED_ID = 27280279


@dataclass(frozen=True, slots=True)
class VehicleEvent:
    """One EVENT, decoded as far as we can."""

    id: int
    sequence: int
    level: int
    """MAV_SEVERITY, or 8 and more for what is not for people."""
    text: str
    is_check: bool
    arguments: bytes


@dataclass(frozen=True, slots=True)
class FailedCheck:
    """One line of the arming report."""

    modes: int
    """Bit mask over `Mode.nav_state`."""
    level: int
    text: str


def decode_event(payload: bytes) -> VehicleEvent:
    """From a full EVENT payload."""
    event_id, _time, sequence, _component, _system, levels, arguments = _event.unpack(payload)
    check = CHECKS.get(event_id)
    text = check or TEXTS.get(event_id) or f"event {event_id}"
    if event_id == SWITCH_REFUSED_ID:
        (custom_mode,) = struct.unpack_from("<I", arguments)
        nav_state = arguments[4]
        mode = BY_NAV_STATE.get(nav_state) or BY_CUSTOM_MODE.get(custom_mode)
        text = f"The vehicle cannot switch to {mode.label} now" if mode else text
    return VehicleEvent(event_id, sequence, levels & 0x0F, text, check is not None, arguments)


class ArmingReport:
    """The newest complete list of what keeps the vehicle from arming or flying.

    A report is a summary, its checks, a second summary (PX4 sends it when something changed).
    """

    def __init__(self) -> None:
        self.can_arm: int | None = None
        """Bit mask of the modes in which it could arm; None before the first report."""
        self.failed: tuple[FailedCheck, ...] = ()
        self._collecting: list[FailedCheck] | None = None
        self._collecting_can_arm = 0

    def feed(self, event: VehicleEvent) -> bool:
        """Takes an event; True where it belongs to a report."""
        if event.id == ARMING_SUMMARY_ID:
            _chunk, _error, _warning, can_arm, _can_run = _summary.unpack_from(event.arguments)
            self._collecting, self._collecting_can_arm = [], can_arm
            return True
        if event.id == HEALTH_SUMMARY_ID:
            if self._collecting is not None:
                self.failed, self.can_arm = tuple(self._collecting), self._collecting_can_arm
                self._collecting = None
            return True
        if self._collecting is None:
            return False
        modes = struct.unpack_from("<I", event.arguments)[0]
        self._collecting.append(FailedCheck(modes, event.level, event.text))
        return True

    def against_arming(self, nav_state: int | None) -> tuple[str, ...]:
        """Why it would not arm in a mode (None: in any), in our words; empty where it would."""
        mask = ALL_MODES if nav_state is None else 1 << nav_state
        if self.can_arm is not None and nav_state is not None and self.can_arm & mask:
            return ()
        concerned = [check for check in self.failed if check.modes & mask]
        grave = [c.text for c in concerned if c.level <= LEVEL_ERROR or c.modes != ALL_MODES]
        return tuple(grave or (c.text for c in concerned))
