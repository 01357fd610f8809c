"""A plan that is ready to be flown by a simulated vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from missions.dry_run.fleet import Vehicle
from missions.dry_run.offboard import OffboardPilot
from missions.dry_run.pilot import Pilot
from missions.dry_run.setup import Aircraft
from missions.dry_run.waypoints import StoredPlan, WaypointPilot
from missions.errors import PlanError
from missions.estimates import estimate
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.positions import Start
from missions.offboard.samples import legs
from missions.offboard.state import MissionVehicle
from missions.offboard.timeline import Timeline
from missions.plan import Plan
from missions.runner.runner import Runner
from missions.trajectory.limits import MotionLimits
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


@dataclass(frozen=True, slots=True)
class FlyableMission:
    """An offboard mission, compiled for the vehicle's start position."""

    fence: tuple[FenceZone, ...]
    expected_s: float
    """Estimated duration of boot and flight [s]."""
    max_duration_s: float
    """Time limit of the flight [s]."""
    name: str
    timeline: Timeline
    motion: MotionLimits
    start_ned_m: Vector3
    """The vehicle's start position in the mission's local frame."""

    @classmethod
    def from_mission(
        cls,
        mission: OffboardMission,
        aircraft: Aircraft,
        files: Mapping[str, bytes] | None = None,
        origin: LocalOrigin | None = None,
        role: str | None = None,
    ) -> FlyableMission:
        """Compiles a mission for one vehicle.

        Args:
            mission: the document.
            aircraft: the vehicle and its start position.
            files: contents of the table files, by name.
            origin: origin of the vehicle's local frame; None: its start position.
            role: the vehicle's role in a mission of several vehicles.

        Raises:
            PlanError: the mission is too large, or has no step that can be flown.
        """
        vehicle = MissionVehicle.from_parameters(aircraft.parameters)
        home = aircraft.home
        local_origin = origin or aircraft.origin
        start_ned_m = local_origin.to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m)
        start = Start(
            position_ned_m=start_ned_m, yaw_ned_rad=aircraft.yaw_ned_rad, origin=local_origin,
            home_alt_amsl_m=home.alt_amsl_m,
        )  # fmt: skip
        timeline = compile_mission(mission, vehicle, start, files, role=role)
        if not timeline.segments and timeline.decision is None:
            raise PlanError("the mission", "no step can be flown", "See the findings of the mission.")
        motion = vehicle.motion_within(mission.limits)
        speed_m_s = min(motion.speed_m_s, mission.limits.speed_m_s or vehicle.limits.vehicle.cruise_m_s)
        return cls(
            mission.fence, BOOT_S + timeline.duration_s, max_duration_s(timeline.duration_s), mission.name,
            timeline, replace(motion, speed_m_s=speed_m_s), start_ned_m,
        )  # fmt: skip

    def positions(self, origin: LocalOrigin) -> list[tuple[float, float]]:
        """Latitude and longitude of positions along all paths [deg].

        Args:
            origin: origin of the mission's local frame.
        """
        lines = legs(self.timeline, self.start_ned_m)
        return [origin.to_geodetic((n, e, d))[:2] for leg in lines for _, n, e, d in leg.points]

    def make_pilot(self, vehicle: Vehicle, *, alone: bool = True) -> OffboardPilot:
        """A pilot for this vehicle; `alone` false: the caller starts it together with the other roles."""
        runner = Runner(self.timeline, self.name, self.motion)
        return OffboardPilot(vehicle, runner, self.start_ned_m, alone=alone)
