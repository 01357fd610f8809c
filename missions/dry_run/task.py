"""A dry run with JSON values as input and output, to be run in a worker process."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from missions import plan as plan_document
from missions.dry_run.document import MonteCarloResult, plain
from missions.dry_run.group import dry_run_group, monte_carlo_group
from missions.dry_run.monte_carlo import monte_carlo
from missions.dry_run.plans import Flyable, FlyableMission, FlyablePlan
from missions.dry_run.result import dry_run
from missions.dry_run.setup import Aircraft, AnyObstacle, Conditions, GroundGrid, Obstacle, Site, prisms_of
from missions.dry_run.spread import Spread
from missions.geodesy import LocalOrigin
from missions.offboard import reader as mission_reader
from missions.route import plan_positions
from missions.terrain.ground import Ground
from missions.values import HomePosition
from missions.values import Obstacle as PlannedObstacle

SIMULATED_SENSORS = (
    "Obstacle avoidance is simulated with a lidar that measures 20 m to all sides and a lidar that points "
    "down; the sensors of the real vehicle may measure less."
)
NOTHING_TO_AVOID = "No obstacles are known, so the obstacle avoidance of the mission has nothing to avoid."

Progress = Callable[[str, float | None], None]
FindGround = Callable[[Sequence[tuple[float, float]]], tuple[Ground | None, Sequence[str]]]
"""Returns the ground around positions (latitude, longitude [deg]), and messages about missing data."""


@dataclass(frozen=True, slots=True)
class _RequestedPlan:
    """The plan of a request, with the data that `_site` needs."""

    flyable: Flyable
    positions: list[tuple[float, float]]
    """Positions of the plan: latitude, longitude [deg]."""
    obstacles: tuple[PlannedObstacle, ...]
    uses_avoidance: bool
    """Whether obstacle avoidance is on in at least one step."""


def _read_plan(request: Mapping[str, Any], aircraft: Aircraft) -> _RequestedPlan:
    if request["kind"] == "waypoint_plan":
        plan = plan_document.read(request["plan"])
        return _RequestedPlan(
            FlyablePlan.from_plan(plan, aircraft), plan_positions(plan), plan.obstacles, uses_avoidance=False
        )
    mission, origin = mission_reader.read(request["plan"]), _origin(request)
    flyable = FlyableMission.from_mission(mission, aircraft, origin=origin)
    uses_avoidance = flyable.timeline.avoidance is not None
    return _RequestedPlan(
        flyable, flyable.positions(origin or aircraft.origin), mission.obstacles, uses_avoidance
    )


def _aircraft(request: Mapping[str, Any]) -> Aircraft:
    fields: dict[str, Any] = dict(request["aircraft"])
    fields["home"] = HomePosition(**fields["home"])
    return Aircraft(**fields)


def _origin(request: Mapping[str, Any]) -> LocalOrigin | None:
    return None if request["origin"] is None else LocalOrigin(**request["origin"])


def run(
    request: Mapping[str, Any], progress: Progress, find_ground: FindGround | None = None
) -> dict[str, Any]:
    """Flies a plan once, then `flights` more times with varied conditions if requested.

    Args:
        request: `kind` (waypoint_plan, offboard_mission), `plan` (JSON text), `origin` (of the vehicle's
            local frame; null: its start position), `aircraft`, `conditions`, `obstacles`, `seed`, `flights`
            and `spread` (null: one flight). For a mission of several vehicles: `roles`, with `aircraft` and
            `origin` of each role, instead of `aircraft` and `origin` (absent or null: one vehicle).
        progress: called with a message and the completed fraction.
        find_ground: reads elevation data; None: no elevation data, and level ground.

    Returns:
        `nominal`, `monte_carlo` (null: one flight), `group` (null: one vehicle), and `assumed`:
        sentences about the ground.

    Raises:
        PlanError: the plan cannot be flown.
    """
    conditions_fields: dict[str, Any] = dict(request["conditions"])
    conditions_fields["wind_ned_m_s"] = tuple(conditions_fields["wind_ned_m_s"])
    conditions = Conditions(**conditions_fields)
    obstacles = [Obstacle(**each) for each in request["obstacles"]]
    if request.get("roles") is not None:
        return _run_group(request, conditions, obstacles, progress, find_ground)
    aircraft = _aircraft(request)
    requested = _read_plan(request, aircraft)
    flyable = requested.flyable
    site, assumptions = _site(
        [*obstacles, *prisms_of(requested.obstacles, aircraft.home)],
        aircraft.origin,
        requested.positions,
        find_ground,
    )
    assumptions += _avoidance_notes(site, requested.uses_avoidance)
    flights = request["flights"]

    def report(now_s: float, ended: int) -> None:
        fraction = min(0.97, now_s / flyable.expected_s)
        if flights is None:
            progress(f"{now_s:.0f} s of the flight are simulated.", fraction)
        else:
            progress(f"{now_s:.0f} s are simulated; {ended} of {flights + 1} flights have ended.", fraction)

    seed = request["seed"]
    if flights is None:
        nominal_run = dry_run(flyable, aircraft, conditions, seed=seed, site=site, report=report)
        return {
            "nominal": nominal_run.document(),
            "monte_carlo": None,
            "group": None,
            "assumed": assumptions,
        }
    result = monte_carlo(
        flyable, aircraft, conditions, Spread(**request["spread"]), flights=flights, seed=seed,
        site=site, report=report,
    )  # fmt: skip
    return {
        "nominal": result.nominal.document(),
        "monte_carlo": plain(result, MonteCarloResult),
        "group": None,
        "assumed": assumptions,
    }


def _run_group(
    request: Mapping[str, Any],
    conditions: Conditions,
    obstacles: Sequence[AnyObstacle],
    progress: Progress,
    find_ground: FindGround | None,
) -> dict[str, Any]:
    """Flies all roles. `nominal` has the path of the first role and the findings of all roles; `monte_carlo`
    has the corridor of the first role and the chances of all roles."""
    mission = mission_reader.read(request["plan"])
    roles, flights = request["roles"], request["flights"]
    aircraft = {role: _aircraft(requested) for role, requested in roles.items()}
    origins = {
        role: origin for role, requested in roles.items() if (origin := _origin(requested)) is not None
    }
    positions: list[tuple[float, float]] = []
    uses_avoidance = False
    for role, vehicle in aircraft.items():
        flyable = FlyableMission.from_mission(mission, vehicle, origin=origins.get(role), role=role)
        positions += flyable.positions(origins.get(role) or vehicle.origin)
        uses_avoidance |= flyable.timeline.avoidance is not None
    first_aircraft = next(iter(aircraft.values()))
    all_obstacles = [*obstacles, *prisms_of(mission.obstacles, first_aircraft.home)]
    site, assumptions = _site(all_obstacles, first_aircraft.origin, positions, find_ground)
    assumptions += _avoidance_notes(site, uses_avoidance)
    count = len(roles) * (1 if flights is None else flights + 1)

    def report(now_s: float, ended: int) -> None:
        progress(f"{now_s:.0f} s are simulated; {ended} of {count} vehicles have ended.", None)

    seed, monte_carlo_document = request["seed"], None
    if flights is None:
        nominal_document = dry_run_group(
            mission, aircraft, conditions, origins=origins, seed=seed, site=site, report=report
        ).document()
    else:
        result = monte_carlo_group(
            mission, aircraft, conditions, Spread(**request["spread"]), flights=flights, origins=origins,
            seed=seed, site=site, report=report,
        )  # fmt: skip
        nominal_document, monte_carlo_document = result.nominal.document(), result.document()
    nominal = dict(next(iter(nominal_document["roles"].values())))
    nominal["findings"] = [*nominal_document.pop("findings"), *findings_of(nominal_document["roles"])]
    nominal["finished"] = all(run["finished"] for run in nominal_document["roles"].values())
    first_role = None
    if monte_carlo_document is not None:
        first_role = dict(next(iter(monte_carlo_document["roles"].values())))
        first_role["chances"] = monte_carlo_document.pop("chances")
    group = {**nominal_document, "monte_carlo": monte_carlo_document}
    return {"nominal": nominal, "monte_carlo": first_role, "group": group, "assumed": assumptions}


def _site(
    obstacles: Sequence[AnyObstacle],
    origin: LocalOrigin,
    positions: Sequence[tuple[float, float]],
    find_ground: FindGround | None,
) -> tuple[Site, list[str]]:
    """The site around the start, and sentences about the ground of the site."""
    if find_ground is None:
        return Site(obstacles), []
    all_positions = [(origin.lat_deg, origin.lon_deg), *positions]
    ground, messages = find_ground(all_positions)
    if ground is None:
        return Site(obstacles), list(messages)
    grid, assumptions = ground_grid(ground, origin, all_positions)
    return Site(obstacles, grid), assumptions


def _avoidance_notes(site: Site, uses_avoidance: bool) -> list[str]:
    if not uses_avoidance:
        return []
    return [NOTHING_TO_AVOID if site.is_empty else SIMULATED_SENSORS]


def findings_of(roles: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The findings of all roles; equal findings of several roles become one finding. A finding without a step
    names its roles."""
    merged: dict[tuple[str, str | None, str], tuple[dict[str, Any], list[str]]] = {}
    for role, run in roles.items():
        for each in run["findings"]:
            key = (each["code"], each["step"], each["text"])
            merged.setdefault(key, (dict(each), []))[1].append(role)
    for each, role_names in merged.values():
        if each["step"] is None:
            each["text"] = f"{' and '.join(role_names)}: {each['text']}"
    return [each for each, _ in merged.values()]


MARGIN_M = 50.0
"""The grid extends beyond the positions of the plan by this distance."""
MAX_SIDE = 200
"""Maximum number of rows and of columns."""


def ground_grid(
    ground: Ground, origin: LocalOrigin, positions: Sequence[tuple[float, float]]
) -> tuple[GroundGrid | None, list[str]]:
    """The ground around the positions of a plan.

    Ground altitudes are relative to the start, because elevation data and GPS altitudes differ by some
    metres. Where the ground is unknown, the altitude of the start is used.

    Args:
        ground: altitudes from elevation files.
        origin: the start.
        positions: latitude and longitude of the positions [deg]; the start need not be among them.

    Returns:
        The grid (None: the ground at the start is unknown), and sentences about the assumptions.
    """
    start_amsl_m = ground.altitude_amsl_m(origin.lat_deg, origin.lon_deg)
    if start_amsl_m is None:
        return None, ["The elevation files do not cover the start: the dry run flies over level ground."]
    local = [(0.0, 0.0), *(origin.to_ned(lat, lon, origin.alt_amsl_m)[:2] for lat, lon in positions)]
    low, high = np.min(local, axis=0) - MARGIN_M, np.max(local, axis=0) + MARGIN_M
    spacing_m = max(ground.spacing_m, float((high - low).max()) / (MAX_SIDE - 2))
    low = np.floor(low / spacing_m) * spacing_m  # the start is a grid point, so its altitude is exactly 0
    rows, columns = (max(2, 1 + math.ceil(side / spacing_m)) for side in (high - low).tolist())
    north_m, east_m = np.meshgrid(
        low[0] + spacing_m * np.arange(rows), low[1] + spacing_m * np.arange(columns), indexing="ij"
    )
    points = np.column_stack((north_m.ravel(), east_m.ravel(), np.zeros(north_m.size)))
    lat_deg, lon_deg, _ = origin.to_geodetic_arrays(points)
    altitudes_home_m = (ground.altitudes_amsl_m(lat_deg, lon_deg) - start_amsl_m).reshape(north_m.shape)
    assumptions = [
        f"The dry run flies over the ground of the elevation files, on a grid of {spacing_m:.0f} m."
    ]
    unknown = np.isnan(altitudes_home_m)
    if unknown.any():
        altitudes_home_m = np.where(unknown, 0.0, altitudes_home_m)
        assumptions.append("Where the elevation files have no data, the ground is as high as at the start.")
    return GroundGrid(float(low[0]), float(low[1]), spacing_m, altitudes_home_m), assumptions
