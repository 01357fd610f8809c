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
"""MAV_FRAME. LOCAL_FRD is level; its forward axis is the initial heading of the external system."""
MAX_COORDINATE_M, FASTEST_M_S = 1e6, 1e3
"""Larger values are treated as invalid messages."""


class VisionService:
    """Receives external position estimates."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {"VISION_POSITION_ESTIMATE": self.position, "ODOMETRY": self.odometry}

    def position(self, link: Link, m: Message) -> None:
        """Handles VISION_POSITION_ESTIMATE: position and heading in NED."""
        covariance = m.covariance
        self._take(
            VisionSample(
                position_ned_m=_usable((m.x, m.y, m.z), MAX_COORDINATE_M),
                heading_rad=m.yaw if abs(m.yaw) < 10.0 else math.nan,
                position_variance_m2=max(covariance[0], covariance[6], covariance[11]),
            )
        )

    def odometry(self, link: Link, m: Message) -> None:
        """Handles ODOMETRY: pose in LOCAL_NED or LOCAL_FRD, velocity in the same frame or in BODY_FRD; other
        frames are ignored."""
        if m.frame_id not in (LOCAL_NED, LOCAL_FRD):
            return
        q = np.array([m.q], dtype=float)
        norm = float(np.linalg.norm(q))
        oriented = math.isfinite(norm) and norm > 0.1
        q = q / norm if oriented else q
        heading = float(euler_of(q)[0, 2]) if oriented else math.nan
        turn = 0.0
        if m.frame_id == LOCAL_FRD:
            if not oriented:
                return
            turn = self._context.view.estimate.yaw_ned_rad - heading
            heading = math.nan
        velocity = _usable((m.vx, m.vy, m.vz), FASTEST_M_S)
        if m.child_frame_id == BODY_FRD:
            velocity = _vector(rotation_matrix(q)[0] @ np.array(velocity)) if oriented else UNKNOWN
        elif m.child_frame_id != m.frame_id:
            velocity = UNKNOWN
        self._take(
            VisionSample(
                position_ned_m=_turned(_usable((m.x, m.y, m.z), MAX_COORDINATE_M), turn),
                velocity_ned_m_s=_turned(velocity, turn),
                heading_rad=heading,
                position_variance_m2=max(m.pose_covariance[0], m.pose_covariance[6], m.pose_covariance[11]),
                velocity_variance_m2_s2=max(
                    m.velocity_covariance[0], m.velocity_covariance[6], m.velocity_covariance[11]
                ),
            )
        )

    def _take(self, sample: VisionSample) -> None:
        view = self._context.view
        view.simulation.add_vision(view.row, sample)


def _usable(values: Vector, largest: float) -> Vector:
    return values if all(abs(value) < largest for value in values) else UNKNOWN


def _turned(vector: Vector, angle_rad: float) -> Vector:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]


def _vector(values: np.ndarray) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])
