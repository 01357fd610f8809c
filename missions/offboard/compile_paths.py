"""Compiles path steps to segments: the approach to the start, the turn, the path and its photos."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from missions.errors import PlanError
from missions.frames import Vector3, q_from_euler, wrap_pi
from missions.offboard import tables
from missions.offboard.segments import (
    AttitudeSegment,
    CurveSegment,
    Event,
    HoldSegment,
    TableSegment,
    VelocitySegment,
)
from missions.offboard.state import State
from missions.offboard.steps import (
    AttitudeStep,
    FigureEight,
    Fly,
    FlyPoint,
    Helix,
    Hold,
    Orbit,
    PathStep,
    Photo,
    Spiral,
    Table,
    VelocityStep,
)
from missions.setpoints import Attitude
from missions.trajectory import ramps, shapes
from missions.trajectory.curve import TimedCurve
from missions.trajectory.headings import AlongPath, LookAt
from missions.trajectory.limits import MotionLimits
from missions.trajectory.points import SAME_POINT_M, PassPoint
from missions.trajectory.solve import Heading, curve_along_path, curve_through_points

MIN_TURN_RAD = math.radians(1.0)
"""Smaller heading changes get no separate turn."""
MAX_PHOTOS = 10_000
"""Maximum number of photos of one segment."""


def compile_hold(state: State, step: Hold) -> None:
    """Adds a turn if a yaw is given, then a hold of the position."""
    if step.yaw_ned_rad is not None:
        turn_to(state, step.yaw_ned_rad)
    hold_position(state, step.duration_s)


def hold_position(
    state: State, duration_s: float, events: tuple[Event, ...] = (), title: str | None = None
) -> None:
    """Adds a segment that holds the current position."""
    state.add(
        HoldSegment(
            state.place, title or state.title, duration_s, state.position_ned_m, state.yaw_ned_rad,
            gimbal=state.gimbal, events=events,
        )
    )  # fmt: skip


def compile_photo(state: State, step: Photo) -> None:
    """Adds a hold of the position with the photos."""
    events = tuple(Event(k * step.interval_s, "photo", step.component) for k in range(step.count))
    hold_position(state, (step.count - 1) * step.interval_s, events)


def turn_to(state: State, yaw_ned_rad: float) -> None:
    """Adds a turn on the spot if the heading differs."""
    if abs(wrap_pi(yaw_ned_rad - state.yaw_ned_rad)) < MIN_TURN_RAD:
        return
    position_ned_m = state.position_ned_m
    curve = curve_through_points(
        [PassPoint(position_ned_m, state.yaw_ned_rad), PassPoint(position_ned_m, yaw_ned_rad)],
        state.compilation.motion,
    )
    add_curve(state, curve, "Turn")


def add_curve(state: State, curve: TimedCurve, title: str, photo_every_m: float | None = None) -> None:
    """Adds a curve that starts at the current position."""
    end = curve.at(curve.duration_s)
    n, e, d = (float(axis or 0.0) for axis in end.position_ned_m)
    yaw_rad = state.yaw_ned_rad if end.yaw_ned_rad is None else end.yaw_ned_rad
    events = () if photo_every_m is None else _photos(curve, photo_every_m)
    state.add(
        CurveSegment(
            state.place, title, curve.duration_s, (n, e, d), yaw_rad, curve.length_m, state.gimbal, events,
            curve=curve,
        )
    )  # fmt: skip


def _photos(curve: TimedCurve, every_m: float) -> tuple[Event, ...]:
    """A photo event at the start and after every `every_m` metres."""
    if curve.length_m / every_m > MAX_PHOTOS:
        reason = f"{curve.length_m / every_m:.0f} photos, the maximum is {MAX_PHOTOS}"
        raise PlanError("field photo_every_m", reason, "Give a larger distance.")
    times = np.linspace(0.0, curve.duration_s, 20 * (10 + int(curve.duration_s)))
    positions_ned_m = curve.sample(times).position_ned_m
    flown_m = np.concatenate(([0.0], np.cumsum(np.sqrt((np.diff(positions_ned_m, axis=0) ** 2).sum(axis=1)))))
    picture_at_m = np.arange(0.0, flown_m[-1], every_m)
    return tuple(Event(t, "photo") for t in np.interp(picture_at_m, flown_m, times).tolist())


def compile_fly(state: State, step: Fly) -> None:
    """Adds paths through the points; a point with a hold time ends one path and starts the next."""
    limits = state.limits_for(step)
    positions = [state.locate(point) for point in step.points]
    has_yaw = any(point.yaw_ned_rad is not None for point in step.points)
    first = 0
    for index, point in enumerate(step.points):
        if point.hold_s > 0.0 or index == len(step.points) - 1:
            path_points = list(zip(step.points[first : index + 1], positions[first : index + 1], strict=True))
            _add_path(state, step, path_points, limits, has_yaw=has_yaw)
            first = index + 1
            if point.hold_s > 0.0:
                hold_position(state, point.hold_s, title="Hold")


def _add_path(
    state: State,
    step: Fly,
    path_points: list[tuple[FlyPoint, Vector3]],
    limits: MotionLimits,
    *,
    has_yaw: bool,
) -> None:
    """Adds one path from the current position through some of the step's points."""
    points = [PassPoint(state.position_ned_m, state.yaw_ned_rad if has_yaw else None)]
    for point, position in path_points:
        points.append(PassPoint(position, point.yaw_ned_rad, point.stop, point.corner_m))
    state.compilation.add_size(points=len(points))
    heading = None if has_yaw else heading_of(state, step)
    curve = curve_through_points(points, limits, exact=step.curve == "smooth", heading=heading)
    _add_turn_and_curve(state, curve, step)


def heading_of(state: State, step: PathStep) -> Heading:
    """The heading during the step."""
    if step.heading == "along_path":
        return AlongPath(state.yaw_ned_rad)
    if step.look_at is not None:
        return LookAt(state.locate(step.look_at))
    return step.yaw_ned_rad


def _add_turn_and_curve(state: State, curve: TimedCurve, step: PathStep) -> None:
    """Adds a turn to the curve's first heading, then the curve."""
    start = curve.at(0.0)
    if start.yaw_ned_rad is not None:
        turn_to(state, start.yaw_ned_rad)
    if curve.duration_s > 0.0:
        add_curve(state, curve, state.title, step.photo_every_m)


def compile_shape(state: State, step: Orbit | FigureEight) -> None:
    """Adds an approach to the start of the shape, then the shape."""
    limits = state.limits_for(step)
    center = state.locate(step.center)
    if isinstance(step, FigureEight):
        path = shapes.figure_eight(
            center, step.length_m, step.width_m, step.rounds, heading_ned_rad=step.axis_ned_rad
        )
    else:
        path = shapes.arc(
            center, step.radius_m, step.turns,
            start_angle_ned_rad=_start_angle(state, center, step),
            clockwise=step.clockwise,
            climb_m=step.climb_m if isinstance(step, Helix | Spiral) else 0.0,
            end_radius_m=step.end_radius_m if isinstance(step, Spiral) else None,
        )  # fmt: skip
    state.compilation.add_size(points=len(path.spans))
    curve = curve_along_path(path, limits, heading_of(state, step))
    start = curve.at(0.0)
    _approach(state, _vector(start.position_ned_m), start.yaw_ned_rad, limits)
    add_curve(state, curve, state.title, step.photo_every_m)


def _start_angle(state: State, center: Vector3, step: Orbit) -> float:
    if step.start_angle_ned_rad is not None:
        return step.start_angle_ned_rad
    north, east = state.position_ned_m[0] - center[0], state.position_ned_m[1] - center[1]
    return math.atan2(east, north) if math.hypot(north, east) > SAME_POINT_M else 0.0


def _vector(position: tuple[float | None, float | None, float | None]) -> Vector3:
    n, e, d = position
    return (n or 0.0, e or 0.0, d or 0.0)


def _approach(state: State, start_ned_m: Vector3, yaw_ned_rad: float | None, limits: MotionLimits) -> None:
    """Adds a straight line to the start of a path; the vehicle turns on this line."""
    has_yaw = yaw_ned_rad is not None
    if math.dist(start_ned_m, state.position_ned_m) >= SAME_POINT_M:
        current_point = PassPoint(state.position_ned_m, state.yaw_ned_rad if has_yaw else None)
        add_curve(
            state,
            curve_through_points([current_point, PassPoint(start_ned_m, yaw_ned_rad)], limits),
            "Approach",
        )
    elif yaw_ned_rad is not None:
        turn_to(state, yaw_ned_rad)


def compile_table(state: State, step: Table) -> None:
    """Adds an approach to the start of the table, then the table with its own times."""
    data = state.compilation.table(step.file)
    offset = state.compilation.start.reference_ned_m if step.relative else (0.0, 0.0, 0.0)
    path = tables.read(data, offset, state.yaw_ned_rad)
    start = path.at(0.0)
    state.compilation.add_size(points=max(2, int(path.duration_s)))
    motion = state.compilation.motion
    cruise_m_s = min(motion.speed_m_s, state.compilation.vehicle.limits.vehicle.cruise_m_s)
    _approach(state, _vector(start.position_ned_m), start.yaw_ned_rad, replace(motion, speed_m_s=cruise_m_s))
    end = path.at(path.duration_s)
    times = np.linspace(0.0, path.duration_s, 2000)
    positions_ned_m, _ = path.sample(times)
    length_m = float(np.sqrt((np.diff(positions_ned_m, axis=0) ** 2).sum(axis=1)).sum())
    yaw_rad = state.yaw_ned_rad if end.yaw_ned_rad is None else end.yaw_ned_rad
    state.add(
        TableSegment(
            state.place, state.title, path.duration_s, _vector(end.position_ned_m), yaw_rad, length_m,
            state.gimbal, path=path,
        )
    )  # fmt: skip


def compile_velocity(state: State, step: VelocityStep) -> None:
    """Adds a straight line that is flown at a velocity for a time, from rest to rest."""
    if step.yaw_ned_rad is not None:
        turn_to(state, step.yaw_ned_rad)
    state.report(
        "position_not_held", "The velocity step does not control the position: wind moves the vehicle.",
        "Use a fly step if the position matters.",
    )  # fmt: skip
    north, east, down = step.velocity_ned_m_s
    horizontal_m_s, speed_m_s = math.hypot(north, east), math.hypot(north, east, down)
    motion = state.compilation.motion
    vertical_m_s = motion.descent_m_s if down > 0.0 else motion.climb_m_s
    if horizontal_m_s > motion.speed_m_s or abs(down) > vertical_m_s:
        message = f"The velocity {step.velocity_ned_m_s} m/s is above the vehicle's limits."
        state.report("speed_exceeded", message, "Lower the velocity.")
        return
    end, line = state.position_ned_m, curve_through_points([PassPoint(state.position_ned_m)], motion)
    if speed_m_s > 1e-3:
        acceleration_m_s2 = min(
            motion.horizontal_acceleration_m_s2 * speed_m_s / max(horizontal_m_s, 1e-9),
            motion.vertical_acceleration_m_s2 * speed_m_s / max(abs(down), 1e-9),
        )
        ramp_s = float(
            ramps.durations(np.array(speed_m_s), np.array(acceleration_m_s2), np.array(motion.jerk_m_s3))
        )
        if step.duration_s < 2.0 * ramp_s:
            message = (
                f"The velocity is not reached in {step.duration_s:g} s; {2.0 * ramp_s:.1f} s are needed."
            )
            state.report("duration_too_short", message, "Give more time, or a lower velocity.", 2.0 * ramp_s)
            return
        constant_speed_s = step.duration_s - ramp_s  # time for the same distance at constant speed
        end = _vector(
            tuple(p + v * constant_speed_s for p, v in zip(end, step.velocity_ned_m_s, strict=True))  # type: ignore[arg-type]
        )
        motion_in_step = replace(
            motion,
            speed_m_s=horizontal_m_s if horizontal_m_s > 1e-3 else motion.speed_m_s,
            climb_m_s=-down if down < -1e-3 else motion.climb_m_s,
            descent_m_s=down if down > 1e-3 else motion.descent_m_s,
        )
        line = curve_through_points([PassPoint(state.position_ned_m), PassPoint(end)], motion_in_step)
    state.add(
        VelocitySegment(
            state.place, state.title, step.duration_s, end, state.yaw_ned_rad,
            math.dist(state.position_ned_m, end), state.gimbal, line=line,
        )
    )  # fmt: skip


def compile_attitude(state: State, step: AttitudeStep) -> None:
    """Adds an attitude for a time. The position at its end is unknown, so the next step is planned from the
    position at its start."""
    yaw_rad = state.yaw_ned_rad if step.yaw_ned_rad is None else step.yaw_ned_rad
    turn_to(state, yaw_rad)
    tilt_rad = math.acos(math.cos(step.roll_rad) * math.cos(step.pitch_rad))
    if tilt_rad > state.compilation.motion.tilt_rad:
        limit_deg = math.degrees(state.compilation.motion.tilt_rad)
        message = f"The attitude tilts by {math.degrees(tilt_rad):.0f}°, the limit is {limit_deg:.0f}°."
        state.report("tilt_exceeded", message, "Lower roll or pitch.", state.compilation.motion.tilt_rad)
        return
    state.needs.add("heading")
    state.report(
        "position_not_held", "The attitude step controls neither position nor altitude.",
        "Keep the step short, and fly it high above the ground.",
    )  # fmt: skip
    setpoint = Attitude(q_from_euler(step.roll_rad, step.pitch_rad, yaw_rad), step.thrust)
    state.add(
        AttitudeSegment(
            state.place, state.title, step.duration_s, state.position_ned_m, yaw_rad, gimbal=state.gimbal,
            attitude=setpoint,
        )
    )  # fmt: skip
