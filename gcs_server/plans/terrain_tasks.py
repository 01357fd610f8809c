"""Computations with the operator's elevation files. GDAL reads the files, so this module is imported only in
worker processes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from missions import plan as plan_document
from missions.checks import Finding
from missions.geodesy import LocalOrigin
from missions.offboard.findings import MissionFinding
from missions.offboard.samples import Leg
from missions.plan import Plan
from missions.route import plan_positions
from missions.terrain import clearance, profile, terrarium
from missions.terrain.files import BoundingBox, Elevation, ElevationFile
from missions.terrain.follow import follow_ground
from missions.terrain.ground import Ground
from missions.terrain.profile import PlanGround
from missions.terrain.relief import axes_deg

MARGIN_M = 100.0
"""Margin around the positions of a plan [m]."""
KNOWN_GROUND_CELLS = 200
GROUND_TILE_PX = 512
GROUND_TILE_CELLS = 600 * 600
"""Maximum number of cells that are read for a tile."""
LONGEST_SIDE_M = 100_000.0
"""Maximum side of a plan's area [m]; longer than any flight of these vehicles."""


def ground_of_plan(plan: Plan, paths: Sequence[str], return_alt_m: float) -> tuple[list[Finding], PlanGround]:
    """Findings about a waypoint plan, and the ground below it."""
    ground, problems = _ground(Elevation.from_files(map(Path, paths)), plan_positions(plan))
    if ground is None:
        return [], PlanGround(not_known=problems)
    findings = list(clearance.plan_findings(plan, ground, return_alt_m))
    known = frozenset(clearance.rows_on_known_ground(plan, ground))
    return findings, PlanGround(profile.plan_profile(plan, ground), problems, known)


def ground_of_mission(
    legs: Sequence[Leg], origin: LocalOrigin | None, start_down_m: float, paths: Sequence[str]
) -> tuple[list[MissionFinding], PlanGround]:
    """Findings about a compiled offboard mission, and the ground below it.

    Args:
        legs: the legs of one vehicle, or of all roles in sequence, in the frame of `origin`.
        origin: origin of the local frame; None: unknown, and the result is empty.
        start_down_m: down coordinate of the start.
        paths: paths of the elevation files.
    """
    if origin is None:
        return [], PlanGround()
    positions = [
        origin.to_geodetic((point[1], point[2], point[3]))[:2] for leg in legs for point in leg.points
    ]
    ground, problems = ground_around(positions, paths)
    if ground is None:
        return [], PlanGround(not_known=problems)
    findings = list(clearance.mission_findings(legs, origin, ground))
    ground_profile = profile.mission_profile(legs, origin, start_down_m, ground)
    known = frozenset(clearance.steps_on_known_ground(legs, origin, ground))
    return findings, PlanGround(ground_profile, problems, known)


def resolve_altitudes(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Resolves the altitudes above the ground of a plan to AMSL. Arguments: `plan` (JSON text), `elevation`
    (paths), `tolerance_m` (null: no waypoints are added)."""
    plan = plan_document.read(arguments["plan"])
    ground, problems = _ground(Elevation.from_files(map(Path, arguments["elevation"])), plan_positions(plan))
    result = follow_ground(plan, ground, arguments["tolerance_m"])
    return {
        "plan": plan_document.write(result.plan).decode(),
        "resolved": result.resolved,
        "unknown": result.unknown,
        "added": result.added,
        "notes": problems,
    }


def ground_around(
    positions: Sequence[tuple[float, float]], paths: Sequence[str]
) -> tuple[Ground | None, tuple[str, ...]]:
    """The ground around positions (latitude, longitude [deg]), and messages about missing elevation data."""
    return _ground(Elevation.from_files(map(Path, paths)), positions)


@dataclass(frozen=True, slots=True)
class GroundBytes:
    """A `Ground` as plain values."""

    fields: dict[str, float]
    """`north_deg`, `west_deg`, `step_lat_deg`, `step_lon_deg`, and the numbers of `rows` and `columns`."""
    amsl_m: bytes
    """Rows of 32-bit floats."""


def known_ground(arguments: Mapping[str, Any]) -> GroundBytes | None:
    """The ground around a position, on at most `KNOWN_GROUND_CELLS` by `KNOWN_GROUND_CELLS` points; None: no
    file covers it. Arguments: `lat_deg`, `lon_deg`, `half_side_m`, `elevation` (paths)."""
    elevation = Elevation.from_files(map(Path, arguments["elevation"]))
    position, half_side_m = (arguments["lat_deg"], arguments["lon_deg"]), arguments["half_side_m"]
    area = BoundingBox.around_positions([position], half_side_m)
    ground = None if area is None else elevation.ground(area)
    if area is None or ground is None:
        return None
    count = min(KNOWN_GROUND_CELLS, 2 + math.ceil(2.0 * half_side_m / ground.spacing_m))
    step_lat_deg = (area.north_deg - area.south_deg) / (count - 1)
    step_lon_deg = (area.east_deg - area.west_deg) / (count - 1)
    numbers = np.arange(count, dtype=np.float64)
    lats, lons = np.meshgrid(
        area.north_deg - step_lat_deg * numbers, area.west_deg + step_lon_deg * numbers, indexing="ij"
    )
    altitudes_m = ground.altitudes_amsl_m(lats.ravel(), lons.ravel()).astype(np.float32)
    if np.isnan(altitudes_m).all():
        return None
    fields = {
        "north_deg": area.north_deg, "west_deg": area.west_deg, "step_lat_deg": step_lat_deg,
        "step_lon_deg": step_lon_deg, "rows": count, "columns": count,
    }  # fmt: skip
    return GroundBytes(fields, altitudes_m.tobytes())


def list_files(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """The area of each elevation file. Argument: `elevation` (paths of the files)."""
    elevation = Elevation.from_files(map(Path, arguments["elevation"]))
    readable: list[ElevationFile] = [file for _, file in elevation.files]
    return {"files": [dataclasses.asdict(each) for each in readable], "unreadable": list(elevation.problems)}


def ground_from_tiles(arguments: Mapping[str, Any]) -> None:
    """Writes an elevation file from tiles. Arguments: `tiles` (path of an MBTiles file with one zoom),
    `file` (path of the new file), `attribution`."""
    terrarium.write_file(Path(arguments["tiles"]), Path(arguments["file"]), arguments["attribution"])


def ground_tile(arguments: Mapping[str, Any]) -> bytes:
    """A Terrarium tile of the known ground; empty: no file covers it. Arguments: `zoom`, `x`, `y` (from the
    north), `elevation` (paths)."""
    place = arguments["zoom"], arguments["x"], arguments["y"]
    lats, lons = terrarium.pixel_positions(*place, GROUND_TILE_PX)
    area = BoundingBox(lons[0, 0], lats[-1, 0], lons[0, -1], lats[0, 0])
    ground = Elevation.from_files(map(Path, arguments["elevation"])).ground(area, GROUND_TILE_CELLS)
    if ground is None:
        return b""
    heights_m = ground.altitudes_amsl_m(lats.ravel(), lons.ravel()).reshape(lats.shape).astype(np.float32)
    return b"" if np.isnan(heights_m).all() else terrarium.tile_of(heights_m)


def relief(arguments: Mapping[str, Any]) -> bytes:
    """The altitudes of a `Relief` (32-bit floats) around a position; empty: no file covers it. Arguments:
    `lat_deg`, `lon_deg`, `elevation` (paths)."""
    lats, lons = axes_deg(arguments["lat_deg"], arguments["lon_deg"])
    area = BoundingBox(lons[0], lats[0], lons[-1], lats[-1])
    ground = Elevation.from_files(map(Path, arguments["elevation"])).ground(area)
    if ground is None:
        return b""
    all_lons, all_lats = np.meshgrid(lons, lats)
    altitudes_m = ground.altitudes_amsl_m(all_lats.ravel(), all_lons.ravel()).astype(np.float32)
    return b"" if np.isnan(altitudes_m).all() else altitudes_m.tobytes()


def _ground(
    elevation: Elevation, positions: Sequence[tuple[float, float]]
) -> tuple[Ground | None, tuple[str, ...]]:
    """The ground around positions, and messages about missing elevation data."""
    area = BoundingBox.around_positions(positions, MARGIN_M)
    if area is None or not elevation.files:
        return None, elevation.problems
    if area.side_m > LONGEST_SIDE_M:
        width, limit = f"{area.side_m / 1000:.0f} km", f"{LONGEST_SIDE_M / 1000:.0f} km"
        text = f"The plan is {width} wide; elevation data are used up to {limit}."
        return None, (*elevation.problems, text)
    ground = elevation.ground(area)
    if ground is None:
        return None, (
            *elevation.problems,
            "No elevation file covers the plan: the ground below it is not known.",
        )
    lat, lon = zip(*positions, strict=True)
    if ground.unknown_at(lat, lon):
        return ground, (*elevation.problems, "The elevation files do not cover all of the plan.")
    return ground, elevation.problems
