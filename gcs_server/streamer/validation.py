"""Checks of setpoints before they are sent: types that the vehicle can fly now over its link, combinations of
axes that PX4 can fly, and targets within the limits.

With other combinations PX4 descends level, or stops. Its position controller needs both north and east of a
quantity, or neither, and a value on every axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs_server.errors import NotYet, Refused
from gcs_server.links.base import UnusableTopic
from gcs_server.ros2.formats import REMEDY as FORMAT_REMEDY
from gcs_server.streamer.frames import KINDS_TO_RESOLVE, NON_LOCAL_KINDS, ResolvedSetpoint
from gcs_server.streamer.transport.mavlink import MAVLINK_KINDS
from gcs_server.streamer.transport.ros2 import ROS2_KINDS, topics_of
from gcs_server.streamer.values.limit_values import Bounds
from gcs_server.streamer.values.snapshot import Snapshot
from missions.curves import PathCurve
from missions.floor import Floor, TooLow
from missions.frames import Vector3
from missions.offboard.segments import CurveSegment, Segment, TableSegment, VelocitySegment, WaitSegment
from missions.setpoints import (
    KINDS,
    UNCONTROLLED,
    Acceleration,
    DirectSetpoint,
    Estimate,
    Follow,
    FollowDevice,
    Partial3,
    Path,
    Position,
    PositionGlobal,
    Setpoint,
    Trajectory,
    Velocity,
    complete_vector,
    needs_of,
)

TYPES_BY_PROTOCOL: dict[str, frozenset[str]] = {
    "MAVLink": MAVLINK_KINDS | KINDS_TO_RESOLVE,
    "ROS 2": ROS2_KINDS | KINDS_TO_RESOLVE | NON_LOCAL_KINDS,
}
"""By link protocol: the setpoint types that its messages can carry, directly or after a conversion."""
WAIT_REMEDY = "Wait for GPS and the estimator (see the vehicle's messages), then try again."
_MISSING = {
    "position": "The vehicle has no fresh position estimate, which a {type} setpoint needs.",
    "velocity": "The vehicle has no fresh velocity estimate, which a {type} setpoint needs.",
    "heading": "The vehicle has no fresh attitude estimate, which a {type} setpoint needs.",
    "global_position": "The vehicle has no valid global position, which a {type} setpoint needs.",
    "home": "The vehicle has no home position yet, so an altitude above home is not defined.",
}


@dataclass(frozen=True, slots=True)
class Available:
    """Whether a type of setpoint can be flown now."""

    can: bool
    why_not: str | None
    """The missing estimate, home position or link; null if the type can be flown."""
    needs: tuple[str, ...]
    """Estimates that this type needs: position, velocity, heading, global_position, home."""


class EstimateSource(Protocol):
    """The interface to a vehicle's estimates: which are valid and fresh."""

    def has_position(self) -> bool: ...

    def has_velocity(self) -> bool: ...

    def has_attitude(self) -> bool: ...

    def origin(self) -> object | None: ...

    def home(self) -> object | None: ...


def why_not_carried(setpoint_type: str, protocol: str) -> str | None:
    """Why links with this protocol cannot carry a setpoint type; None if the links can carry it."""
    if setpoint_type in TYPES_BY_PROTOCOL.get(protocol, frozenset()):
        return None
    carried = ", ".join(sorted(TYPES_BY_PROTOCOL.get(protocol, frozenset()))) or "none"
    return (
        f"A {protocol} link carries no {setpoint_type} setpoints, because PX4 follows no {protocol} message "
        f"for them. This link carries {carried}."
    )


def require_usable(topic: UnusableTopic | None) -> None:
    """Raises Refused if there is a topic that cannot be used; NotYet if the vehicle may still report it."""
    if topic is not None:
        raise (NotYet if topic.awaited else Refused)(f"{topic.text}.", remedy=FORMAT_REMEDY)


class Availability:
    """Checks the vehicle's link and estimates.

    Args:
        estimates: the vehicle's newest samples.
        protocol: protocol of the vehicle's links.
        unusable_topics: the vehicle's ROS 2 topics that the server cannot use, and why.
    """

    def __init__(
        self,
        estimates: EstimateSource,
        protocol: Callable[[], str],
        unusable_topics: Callable[[], Mapping[str, UnusableTopic]],
    ) -> None:
        self._protocol, self._unusable_topics = protocol, unusable_topics
        self._has_estimate: dict[str, Callable[[], bool]] = {
            "position": estimates.has_position,
            "velocity": estimates.has_velocity,
            "heading": estimates.has_attitude,
            "global_position": lambda: estimates.origin() is not None,
            "home": lambda: estimates.home() is not None,
        }

    def for_type(self, setpoint_type: str) -> Available:
        """Availability of a setpoint type."""
        needs = KINDS[setpoint_type].needs
        unusable = self._unusable({setpoint_type}, in_offboard=True)
        why_not = (
            why_not_carried(setpoint_type, self._protocol())
            or (None if unusable is None else f"{unusable.text}.")
            or self._missing(setpoint_type, needs)
        )
        return Available(why_not is None, why_not, needs)

    def require_estimates(self, setpoint_type: str, needs: tuple[Estimate, ...]) -> None:
        """Raises NotYet if one of these estimates is missing."""
        why_not = self._missing(setpoint_type, needs)
        if why_not is not None:
            raise NotYet(why_not, remedy=WAIT_REMEDY)

    def require_topics(self, setpoint_types: Iterable[str], *, in_offboard: bool) -> None:
        """Raises Refused if the vehicle lacks a topic of these types, or has it in an unknown layout; NotYet
        if the vehicle may still report it.

        Args:
            setpoint_types: setpoint types of the stream.
            in_offboard: whether the stream flies in Offboard, or else in a mode that is registered with PX4.
        """
        require_usable(self._unusable(setpoint_types, in_offboard=in_offboard))

    def _unusable(self, setpoint_types: Iterable[str], *, in_offboard: bool) -> UnusableTopic | None:
        unusable = self._unusable_topics()
        if not unusable:
            return None
        topics = (topic for each in setpoint_types for topic in topics_of(each, in_offboard=in_offboard))
        return next((unusable[topic] for topic in topics if topic in unusable), None)

    def _missing(self, setpoint_type: str, needs: tuple[Estimate, ...]) -> str | None:
        missing = next((need for need in needs if not self._has_estimate[need]()), None)
        return None if missing is None else _MISSING[missing].format(type=setpoint_type)

    def all(self) -> dict[str, Available]:
        """Availability of every type."""
        return {setpoint_type: self.for_type(setpoint_type) for setpoint_type in KINDS}

    def require(self, setpoint: Setpoint, *, in_offboard: bool) -> None:
        """Raises Refused if the setpoint cannot be flown now; `in_offboard`: see `require_topics`."""
        why_not = why_not_carried(setpoint.type, self._protocol())
        if why_not is not None:
            raise Refused(why_not, remedy="This type needs a ROS 2 link: add ros2://DOMAIN.")
        self.require_topics([setpoint.type], in_offboard=in_offboard)
        self.require_estimates(setpoint.type, needs_of(setpoint))


_AXES = ("north", "east", "down")


def axes_problem(
    position: Partial3 = UNCONTROLLED,
    velocity: Partial3 = UNCONTROLLED,
    acceleration: Partial3 = UNCONTROLLED,
) -> str | None:
    """Why PX4 would not fly this combination of axes; None if PX4 would fly it."""
    named = {
        "position_ned_m": position,
        "velocity_ned_m_s": velocity,
        "acceleration_ned_m_s2": acceleration,
    }
    if all(value is None for vector in named.values() for value in vector):
        return (
            "Only yaw is controlled: PX4 refuses a setpoint without position, velocity or acceleration. "
            "Give the current position to turn on the spot."
        )
    for name, (north, east, _) in named.items():
        if (north is None) != (east is None):
            return f"{name}: north and east are needed together; PX4 does not fly one without the other."
    for axis, name in enumerate(_AXES):
        if all(vector[axis] is None for vector in named.values()):
            return (
                f"{name} is not controlled: PX4 stops instead of flying the rest. Give a position, a "
                "velocity or an acceleration on every axis (type trajectory mixes them)."
            )
    return None


def problem_of(setpoint: Setpoint) -> str | None:
    """Why PX4 would never fly this setpoint, in any state of the vehicle; None if PX4 can fly it."""
    if isinstance(setpoint, Position):
        return axes_problem(position=setpoint.position_ned_m)
    if isinstance(setpoint, Velocity):
        return axes_problem(velocity=setpoint.velocity_ned_m_s)
    if isinstance(setpoint, Acceleration):
        return axes_problem(acceleration=setpoint.acceleration_ned_m_s2)
    if isinstance(setpoint, Trajectory):
        return axes_problem(
            setpoint.position_ned_m, setpoint.velocity_ned_m_s, setpoint.acceleration_ned_m_s2
        )
    return None


SETPOINT_MAX_DISTANCE_M = 1000.0
MAX_PATH_START_DISTANCE_M = 5.0
PATH_CHECK_PERIOD_S = 0.2
"""Time between two checked positions of a path [s]."""
SPEED_TOLERANCE = 1.05
"""Factor by which a curve may exceed the speed limit between its points."""
LIMITS_REMEDY = "Wait for GPS and the estimator, or remove the limits of altitude, distance and geofence."
LOCAL_FRAME_HINT = "Coordinates are metres north, east, down of the vehicle's local origin."


def check_segments(
    segments: Iterable[Segment], snapshot: Snapshot, floor: Floor, *, has_position_limits: bool
) -> None:
    """Checks that a mission, or a part of it, stays inside the position limits and above the ground.

    Args:
        segments: segments of the mission, in the local frame.
        snapshot: the vehicle, with its bounds.
        floor: the lowest altitudes.
        has_position_limits: whether the operator has set position limits.

    Raises:
        Refused: the path leaves the limits or goes below the ground, or the limits cannot be enforced.
    """
    bounds = snapshot.bounds
    if has_position_limits and bounds.enforcement_problem is not None:
        raise Refused(
            f"The operator's limits cannot be enforced: {bounds.enforcement_problem}.", remedy=LIMITS_REMEDY
        )
    region = bounds.region
    for segment in segments:
        positions = _positions(segment)
        if isinstance(segment, WaitSegment) and segment.kind == "land":
            positions = positions[:0]  # the landing descends to the ground, whose altitude is unknown
        if not isinstance(segment, VelocitySegment):
            place = f"The path at {segment.place} ({segment.title})"
            _check_local_floor(positions, place, snapshot, snapshot.position_ned_m, floor)
        outside = region.are_outside(positions[:, :2]) | (positions[:, 2] < region.down_min_m)
        outside |= positions[:, 2] > region.down_max_m
        for index in np.flatnonzero(outside)[:1]:
            north, east, down = positions[index].tolist()
            breach = _breach((north, east, down), bounds) or "the limits"
            raise Refused(
                f"The mission leaves {breach} at {segment.place} ({segment.title}).",
                remedy="Change that step, or the limit.",
            )


def _positions(segment: Segment) -> NDArray[np.float64]:
    """Positions of a segment, (N, 3) [m]."""
    if isinstance(segment, CurveSegment | TableSegment):
        duration_s = segment.duration_s
        times_s = np.minimum(
            np.arange(math.ceil(duration_s / PATH_CHECK_PERIOD_S) + 1) * PATH_CHECK_PERIOD_S, duration_s
        )
        if isinstance(segment, CurveSegment):
            return segment.curve.sample(times_s).position_ned_m
        return segment.path.sample(times_s)[0]
    return np.array([segment.end_ned_m])


def check_target(
    setpoint: Setpoint, now_s: float, snapshot: Snapshot, floor: Floor, *, has_position_limits: bool
) -> None:
    """Checks that the vehicle may fly to the target.

    Args:
        setpoint: the setpoint; the estimates that it needs are valid.
        now_s: current time [s, monotonic].
        snapshot: the vehicle, with its bounds.
        floor: the lowest altitudes.
        has_position_limits: whether the operator has set position limits.

    Raises:
        Refused: the target is below the ground, too far away, outside the limits, or too fast, or the limits
            cannot be enforced.
    """
    bounds, position_now = snapshot.bounds, snapshot.position_at(now_s)
    if not floor.knows_nothing:
        _check_floor(setpoint, now_s, snapshot, floor)
    if has_position_limits and (bounds.enforcement_problem is not None or position_now is None):
        why = bounds.enforcement_problem or "the vehicle has no valid position estimate"
        raise Refused(
            f"The operator's limits cannot be enforced: {why}.",
            remedy=LIMITS_REMEDY,
        )
    if position_now is None:
        return
    if isinstance(setpoint, Path):
        check_path(setpoint, position_now, bounds)
    elif not isinstance(
        setpoint, Follow | FollowDevice
    ):  # their paths are unknown; the limits apply in flight
        target = _target_of(ResolvedSetpoint(setpoint, now_s, snapshot, 0.0).at(now_s, snapshot), bounds)
        if target is not None:
            _check_distance(target, position_now, "The target")
            _check_inside(target, position_now, bounds)


def _check_floor(setpoint: Setpoint, now_s: float, snapshot: Snapshot, floor: Floor) -> None:
    """Raises Refused if the setpoint fixes an altitude below the ground; a velocity fixes none."""
    position_now = snapshot.position_at(now_s)
    if isinstance(setpoint, Path):
        _check_local_floor(_path_positions(setpoint), "The path", snapshot, position_now, floor)
        return
    if snapshot.leader is not None:  # where the leader is now, not raised to the floor as in flight
        snapshot = replace(snapshot, leader=replace(snapshot.leader, lowest_down_m=None))
    try:
        target = ResolvedSetpoint(setpoint, now_s, snapshot, 0.0).at(now_s, snapshot)
    except ValueError:
        return  # an estimate is missing, for which the setpoint is refused
    if isinstance(target, PositionGlobal) and target.alt_amsl_m is not None:
        origin = snapshot.bounds.origin
        vehicle = None if origin is None or position_now is None else origin.to_geodetic(position_now)
        lat_deg, lon_deg = np.array([target.lat_deg]), np.array([target.lon_deg])
        too_low = floor.too_low(lat_deg, lon_deg, np.array([target.alt_amsl_m]), vehicle)
        _require_high_enough(too_low, "The target")
    elif isinstance(target, Position | Trajectory) and target.position_ned_m[2] is not None:
        north, east, down = target.position_ned_m
        origin = snapshot.bounds.origin
        if origin is not None and down is not None and floor.is_clear(origin.alt_amsl_m - down):
            return  # the usual case, without arrays for a single position
        here = position_now or (0.0, 0.0, 0.0)
        # without a horizontal target, the ground below the vehicle counts
        place = (here[0] if north is None else north, here[1] if east is None else east, down)
        _check_local_floor(np.array([place]), "The target", snapshot, position_now, floor)


def _check_local_floor(
    positions_ned_m: NDArray[np.float64],
    name: str,
    snapshot: Snapshot,
    position_now: Vector3 | None,
    floor: Floor,
) -> None:
    origin = snapshot.bounds.origin
    if origin is None or floor.knows_nothing or not len(positions_ned_m):
        return
    vehicle = None if position_now is None else origin.to_geodetic(position_now)
    lat_deg, lon_deg, alt_amsl_m = origin.to_geodetic_arrays(positions_ned_m)
    _require_high_enough(floor.too_low(lat_deg, lon_deg, alt_amsl_m, vehicle), name)


def _require_high_enough(too_low: TooLow | None, name: str) -> None:
    if too_low is not None:
        raise Refused(f"{name} is {too_low.text}.", remedy=too_low.remedy)


def _path_positions(path: Path) -> NDArray[np.float64]:
    """The points of a path and positions between them, (N, 3) [m]."""
    curve = PathCurve.of(path, None)
    times_s = np.append(np.arange(0.0, curve.duration_s, PATH_CHECK_PERIOD_S), curve.duration_s)
    points = np.array([point.position_ned_m for point in path.points])
    return np.concatenate((points, curve.sample(times_s)[0]))


def _target_of(setpoint: DirectSetpoint | None, bounds: Bounds) -> Vector3 | None:
    if isinstance(setpoint, Position | Trajectory):
        return complete_vector(setpoint.position_ned_m)
    if isinstance(setpoint, PositionGlobal) and bounds.origin is not None and setpoint.alt_amsl_m is not None:
        return bounds.origin.to_ned(setpoint.lat_deg, setpoint.lon_deg, setpoint.alt_amsl_m)
    return None


def _check_distance(target: Vector3, position_now: Vector3, target_name: str) -> None:
    distance_m = math.dist(target, position_now)
    if distance_m > SETPOINT_MAX_DISTANCE_M:
        raise Refused(
            f"{target_name} is {distance_m:.0f} m from the vehicle; setpoints may be at most "
            f"{SETPOINT_MAX_DISTANCE_M:.0f} m away.",
            remedy=LOCAL_FRAME_HINT,
        )


def _check_inside(target: Vector3, position_now: Vector3, bounds: Bounds) -> None:
    breach = _breach(target, bounds)
    if breach is not None:
        raise Refused(
            f"The target is outside {breach}.",
            remedy="Choose a position inside the limit, or change the limit.",
        )
    region, start, end = bounds.region, (position_now[0], position_now[1]), (target[0], target[1])
    distance_m = math.dist(start, end)
    if distance_m < 1e-6 or region.breach(start) is not None:
        return  # from outside, the vehicle may fly back inside
    direction = ((end[0] - start[0]) / distance_m, (end[1] - start[1]) / distance_m)
    if region.distance_to_edge_m(start, direction) < distance_m:
        raise Refused(
            "The straight line to the target leaves the geofence.",
            remedy="Fly around the corner: with a position in between, or with a path.",
        )


def _breach(position: Vector3, bounds: Bounds) -> str | None:
    """The name of a limit that the position violates; None: the position is inside all limits."""
    region = bounds.region
    if region.clamp_down_m(position[2]) != position[2]:
        return "the altitude limits"
    return region.breach((position[0], position[1]))


def check_path(path: Path, position_now: Vector3, bounds: Bounds) -> None:
    """Raises Refused if the path begins too far away, leaves the limits, or is too fast."""
    begin = path.points[0].position_ned_m
    distance_m = math.dist(begin, position_now)
    if distance_m > MAX_PATH_START_DISTANCE_M:
        raise Refused(
            f"The path begins {distance_m:.1f} m away; it must begin within {MAX_PATH_START_DISTANCE_M:g} m.",
            remedy="Fly to the first point of the path first.",
        )
    for index, point in enumerate(path.points):
        _check_distance(point.position_ned_m, position_now, f"Point {index} of the path")
    curve = PathCurve.of(path, None)
    times_s = np.minimum(
        np.arange(math.ceil(curve.duration_s / PATH_CHECK_PERIOD_S) + 1) * PATH_CHECK_PERIOD_S,
        curve.duration_s,
    )
    for index in np.flatnonzero(_violations(*curve.sample(times_s), bounds)):
        t_s = float(times_s[index])
        sample = curve.at(t_s)
        position, velocity = complete_vector(sample.position_ned_m), complete_vector(sample.velocity_ned_m_s)
        assert position is not None
        assert velocity is not None
        breach = _breach(position, bounds)
        if breach is not None:
            raise Refused(
                f"After {t_s:.1f} s the path is outside {breach}.",
                remedy="The curve swings beyond its points where it turns: keep the points further inside.",
            )
        speed_problem = _speed_problem(velocity, bounds)
        if speed_problem is not None:
            raise Refused(f"After {t_s:.1f} s {speed_problem}.", remedy="Give the points more time.")


def _violations(
    positions: NDArray[np.float64], velocities: NDArray[np.float64], bounds: Bounds
) -> NDArray[np.bool_]:
    """For each sample of a path: whether it is outside the limits or too fast."""
    region, down_m, down_m_s = bounds.region, positions[:, 2], velocities[:, 2]
    return (
        region.are_outside(positions[:, :2])
        | (down_m < region.down_min_m)
        | (down_m > region.down_max_m)
        | (np.hypot(velocities[:, 0], velocities[:, 1]) > bounds.speed_m_s * SPEED_TOLERANCE)
        | (-down_m_s > bounds.climb_m_s * SPEED_TOLERANCE)
        | (down_m_s > bounds.descent_m_s * SPEED_TOLERANCE)
    )


def _speed_problem(velocity: Vector3, bounds: Bounds) -> str | None:
    speed, velocity_down_m_s = math.hypot(velocity[0], velocity[1]), velocity[2]
    if speed > bounds.speed_m_s * SPEED_TOLERANCE:
        return f"the path flies at {speed:.1f} m/s; at most {bounds.speed_m_s:g} m/s are allowed"
    if -velocity_down_m_s > bounds.climb_m_s * SPEED_TOLERANCE:
        return (
            f"the path climbs at {-velocity_down_m_s:.1f} m/s; at most {bounds.climb_m_s:g} m/s are allowed"
        )
    if velocity_down_m_s > bounds.descent_m_s * SPEED_TOLERANCE:
        return (
            f"the path descends at {velocity_down_m_s:.1f} m/s; "
            f"at most {bounds.descent_m_s:g} m/s are allowed"
        )
    return None
