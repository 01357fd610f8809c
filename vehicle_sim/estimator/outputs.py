"""Creates the initial estimates of a fleet, and resets the estimate of a vehicle that restarts."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from vehicle_sim.state import EstimateState

_NAN_FIELDS = frozenset(
    {
        "lat_deg",
        "lon_deg",
        "alt_amsl_m",
        "origin_lat_deg",
        "origin_lon_deg",
        "origin_alt_amsl_m",
        "height_above_ground_m",
    }
)
_VECTOR_FIELDS = frozenset(
    {
        "position_ned_m",
        "velocity_ned_m_s",
        "acceleration_ned_m_s2",
        "rates_frd_rad_s",
        "angular_acceleration_frd_rad_s2",
    }
)


def blank_estimate(count: int) -> EstimateState:
    """Estimates of N vehicles that are level, at rest and without a global position."""
    values: dict[str, np.ndarray] = {}
    for field in fields(EstimateState):
        if field.name in _VECTOR_FIELDS:
            values[field.name] = np.zeros((count, 3))
        elif field.name == "q_ned_frd":
            values[field.name] = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1))
        elif field.name.startswith("valid_") or field.name == "gps_rejected":
            values[field.name] = np.zeros(count, dtype=np.bool_)
        else:
            values[field.name] = np.full(count, np.nan if field.name in _NAN_FIELDS else 0.0)
    return EstimateState(**values)


def reset_row(estimate: EstimateState, i: int) -> None:
    """Resets the estimate of vehicle `i`."""
    blank = blank_estimate(1)
    for field in fields(EstimateState):
        getattr(estimate, field.name)[i] = getattr(blank, field.name)[0]
