"""Skips the checks of a steady flight while they would give the same result as last time.

`Commander` runs the checks at 10 Hz, usually with the same inputs as last time. Their result depends only on

- the values that are compared here,
- commands, parameters and the commander's state; a change of these ends the steady flight,
- time, but only if a sensor sends no data, the position was lost, or a link has been connected since boot. In
  these conditions no check is skipped.
"""

from __future__ import annotations

from vehicle_sim.autopilot.checks import Checks
from vehicle_sim.autopilot.failsafe import NO_FAILSAFE
from vehicle_sim.autopilot.failsafe_watch import FailsafeWatch
from vehicle_sim.autopilot.fence_watch import FenceWatch
from vehicle_sim.autopilot.setpoint_writer import bool_view
from vehicle_sim.vehicle_view import VehicleView


class CheckSkipper:
    """Compares the inputs of the checks of one vehicle with those of its last checks."""

    def __init__(
        self,
        view: VehicleView,
        checks: Checks,
        failsafe: FailsafeWatch,
        fence: FenceWatch,
    ) -> None:
        self._checks, self._failsafe, self._fence = checks, failsafe, fence
        self._simulation, self._row = view.simulation, view.row
        sensors = view.simulation.sensors
        self._baro_fresh, self._mag_fresh = bool_view(sensors.baro_fresh), bool_view(sensors.mag_fresh)
        self._gnss_used = bool_view(view.simulation.fusion.gnss_pos)
        self._inputs: tuple[object, ...] | None = None
        """Inputs of the last checks; None: the next checks must run."""

    def reset(self) -> None:
        """Makes the next checks run, because a full tick may change values that are not compared."""
        self._inputs = None

    def store_inputs(self, armed_at_s: float) -> None:
        """Stores the inputs of the checks that have just run in a steady tick."""
        self._inputs = self._read_inputs(armed_at_s)

    def skip_if_unchanged(self, armed_at_s: float) -> bool:
        """Whether the inputs are unchanged; True: this call replaces the checks."""
        if self._inputs is None or self._read_inputs(armed_at_s) != self._inputs:
            self._inputs = None
            return False
        self._checks.sensors.note_fresh_data()
        return True

    def _read_inputs(self, armed_at_s: float) -> tuple[object, ...] | None:
        """The inputs of the checks; None: the result also depends on time."""
        checks, simulation, row = self._checks, self._simulation, self._row
        estimate, now_s = simulation.estimates[row], simulation.time_s
        if (
            checks.has_been_connected
            or checks.has_unreported_change
            or not estimate.valid_position
            or now_s < checks.position_usable_at_s
            or not (self._baro_fresh[row] and self._mag_fresh[row])
            or self._failsafe.decision is not NO_FAILSAFE
            or self._failsafe.in_early_takeoff(now_s - armed_at_s)
        ):
            return None
        return (
            checks.report, estimate.valid_velocity, estimate.valid_attitude, checks.offboard.has_signal(),
            checks.battery_warning, self._gnss_used[row], self._fence.breaches, checks.logging,
            checks.external.health(),
        )  # fmt: skip
