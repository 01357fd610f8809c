"""Path and corridor of a dry run, for comparison with the flight of a waypoint plan."""

from __future__ import annotations

import asyncio

from gcs_server.api.documents import UnreadDocument
from gcs_server.api.plan_items import mavlink_items
from gcs_server.api.station import Station
from gcs_server.errors import Refused
from gcs_server.plans.dry_run_corridor import path_of
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.waypoints.flight import NamedDryRun
from gcs_server.vehicle.services.mission_compare import differences
from gcs_server.vehicle.vehicle import Vehicle
from missions.frames import Vector3
from missions.geodesy import LocalOrigin


async def dry_run_path(station: Station, vehicle: Vehicle, dry_run_id: str | None) -> NamedDryRun | None:
    """Path and corridor of the dry run, in the vehicle's local frame; None: no dry run is named.

    Raises:
        UnknownDryRun: there is no such dry run.
        Refused: the dry run was made for another plan, did not fly the whole plan, or began at another
            position.
    """
    if dry_run_id is None:
        return None
    result = await station.dry_runs.result(dry_run_id)
    on_vehicle = vehicle.mission.items_on_vehicle
    if result["kind"] != "waypoint_plan" or on_vehicle is None or vehicle.mission.plan_on_vehicle() != "plan":
        raise _wrong_plan_refusal(vehicle, dry_run_id)
    items, rows = await mavlink_items(station, UnreadDocument(station.dry_runs.plan(dry_run_id)))
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
