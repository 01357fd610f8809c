"""The dry run that a start of a waypoint plan names."""

from __future__ import annotations

from gcs_server.api.station import Station
from gcs_server.errors import Refused
from gcs_server.plans.dry_run_corridor import path_of
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.waypoints.flight import DryRunPath
from gcs_server.vehicle.services.mission_compare import differences
from gcs_server.vehicle.vehicle import Vehicle
from missions import plan as plan_document
from missions.formats import mavlink_items
from missions.frames import Vector3
from missions.geodesy import LocalOrigin


def dry_run_path(station: Station, vehicle: Vehicle, dry_run_id: str | None) -> DryRunPath | None:
    """Path and corridor of the dry run, in the vehicle's local frame; None: no dry run is named.

    Raises:
        UnknownDryRun: there is no such dry run.
        Refused: it was made for another plan, has not flown the whole plan, or began at another position.
    """
    if dry_run_id is None:
        return None
    result = station.dry_runs.get(dry_run_id)
    held = vehicle.mission.items_on_vehicle
    if result["kind"] != "waypoint_plan" or held is None or vehicle.mission.plan_on_vehicle() != "plan":
        raise _another_plan(vehicle, dry_run_id)
    plan = plan_document.read(station.dry_runs.plan(dry_run_id))
    items = mavlink_items.mission_items(plan)
    if any(each.essential for each in differences("mission", items, held.items["mission"])):
        raise _another_plan(vehicle, dry_run_id)
    ground_ned_m, origin = _ground(vehicle)
    planned, corridor = path_of(result, plan, ground_ned_m, origin)
    return DryRunPath(dry_run_id, planned, corridor)


def _another_plan(vehicle: Vehicle, dry_run_id: str) -> Refused:
    return Refused(
        f"Dry run {dry_run_id} was not made for the plan on vehicle {vehicle.id}.",
        remedy="Fly the plan on the vehicle in simulation, and name that dry run.",
    )


def _ground(vehicle: Vehicle) -> tuple[Vector3, LocalOrigin]:
    """The vehicle's position on the ground, in flight its home; and the origin of its local frame.

    Raises:
        Refused: they are unknown.
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
