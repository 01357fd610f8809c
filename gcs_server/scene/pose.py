"""Converts a vehicle's topics to the pose that is drawn, one frozen value per update. No I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs_server.scene.frames import enu_from_ned, q_enu_flu_from_q_ned_frd, q_ned_camera, yaw_enu_from_ned
from gcs_server.scene.model import Points
from gcs_server.scene.placement import VehiclePlace
from gcs_server.scene.ports import OffboardTarget, SceneVehicle, value_of
from gcs_server.scene.texts import altitude_text
from gcs_server.vehicle.samples import Attitude, Gimbal, Motors, Status, TargetLocal
from gcs_server.vehicle.scans import scans_of
from missions.avoidance.scans import LEVEL_MAX_SINE, recent_scans
from missions.frames import IDENTITY, Quaternion, Vector3, conjugate, multiply, normalized

DRAWN_FOR_S = 2.5
"""Time for which a measured point is drawn [s]; by default PX4 sends DISTANCE_SENSOR every two seconds."""
HALF_HEIGHT_M = 0.18
"""Half the height of the stroke that marks a point [m]."""


def measured_points(
    vehicle: SceneVehicle, q_ned_frd: Quaternion, position_enu_m: Vector3, now_monotonic_s: float
) -> tuple[Vector3, ...]:
    """The measured points, except those of sensors that point down."""
    samples = (vehicle.topic("distance_sensors"), vehicle.topic("obstacle_distance"))
    if samples == (None, None):
        return ()
    x, y, z = position_enu_m
    points: list[Vector3] = []
    for scan in recent_scans(scans_of(samples, q_ned_frd, now_monotonic_s), now_monotonic_s, DRAWN_FOR_S):
        for (n, e, d), distance_m in zip(scan.directions_ned, scan.distances_m, strict=True):
            if distance_m is not None and d <= LEVEL_MAX_SINE:
                east, north, up = enu_from_ned((n * distance_m, e * distance_m, d * distance_m))
                points.append((x + east, y + north, z + up))
    return tuple(points)


def upright_lines(points_enu_m: tuple[Vector3, ...]) -> Points:
    """An upright line at each point, (N, 2, 3), which is visible from all sides."""
    points = np.asarray(points_enu_m, np.float32).reshape(-1, 1, 3)
    half = np.asarray([[0.0, 0.0, -HALF_HEIGHT_M], [0.0, 0.0, HALF_HEIGHT_M]], np.float32)
    return points + half


PWM_STOPPED_US = 1000
PWM_FULL_US = 2000
TARGET_FRESH_S = 1.5
"""Age up to which a reported target is drawn [s]; PX4 sends POSITION_TARGET_LOCAL_NED at 10 Hz while it
follows a target."""
VELOCITY_TARGET_S = 1.0
"""A velocity setpoint is drawn as the position that the vehicle reaches in this time [s]."""


@dataclass(frozen=True, slots=True)
class Target:
    """The current target, in the world's ENU."""

    position_enu_m: Vector3
    yaw_enu_rad: float | None
    is_velocity: bool
    """Whether the position is extrapolated from a velocity setpoint."""


@dataclass(frozen=True, slots=True)
class VehiclePose:
    """The pose and the texts of one vehicle for drawing."""

    position_enu_m: Vector3
    q_enu_flu: Quaternion
    ground_z_m: float
    home_enu_m: Vector3 | None
    q_body_camera: Quaternion | None
    """Rotation of the camera from its forward-left-up axes to those of the body; None: no gimbal has
    reported.
    """
    motors: tuple[float, float, float, float] | None
    """Commanded effort of PX4's motors 1–4, 0 to 1; None if the vehicle does not report it."""
    target: Target | None
    lost: bool
    """Whether the connection to the vehicle is lost."""
    label: str
    note: str
    """Note after the label: simulated, replayed, lost, no position; otherwise empty."""
    measured_points_enu_m: tuple[Vector3, ...] = ()
    """Points measured by the vehicle's distance sensors."""


def pose_of(
    vehicle: SceneVehicle, place: VehiclePlace, offboard: OffboardTarget | None, now_monotonic_s: float
) -> VehiclePose:
    """The pose from a vehicle's newest samples."""
    attitude = value_of(vehicle, "attitude", Attitude)
    status = value_of(vehicle, "status", Status)
    q_ned_frd = (normalized(attitude.q_ned_frd) if attitude else None) or IDENTITY
    yaw_ned_rad = attitude.yaw_ned_rad if attitude else 0.0
    lost = status is not None and status.link_lost
    return VehiclePose(
        position_enu_m=place.position_enu_m,
        q_enu_flu=q_enu_flu_from_q_ned_frd(q_ned_frd),
        ground_z_m=place.ground_z_m,
        home_enu_m=place.home_enu_m,
        q_body_camera=gimbal_in_body(value_of(vehicle, "gimbal", Gimbal), q_ned_frd, yaw_ned_rad),
        motors=motor_efforts(value_of(vehicle, "motors", Motors), armed=status is not None and status.armed),
        target=None if lost else _target(vehicle, place, offboard, now_monotonic_s),
        lost=lost,
        label=_label(vehicle.id, place),
        note=_note(vehicle, place, lost),
        measured_points_enu_m=(
            () if lost else measured_points(vehicle, q_ned_frd, place.position_enu_m, now_monotonic_s)
        ),
    )


def gimbal_in_body(gimbal: Gimbal | None, q_ned_frd: Quaternion, yaw_ned_rad: float) -> Quaternion | None:
    """Rotation of the camera relative to the airframe, both in FLU."""
    q = normalized(gimbal.q) if gimbal else None
    if gimbal is None or q is None:
        return None
    q_camera = q_ned_camera(q, yaw_in_earth_frame=gimbal.yaw_in_earth_frame, vehicle_yaw_ned_rad=yaw_ned_rad)
    return normalized(
        multiply(conjugate(q_enu_flu_from_q_ned_frd(q_ned_frd)), q_enu_flu_from_q_ned_frd(q_camera))
    )


def motor_efforts(motors: Motors | None, *, armed: bool) -> tuple[float, float, float, float] | None:
    """PWM of the first four outputs as 0 to 1; 0 if the vehicle is disarmed."""
    if motors is None or len(motors.pwm_us) < 4:
        return None
    if not armed:
        return (0.0, 0.0, 0.0, 0.0)
    span = PWM_FULL_US - PWM_STOPPED_US
    a, b, c, d = (min(1.0, max(0.0, (pwm - PWM_STOPPED_US) / span)) for pwm in motors.pwm_us[:4])
    return (a, b, c, d)


def _target(
    vehicle: SceneVehicle, place: VehiclePlace, offboard: OffboardTarget | None, now_monotonic_s: float
) -> Target | None:
    origin = place.local_origin_enu_m
    if origin is None:
        return None
    target = offboard
    if target is None:
        sample = vehicle.topic("target_local")
        if sample is None or not isinstance(sample.value, TargetLocal):
            return None
        if now_monotonic_s - sample.received_monotonic_s > TARGET_FRESH_S:
            return None
        status = value_of(vehicle, "status", Status)
        if status is not None and not status.armed:
            return None
        target = OffboardTarget(
            position_ned_m=_complete_vector(sample.value.position_ned_m),
            velocity_ned_m_s=_complete_vector(sample.value.velocity_ned_m_s),
            yaw_ned_rad=sample.value.yaw_ned_rad,
        )
    yaw_enu_rad = None if target.yaw_ned_rad is None else yaw_enu_from_ned(target.yaw_ned_rad)
    if target.position_ned_m is not None:
        offset_enu_m = enu_from_ned(target.position_ned_m)
        return Target(
            (origin[0] + offset_enu_m[0], origin[1] + offset_enu_m[1], origin[2] + offset_enu_m[2]),
            yaw_enu_rad,
            False,
        )
    if target.velocity_ned_m_s is not None:
        v = enu_from_ned(target.velocity_ned_m_s)
        p, t = place.position_enu_m, VELOCITY_TARGET_S
        return Target((p[0] + v[0] * t, p[1] + v[1] * t, p[2] + v[2] * t), yaw_enu_rad, True)
    return None


def _complete_vector(v: tuple[float | None, float | None, float | None]) -> Vector3 | None:
    a, b, c = v
    if a is None or b is None or c is None or not all(math.isfinite(x) for x in (a, b, c)):
        return None
    return (a, b, c)


def _label(vehicle_id: str, place: VehiclePlace) -> str:
    if not place.position_known:
        return vehicle_id
    return f"{vehicle_id} · {altitude_text(place.height_m, above_home=place.home_enu_m is not None)}"


def _note(vehicle: SceneVehicle, place: VehiclePlace, lost: bool) -> str:
    notes = (
        (lost, "connection lost"),
        (not place.position_known, "no position"),
        (vehicle.identity.simulated is True, "simulated"),
        (vehicle.identity.simulated is None, "may be real"),
        (vehicle.identity.replayed, "replayed"),
    )
    return ", ".join(text for applies, text in notes if applies)
