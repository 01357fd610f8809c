"""The corridor of a dry run, as a mission that is flown for real takes it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gcs_server.errors import Refused
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.runner.corridor import Corridor

SAME_START_M = 5.0
"""A dry run that began farther from the vehicle was one of another flight."""


def corridor_of(found: Mapping[str, Any], here_ned_m: Vector3, origin: LocalOrigin | None) -> Corridor:
    """In the vehicle's local frame.

    Args:
        found: the dry run.
        here_ned_m: where the vehicle is.
        origin: of its local frame; None: not known, the dry run is taken to have begun here.

    Raises:
        Refused: the dry run has no corridor, is one of a waypoint plan, or began elsewhere.
    """
    many = found["monte_carlo"]
    corridor = None if many is None else many["corridor"]
    if found["kind"] != "offboard_mission" or corridor is None:
        raise Refused(
            f"Dry run {found['id']} has no corridor of an offboard mission.",
            remedy="Fly the mission in simulation with `flights` of 10 or more, and name that dry run.",
        )
    start = here_ned_m
    if origin is not None:
        begun = found["nominal"]["origin"]
        start = origin.to_ned(begun["lat_deg"], begun["lon_deg"], begun["alt_amsl_m"])
        away_m = math.dist(start[:2], here_ned_m[:2])
        if away_m > SAME_START_M:
            raise Refused(
                f"Dry run {found['id']} began {away_m:.0f} m from where the vehicle is.",
                remedy="Fly it in simulation again, with this vehicle's id.",
            )
    places = [(start[0] + n, start[1] + e, start[2] + d) for n, e, d in corridor["position_ned_m"]]
    beside, vertical = corridor["horizontal_m"], corridor["vertical_m"]
    above = [max(0.0, *pair) for pair in zip(vertical["p95"], vertical["greatest"], strict=True)]
    below = [max(0.0, -low, -most) for low, most in zip(vertical["p5"], vertical["greatest"], strict=True)]
    return Corridor(tuple(places), tuple(beside["greatest"]), tuple(above), tuple(below))
