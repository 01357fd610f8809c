"""Compares the flight of a waypoint plan or an offboard mission with the current flights of the other
vehicles of this flights."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from gcs_server.flights.readings import vehicle_reading
from gcs_server.flights.waypoint_flight import NamedDryRun, Prediction, vehicle_model
from gcs_server.plans import typed_values
from gcs_server.plans.traffic_task import SEPARATION, PlanStart, Traffic, path_not_known, predicted_path
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.samples import Mission
from gcs_server.vehicle.vehicle import Vehicle
from missions.geodesy import LocalOrigin
from missions.offboard.timeline import Timeline
from missions.plan import Plan
from missions.traffic.conflict import Conflict, conflicts
from missions.traffic.path import PredictedPath, stationary_path
from missions.traffic.waypoints import predict_mission, predict_timeline

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights

MAX_HOVER_SPEED_M_S = 0.5
"""Speed below which a vehicle without a known path counts as hovering."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """The flight of a plan, compared with the flights of the other vehicles."""

    path: PredictedPath | None
    """Predicted path of the vehicle; None: the vehicle's position is not known, or the plan has no path."""
    conflicts: tuple[Conflict, ...]
    not_compared: tuple[str, ...]
    """Sentences about flying vehicles that cannot be compared."""


async def compare_with_others(
    flights: Flights,
    vehicle: Vehicle,
    plan: Plan,
    item: int | None = None,
    dry_run: NamedDryRun | None = None,
) -> Comparison:
    """Compares the flight of a plan, started now, with the flights of the other vehicles.

    Args:
        flights: all that flies plans.
        vehicle: the vehicle that will fly the plan.
        plan: the plan.
        item: index of the item at which the flight starts; None: the vehicle's current item.
        dry_run: the path of a dry run of the plan; None: straight lines with estimated times.
    """
    start, planned = _plan_start(vehicle, item), None if dry_run is None else dry_run.planned
    others = _others(flights, vehicle)

    def compare() -> Comparison:
        other_paths, not_compared = others()
        path = None if start is None else predicted_path(start, plan, planned)
        if path is None and other_paths:
            return Comparison(None, (), (path_not_known(vehicle.id),))
        return Comparison(path, () if path is None else conflicts(path, other_paths), tuple(not_compared))

    return await asyncio.to_thread(compare)


async def traffic_of(flights: Flights, vehicle: Vehicle) -> bytes | None:
    """The start of a plan now and the other vehicles in flight, as `Traffic` for the task `check`; None: the
    vehicle is already flying."""
    if vehicle_reading(vehicle).in_air:
        return None
    start, others = _plan_start(vehicle, 0), _others(flights, vehicle)

    def predict() -> bytes:
        other_paths, not_compared = others()
        return typed_values.to_bytes(Traffic(start, vehicle.id, tuple(other_paths), tuple(not_compared)))

    return await asyncio.to_thread(predict)


async def mission_separation_findings(
    flights: Flights, vehicle: Vehicle, timeline: Timeline
) -> list[dict[str, Any]]:
    """Separation errors of an offboard mission that starts now: the steps in which the vehicle comes too near
    to other vehicles."""
    position_ned_m, origin = vehicle_reading(vehicle).position_ned_m, VehicleEstimates(vehicle).origin()
    if position_ned_m is None or origin is None:
        return []  # the mission is not started without a position
    others = _others(flights, vehicle)

    def compare() -> tuple[Conflict, ...]:
        path = predict_timeline(vehicle.id, origin, timeline, position_ned_m)
        return () if path is None else conflicts(path, others()[0])

    found = await asyncio.to_thread(compare)
    return [
        {"code": SEPARATION, "severity": "error", "step": each.place, "text": each.text} for each in found
    ]


# --- the other vehicles -----------------------------------------------------------------------------------


def _others(flights: Flights, vehicle: Vehicle) -> Callable[[], tuple[list[PredictedPath], list[str]]]:
    """Reads what the other vehicles fly now. The returned function predicts their paths, for a thread, and
    makes sentences about flying vehicles whose path is not known."""
    others = [
        (other.id, vehicle_reading(other).in_air, predictions_of(flights, other))
        for other in flights.fleet.all()
        if other.id != vehicle.id and not other.identity.replayed
    ]

    def predict() -> tuple[list[PredictedPath], list[str]]:
        paths: list[PredictedPath] = []
        not_compared: list[str] = []
        for vehicle_id, in_air, predictions in others:
            path = next((found for each in predictions if (found := each()) is not None), None)
            if path is not None:
                paths.append(path)
            elif in_air:
                not_compared.append(
                    f"Vehicle {vehicle_id} is flying, and its path is not known, so it is not compared."
                )
        return paths, not_compared

    return predict


def predictions_of(flights: Flights, other: Vehicle) -> list[Prediction]:
    """Functions that predict what the vehicle may be flying: its offboard mission, its waypoint plan, or a
    hover; the first path counts."""
    reading, origin = vehicle_reading(other), VehicleEstimates(other).origin()
    position, velocity = reading.position_ned_m, reading.velocity_ned_m_s
    mission, found = flights.missions.find_flight(other.id), list[Prediction]()
    if mission is not None and mission.runner.in_charge and origin is not None and position is not None:
        found.append(predict_mission(other.id, origin, mission.runner.flight, position))
    if (flown := flights.waypoint_flights.prediction(other.id)) is not None:
        found.append(flown)
    hovers = velocity is not None and math.hypot(*velocity) <= MAX_HOVER_SPEED_M_S
    if reading.in_air and hovers and origin is not None and position is not None:
        found.append(partial(stationary_path, other.id, origin, position, "hovering"))
    return found


# --- the vehicle's own path -------------------------------------------------------------------------------


def _plan_start(vehicle: Vehicle, item: int | None) -> PlanStart | None:
    """The start of a plan now; None: the vehicle's position is not known."""
    estimates, reading = VehicleEstimates(vehicle), vehicle_reading(vehicle)
    position_ned_m, origin = reading.position_ned_m, estimates.origin()
    if position_ned_m is None or origin is None:
        return None
    home_origin = LocalOrigin(*origin.to_geodetic(position_ned_m))
    home = estimates.home()
    if reading.in_air and home is not None:
        home_origin = LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    return PlanStart(
        vehicle.id, vehicle_model(vehicle), origin, home_origin, position_ned_m, reading.in_air,
        _current_item(vehicle) if item is None else item,
    )  # fmt: skip


def _current_item(vehicle: Vehicle) -> int:
    sample = vehicle.topic("mission")
    current = sample.value.current if sample is not None and isinstance(sample.value, Mission) else None
    return current or 0
