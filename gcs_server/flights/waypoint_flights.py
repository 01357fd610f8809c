"""The flights of waypoint plans of all vehicles; monitors each flight ten times a second."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, Refused
from gcs_server.flights.resume import ProgressStore, ResumeOffer, ResumeOffers
from gcs_server.flights.waypoint_flight import (
    ClientStart,
    PlannedFlight,
    Prediction,
    WaypointFlight,
    WaypointFlightStatus,
    plan_flight,
)
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.limit_store import key_of
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.services.mission_on_vehicle import Ids
from gcs_server.vehicle.vehicle import Vehicle
from missions.runner.flown import FlownMission
from missions.traffic.path import PredictedPath

PERIOD_S = 0.1
STANDING_TURNS = 5
"""A vehicle that has not flown a plan is checked at every fifth update, in turn with the others."""
HOME_WAIT_S = 10.0
"""Time to wait for the home of a vehicle that is already flying a plan when the server starts. After that the
flight is monitored, but not compared with the planned path."""


class WaypointFlights:
    """The newest flight of each vehicle that flies a plan which the server knows.

    Args:
        clock: the server's clock.
        supervisor: runs the periodic update.
        store: stores the progress of the flights across restarts.
    """

    def __init__(self, clock: Clock, supervisor: Supervisor, store: ProgressStore) -> None:
        self._clock, self._supervisor = clock, supervisor
        self._store, self._resume_offers = store, ResumeOffers(store)
        self._vehicles: dict[str, Vehicle] = {}
        self._link_loss: dict[str, LinkLoss] = {}
        self._flights: dict[str, WaypointFlight] = {}
        self._client_starts: dict[str, ClientStart] = {}
        self._beginning: dict[str, asyncio.Task[None]] = {}
        """Tasks that read the plan of a flight that has begun, by vehicle."""
        self._in_mission: dict[str, bool] = {}
        """Whether the vehicle was flying its mission at the last update."""
        self._monitored: dict[str, None] = {}
        """Vehicles that are checked at every update: those with a flight, or not yet checked."""
        self._updates = 0
        self._start_paths: dict[str, PredictedPath] = {}
        """Predicted paths of vehicles that are being started."""
        self.comparison_lock = asyncio.Lock()
        """Locked while a start is compared with the flights of other vehicles. So if two vehicles are started
        at the same time, the second start is compared with the first."""
        self._accepted: dict[str, tuple[Ids | None, frozenset[str]]] = {}
        """Ids of the mission, and the codes of findings that a client accepted for the present flight."""
        self._waiting_since_s: dict[str, float] = {}
        """Time since which the monitoring of a flying vehicle waits for its home position [s, monotonic]."""

    def attach(self, vehicle: Vehicle) -> None:
        """Sets the vehicle's attribute `waypoint_flight`, and monitors the vehicle."""
        vehicle.waypoint_flight = VehicleWaypointFlight(self, vehicle.id)
        if not vehicle.identity.replayed:
            self._vehicles[vehicle.id] = vehicle
            self._monitored[vehicle.id] = None
            self._link_loss[vehicle.id] = LinkLoss(vehicle, self._clock)

    def detach(self, vehicle: Vehicle) -> None:
        """Drops all data of a removed vehicle."""
        by_vehicle = (self._vehicles, self._link_loss, self._flights, self._client_starts, self._start_paths)
        for values in (*by_vehicle, self._in_mission, self._monitored, self._accepted, self._waiting_since_s):
            values.pop(vehicle.id, None)
        self._resume_offers.forget(vehicle.id)

    def start(self) -> None:
        """Starts the periodic update."""
        self._supervisor.repeat("waypoint-flights", self.update, PERIOD_S)

    @asynccontextmanager
    async def started_by_client(self, vehicle_id: str, client_start: ClientStart) -> AsyncGenerator[None]:
        """Context for a client's start of a mission: a flight that begins in the block was started by the
        client.

        A start with a dry run always begins a new flight, also for a vehicle in the air. A start without a
        dry run continues a flight that is already monitored.
        """
        self._client_starts[vehicle_id] = client_start
        try:
            yield
            if (vehicle := self._vehicles.get(vehicle_id)) is not None:
                self._update_vehicle(vehicle)
                if (beginning := self._beginning.get(vehicle_id)) is not None:
                    await asyncio.wait([beginning])
        finally:
            self._client_starts.pop(vehicle_id, None)
            self._start_paths.pop(vehicle_id, None)

    def accepted_codes(self, vehicle: Vehicle, ids: Ids | None) -> frozenset[str]:
        """Codes of findings that a client accepted when it started the present flight of this mission."""
        of_ids, codes = self._accepted.get(vehicle.id, (None, frozenset[str]()))
        return codes if of_ids == ids and vehicle.flight_state.armed else frozenset()

    def accept_codes(self, vehicle: Vehicle, ids: Ids | None, codes: frozenset[str]) -> None:
        """Keeps accepted codes until the vehicle is disarmed or has another mission."""
        self._accepted[vehicle.id] = (ids, codes)

    def set_start_path(self, vehicle_id: str, path: PredictedPath) -> None:
        """Sets the path that a vehicle will fly after its start; valid until the end of the block
        `started_by_client`."""
        self._start_paths[vehicle_id] = path

    def prediction(self, vehicle_id: str) -> Prediction | None:
        """Predicts the path of a vehicle from now to the end of its plan. None: the vehicle does not fly a
        plan and is not being started, or its path is not known."""
        if (path := self._start_paths.get(vehicle_id)) is not None:
            return lambda: path
        flight, vehicle = self._flights.get(vehicle_id), self._vehicles.get(vehicle_id)
        if flight is None or flight.over or vehicle is None or not vehicle.status.armed:
            return None  # a vehicle that has just disarmed has landed, also before the next update
        return flight.prediction()

    def status(self, vehicle_id: str) -> WaypointFlightStatus | None:
        """Status of a vehicle's newest flight; None: there was no flight."""
        flight = self._flights.get(vehicle_id)
        return None if flight is None else flight.status()

    def if_link_lost(self, vehicle_id: str) -> str | None:
        """What the vehicle does in Mission mode without a ground station, as a sentence; None: not known."""
        link_loss = self._link_loss.get(vehicle_id)
        return None if link_loss is None else link_loss.text()

    def flown(self, vehicle_id: str) -> FlownMission:
        """A vehicle's newest flight, with its plan.

        Raises:
            Refused: there was no flight.
        """
        flight = self._flights.get(vehicle_id)
        if flight is None:
            raise Refused(
                f"Vehicle {vehicle_id} has not flown a plan that the server knows.",
                remedy="Upload a plan, or read it back and compare it, then start it.",
            )
        return flight.flown()

    async def resume_offer(self, vehicle_id: str) -> ResumeOffer | str | None:
        """Where a vehicle's interrupted flight can be resumed, or the reason why it cannot be resumed, as a
        sentence; None: no flight was interrupted."""
        vehicle = self._vehicles.get(vehicle_id)
        return None if vehicle is None else await self._resume_offers.offer_for(vehicle)

    def update(self) -> None:
        """Updates each flight. A fault in one flight affects only that vehicle."""
        self._updates += 1
        standing = list(self._vehicles)[self._updates % STANDING_TURNS :: STANDING_TURNS]
        for vehicle_id in dict.fromkeys((*self._monitored, *standing)):
            vehicle = self._vehicles[vehicle_id]
            vehicle.isolation.run("the update of its waypoint flight", self._update_vehicle, vehicle)

    def _update_vehicle(self, vehicle: Vehicle) -> None:
        flight = self._flights.get(vehicle.id)
        if flight is not None:
            flight.update()
            self._save_progress(vehicle, flight)
        was_flying = self._in_mission.get(vehicle.id, True)
        is_flying = vehicle.flight_state.armed and (
            vehicle.mode == "mission" or (was_flying and flight is None and self._left_mission(vehicle))
        )
        if not (is_flying or was_flying) or vehicle.link_lost:
            return
        self._in_mission[vehicle.id] = is_flying
        if is_flying or flight is not None:
            self._monitored[vehicle.id] = None
        else:
            self._monitored.pop(vehicle.id, None)
        if is_flying:
            self._begin_if_new(vehicle, flight, was_flying)

    def _begin_if_new(self, vehicle: Vehicle, flight: WaypointFlight | None, was_flying: bool) -> None:
        if vehicle.id in self._beginning:
            return
        client_start = self._client_starts.pop(vehicle.id, None)
        if flight is not None and not flight.over:
            if client_start is None or client_start.path is None:
                return
            flight.stop(f"{client_start.client} started the plan again.")
        on_vehicle = vehicle.mission.items_on_vehicle
        if on_vehicle is None or vehicle.mission.plan_on_vehicle() != "plan":
            return
        if flight is not None and was_flying and client_start is None and flight.flies(on_vehicle):
            return
        saw_start = client_start is not None or not was_flying
        if not saw_start and self._waits_for_home(vehicle):
            return
        self._waiting_since_s.pop(vehicle.id, None)
        path = None if client_start is None else client_start.path
        read = plan_flight(vehicle, on_vehicle, path)

        def begin(planned: PlannedFlight | BaseException) -> None:
            if isinstance(planned, BaseException):
                raise planned
            if self._vehicles.get(vehicle.id) is vehicle:  # otherwise it was removed meanwhile
                flight = WaypointFlight(vehicle, on_vehicle, planned, client_start, saw_start=saw_start)
                self._flights[vehicle.id] = flight
                flight.update()

        async def read_and_begin() -> None:
            (planned,) = await asyncio.gather(asyncio.to_thread(read), return_exceptions=True)
            vehicle.isolation.run("the begin of its waypoint flight", begin, planned)

        task = self._supervisor.spawn(f"vehicle {vehicle.id}: waypoint flight", read_and_begin())
        self._beginning[vehicle.id] = task
        task.add_done_callback(lambda _: self._beginning.pop(vehicle.id, None))

    def _left_mission(self, vehicle: Vehicle) -> bool:
        """Whether an armed vehicle has left its mission while the server did not run: it is in the air in
        another mode, and its stored flight has not ended. The vehicle then still reports how far it came."""
        key, ids = key_of(vehicle.identity), vehicle.mission.ids()
        progress = None if key is None else self._store.find(key)
        return (
            progress is not None
            and not progress.finished
            and vehicle.flight_state.landed_state != "on_ground"
            and (ids is None or ids["mission"] == progress.mission_id)
        )

    def _save_progress(self, vehicle: Vehicle, flight: WaypointFlight) -> None:
        if (key := key_of(vehicle.identity)) is None or (progress := flight.new_progress()) is None:
            return
        stored = self._store.find(key)
        if (
            not flight.saw_start
            and stored is not None
            and not progress.finished
            and (stored.mission_id, stored.item) == (progress.mission_id, progress.item)
        ):
            progress = replace(progress, leg_start=max(stored.leg_start, progress.leg_start))
        self._store.save(key, progress)

    def _waits_for_home(self, vehicle: Vehicle) -> bool:
        estimates, now_s = VehicleEstimates(vehicle), self._clock.monotonic_s()
        if estimates.home() is not None and estimates.origin() is not None:
            return False
        return now_s - self._waiting_since_s.setdefault(vehicle.id, now_s) < HOME_WAIT_S


@dataclass(frozen=True, slots=True)
class VehicleWaypointFlight:
    """A vehicle's attribute `waypoint_flight`."""

    flights: WaypointFlights
    vehicle_id: str

    def status(self) -> WaypointFlightStatus | None:
        """Current status; None before the first flight."""
        return self.flights.status(self.vehicle_id)


LINK_LOSS_PARAMETERS = ("NAV_DLL_ACT", "COM_DL_LOSS_T", "COM_DLL_EXCEPT", "COM_FAIL_ACT_T")
EXCEPT_MISSION = 1
"""Bit of COM_DLL_EXCEPT."""
REQUEST_PERIOD_S = 10.0
"""Time between two requests for the parameters [s]."""
_ACTIONS = {
    1: "holds its position in Hold mode",
    2: "returns (RTL)",
    3: "lands at its current position",
    5: "terminates the flight: the motors stop and it falls",
    6: "disarms: the motors stop and it falls",
}
"""The vehicle's action by NAV_DLL_ACT."""
_AFTER_HOLD = (2, 3)
"""Actions that PX4 begins with Hold for COM_FAIL_ACT_T, so that the pilot can take over."""


class LinkLoss:
    """What one vehicle does in Mission mode without a ground station.

    Args:
        vehicle: the vehicle.
        clock: the server's clock.
    """

    def __init__(self, vehicle: Vehicle, clock: Clock) -> None:
        self._vehicle, self._clock = vehicle, clock
        self._requested_s: float | None = None
        self._read_values: dict[str, float] = {}
        """Values of the parameters that were read by name."""

    def text(self) -> str | None:
        """The action as a sentence; None: not known yet.

        Parameters that the vehicle's parameter list does not contain are read in the background
        repeatedly, because they may change.
        """
        known_values = {
            name: each.value for name in LINK_LOSS_PARAMETERS if (each := self._vehicle.params.known(name))
        }
        now_s = self._clock.monotonic_s()
        due = self._requested_s is None or now_s - self._requested_s >= REQUEST_PERIOD_S
        if (
            len(known_values) < len(LINK_LOSS_PARAMETERS)
            and due
            and "parameters" not in self._vehicle.reach.missing
        ):
            self._requested_s = now_s
            self._vehicle.in_background("its action without a ground station", self._request(known_values))
        return link_loss_text({**self._read_values, **known_values})

    async def _request(self, known_values: Mapping[str, float]) -> None:
        self._vehicle.require_commandable()
        for name in LINK_LOSS_PARAMETERS:
            try:
                if name not in known_values:
                    self._read_values[name] = (await self._vehicle.params.get(name)).value
            except GcsError:
                continue  # the parameter stays unknown: the firmware does not have it, or the link is bad


def link_loss_text(parameters: Mapping[str, float]) -> str | None:
    """The action by the vehicle's parameters, as a sentence; None if NAV_DLL_ACT is not known."""
    if "NAV_DLL_ACT" not in parameters:
        return None
    action, exceptions = int(parameters["NAV_DLL_ACT"]), int(parameters.get("COM_DLL_EXCEPT", 0))
    if action == 0:
        return "The vehicle continues the mission (NAV_DLL_ACT 0)."
    if exceptions & EXCEPT_MISSION:
        return f"The vehicle continues the mission (COM_DLL_EXCEPT {exceptions})."
    after_s = parameters.get("COM_DL_LOSS_T")
    after_text = "After COM_DL_LOSS_T" if after_s is None else f"After about {after_s:g} s"
    action_text = _ACTIONS.get(action, "does an action that is unknown to this server")
    hold_s = parameters.get("COM_FAIL_ACT_T")
    if action in _AFTER_HOLD and hold_s != 0.0:
        action_text = (
            f"holds for {'COM_FAIL_ACT_T' if hold_s is None else f'{hold_s:g} s'}, then {action_text}"
        )
    return f"{after_text} without any ground station, the vehicle {action_text} (NAV_DLL_ACT {action})."
