"""Starts dry runs: plans flown in simulation, by aircraft with the known parameters, position and battery of
real vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gcs_server.errors import InvalidRequest
from gcs_server.flights.chosen import PlanSource, choose
from gcs_server.flights.mission_start import require_roles
from gcs_server.flights.vehicle_models import VehicleModels
from gcs_server.operations.operations import Operation, ReportProgress
from gcs_server.plans.tasks import DocumentHead
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.samples import Attitude, Battery, GlobalPosition, Home
from gcs_server.vehicle.vehicle import Vehicle
from missions.dry_run.setup import release_name, simulated_release
from missions.dry_run.spread import MAX_VEHICLES
from missions.geodesy import LocalOrigin

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights

DEFAULT_HOME = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_amsl_m": 488.0}
"""Home position of PX4's own simulation, used for a mission whose positions are all relative to its start."""

SimulatedVehicles = tuple[dict[str, Any], list[str]]
"""The simulated vehicles, and the assumptions about them."""


async def begin_dry_run(
    flights: Flights,
    source: PlanSource,
    vehicle_id: str | None,
    vehicle_ids: Mapping[str, str] | None,
    settings: dict[str, Any],
    by: tuple[str, str],
) -> Operation:
    """Starts a dry run, as an operation.

    Args:
        flights: all that flies plans.
        source: the plan.
        vehicle_id: the vehicle whose data the simulated vehicle gets; None: PX4's defaults.
        vehicle_ids: the vehicle of each role of a mission with roles; None: each role starts at its planned
            position.
        settings: `conditions`, `obstacles`, `seed`, `flights` and `spread` of `missions.dry_run.task`;
            `endurance_s` and `battery_reserve` of all aircraft.
        by: name and key of the client.

    Raises:
        InvalidRequest: the plan cannot be used, or does not fit the vehicles.
        ClientHasTooMany, Refused: too many dry runs are running.
    """
    chosen = await choose(flights.plans, source)
    document = await chosen.document.read(flights.plan_work, field=chosen.field)
    battery = {name: settings.pop(name) for name in ("endurance_s", "battery_reserve")}
    head = document.head
    if head.roles:
        simulated, assumed = _role_vehicles(flights, head, vehicle_id, vehicle_ids, settings, battery)
    elif vehicle_ids is None:
        vehicle = None if vehicle_id is None else flights.fleet.get(vehicle_id)
        aircraft, origin, assumed = aircraft_from_vehicle(vehicle, head, models=flights.models)
        simulated = {"roles": None, "aircraft": {**aircraft, **battery}, "origin": origin}
    else:
        raise InvalidRequest(
            "vehicles", "The plan has no roles: one vehicle flies it.", remedy="Name it in `vehicle`."
        )
    elevation = await flights.plan_work.elevation_paths()
    request = {"kind": head.kind, **simulated, **settings, "elevation": elevation}
    reference = chosen.reference
    details = {
        "kind": head.kind, "name": reference.name, "plan_id": reference.id, "version": reference.version,
        "vehicle": vehicle_id, "vehicles": vehicle_ids, "assumed": assumed,
    }  # fmt: skip
    dry_run_id = flights.dry_runs.next_id(by[1])

    async def work(report: ReportProgress) -> dict[str, object]:
        return await flights.dry_runs.run(dry_run_id, document.text, request, details, report, by[1])

    return flights.operations.start(
        "dry_run", work, text="The simulated vehicles start.", subject=dry_run_id, by=by
    )


def aircraft_from_vehicle(
    vehicle: Vehicle | None,
    document: DocumentHead,
    role: str | None = None,
    *,
    models: VehicleModels | None = None,
) -> tuple[dict[str, Any], dict[str, float] | None, list[str]]:
    """Returns the simulated aircraft (`home`, `yaw_ned_rad`, `parameters`, `battery_share`), the local origin
    (None: unknown), and the assumptions made because values were unknown.

    Args:
        vehicle: the real vehicle; None: PX4's defaults, at the planned home.
        document: head of the plan.
        role: the vehicle's role in a mission of several vehicles; the assumptions then do not name the
            vehicle.
        models: the kept models of vehicles.

    Raises:
        InvalidRequest: the start position is unknown.
    """
    assumptions: list[str] = []
    if vehicle is None:
        assumptions.append("No vehicle is named: PX4's defaults and a full battery are used.")
        return {"home": _planned_start(document, role)}, None, assumptions
    vehicle_name = f"vehicle {vehicle.id}" if role is None else "the vehicle"
    aircraft: dict[str, Any] = {
        "parameters": {param.name: float(param.value) for param in vehicle.params.all()}
    }
    release = vehicle.identity.software.release
    simulated = simulated_release(release)
    aircraft["px4"] = release_name(simulated)
    if release is None:
        assumptions.append(
            f"The release of PX4 of {vehicle_name} is not known: v{aircraft['px4']} is simulated."
        )
    elif release != simulated:
        assumptions.append(
            f"PX4 v{release_name(release)} of {vehicle_name} cannot be simulated: v{aircraft['px4']} is."
        )
    if not aircraft["parameters"]:
        assumptions.append(f"The parameters of {vehicle_name} have not been read: PX4's defaults are used.")
    kept = None if models is None else models.find(vehicle.identity)
    if kept is not None:
        aircraft["body"] = dict(kept.parameters)
        assumptions.append(f"The body of {vehicle_name} is the one identified in a flight: {kept.text()}.")
    position = _start_position(vehicle, vehicle_name, assumptions)
    if position is None:
        assumptions.append(f"The position of {vehicle_name} is not known: the plan's home is used.")
        aircraft["home"] = _planned_start(document, role)
        return aircraft, None, assumptions
    aircraft["home"] = position
    attitude, battery = vehicle.topic("attitude"), vehicle.topic("battery")
    if attitude is not None and isinstance(attitude.value, Attitude):
        aircraft["yaw_ned_rad"] = attitude.value.yaw_ned_rad
    percent = battery.value.remaining_percent if battery and isinstance(battery.value, Battery) else None
    if percent is None:
        assumptions.append(f"The battery charge of {vehicle_name} is not known: a full battery is used.")
    else:
        aircraft["battery_share"] = min(1.0, max(0.0, percent / 100.0))
    origin = VehicleEstimates(vehicle).origin()
    return aircraft, None if origin is None else asdict(origin), assumptions


def merged_assumptions(assumptions: Mapping[str, Sequence[str]]) -> list[str]:
    """Merges the assumptions of all roles: each sentence appears once, preceded by its roles."""
    roles_of: dict[str, list[str]] = {}
    for role, texts in assumptions.items():
        for text in texts:
            roles_of.setdefault(text, []).append(role)
    # Only sentences about "the vehicle" (or "The vehicle") differ between roles.
    return [
        f"{' and '.join(roles)}: {text}" if "he vehicle" in text else text for text, roles in roles_of.items()
    ]


def _start_position(vehicle: Vehicle, vehicle_name: str, assumptions: list[str]) -> dict[str, float] | None:
    """The position of a vehicle on the ground, or the home position of a flying vehicle; None: unknown."""
    position, home = vehicle.topic("global_position"), vehicle.topic("home")
    in_flight = vehicle.flight_state.armed and vehicle.flight_state.landed_state != "on_ground"
    if position is not None and isinstance(position.value, GlobalPosition) and not in_flight:
        return _coordinates(position.value)
    if home is None or not isinstance(home.value, Home):
        return None
    if in_flight:
        assumptions.append(
            f"{vehicle_name[0].upper()}{vehicle_name[1:]} is flying: the dry run starts on the ground at its "
            "home."
        )
    return _coordinates(home.value)


def _coordinates(value: GlobalPosition | Home) -> dict[str, float]:
    return {name: getattr(value, name) for name in ("lat_deg", "lon_deg", "alt_amsl_m")}


def _planned_start(document: DocumentHead, role: str | None) -> dict[str, float]:
    """Start position of the plan, or of one of its roles."""
    if document.home is None and document.kind == "waypoint_plan":
        raise InvalidRequest(
            "plan.planned_home",
            "The plan has no planned home, and no vehicle with a position is named: the start is not known.",
            remedy="Give the plan a home, or name a vehicle.",
        )
    home = dict(document.home or DEFAULT_HOME)
    if role is None:
        return home
    offset_ned_m = document.roles[role] or (0.0, 0.0, 0.0)
    lat_deg, lon_deg, alt_amsl_m = LocalOrigin(**home).to_geodetic(offset_ned_m)
    return {"lat_deg": lat_deg, "lon_deg": lon_deg, "alt_amsl_m": alt_amsl_m}


def _role_vehicles(
    flights: Flights,
    document: DocumentHead,
    vehicle_id: str | None,
    vehicle_ids: Mapping[str, str] | None,
    settings: Mapping[str, Any],
    battery: Mapping[str, Any],
) -> SimulatedVehicles:
    """The vehicles of a mission with roles."""
    if vehicle_id is not None:
        raise InvalidRequest(
            "vehicle",
            "The mission has roles, each flown by one vehicle.",
            remedy="Leave `vehicle` out, and name a vehicle for each role in `vehicles`.",
        )
    max_flights = MAX_VEHICLES // len(document.roles)
    if settings["flights"] is not None and settings["flights"] > max_flights:
        raise InvalidRequest(
            "flights",
            f"{settings['flights']} flights of {len(document.roles)} vehicles are too many.",
            remedy=f"Give at most {max_flights}.",
        )
    if vehicle_ids is not None:
        require_roles(document, vehicle_ids)
    elif any(start_ned_m is None for start_ned_m in document.roles.values()):
        raise InvalidRequest(
            "vehicles",
            "The start positions are not known: no vehicle is named, and some roles have no `start_ned_m`.",
            remedy="Name a vehicle for each role, or give each role `start_ned_m`.",
        )
    roles: dict[str, dict[str, Any]] = {}
    assumptions: dict[str, list[str]] = {}
    for role in document.roles:
        vehicle = None if vehicle_ids is None else flights.fleet.get(vehicle_ids[role])
        aircraft, origin, assumptions[role] = aircraft_from_vehicle(
            vehicle, document, role, models=flights.models
        )
        roles[role] = {"aircraft": {**aircraft, **battery}, "origin": origin}
    return {"roles": roles}, merged_assumptions(assumptions)
