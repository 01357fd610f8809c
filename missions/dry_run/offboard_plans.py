"""An offboard mission, ready for a simulated vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from missions.dry_run.fleet import Vehicle
from missions.dry_run.offboard import OffboardPilot
from missions.dry_run.plans import BOOT_S, max_duration_s
from missions.dry_run.setup import Aircraft
from missions.errors import PlanError
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.offboard.positions import Start
from missions.offboard.samples import legs
from missions.offboard.state import MissionVehicle
from missions.offboard.timeline import Timeline
from missions.runner.runner import Runner
from missions.trajectory.limits import MotionLimits
from missions.values import FenceZone


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
