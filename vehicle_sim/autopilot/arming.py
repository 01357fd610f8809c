"""Reasons for arming, disarming and denied arming, and PX4's flight statistics."""

from __future__ import annotations

import math
from enum import IntEnum

from vehicle_sim.autopilot.health import CheckResults
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.sticks import Sticks
from vehicle_sim.autopilot.tasks.manual import ATTITUDE_RATE_MODES, STICK_MODES
from vehicle_sim.vehicle_view import VehicleView

THROTTLE_ABOVE_CENTRE, THROTTLE_LOW = 0.2, -0.8
"""Throttle stick (-1..1) above which the vehicle would climb, and below which the thrust is zero."""
_LOW_32_BITS = 0xFFFFFFFF


class Reason(IntEnum):
    """Why the vehicle was armed or disarmed; the numbers of PX4's events."""

    INTERNAL_COMMAND = 3
    EXTERNAL_COMMAND = 4
    MISSION_START = 5
    LANDING = 6
    PREFLIGHT = 7
    KILL = 8
    FAILSAFE = 14


REASONS = {
    Reason.INTERNAL_COMMAND: "internal command",
    Reason.EXTERNAL_COMMAND: "external command",
    Reason.MISSION_START: "mission start",
    Reason.LANDING: "landing",
    Reason.PREFLIGHT: "auto preflight disarming",
    Reason.FAILSAFE: "failsafe",
    Reason.KILL: "kill-switch",
}
"""Names of the reasons in PX4's status texts."""


def arming_denial(
    report: CheckResults, mode: NavState, sticks: Sticks, *, calibrating: bool
) -> tuple[str, str] | None:
    """Why arming is denied in this mode (text, and suffix of the event name); None: arming is allowed."""
    if calibrating:
        return "calibrating", "calibrating"
    if mode in STICK_MODES and sticks.valid:
        if mode in ATTITUDE_RATE_MODES and not sticks.raw.throttle < THROTTLE_LOW:
            return "throttle is not down", "throttle_high"
        if mode not in ATTITUDE_RATE_MODES and sticks.raw.throttle > THROTTLE_ABOVE_CENTRE:
            return "throttle is above its centre", "throttle_center"
    if not report.armable(mode):
        return "Resolve system health failures first", "resolve_failures"
    return None


def auto_disarm_after_s(view: VehicleView, *, took_off: bool) -> float:
    """Time after which a vehicle on the ground disarms automatically; infinite: it stays armed.

    Args:
        view: the vehicle.
        took_off: whether the vehicle has taken off since arming; then the time counts from the landing,
            otherwise from arming.
    """
    delay_s = view.parameter("COM_DISARM_LAND" if took_off else "COM_DISARM_PRFLT")
    if delay_s <= 0.0:
        return math.inf
    return delay_s if took_off else delay_s + view.parameter("COM_SPOOLUP_TIME")


class FlightStatistics:
    """Number of flights (COM_FLIGHT_UUID) and total flight time (LND_FLIGHT_T_*)."""

    def __init__(self, view: VehicleView) -> None:
        self._view = view
        self._took_off_at_s = math.nan

    def on_takeoff(self) -> None:
        """Stores the time of the first take-off after arming; called at each take-off."""
        if math.isnan(self._took_off_at_s):
            self._took_off_at_s = self._view.time_s

    def on_disarming(self) -> None:
        """Stores the statistics; called at each disarming, even without a flight."""
        parameters = self._view.parameters
        parameters.store_statistic("COM_FLIGHT_UUID", int(parameters.get("COM_FLIGHT_UUID")) + 1)
        if math.isnan(self._took_off_at_s):
            return
        high, low = int(parameters.get("LND_FLIGHT_T_HI")), int(parameters.get("LND_FLIGHT_T_LO"))
        flight_time_us = round(1e6 * (self._view.time_s - self._took_off_at_s))
        total_us = (high << 32 | low & _LOW_32_BITS) + flight_time_us
        parameters.store_statistic("LND_FLIGHT_T_HI", total_us >> 32)
        parameters.store_statistic("LND_FLIGHT_T_LO", total_us & _LOW_32_BITS)
        self._took_off_at_s = math.nan
