"""Passes VISION_POSITION_ESTIMATE and ODOMETRY to the estimator."""

from __future__ import annotations

import math

import numpy as np

from vehicle_sim.estimator.vision import UNKNOWN, Vector, VisionSample
from vehicle_sim.frames import euler_of, rotation_matrix
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link

LOCAL_NED, BODY_FRD, LOCAL_FRD = 1, 12, 20
"""MAV_FRAME. LOCAL_FRD is level; its forward axis has the initial heading of the external estimator."""
MAX_COORDINATE_M, MAX_SPEED_M_S = 1e6, 1e3
"""Values from these limits upwards count as invalid."""


class VisionService:
    """Receives external estimates of position, velocity and heading."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {"VISION_POSITION_ESTIMATE": self.position, "ODOMETRY": self.odometry}

    def position(self, link: Link, m: Message) -> None:
        """Handles VISION_POSITION_ESTIMATE: position and heading in NED."""
        covariance = m.covariance
        self._add_sample(
            VisionSample(
                position_ned_m=_valid_or_unknown((m.x, m.y, m.z), MAX_COORDINATE_M),
                heading_rad=m.yaw if abs(m.yaw) < 10.0 else math.nan,
                position_variance_m2=max(covariance[0], covariance[6], covariance[11]),
            )
        )

    def odometry(self, link: Link, m: Message) -> None:
        """Handles ODOMETRY: pose in LOCAL_NED or LOCAL_FRD, velocity in the pose's frame or in BODY_FRD.
        A pose in another frame is ignored with its velocity; a velocity in another frame is unknown."""
        if m.frame_id not in (LOCAL_NED, LOCAL_FRD):
            return
        q = np.array([m.q], dtype=float)
        norm = float(np.linalg.norm(q))
        has_attitude = math.isfinite(norm) and norm > 0.1
        q = q / norm if has_attitude else q
        heading = float(euler_of(q)[0, 2]) if has_attitude else math.nan
        frame_yaw_rad = 0.0
        if m.frame_id == LOCAL_FRD:
            if not has_attitude:
                return
            frame_yaw_rad = self._context.view.estimate.yaw_ned_rad - heading
            heading = math.nan
        velocity = _valid_or_unknown((m.vx, m.vy, m.vz), MAX_SPEED_M_S)
        if m.child_frame_id == BODY_FRD:
            velocity = _to_vector(rotation_matrix(q)[0] @ np.array(velocity)) if has_attitude else UNKNOWN
        elif m.child_frame_id != m.frame_id:
            velocity = UNKNOWN
        position = _valid_or_unknown((m.x, m.y, m.z), MAX_COORDINATE_M)
        self._add_sample(
            VisionSample(
                position_ned_m=_rotated_in_yaw(position, frame_yaw_rad),
                velocity_ned_m_s=_rotated_in_yaw(velocity, frame_yaw_rad),
                heading_rad=heading,
                position_variance_m2=max(m.pose_covariance[0], m.pose_covariance[6], m.pose_covariance[11]),
                velocity_variance_m2_s2=max(
                    m.velocity_covariance[0], m.velocity_covariance[6], m.velocity_covariance[11]
                ),
            )
        )

    def _add_sample(self, sample: VisionSample) -> None:
        view = self._context.view
        view.simulation.add_vision(view.row, sample)


def _valid_or_unknown(values: Vector, limit: float) -> Vector:
    return values if all(abs(value) < limit for value in values) else UNKNOWN


def _rotated_in_yaw(vector: Vector, angle_rad: float) -> Vector:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]


def _to_vector(values: np.ndarray) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])
