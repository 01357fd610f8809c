"""One flight of a waypoint plan in PX4's Mission mode: the server monitors, reports and records it, but never
commands it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from gcs_server.flights.readings import vehicle_reading
from gcs_server.flights.resume import FlightProgress
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.samples import Mission
from gcs_server.vehicle.services.mission_on_vehicle import ItemsOnVehicle, plan_from_items
from gcs_server.vehicle.vehicle import Vehicle
from missions.plan import Plan
from missions.runner.corridor import Corridor
from missions.runner.flown import FlightRecord, FlownMission
from missions.runner.requests import Notify
from missions.traffic.path import PredictedPath
from missions.traffic.waypoints import ends_with_landing, predict_plan
from missions.values import HomePosition
from missions.vehicle import PARAMETERS, VehicleModel
from missions.waypoints.monitor import WaypointMonitor
from missions.waypoints.planned import MAX_PASSES, PlannedPasses, estimate_passes

WARNING, NOTICE = 4, 5
Prediction = Callable[[], PredictedPath | None]
"""Predicts a path, in any thread; None: the path is not known."""


@dataclass(frozen=True, slots=True)
class NamedDryRun:
    """The dry run that the client named at the start, in the vehicle's local frame."""

    dry_run: str
    planned: PlannedPasses
    corridor: Corridor | None
    """None: the dry run had only one flight, so it has no corridor."""


@dataclass(frozen=True, slots=True)
class ClientStart:
    """A start by a client of this server."""

    client: str
    path: NamedDryRun | None = None
    """None: the client named no dry run."""


@dataclass(frozen=True, slots=True)
class PlannedFlight:
    """The plan on a vehicle, and its planned flight."""

    plan: Plan
    lands: bool
    """Whether the plan ends with a landing or a return."""
    passes: PlannedPasses | None
    """None: see `reason_not_compared`."""
    reason_not_compared: str | None


class WaypointFlight:
    """One flight.

    Args:
        vehicle: the vehicle, which flies its mission.
        on_vehicle: the items on the vehicle, of a known plan.
        planned: the plan, and the planned flight.
        client_start: the start by a client; None: the pilot or another station selected Mission.
        saw_start: whether the server was connected when the vehicle entered Mission with this plan.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        on_vehicle: ItemsOnVehicle,
        planned: PlannedFlight,
        client_start: ClientStart | None,
        *,
        saw_start: bool,
    ) -> None:
        self._vehicle, self._on_vehicle = vehicle, on_vehicle
        self.saw_start = saw_start
        """Whether the server was connected when the vehicle entered Mission with this plan."""
        self._client = None if client_start is None else client_start.client
        self._path = None if client_start is None else client_start.path
        self._count, self._lands, self._planned = len(planned.plan.items), planned.lands, planned.passes
        reading = vehicle_reading(vehicle)
        self._monitor = WaypointMonitor(
            planned.plan,
            planned.passes,
            reason_not_compared=planned.reason_not_compared,
            corridor=None if self._path is None else self._path.corridor,
            from_start=saw_start and not reading.in_air,
        )
        self._progress: FlightProgress | None = None
        self._interrupted = False
        """Whether the flight was interrupted at the last call of `new_progress`."""
        name = (
            on_vehicle.plan.name
            if on_vehicle.plan is not None and on_vehicle.plan.name is not None
            else "Mission"
        )
        self._record = FlightRecord(
            name, vehicle.clock.unix_s(), self._now_s, reading, VehicleEstimates(vehicle).origin(),
            self._monitor.planned_flight,
        )  # fmt: skip

    @property
    def over(self) -> bool:
        """Whether the flight has ended."""
        return self._monitor.over

    def flies(self, on_vehicle: ItemsOnVehicle) -> bool:
        """Whether the vehicle flies these items in this flight."""
        return self._on_vehicle.ids == on_vehicle.ids

    def update(self) -> None:
        """Updates the flight with the vehicle's state; called about ten times a second."""
        if self.over or self._vehicle.status.link_lost:
            return
        if not self._has_same_plan():
            self.stop("The vehicle has another plan now.")
            return
        sample = self._vehicle.topic("mission")
        mission = sample.value if sample is not None and isinstance(sample.value, Mission) else None
        reading = vehicle_reading(self._vehicle)
        item, reached = (None, None) if mission is None else (mission.current, mission.reached)
        for notice in self._monitor.update(self._now_s, reading, item, reached):
            self._add_event(notice)
        self._record.record(self._now_s, reading, self._monitor.planned_state(reading))
        if self.over:
            self._record.end(self._now_s)

    def stop(self, reason: str) -> None:
        """Ends the flight, because the vehicle no longer flies this plan."""
        self._monitor.stop(reason)
        self._record.end(self._now_s)

    def status(self) -> WaypointFlightStatus:
        """Status of the flight."""
        monitor, stored_plan, planned = self._monitor, self._on_vehicle.plan, self._planned
        return WaypointFlightStatus(
            state=monitor.state,
            name=None if stored_plan is None else stored_plan.name,
            plan_id=None if stored_plan is None else stored_plan.id,
            version=None if stored_plan is None else stored_plan.version,
            client=self._client,
            started_unix_s=self._record.started_unix_s,
            item=monitor.item,
            count=self._count,
            place=None if monitor.over else monitor.place,
            title=None if monitor.over else monitor.title,
            planned_by=None if planned is None else planned.source,
            dry_run=None if self._path is None else self._path.dry_run,
            duration_s=None if planned is None else _rounded(planned.duration_s, 1),
            remaining_s=_rounded(monitor.remaining_s, 1),
            deviation_horizontal_m=_rounded(monitor.horizontal_m, 2),
            deviation_vertical_m=_rounded(monitor.vertical_m, 2),
            outside_corridor_m=_rounded(monitor.outside_corridor_m, 2),
            not_compared=monitor.reason_not_compared,
            reason=monitor.reason,
        )

    def prediction(self) -> Prediction | None:
        """Predicts the rest of the flight; None: the vehicle is not flying the plan, or the path is not
        known."""
        progress, origin = self._monitor.progress_now(self._now_s), VehicleEstimates(self._vehicle).origin()
        if progress is None or origin is None or self._planned is None:
            return None
        index, t_s, on_path = progress
        position = vehicle_reading(self._vehicle).position_ned_m
        if not on_path and position is None:
            return None
        return partial(
            predict_plan, self._vehicle.id, origin, self._planned,
            ends_in_air=not self._lands, index=index, t_s=t_s,
            current_position_ned_m=None if on_path else position,
            speed_m_s=vehicle_model(self._vehicle).cruise_m_s,
        )  # fmt: skip

    def new_progress(self) -> FlightProgress | None:
        """The progress of the flight; None if it has not changed since the last call. Also None before the
        first waypoint, because such a flight is repeated from its first item."""
        monitor, before = self._monitor, self._progress
        finished, leg_start = monitor.state == "done", monitor.leg_start
        if monitor.item is None or (leg_start is None and not finished):
            return None
        leg_start = 0 if leg_start is None else leg_start
        state = (monitor.item, leg_start, finished)
        was_interrupted, self._interrupted = self._interrupted, monitor.state in ("paused", "stopped")
        is_unchanged = before is not None and (before.item, before.leg_start, before.finished) == state
        if is_unchanged and (was_interrupted or not self._interrupted):
            return None
        home = _home(self._vehicle)
        self._progress = FlightProgress(
            self._on_vehicle.ids["mission"],
            None if self._on_vehicle.plan is None else self._on_vehicle.plan.name,
            *state,
            self._vehicle.clock.unix_s(),
            home,
        )
        return self._progress

    def flown(self) -> FlownMission:
        """The flight so far, with its plan."""
        return self._record.flown(self._now_s)

    @property
    def _now_s(self) -> float:
        return self._vehicle.clock.monotonic_s()

    def _has_same_plan(self) -> bool:
        """Whether the vehicle still has this plan."""
        service = self._vehicle.mission
        return (
            service.plan_on_vehicle() != "another"
            and service.items_on_vehicle is not None
            and self.flies(service.items_on_vehicle)
        )

    def _add_event(self, notice: Notify) -> None:
        data = {"source": "waypoint_flight", "code": notice.code}
        kind, severity = ("warning", WARNING) if notice.warning else ("command", NOTICE)
        unix_s = self._vehicle.clock.unix_s()
        self._vehicle.events.add(kind, unix_s, notice.text, severity=severity, data=data)


def plan_flight(
    vehicle: Vehicle, on_vehicle: ItemsOnVehicle, path: NamedDryRun | None
) -> Callable[[], PlannedFlight]:
    """Reads the vehicle's data for a flight that begins now. The returned function reads the plan, for a
    thread, because a plan can have thousands of items."""
    home, origin, model = _home(vehicle), VehicleEstimates(vehicle).origin(), vehicle_model(vehicle)

    def read() -> PlannedFlight:
        plan, _ = plan_from_items(on_vehicle)
        passes, reason = None if path is None else path.planned, None
        if passes is None and (home is None or origin is None):
            reason = "The home of the vehicle was not known when the monitoring began."
        elif passes is None and home is not None and origin is not None:
            passes = estimate_passes(plan, model, home, origin)
            if passes is None or not passes.passes:
                passes = None
                reason = f"The plan has no path, or more than {MAX_PASSES} legs with its repeats."
        return PlannedFlight(plan, ends_with_landing(plan), passes, reason)

    return read


def vehicle_model(vehicle: Vehicle) -> VehicleModel:
    """Speeds and limits of a vehicle, from its known parameters."""
    parameters = {
        name: float(param.value)
        for name in PARAMETERS.values()
        if (param := vehicle.params.known(name)) is not None
    }
    return VehicleModel.from_parameters(parameters)


def _home(vehicle: Vehicle) -> HomePosition | None:
    home = VehicleEstimates(vehicle).home()
    if home is None:
        return None
    return HomePosition(lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_amsl_m=home.alt_amsl_m)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


@dataclass(frozen=True, slots=True)
class WaypointFlightStatus:
    """Status of the newest flight of a waypoint plan in PX4's Mission mode: the topic `waypoint_flight`. The
    server only monitors the flight."""

    state: Literal["flying", "paused", "done", "stopped"]
    """paused: the vehicle is in another mode, so the server does not monitor it now; done, stopped: the
    flight has ended."""
    name: str | None
    """Name of the plan; null: the plan is not stored on this server."""
    plan_id: str | None
    """Id of the stored plan; null: the plan is not stored on this server."""
    version: int | None
    client: str | None
    """Client that started the flight; null: the pilot, another station, or a mode switch."""
    started_unix_s: float
    """Time from which the server has monitored the flight."""
    item: int | None
    """Index of the current item, from 0; null: the vehicle has not reported an item."""
    count: int
    """Number of items."""
    place: str | None
    """Current item, as in the dry run: "item 3"."""
    title: str | None
    """Kind of the current item: "Waypoint"."""
    planned_by: Literal["dry_run", "plan"] | None
    """Source of the planned path: the dry run that the start named, or straight lines between the items with
    estimated times; null: the flight is not compared with its plan."""
    dry_run: str | None
    """Id of the dry run that the start named."""
    duration_s: float | None
    """Planned time of the whole plan, from arming to disarming; null: not known."""
    remaining_s: float | None
    """Planned time until disarming; null: not known, or the flight has ended."""
    deviation_horizontal_m: float | None
    """Horizontal distance from the planned path [m]; null: see `not_compared`."""
    deviation_vertical_m: float | None
    """Vertical distance from the planned path [m]: positive above it, negative below it; null: see
    `not_compared`."""
    outside_corridor_m: float | None
    """Distance of the vehicle from the dry run's corridor [m], 0 inside; null: no corridor is monitored
    now."""
    not_compared: str | None
    """Why there is no deviation now."""
    reason: str | None
    """Why the flight is paused or has stopped."""
