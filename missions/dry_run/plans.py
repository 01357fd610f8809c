"""A plan that is ready to be flown by a simulated vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from missions.dry_run.fleet import Vehicle
from missions.dry_run.pilot import Pilot
from missions.dry_run.setup import Aircraft
from missions.dry_run.waypoints import StoredPlan, WaypointPilot
from missions.estimates import estimate
from missions.plan import Plan
from missions.values import FenceZone
from missions.vehicle import VehicleModel

MAX_DURATION_S = 3600.0
"""Time limit of any flight."""
DURATION_FACTOR = 2.0
MARGIN_S = 90.0
"""The time limit of a flight is DURATION_FACTOR times its estimated duration plus MARGIN_S."""
BOOT_S = 5.0
"""Estimated time from boot to the start of the flight."""


def max_duration_s(expected_s: float) -> float:
    """Time limit of a flight with this estimated duration."""
    return min(MAX_DURATION_S, DURATION_FACTOR * expected_s + MARGIN_S)


class Flyable(Protocol):
    """A plan of any kind, with a simulated pilot that flies it."""

    @property
    def fence(self) -> tuple[FenceZone, ...]:
        """The plan's geofence."""
        ...

    @property
    def expected_s(self) -> float:
        """Estimated duration of boot and flight."""
        ...

    @property
    def max_duration_s(self) -> float:
        """Time limit of the flight."""
        ...

    def make_pilot(self, vehicle: Vehicle) -> Pilot:
        """Creates the simulated pilot that flies the plan with this vehicle."""
        ...


@dataclass(frozen=True, slots=True)
class FlyablePlan:
    """A waypoint plan."""

    fence: tuple[FenceZone, ...]
    expected_s: float
    max_duration_s: float
    stored_plan: StoredPlan

    @classmethod
    def from_plan(cls, plan: Plan, aircraft: Aircraft) -> FlyablePlan:
        """Prepares a plan for one vehicle.

        Raises:
            PlanError: PX4 refuses the plan.
        """
        vehicle = VehicleModel.from_parameters(aircraft.parameters)
        with_home = plan.model_copy(update={"planned_home": aircraft.home})
        expected_s = estimate(with_home, vehicle).time_s
        return cls(plan.fence, BOOT_S + expected_s, max_duration_s(expected_s), StoredPlan.from_plan(plan))

    def make_pilot(self, vehicle: Vehicle) -> WaypointPilot:
        """A pilot that uploads the plan and starts it."""
        return WaypointPilot(vehicle, self.stored_plan)
