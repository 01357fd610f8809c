"""Converts path and corridor of a dry run to the vehicle's local frame, for comparison with a real flight."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gcs_server.errors import Refused
from gcs_server.flights.waypoint_flight import NamedDryRun
from gcs_server.plans.work import UnreadDocument
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.services.mission_compare import differences
from gcs_server.vehicle.vehicle import Vehicle
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.runner.corridor import Corridor
from missions.waypoints.planned import PlannedPasses, planned_by_dry_run

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights


MAX_START_DISTANCE_M = 5.0
"""Maximum distance from the vehicle to the start of its dry run [m]."""


def corridor_of(
    dry_run: Mapping[str, Any], position_ned_m: Vector3, origin: LocalOrigin | None, role: str | None = None
) -> Corridor:
    """The corridor in the vehicle's local frame.

    Args:
        dry_run: the result of the dry run.
        position_ned_m: the vehicle's position.
        origin: origin of the vehicle's local frame. None: unknown; the dry run is then assumed to have
            started at `position_ned_m`.
        role: the vehicle's role in a mission of several vehicles; None: the mission has one vehicle. In the
            dry run all vehicles start at one altitude, so a role's corridor begins at the altitude of the
            real vehicle.

    Raises:
        Refused: the dry run has no corridor of this role, was made for a waypoint plan, or started at another
            position.
    """
    corridor = _stored_corridor(dry_run, role)
    if dry_run["kind"] != "offboard_mission" or corridor is None:
        raise Refused(
            f"Dry run {dry_run['id']} has no corridor of {_subject(role)}.",
            remedy="Make a dry run with 10 or more varied flights (`flights`), and name that dry run.",
        )
    first_n, first_e, first_d = corridor["position_ned_m"][0]
    dry_run_origin_ned_m = (
        position_ned_m[0] - first_n,
        position_ned_m[1] - first_e,
        position_ned_m[2] - first_d,
    )
    if origin is not None:
        home = dry_run["nominal"]["origin"]
        north, east, down = origin.to_ned(home["lat_deg"], home["lon_deg"], home["alt_amsl_m"])
        dry_run_origin_ned_m = (north, east, down if role is None else dry_run_origin_ned_m[2])
        _require_same_start(dry_run, (north + first_n, east + first_e), position_ned_m)
    return _in_local_frame(corridor, dry_run_origin_ned_m)


def path_of(
    dry_run: Mapping[str, Any], rows: Sequence[int], ground_ned_m: Vector3, origin: LocalOrigin
) -> tuple[PlannedPasses, Corridor | None]:
    """The nominal path of a waypoint plan's dry run, and its corridor, in the vehicle's local frame.

    Args:
        dry_run: the result of the dry run.
        rows: index in the plan's `items` of each item as uploaded, in order.
        ground_ned_m: the vehicle's position on the ground; in flight its home. The path begins at this
            altitude, because the altitudes of most plans are above home.
        origin: origin of the vehicle's local frame.

    Returns:
        The path, and the corridor; None: the dry run has one flight.

    Raises:
        Refused: the dry run did not fly the whole plan, or started at another position.
    """
    nominal, monte_carlo = dry_run["nominal"], dry_run["monte_carlo"]
    if not nominal["finished"] or nominal["path"] is None:
        raise Refused(
            f"Dry run {dry_run['id']} has not flown the whole plan.",
            remedy="Correct the plan, then make a new dry run.",
        )
    home = nominal["origin"]
    north, east, _ = origin.to_ned(home["lat_deg"], home["lon_deg"], home["alt_amsl_m"])
    _require_same_start(dry_run, (north, east), ground_ned_m)
    dry_run_origin_ned_m = (north, east, ground_ned_m[2])
    planned = planned_by_dry_run(nominal, rows, dry_run_origin_ned_m)
    if monte_carlo is None:
        return planned, None
    return planned, _in_local_frame(monte_carlo["corridor"], dry_run_origin_ned_m)


def _require_same_start(
    dry_run: Mapping[str, Any], start_ne_m: tuple[float, float], position_ned_m: Vector3
) -> None:
    distance_m = math.dist(start_ne_m, position_ned_m[:2])
    if distance_m > MAX_START_DISTANCE_M:
        raise Refused(
            f"Dry run {dry_run['id']} began {distance_m:.0f} m from the vehicle's position.",
            remedy="Make a new dry run with this vehicle's id.",
        )


def _in_local_frame(corridor: Mapping[str, Any], dry_run_origin_ned_m: Vector3) -> Corridor:
    """The corridor in the vehicle's local frame; the origin of the dry run's frame is at this position."""
    north, east, down = dry_run_origin_ned_m
    points = [(north + n, east + e, down + d) for n, e, d in corridor["position_ned_m"]]
    horizontal, vertical = corridor["horizontal_m"], corridor["vertical_m"]
    above_m = [max(0.0, *pair) for pair in zip(vertical["p95"], vertical["greatest"], strict=True)]
    below_m = [
        max(0.0, -low, -greatest) for low, greatest in zip(vertical["p5"], vertical["greatest"], strict=True)
    ]
    return Corridor(tuple(points), tuple(horizontal["greatest"]), tuple(above_m), tuple(below_m))


def _stored_corridor(dry_run: Mapping[str, Any], role: str | None) -> Mapping[str, Any] | None:
    monte_carlo, group = dry_run["monte_carlo"], dry_run["group"]
    if monte_carlo is None or (role is None) != (group is None):
        return None
    if group is None:
        return monte_carlo["corridor"]
    role_result = group["monte_carlo"]["roles"].get(role)
    return None if role_result is None else role_result["corridor"]


def _subject(role: str | None) -> str:
    return "an offboard mission of one vehicle" if role is None else f"the role {role!r}"


async def dry_run_path(flights: Flights, vehicle: Vehicle, dry_run_id: str | None) -> NamedDryRun | None:
    """Path and corridor of the dry run, in the vehicle's local frame; None: no dry run is named.

    Raises:
        UnknownDryRun: there is no such dry run.
        Refused: the dry run was made for another plan, did not fly the whole plan, or began at another
            position.
    """
    if dry_run_id is None:
        return None
    result = await flights.dry_runs.result(dry_run_id)
    on_vehicle = vehicle.mission.items_on_vehicle
    if result["kind"] != "waypoint_plan" or on_vehicle is None or vehicle.mission.plan_on_vehicle() != "plan":
        raise _wrong_plan_refusal(vehicle, dry_run_id)
    items, rows = await UnreadDocument(flights.dry_runs.plan(dry_run_id)).items(flights.plan_work)
    if any(each.essential for each in differences("mission", items["mission"], on_vehicle.items["mission"])):
        raise _wrong_plan_refusal(vehicle, dry_run_id)
    ground_ned_m, origin = _ground_position(vehicle)
    planned, corridor = await asyncio.to_thread(path_of, result, rows, ground_ned_m, origin)
    return NamedDryRun(dry_run_id, planned, corridor)


def _wrong_plan_refusal(vehicle: Vehicle, dry_run_id: str) -> Refused:
    return Refused(
        f"Dry run {dry_run_id} was not made for the plan on vehicle {vehicle.id}.",
        remedy="Make a dry run of the plan that is on the vehicle, and name that dry run.",
    )


def _ground_position(vehicle: Vehicle) -> tuple[Vector3, LocalOrigin]:
    """The position of a vehicle on the ground, or the home of a flying vehicle; and the origin of its local
    frame.

    Raises:
        Refused: the position, the home or the origin is unknown.
    """
    estimates, status = VehicleEstimates(vehicle), vehicle.status
    local, home, origin = estimates.local(), estimates.home(), estimates.origin()
    in_air = status.armed and status.landed_state not in ("on_ground", "unknown")
    if origin is not None and in_air and home is not None:
        return origin.to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m), origin
    if origin is None or local is None or in_air:
        raise Refused(
            f"Vehicle {vehicle.id} has no valid global position or home, which the comparison with a dry run "
            "needs.",
            remedy="Wait for GPS and the estimator, or start without a dry run.",
        )
    return local.position_ned_m, origin
