"""Merges the limits, geofences, obstacles and actions of two missions when one is inserted into the other."""

from __future__ import annotations

from typing import Any

from missions.errors import PlanError
from missions.offboard.document import Bounds, OffboardMission
from missions.values import FenceZone, Obstacle


def merged_settings(mission: OffboardMission, inserted: OffboardMission) -> tuple[dict[str, Any], list[str]]:
    """The fields of `mission` that change by the insertion, and notes about them for the operator.

    For the whole flight, the lower value of each limit and the geofence zones and obstacles of both missions
    apply. The actions remain those of `mission`.

    Raises:
        PlanError: The two geofences cannot be combined.
    """
    notes: list[str] = []
    limits, lowered = _limits(mission.limits, inserted.limits)
    if lowered:
        limits_text = ", ".join(f"{name} {value:g}" for name, value in lowered.items())
        notes.append(f"Lower limits of {inserted.name!r} now apply to the whole mission: {limits_text}.")
    zones = _new_zones(mission, inserted)
    if zones:
        notes.append(f"The geofence of {inserted.name!r} now applies to the whole mission.")
    existing = set(mission.obstacles)
    obstacles = [each for each in _obstacles(mission, inserted) if each not in existing]
    if obstacles:
        nouns, verb = ("obstacle", "is") if len(obstacles) == 1 else ("obstacles", "are")
        notes.append(f"{len(obstacles)} {nouns} of {inserted.name!r} {verb} added.")
    differences = [
        f"{name} {value}, not {inserted_value}"
        for (name, value), (_, inserted_value) in zip(mission.actions, inserted.actions, strict=True)
        if value != inserted_value
    ]
    if differences:
        notes.append(f"The actions of this mission apply: {'; '.join(differences)}.")
    fields = {
        "limits": limits,
        "fence": (*mission.fence, *zones),
        "obstacles": (*mission.obstacles, *obstacles),
    }
    return fields, notes


def _limits(limits: Bounds, inserted: Bounds) -> tuple[Bounds, dict[str, float]]:
    """The merged limits, and the limits that the inserted mission lowers.

    `speed_m_s` is not merged: it is written into each inserted step (`insertion_steps.py`).
    """
    lowered: dict[str, float] = {}
    for (name, value), (_, inserted_value) in zip(limits, inserted, strict=True):
        if name != "speed_m_s" and inserted_value is not None and (value is None or inserted_value < value):
            lowered[name] = inserted_value
    return limits.model_copy(update=lowered), lowered


def _new_zones(mission: OffboardMission, inserted: OffboardMission) -> list[FenceZone]:
    zones, inserted_zones = list(mission.fence), list(inserted.fence)
    inclusions = [zone for zone in zones if zone.inclusion]
    inserted_inclusions = [zone for zone in inserted_zones if zone.inclusion]
    if inclusions and any(zone not in inclusions for zone in inserted_inclusions):
        raise PlanError(
            f"mission {inserted.name!r}, field fence",
            "both missions have a geofence to stay inside; together they would allow the areas of both",
            "Give both missions the same zones, or remove those of one mission.",
        )
    return [zone for zone in inserted_zones if zone not in zones]


def _obstacles(mission: OffboardMission, inserted: OffboardMission) -> list[Obstacle]:
    """The obstacles of the inserted mission, with tops above its home converted to the home of `mission`."""
    if mission.home is None or inserted.home is None:
        return list(inserted.obstacles)
    home_difference_m = inserted.home.alt_amsl_m - mission.home.alt_amsl_m
    obstacles: list[Obstacle] = []
    for obstacle in inserted.obstacles:
        if obstacle.top.reference == "home":
            top = obstacle.top.model_copy(update={"value_m": obstacle.top.value_m + home_difference_m})
            obstacle = obstacle.model_copy(update={"top": top})
        obstacles.append(obstacle)
    return obstacles
