"""The simulated aircraft of a dry run, with the known parameters, position and battery of a real vehicle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from gcs_server.errors import InvalidRequest
from gcs_server.plans.tasks import DocumentHead
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.samples import Attitude, Battery, GlobalPosition, Home
from gcs_server.vehicle.vehicle import Vehicle
from missions.geodesy import LocalOrigin

DEFAULT_HOME = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_amsl_m": 488.0}
"""Home position of PX4's own simulation, used for a mission whose positions are all relative to its start."""


def aircraft_from_vehicle(
    vehicle: Vehicle | None, document: DocumentHead, role: str | None = None
) -> tuple[dict[str, Any], dict[str, float] | None, list[str]]:
    """Returns the simulated aircraft (`home`, `yaw_ned_rad`, `parameters`, `battery_share`), the local origin
    (None: unknown), and the assumptions made because values were unknown.

    Args:
        vehicle: the real vehicle; None: PX4's defaults, at the planned home.
        document: head of the plan.
        role: the vehicle's role in a mission of several vehicles; the assumptions then do not name the
            vehicle.

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
    if not aircraft["parameters"]:
        assumptions.append(f"The parameters of {vehicle_name} have not been read: PX4's defaults are used.")
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
