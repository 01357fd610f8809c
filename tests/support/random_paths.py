"""Random points, shapes and limits for trajectories, from a seed."""

from __future__ import annotations

import numpy as np

from missions.trajectory.limits import MotionLimits
from missions.trajectory.points import PassPoint


def random_limits(rng: np.random.Generator) -> MotionLimits:
    """Random limits within the range of PX4's parameters."""
    return MotionLimits(
        speed_m_s=rng.uniform(1.0, 20.0),
        climb_m_s=rng.uniform(0.5, 8.0),
        descent_m_s=rng.uniform(0.5, 4.0),
        acceleration_m_s2=rng.uniform(2.0, 15.0),
        acceleration_up_m_s2=rng.uniform(2.0, 15.0),
        acceleration_down_m_s2=rng.uniform(2.0, 8.0),
        jerk_m_s3=rng.uniform(1.0, 80.0),
        tilt_rad=rng.uniform(0.3, 1.2),
        yaw_rate_rad_s=rng.uniform(0.1, 3.0),
        yaw_acceleration_rad_s2=rng.uniform(0.1, 6.0),
    )


def random_points(rng: np.random.Generator, count: int, yaws: bool) -> list[PassPoint]:
    """A random walk with steps from centimetres to hundreds of metres, stops, reversals and repeated
    points."""
    position = rng.uniform(-50.0, 50.0, 3)
    points: list[PassPoint] = []
    for _ in range(count):
        points.append(
            PassPoint(
                (float(position[0]), float(position[1]), float(position[2])),
                float(rng.uniform(-4.0, 4.0)) if yaws and rng.random() < 0.7 else None,
                stop=bool(rng.random() < 0.15),
                corner_m=float(rng.choice([0.0, 0.05, 0.5, 2.0, 20.0])),
            )
        )
        displacement_m = rng.normal(0.0, 1.0, 3) * 10.0 ** rng.uniform(-2.0, 2.3)
        choice = rng.random()
        if choice < 0.08 and len(points) > 1:  # a reversal
            displacement_m = np.array(points[-2].position_ned_m) - position
        elif choice < 0.16:  # a repeated point
            displacement_m = np.zeros(3)
        elif choice < 0.24:  # vertical
            displacement_m[:2] = 0.0
        elif choice < 0.4:  # level
            displacement_m[2] = 0.0
        position = position + displacement_m
    return points
