"""Converts a pattern to the steps of an offboard mission: the same lines, flown by setpoints.

The steps are placed in a mission after its take-off. As in a waypoint plan, the heading is along the path, or
towards the position that the camera looks at. The photos then have the orientation that the pattern
assumes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from missions.errors import PlanError
from missions.items import PlacedItem
from missions.offboard import steps as s
from missions.offboard.from_plan import steps_in_air
from missions.offboard.positions import MissionPosition
from missions.pattern_settings import OrbitPattern, PatternDocument, StructurePattern
from missions.plan import SimpleItem
from missions.values import Altitude, Point
from missions.vehicle import VehicleModel

TITLES = {
    "survey": "Survey line",
    "corridor": "Corridor line",
    "perimeter": "Perimeter",
    "orbit": "Orbit",
    "structure": "Structure scan, round",
}
"""Step names, shown to the pilot."""


def steps_from_pattern(
    pattern: PatternDocument, items: Sequence[SimpleItem], vehicle: VehicleModel | None = None
) -> tuple[s.MissionStep, ...]:
    """The steps of a pattern.

    Args:
        pattern: the document of the pattern.
        items: items of the pattern (`patterns.document.make`); terrain altitudes must be resolved.
        vehicle: the vehicle's parameters; None: PX4's defaults.

    Raises:
        PlanError: There are too many steps, or a terrain altitude is not resolved.
    """
    if isinstance(pattern, OrbitPattern) and not _is_above_ground(pattern):
        return _orbit(pattern)
    _check_altitudes(pattern, items)
    try:
        steps = steps_in_air(items, vehicle)
    except PlanError as error:
        raise PlanError("the pattern", error.reason, error.fix.replace("plan", "pattern")) from None
    return _named(steps, TITLES[pattern.kind])


def _check_altitudes(pattern: PatternDocument, items: Sequence[SimpleItem]) -> None:
    """Refuses terrain altitudes that are not resolved, because they cannot be converted to altitudes AMSL."""
    altitudes = [item.altitude for item in items if isinstance(item, PlacedItem)]
    if any(each.reference == "terrain" and each.resolved_amsl_m is None for each in altitudes):
        reason = "it is relative to the ground, and the elevation of the ground is unknown"
        fix = "Put elevation files of this area into the data folder, or choose another reference."
        field = "base" if isinstance(pattern, StructurePattern) else "altitude"
        raise PlanError(f"field {field}", reason, fix, field=field)


def _is_above_ground(orbit: OrbitPattern) -> bool:
    altitudes = (orbit.altitude, orbit.look_at)
    return any(each is not None and each.reference == "terrain" for each in altitudes)


def _orbit(orbit: OrbitPattern) -> tuple[s.MissionStep, ...]:
    """An orbit pattern as one orbit step, so that the pilot can edit the circle itself."""
    look_at = None if orbit.look_at is None else _position(orbit.center, orbit.look_at)
    orbit_step = s.Orbit(
        name=TITLES["orbit"],
        center=_position(orbit.center, orbit.altitude),
        radius_m=orbit.radius_m,
        turns=float(orbit.rounds),
        clockwise=orbit.clockwise,
        start_angle_ned_rad=math.remainder(math.radians(orbit.start_deg), math.tau),
        heading="along_path" if look_at is None else "keep",
        look_at=look_at,
    )
    if look_at is None:
        return (orbit_step,)
    return (s.Gimbal(track="look_at", place=look_at), orbit_step, s.Gimbal(track="release"))


def _position(point: Point, altitude: Altitude) -> MissionPosition:
    above_home = altitude.reference == "home"
    return MissionPosition(
        lat_deg=point.lat_deg,
        lon_deg=point.lon_deg,
        alt_home_m=altitude.value_m if above_home else None,
        alt_amsl_m=None if above_home else altitude.value_m,
    )


def _named(steps: Sequence[s.MissionStep], title: str) -> tuple[s.MissionStep, ...]:
    """The steps with headings and names. If the pattern takes photos, each name contains the number of a
    line with photos."""
    takes_pictures = any(isinstance(step, s.Fly) and step.photo_every_m is not None for step in steps)
    line_number, target, named = 0, None, list[s.MissionStep]()
    for step in steps:
        if isinstance(step, s.Gimbal):
            target = step.place
        if isinstance(step, s.Fly):
            on_line = step.photo_every_m is not None
            line_number += on_line
            name = title
            if takes_pictures:
                next_line = f"{title[0].lower()}{title[1:]} {line_number + 1}"
                name = f"{title} {line_number}" if on_line else f"To {next_line}"
            step = step.model_copy(update={"name": name, **_heading(step, target)})
        named.append(step)
    return tuple(named)


def _heading(step: s.Fly, target: MissionPosition | None) -> dict[str, object]:
    """The fields for the heading of a step; empty if the points have yaws."""
    if any(point.yaw_ned_rad is not None for point in step.points):
        return {}
    return {"heading": "along_path"} if target is None else {"look_at": target}
