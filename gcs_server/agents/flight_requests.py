"""Flights that an agent asks for, and that a person allows or refuses.

A request is of one dry run: its plan in its version, its vehicle. It is void as soon as anything that the
person looks at is no longer true. Only what a person has allowed is started, with the agent as the client in
control, so that the flight ends with it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal, Protocol

import msgspec

from gcs_server.agents.agent import Agent
from gcs_server.agents.answers import visible
from gcs_server.agents.calls import Request
from gcs_server.control.accepted import Commanded
from gcs_server.control.commands import API
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, InvalidRequest, Refused, UnknownVehicle
from gcs_server.flights.flights import Flights
from gcs_server.operations.operations import Operations
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.vehicle import Vehicle

MAX_DRY_RUN_AGE_S: Final = 300.0
"""A flight is asked for with a dry run that has ended within this time [s]."""
ANSWER_S: Final = 120.0
"""Time for a person to answer [s]."""
MAX_REQUESTS: Final = 20
MAX_NAME: Final = 60
State = Literal["waiting", "refused", "expired", "void", "starting", "started", "failed"]


@dataclass(frozen=True, slots=True)
class FlightRequestView:
    """A flight that an agent asks for."""

    id: str
    """Id of the request."""
    agent: str
    """Name of the agent."""
    vehicle: str
    """Id of the vehicle."""
    plan_id: str
    """Id of the plan."""
    plan_version: int
    """Version of the plan."""
    plan_name: str
    """Name of the plan."""
    kind: str
    """waypoint_plan or offboard_mission."""
    dry_run_id: str
    """Id of the dry run, which passed on this vehicle."""
    dry_run_age_s: float
    """Time since the end of the dry run [s]."""
    duration_s: float | None
    """Duration of the flight in the dry run [s]; null: not known."""
    findings: int
    """Findings of the dry run, none of which is an error."""
    state: State
    """waiting for a person; refused by a person; expired: nobody answered; void: something has changed;
    starting; started; failed."""
    text: str
    """What has become of it, as a sentence."""
    asked_unix_s: float
    """When it was asked for [s since 1970 UTC]."""
    expires_in_s: float
    """Time left to answer [s]; 0 unless it waits."""


class _DryRun(msgspec.Struct):
    """What a request needs of the result of a dry run."""

    kind: str
    name: str | None = None
    plan_id: str | None = None
    version: int | None = None
    vehicle: str | None = None
    vehicles: dict[str, str] | None = None
    monte_carlo: msgspec.Raw | None = None


@dataclass(slots=True, eq=False)
class _FlightRequest:
    id: str
    agent: Agent
    vehicle: Vehicle
    plan_id: str
    version: int
    name: str
    dry_run_id: str
    dry_run: _DryRun
    ended_unix_s: float
    duration_s: float | None
    findings: int
    asked_unix_s: float
    expires_s: float
    state: State = "waiting"
    text: str = "Waits for a person."


class RequestingStation(Commanded, Protocol):
    """The parts of the running server that requests need."""

    flights: Flights
    operations: Operations


class FlightRequests:
    """The newest requests of all agents.

    Args:
        station: the parts of the server that fly plans.
        supervisor: owns the tasks that start flights.
        request: calls the API as an agent.
        take_control: gives an agent control of a vehicle, if it may have it.
    """

    def __init__(
        self,
        station: RequestingStation,
        supervisor: Supervisor,
        request: Request,
        take_control: Callable[[Agent, str], None],
    ) -> None:
        self._station, self._supervisor = station, supervisor
        self._request, self._take_control = request, take_control
        self._requests: dict[str, _FlightRequest] = {}
        self._count = 0

    def views(self) -> list[FlightRequestView]:
        """The requests, newest first."""
        return [self._view(request) for request in reversed(self._requests.values())]

    def view(self, request_id: str) -> FlightRequestView:
        """A request. Raises InvalidRequest: there is none of this id."""
        return self._view(self._get(request_id))

    async def ask(self, agent: Agent, dry_run_id: str) -> FlightRequestView:
        """Asks a person for the flight of a dry run.

        Raises:
            UnknownDryRun, UnknownPlan, UnknownVehicle: it has no result, or its plan or vehicle is gone.
            Refused: it has not passed, is too old, or was not of one vehicle and a stored plan; or the
                vehicle cannot start now.
        """
        flights = self._station.flights
        dry_run = await asyncio.to_thread(
            msgspec.json.decode, flights.dry_runs.body(dry_run_id), type=_DryRun
        )
        plan_id, version = dry_run.plan_id, dry_run.version
        if plan_id is None or version is None or dry_run.vehicle is None or dry_run.vehicles is not None:
            raise Refused(
                f"Dry run {dry_run_id} is not that of a stored plan on one vehicle.",
                remedy="Store the plan (plans_create), then start a dry run with plan_id and vehicle.",
            )
        operation = next(
            (o for o in self._station.operations.all() if o.kind == "dry_run" and o.subject == dry_run_id),
            None,
        )
        if operation is None or operation.ended_unix_s is None or operation.result is None:
            raise Refused(f"When dry run {dry_run_id} ended is not known.", remedy="Start it again.")
        result: dict[str, Any] = operation.result
        if result.get("errors") != 0 or not result.get("finished"):
            raise Refused(
                f"Dry run {dry_run_id} has not passed: {result.get('errors')} errors, "
                f"{'finished' if result.get('finished') else 'not finished'}.",
                remedy="Read its findings (read_dry_run), change the plan, and start another dry run.",
            )
        self._require_fresh(dry_run_id, operation.ended_unix_s)
        self._count += 1
        request = _FlightRequest(
            str(self._count),
            agent,
            self._station.fleet.get(dry_run.vehicle),
            plan_id,
            version,
            visible(dry_run.name or "", MAX_NAME),
            dry_run_id,
            dry_run,
            operation.ended_unix_s,
            result.get("duration_s"),
            int(result.get("findings", 0)),
            self._station.clock.unix_s(),
            self._station.clock.monotonic_s() + ANSWER_S,
        )
        request.vehicle.require_commandable()
        if (why := await self._why_void(request)) is not None:
            raise Refused(f"The flight cannot be asked for: {why}")
        for other in self._requests.values():
            if other.state == "waiting" and agent is other.agent:
                other.state, other.text = "void", "The agent has asked for another flight."
        self._requests[request.id] = request
        while len(self._requests) > MAX_REQUESTS:
            del self._requests[next(iter(self._requests))]
        return self._view(request)

    async def allow(self, request_id: str, by: Principal) -> FlightRequestView:
        """Starts the flight, with control for the agent: that of the person who allows it, if that person has
        it.

        Raises:
            InvalidRequest: there is no such request.
            NotInControl: another client controls the vehicle.
            Refused: the request does not wait any more, or is void.
        """
        request = self._waiting(request_id)
        if (why := await self._why_void(request)) is not None:
            request.state, request.text = "void", why
        request = self._waiting(request_id)  # another person may have answered meanwhile
        lease, client = self._station.authority.control(request.vehicle.id).lease, request.agent.principal
        holder = lease.holder
        if holder is not None and holder.key == by.key:
            lease.request(client)
            lease.grant(by, client.key)
        elif holder is None or holder.key != client.key:
            refusal = lease.refusal(client)
            if refusal is not None:
                raise refusal
        self._take_control(request.agent, request.vehicle.id)
        request.state, request.text = "starting", f"{by} has allowed the flight."
        self._supervisor.spawn(f"flight of agent {request.agent.name}", self._start(request, by))
        return self._view(request)

    def refuse(self, request_id: str, by: Principal) -> FlightRequestView:
        """Refuses a flight. Raises the same errors as `allow`, but for NotInControl."""
        request = self._waiting(request_id)
        request.state, request.text = "refused", f"{by} has refused the flight."
        return self._view(request)

    async def _start(self, request: _FlightRequest, by: Principal) -> None:
        """Uploads and starts what was allowed."""
        vehicle = f"{API}/vehicles/{request.vehicle.id}"
        plan = {"plan_id": request.plan_id, "version": request.version}
        if request.dry_run.kind == "waypoint_plan":
            steps: list[tuple[str, dict[str, Any]]] = [
                (f"{vehicle}/mission/upload", {**plan, "wait": True}),
                (f"{vehicle}/mission/start", {"dry_run": request.dry_run_id}),
            ]
        else:
            compared = {} if request.dry_run.monte_carlo is None else {"dry_run": request.dry_run_id}
            steps = [(f"{vehicle}/offboard_mission/start", {**plan, **compared})]
        for path, body in steps:
            # A person may have overruled the agent during the upload.
            why = request.agent.paused.get(request.vehicle.id) or await self._why_void(request)
            if why is None:
                status, answer = await self._request(request.agent, "POST", path, {}, body)
                if status < 400:
                    continue
                why = str(answer.get("detail")) if isinstance(answer, dict) else f"status {status}"
            request.state, request.text = (
                "failed",
                f"{by} has allowed the flight, but it did not start: {why}",
            )
            return
        request.state, request.text = "started", f"{by} has allowed the flight. It has started."

    # --- what must be true ----------------------------------------------------------------------

    async def _why_void(self, request: _FlightRequest) -> str | None:
        """Why a flight that was asked for is no longer the one that would begin; None: it is."""
        why = self._why_vehicle_changed(request)
        if why is not None:
            return why
        try:
            newest, _ = await self._station.flights.plans.get(request.plan_id)
        except GcsError as error:
            return str(error)
        if newest.version != request.version:
            return f"The plan was changed: it has version {newest.version} now."
        return self._why_vehicle_changed(request)

    def _why_vehicle_changed(self, request: _FlightRequest) -> str | None:
        vehicle = request.vehicle
        try:
            if self._station.fleet.get(vehicle.id) is not vehicle:
                return "The vehicle is another one."
        except UnknownVehicle as error:
            return str(error)
        if vehicle.link_lost:
            return "The connection to the vehicle is lost."
        if vehicle.flight_state.armed:
            return "The vehicle is armed."
        return request.agent.paused.get(vehicle.id)

    def _require_fresh(self, dry_run_id: str, ended_unix_s: float) -> None:
        age_s = self._station.clock.unix_s() - ended_unix_s
        if age_s > MAX_DRY_RUN_AGE_S:
            raise Refused(
                f"Dry run {dry_run_id} ended {age_s / 60.0:.0f} minutes ago.",
                remedy=f"Start it again: one of the last {MAX_DRY_RUN_AGE_S / 60.0:.0f} minutes is accepted.",
            )

    # --- requests -------------------------------------------------------------------------------

    def _get(self, request_id: str) -> _FlightRequest:
        request = self._requests.get(request_id)
        if request is None:
            raise InvalidRequest("request_id", f"There is no request {visible(request_id, 20)!r}.")
        self._end_if_due(request)
        return request

    def _end_if_due(self, request: _FlightRequest) -> None:
        """Ends a request that waits for too long, or that is void."""
        if request.state != "waiting":
            return
        if self._station.clock.monotonic_s() > request.expires_s:
            request.state, request.text = "expired", f"Nobody answered within {ANSWER_S:g} s."
        elif (why := self._why_vehicle_changed(request)) is not None:
            request.state, request.text = "void", why

    def _waiting(self, request_id: str) -> _FlightRequest:
        request = self._get(request_id)
        if request.state != "waiting":
            raise Refused(f"The request does not wait any more. {request.text}")
        return request

    def _view(self, request: _FlightRequest) -> FlightRequestView:
        self._end_if_due(request)
        clock = self._station.clock
        waits = request.state == "waiting"
        return FlightRequestView(
            request.id,
            request.agent.name,
            request.vehicle.id,
            request.plan_id,
            request.version,
            request.name,
            request.dry_run.kind,
            request.dry_run_id,
            max(0.0, clock.unix_s() - request.ended_unix_s),
            request.duration_s,
            request.findings,
            request.state,
            request.text,
            request.asked_unix_s,
            max(0.0, request.expires_s - clock.monotonic_s()) if waits else 0.0,
        )
