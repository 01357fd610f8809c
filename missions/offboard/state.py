"""The state of a compilation: the compiled segments, and the planned state of the vehicle after these
segments."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from missions.avoidance.values import AvoidanceWay
from missions.check_context import CheckLimits
from missions.errors import PlanError
from missions.fence import Fence, fence_from_json
from missions.frames import Vector3
from missions.offboard.document import Bounds, OffboardMission
from missions.offboard.findings import MissionFinding
from missions.offboard.positions import MissionPosition, Start, to_local
from missions.offboard.segments import GimbalTrack, Segment
from missions.offboard.steps import PathStep
from missions.setpoints import Estimate
from missions.trajectory.limits import MotionLimits
from missions.vehicle import VehicleModel

MAX_SEGMENTS = 2000
MAX_STEPS = 10_000
"""Maximum number of steps to compile, over all branches; each repeat counts."""
MAX_POINTS = 50_000
"""Maximum number of path points to compute, over all branches."""


@dataclass(frozen=True, slots=True)
class OperatorArea:
    """The area in which the operator's limits allow the vehicle to fly; None: no limit."""

    height_max_m: float | None = None
    """Altitude above home."""
    distance_max_m: float | None = None
    """Horizontal distance from home."""
    fence: Fence | None = None

    def to_json(self) -> dict[str, Any]:
        """The area as a JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> OperatorArea:
        """The area from the values that `to_json` returned."""
        fence = values["fence"]
        return cls(
            values["height_max_m"],
            values["distance_max_m"],
            None if fence is None else fence_from_json(fence),
        )


@dataclass(frozen=True, slots=True)
class MissionVehicle:
    """The limits that a mission is compiled for: the vehicle's and the operator's."""

    motion: MotionLimits = field(default_factory=MotionLimits)
    limits: CheckLimits = field(default_factory=CheckLimits)
    reported: frozenset[str] | None = None
    """Names of the condition values that the vehicle reports; None: unknown."""
    operator: OperatorArea = field(default_factory=OperatorArea)

    @classmethod
    def from_parameters(
        cls,
        parameters: Mapping[str, float],
        limits: CheckLimits | None = None,
        reported: Iterable[str] | None = None,
        operator: OperatorArea | None = None,
    ) -> MissionVehicle:
        """Creates the limits from the vehicle's parameters and the operator's limits."""
        model = VehicleModel.from_parameters(parameters)
        return cls(
            MotionLimits.from_parameters(parameters), replace(limits or CheckLimits(), vehicle=model),
            None if reported is None else frozenset(reported), operator or OperatorArea(),
        )  # fmt: skip

    def motion_within(self, bounds: Bounds) -> MotionLimits:
        """The vehicle's motion limits, or the limits of a mission where these are lower. The speed limit of
        the mission is not applied here, because `State.limits_for` reports when it is exceeded."""
        lower = {
            name: min(value, getattr(self.motion, name))
            for name, value in bounds
            if value is not None and name != "speed_m_s"
        }
        return replace(self.motion, **lower)


@dataclass(slots=True)
class Compilation:
    """Data that all branches of one compilation share."""

    mission: OffboardMission
    vehicle: MissionVehicle
    start: Start
    files: Mapping[str, bytes]
    motion: MotionLimits
    findings: dict[MissionFinding, None] = field(default_factory=dict)
    """Findings without repetitions, in order."""
    segment_count: int = 0
    step_count: int = 0
    point_count: int = 0

    def add_size(self, *, segments: int = 0, steps: int = 0, points: int = 0) -> None:
        """Adds to the counters that limit the size of a mission.

        Raises:
            PlanError: The mission is too large.
        """
        self.segment_count += segments
        self.step_count += steps
        self.point_count += points
        if self.segment_count > MAX_SEGMENTS or self.step_count > MAX_STEPS or self.point_count > MAX_POINTS:
            reason = f"more than {MAX_SEGMENTS} segments, {MAX_STEPS} steps or {MAX_POINTS} points"
            raise PlanError(
                "the mission",
                reason,
                "Split the mission: repeats and branches multiply their inner steps.",
            )

    def table(self, name: str) -> bytes:
        """The trajectory of a table step, from the given files or from the document.

        Raises:
            PlanError: No trajectory has this name.
        """
        if name in self.files:
            return self.files[name]
        if name in self.mission.tables:
            return self.mission.tables[name].encode()
        raise PlanError("field file", f"there is no file {name!r}", "Add the file, or correct its name.")


@dataclass(slots=True)
class State:
    """The planned state of the vehicle on one path through the mission's branches."""

    compilation: Compilation
    position_ned_m: Vector3
    yaw_ned_rad: float
    in_air: bool
    place: str = "the mission"
    title: str = ""
    gimbal: GimbalTrack | None = None
    avoidance: AvoidanceWay | None = None
    executed_step: int = 0
    """Number of the current step among all executed steps, from 1."""
    needs: set[Estimate] = field(default_factory=set)
    """Estimates that the vehicle must have."""
    segments: list[Segment] = field(default_factory=list)

    def fork(self) -> State:
        """A copy of the state for a branch, without segments."""
        return replace(self, needs=set(), segments=[])

    def add(self, segment: Segment) -> None:
        """Adds a segment and moves the planned position to the end of the segment."""
        self.compilation.add_size(segments=1)
        self.segments.append(replace(segment, avoidance=self.avoidance, executed_step=self.executed_step))
        self.position_ned_m, self.yaw_ned_rad = segment.end_ned_m, segment.end_yaw_ned_rad

    def report(self, code: str, message: str, fix: str | None = None, limit: float | None = None) -> None:
        """Adds a finding about the current step; the arguments are fields of `MissionFinding`."""
        self.compilation.findings[MissionFinding(code, message, self.place, fix, limit)] = None

    def locate(self, position: MissionPosition) -> Vector3:
        """Converts a position to the local frame.

        Raises:
            MissingReference: A value for the conversion is unknown.
        """
        if position.lat_deg is not None:
            self.needs.add("global_position")
        if position.alt_home_m is not None:
            self.needs.add("home")
        return to_local(position, self.compilation.start)

    def limits_for(self, step: PathStep) -> MotionLimits:
        """The limits of a step: the vehicle's, the mission's, and the step's speed."""
        motion = self.compilation.motion
        mission_limit_m_s = self.compilation.mission.limits.speed_m_s
        cruise_m_s = self.compilation.vehicle.limits.vehicle.cruise_m_s
        requested_m_s = step.speed_m_s or mission_limit_m_s or cruise_m_s
        limit_m_s = min(motion.speed_m_s, mission_limit_m_s or math.inf)
        if requested_m_s > limit_m_s:
            message = f"A speed of {requested_m_s:g} m/s is requested; the limit is {limit_m_s:g} m/s."
            self.report("speed_too_high", message, "Lower the speed, or raise the limit.", limit_m_s)
        return replace(motion, speed_m_s=min(requested_m_s, limit_m_s))
