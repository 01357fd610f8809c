"""Starts offboard missions: chooses, compiles and checks the mission, and begins it with one vehicle, or with
one vehicle for each role."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import msgspec

from gcs_server.errors import InvalidRequest, NotYet, Refused
from gcs_server.flights.chosen import ChosenPlan, PlanSource, choose
from gcs_server.flights.dry_run_paths import corridor_of
from gcs_server.flights.mission_values import MissionAsMode, MissionName, Start
from gcs_server.flights.missions import low_battery_share
from gcs_server.flights.plan_checks import ErrorGroup, plan_context_of, require_accepted
from gcs_server.flights.preparation import CompileInputs
from gcs_server.flights.traffic import mission_separation_findings
from gcs_server.plans import typed_values
from gcs_server.plans.tasks import Answer, DocumentHead
from gcs_server.plans.work import UnreadDocument
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.samples import GlobalPosition
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from gcs_server.vehicle.services.transaction import ReportProgress
from gcs_server.vehicle.settling import settled
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions.geodesy import LocalOrigin
from missions.offboard.timeline import Timeline
from missions.trajectory.limits import MotionLimits

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights

CompiledMission = tuple[Timeline, MotionLimits]
"""The timeline of one vehicle, and its limits for pauses and approaches."""
Vehicles = Mapping[str | None, Vehicle]
"""The vehicle of each role; the role of a mission of one vehicle is None."""


@dataclass(frozen=True, slots=True)
class PreparedMission:
    """A compiled mission."""

    name: MissionName
    separation_m: float | None
    """Minimum separation of the vehicles [m]; None: the mission has one vehicle."""
    starts: Mapping[str | None, Start]
    """By role."""
    findings: list[dict[str, Any]]


async def begin_mission(
    flights: Flights,
    source: PlanSource,
    vehicle_ids: Mapping[str | None, str],
    tickets: Mapping[str, Ticket],
    client: str,
    *,
    despite: Sequence[str],
    dry_run_id: str | None,
    progress: ReportProgress | None = None,
) -> list[str]:
    """Compiles a mission from the vehicles' present positions, checks it, and begins it with all vehicles or
    with none; returns the vehicles' ids in the order of the roles.

    Args:
        flights: all that flies plans.
        source: the mission.
        vehicle_ids: the vehicle of each role; the role of a mission of one vehicle is None.
        tickets: the ticket of the command, by vehicle id.
        client: name of the client.
        despite: codes of the error findings that the client accepts.
        dry_run_id: the dry run whose corridor is monitored; None: no corridor.
        progress: reports what a vehicle that has just connected has not reported yet.

    Raises:
        PlanFindings: the mission has error findings whose codes are not in `despite`.
        InvalidRequest: the mission cannot be used, or has other roles.
        Refused: a vehicle cannot start now.
        Interrupted: a ticket was cancelled.
    """
    chosen = await choose(flights.plans, source, "offboard_mission")
    vehicles = {role: flights.fleet.get(vehicle_id) for role, vehicle_id in vehicle_ids.items()}
    alone = vehicles.get(None)
    if alone is None:
        _require_ready(vehicles)
    for vehicle in vehicles.values():
        await wait_for_estimates(vehicle, progress)
    prepared = await _compiled(flights, chosen, vehicles, client)
    dry_run = None if dry_run_id is None else await flights.dry_runs.result(dry_run_id)
    starts: dict[str, Start] = {}
    for role, start in prepared.starts.items():
        vehicle, corridor = vehicles[role], None
        if dry_run is not None:
            estimates = VehicleEstimates(vehicle)
            local = estimates.local()
            position = (0.0, 0.0, 0.0) if local is None else local.position_ned_m
            corridor = corridor_of(dry_run, position, estimates.origin(), role)
        starts[vehicle.id] = replace(start, corridor=corridor, role=role, dry_run=dry_run_id)
    async with flights.waypoint_flights.comparison_lock:
        if alone is not None:
            timeline = starts[alone.id].timeline
            prepared.findings.extend(await mission_separation_findings(flights, alone, timeline))
        _require_accepted_findings(prepared, despite)
        await _wait_for_sensors(flights, starts)
        if alone is None:
            await flights.missions.ready()
            _require_ready(vehicles)  # checked again, because the compilation takes seconds
        flights.missions.begin(starts, tickets, prepared.separation_m)
        return list(starts)


async def mission_as_mode(
    flights: Flights,
    source: PlanSource,
    name: str,
    client: str,
    *,
    despite: Sequence[str],
    defer_failsafes_s: int,
) -> MissionAsMode:
    """A mission that is to be registered with PX4 as a flight mode.

    Raises:
        InvalidRequest: the mission cannot be used.
    """
    chosen = await choose(flights.plans, source, "offboard_mission")
    read = await chosen.document.read(flights.plan_work, field="mission")
    mission = _name_of(chosen, read.head)
    return MissionAsMode(
        name, mission, read.text, tuple(despite), client, defer_failsafes_s, read.head.takes_off
    )


async def prepare_mode(flights: Flights, vehicle_id: str, mode: MissionAsMode) -> Start:
    """The mission of a mode, compiled and checked for the vehicle's present position.

    Raises:
        GcsError: the mission cannot be flown from the present position.
    """
    vehicle = flights.fleet.get(vehicle_id)
    overrides = _home_when_armed(vehicle) if mode.takes_off else {"in_air": True}
    document = UnreadDocument(mode.text, "offboard_mission")
    reference = PlanReference(mode.mission.plan_id, mode.mission.version, mode.mission.name)
    chosen = ChosenPlan(reference, document, "mission")
    prepared = await _compiled(flights, chosen, {None: vehicle}, mode.client, overrides)
    _require_accepted_findings(prepared, mode.despite)
    await _wait_for_sensors(flights, {vehicle_id: prepared.starts[None]})
    return prepared.starts[None]


def compile_inputs_of(flights: Flights, vehicle_id: str) -> CompileInputs | None:
    """Position, yaw and settings for a mission that is compiled now; None: no valid position."""
    vehicle = flights.fleet.get(vehicle_id)
    try:
        start = _start_conditions(vehicle)
    except Refused:
        return None
    context = plan_context_of(flights, vehicle)
    origin = None if start["origin"] is None else LocalOrigin(**start["origin"])
    settings = (context.parameters, context.reported, context.operator)
    return CompileInputs(start["position_ned_m"], start["yaw_ned_rad"], origin, settings)


def require_roles(mission: DocumentHead, vehicle_ids: Mapping[str, object]) -> None:
    """Raises InvalidRequest unless `vehicle_ids` has exactly the roles of the mission."""
    if not mission.roles:
        raise InvalidRequest(
            "mission",
            f"{mission.name!r} has no roles: one vehicle flies it.",
            remedy="Start it with that vehicle (POST /vehicles/{v}/offboard_mission/start).",
        )
    missing = [role for role in mission.roles if role not in vehicle_ids]
    unknown = [role for role in vehicle_ids if role not in mission.roles]
    if missing or unknown:
        problem = f"role {missing[0]!r} has no vehicle" if missing else f"there is no role {unknown[0]!r}"
        raise InvalidRequest(
            "vehicles",
            f"vehicles: {problem}.",
            remedy=f"Name a vehicle for each role: {', '.join(mission.roles)}.",
        )


# --- helpers ----------------------------------------------------------------------------------------------


async def _compiled(
    flights: Flights,
    chosen: ChosenPlan,
    vehicles: Vehicles,
    client: str,
    overrides: Mapping[str, Any] | None = None,
) -> PreparedMission:
    """Compiles a mission from the vehicles' present positions; the only reading of its document.

    Args:
        flights: all that flies plans.
        chosen: the mission.
        vehicles: its vehicles.
        client: name of the client that starts it.
        overrides: values of `_start_conditions` that will be different when the mission begins.

    Raises:
        InvalidRequest: the mission cannot be used, or has other roles.
        Refused: a vehicle's position is unknown, or the result cannot be read.
    """
    for vehicle in vehicles.values():
        await flights.offboard(vehicle.id).ensure_parameters()
    contexts: list[tuple[str | None, dict[str, Any]]] = []
    for role, vehicle in vehicles.items():
        context = plan_context_of(flights, vehicle)
        values = {
            "parameters": context.parameters,
            "reported": context.reported,
            "operator": context.operator.to_json(),
            "start": {**_start_conditions(vehicle), **(overrides or {})},
        }
        contexts.append((role, values))
    arguments = {"plan": chosen.document.text, "vehicles": contexts}
    answer = await flights.plan_work.run("compile", arguments, small=False, field="mission")
    head = msgspec.convert(answer.values["head"], DocumentHead)
    if None not in vehicles:
        require_roles(head, {role: True for role in vehicles if role is not None})
    name = _name_of(chosen, head)
    starts: dict[str | None, Start] = {}
    for role, (timeline, motion) in (await compiled_missions(answer)).items():
        starts[role] = Start(name, timeline, motion, client, low_battery_share(vehicles[role]))
    return PreparedMission(name, head.separation_m, starts, list(answer.values["findings"]))


async def compiled_missions(answer: Answer) -> dict[str | None, CompiledMission]:
    """The result of the task `compile`, by role; read in a thread, because a long mission takes a tenth of a
    second. Raises Refused if it cannot be read."""
    expected = dict[str | None, CompiledMission]
    try:
        return await asyncio.to_thread(typed_values.from_bytes, answer.body, expected)
    except typed_values.WrongValue as error:
        raise Refused(f"The compiled mission cannot be read: {error}.") from error


def _name_of(chosen: ChosenPlan, head: DocumentHead) -> MissionName:
    reference = chosen.reference
    return MissionName(reference.name or head.name or "", reference.id, reference.version)


def _require_accepted_findings(mission: PreparedMission, despite: Sequence[str]) -> None:
    """Raises PlanFindings if the mission has error findings whose codes are not in `despite`."""
    errors = tuple(
        (each["code"], f"{each['step'] or 'The mission'}: {each['text']}")
        for each in mission.findings
        if each["severity"] == "error"
    )
    remedy = "Correct the mission, or name the codes in `despite` if you accept them."
    require_accepted([ErrorGroup(f"The mission {mission.name.name!r} has errors.", errors, remedy)], despite)


async def _wait_for_sensors(flights: Flights, starts: Mapping[str, Start]) -> None:
    """Waits for the distance sensor of each vehicle that avoids obstacles; raises Refused without one."""
    for vehicle_id, start in starts.items():
        if start.timeline.avoidance:
            await flights.offboard(vehicle_id).avoidance.wait_for_sensor()


def _require_ready(vehicles: Vehicles) -> None:
    """Raises an error if one of several vehicles cannot be commanded, or is on the ground and reports that it
    cannot be armed."""
    for vehicle in vehicles.values():
        vehicle.require_commandable()
        if not vehicle.status.armed and vehicle.health.prevents_arming:
            raise Refused(
                f"Vehicle {vehicle.id} cannot be armed now, so none of the vehicles starts.",
                remedy=f"See its report (GET /vehicles/{vehicle.id}/readiness), then start all again.",
            )


async def wait_for_estimates(vehicle: Vehicle, progress: ReportProgress | None = None) -> None:
    """Waits for the position of a vehicle that has just connected over ROS 2; returns without an error if it
    has reported none in time, because not every mission needs a global position."""

    def check() -> None:
        if _start_conditions(vehicle)["origin"] is None:
            raise NotYet(f"Vehicle {vehicle.id} has no valid global position.")

    with suppress(NotYet):
        await settled(vehicle, check, progress=progress)


def _start_conditions(vehicle: Vehicle) -> dict[str, Any]:
    """Conditions for a mission that starts now: the vehicle's position and yaw, its local origin, the
    altitude of home, and whether the vehicle is in the air.

    Raises:
        NotYet: the position is unknown.
    """
    estimates = VehicleEstimates(vehicle)
    local, attitude, home = estimates.local(), estimates.attitude(), estimates.home()
    if local is None or attitude is None or not estimates.has_position():
        raise NotYet(
            f"Vehicle {vehicle.id} has no valid position estimate, which a mission needs.",
            remedy="Wait for GPS and the estimator (see the vehicle's messages), then try again.",
        )
    origin = estimates.origin()
    return {
        "position_ned_m": local.position_ned_m,
        "yaw_ned_rad": attitude.yaw_ned_rad,
        "origin": None if origin is None else asdict(origin),
        "home_alt_amsl_m": None if home is None else home.alt_amsl_m,
        "in_air": vehicle.status.armed and vehicle.status.landed_state not in ("on_ground", "unknown"),
    }


def _home_when_armed(vehicle: Vehicle) -> dict[str, float]:
    """The home altitude that PX4 sets when the vehicle is armed: the vehicle's present altitude."""
    position = vehicle.topic("global_position")
    if vehicle.topic("home") is None or position is None or not isinstance(position.value, GlobalPosition):
        return {}
    return {"home_alt_amsl_m": position.value.alt_amsl_m}
