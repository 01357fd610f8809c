"""Precision landing without a target in view: no simulated vehicle has a sensor for one."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.path import Path
from vehicle_sim.autopilot.tick_arrays import Motion, SteadyTask
from vehicle_sim.vehicle_view import VehicleView

START_S = 2.0
"""Time for which PX4 waits for the target at the start, before it climbs to search for it."""


class PrecisionLanding:
    """The flight task: the vehicle waits where the mode began, searches at PLD_SRCH_ALT above the local
    origin for PLD_SRCH_TOUT, and then lands like Land. With a PLD_SRCH_TOUT of zero it lands at once."""

    def __init__(self, view: VehicleView, path: Path) -> None:
        self._view, self._path = view, path
        self._entered_at_s = -math.inf
        self._landing_alt_amsl_m: float | None = None

    def enter(self) -> None:
        """Starts at the vehicle's position."""
        self._entered_at_s, self._landing_alt_amsl_m = self._view.time_s, None
        self._path.target_ned_m = self._view.estimate.position_ned_m
        self._path.face_target = False

    @property
    def landing(self) -> bool:
        """Whether the search has ended and the vehicle lands."""
        return self._landing_alt_amsl_m is not None

    @property
    def waypoint(self) -> tuple[float, float, float] | None:
        """Target: north and east [m, local frame], altitude AMSL [m]."""
        north, east, down = self._path.target_ned_m
        if north is None or east is None:
            return None
        if self._landing_alt_amsl_m is not None:
            return north, east, self._landing_alt_amsl_m
        return None if down is None else (north, east, self._view.origin[2] - down)

    def run(self) -> None:
        """Runs one tick."""
        if self._landing_alt_amsl_m is None:
            self._search()
        if self.landing:
            self._path.descend()
        else:
            self._path.fly_to_target()

    def _search(self) -> None:
        north, east, _ = self._path.target_ned_m
        since_s, search_s = self._view.time_s - self._entered_at_s, self._view.parameter("PLD_SRCH_TOUT")
        if search_s <= 0.0 or since_s > START_S + search_s:
            estimate = self._view.estimate
            self._landing_alt_amsl_m = estimate.alt_amsl_m
            self._path.target_ned_m = (*estimate.position_ned_m[:2], None)
        elif since_s > START_S:
            self._path.target_ned_m = (north, east, -self._view.parameter("PLD_SRCH_ALT"))

    def steady_task(self) -> SteadyTask | None:
        """The descent of the landing; None: the search needs full ticks."""
        return self._path.steady_task(Motion.DESCENT) if self.landing else None
