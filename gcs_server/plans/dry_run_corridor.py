"""Converts the corridor of a dry run to the vehicle's local frame, for the check of a real flight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gcs_server.errors import Refused
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.runner.corridor import Corridor

SAME_START_M = 5.0
"""Maximum distance from the vehicle to the start of its dry run [m]."""


def corridor_of(dry_run: Mapping[str, Any], here_ned_m: Vector3, origin: LocalOrigin | None) -> Corridor:
    """The corridor in the vehicle's local frame.

    Args:
        found: the dry run.
        here_ned_m: the vehicle's position.
        origin: origin of the vehicle's local frame. None: unknown; the dry run is then assumed to have
            started at this position.

    Raises:
        Refused: the dry run has no corridor, was made for a waypoint plan, or started at another position.
    """
    many = dry_run["monte_carlo"]
    corridor = None if many is None else many["corridor"]
    if dry_run["kind"] != "offboard_mission" or corridor is None:
        raise Refused(
            f"Dry run {dry_run['id']} has no corridor of an offboard mission.",
            remedy="Fly the mission in simulation with `flights` of 10 or more, and name that dry run.",
        )
    start = here_ned_m
    if origin is not None:
        start_origin = dry_run["nominal"]["origin"]
        start = origin.to_ned(start_origin["lat_deg"], start_origin["lon_deg"], start_origin["alt_amsl_m"])
        away_m = math.dist(start[:2], here_ned_m[:2])
        if away_m > SAME_START_M:
            raise Refused(
                f"Dry run {dry_run['id']} began {away_m:.0f} m from the vehicle's position.",
                remedy="Fly it in simulation again, with this vehicle's id.",
            )
    points = [(start[0] + n, start[1] + e, start[2] + d) for n, e, d in corridor["position_ned_m"]]
    horizontal, vertical = corridor["horizontal_m"], corridor["vertical_m"]
    above = [max(0.0, *pair) for pair in zip(vertical["p95"], vertical["greatest"], strict=True)]
    below = [max(0.0, -low, -most) for low, most in zip(vertical["p5"], vertical["greatest"], strict=True)]
    return Corridor(tuple(points), tuple(horizontal["greatest"]), tuple(above), tuple(below))
