"""Finds where the interrupted flight of a plan can be resumed: after a landing, also after a restart of the
vehicle or the server."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from gcs_server.storage.files import StoredTime, typed
from gcs_server.storage.records import MAX_RECORDS, Records, Unreadable
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.limit_store import VehicleKey, key_of
from gcs_server.vehicle.samples import GlobalPosition
from gcs_server.vehicle.services.mission_on_vehicle import ItemsOnVehicle, plan_from_items
from gcs_server.vehicle.vehicle import Vehicle
from missions.geodesy import distance_m
from missions.plan import Plan
from missions.values import HomePosition, Reference
from missions.waypoints.planned import item_title
from missions.waypoints.resume import REPORTED_DISTANCE_M, ResumePoint, resume_after


@dataclass(frozen=True, slots=True)
class ResumeOffer:
    """Where an interrupted flight of the plan on the vehicle can be resumed: `POST …/mission/start` with
    `item` and `mission_id`."""

    item: int
    """Index of the item to start at, from 0: the beginning of the leg that was interrupted."""
    title: str
    """Kind of this item: "Waypoint"."""
    count: int
    """Number of items."""
    mission_id: int
    """The vehicle's checksum of the mission that was interrupted, and that it still has."""
    altitude_m: float
    """Altitude [m] to which the vehicle climbs at its position, and at which it then flies straight to the
    first waypoint. PX4 climbs to MIS_TAKEOFF_ALT if this is higher."""
    altitude_reference: Reference
    """Reference of `altitude_m`: home (the position at take-off) or amsl."""
    distance_m: float | None
    """Horizontal distance to the first waypoint [m]; null: the position is not known."""
    interrupted_item: int
    """Index of the item to which the vehicle was flying."""
    interrupted_unix_s: float
    """Time at which the flight was interrupted; if the server was not connected then, time at which the leg
    began [s since 1970]."""
    cautions: tuple[str, ...]
    """Differences from a flight without interruption, as sentences."""


class ResumeOffers:
    """Finds the offers to resume the interrupted flights of all vehicles.

    Args:
        store: the stored progress of the flights.
    """

    def __init__(self, store: ProgressStore) -> None:
        self._store = store
        self._points: dict[str, tuple[ItemsOnVehicle, FlightProgress, Plan, ResumePoint | str]] = {}
        """Newest result by vehicle; stored, because a plan can have thousands of items."""

    def forget(self, vehicle_id: str) -> None:
        """Drops all data of a removed vehicle."""
        self._points.pop(vehicle_id, None)

    async def offer_for(self, vehicle: Vehicle) -> ResumeOffer | str | None:
        """The offer, or the reason why the flight cannot be resumed, as a sentence; None: no flight was
        interrupted."""
        key = key_of(vehicle.identity)
        progress = None if key is None else self._store.find(key)
        ids = vehicle.mission.ids()
        if progress is None or ids is None or not ids["mission"]:
            return None
        on_vehicle, plan_text = (
            vehicle.mission.items_on_vehicle,
            "the plan" if progress.name is None else f"“{progress.name}”",
        )
        if ids["mission"] != progress.mission_id:
            return (
                f"Vehicle {vehicle.id} has flown {plan_text} up to item {progress.item + 1}, and now has "
                "another plan: that flight cannot be resumed."
            )
        if progress.finished:
            return f"Vehicle {vehicle.id} has flown {plan_text} to its end."
        if vehicle.mission.plan_on_vehicle() != "plan" or on_vehicle is None:
            return (
                f"Vehicle {vehicle.id} has flown {plan_text} up to item {progress.item + 1}. Read the plan "
                "back and compare it; then the flight can be resumed."
            )
        if vehicle.status.armed:
            return f"Vehicle {vehicle.id} is armed. In flight, the mission continues at its current item."
        plan, point = await self._point(vehicle, on_vehicle, progress)
        return point if isinstance(point, str) else _offer(vehicle, progress, plan, point)

    async def _point(
        self, vehicle: Vehicle, on_vehicle: ItemsOnVehicle, progress: FlightProgress
    ) -> tuple[Plan, ResumePoint | str]:
        cached = self._points.get(vehicle.id)
        if cached is None or cached[0] is not on_vehicle or cached[1] is not progress:

            def find() -> tuple[Plan, ResumePoint | str]:
                plan, _ = plan_from_items(on_vehicle)
                return plan, resume_after(plan, progress.leg_start, progress.item)

            found = await asyncio.to_thread(find)
            cached = self._points[vehicle.id] = (on_vehicle, progress, *found)
        return cached[2], cached[3]


def _offer(vehicle: Vehicle, progress: FlightProgress, plan: Plan, point: ResumePoint) -> ResumeOffer:
    items = [item for _, item in plan.simple_items()]
    first, position = point.first, VehicleEstimates(vehicle).global_position()
    away_m = (
        None
        if position is None
        else distance_m(position.lat_deg, position.lon_deg, first.lat_deg, first.lon_deg)
    )
    return ResumeOffer(
        item=point.item,
        title=item_title(items[point.item]),
        count=len(items),
        mission_id=progress.mission_id,
        altitude_m=first.altitude.value_m,
        altitude_reference=first.altitude.reference,
        distance_m=None if away_m is None else round(away_m, 1),
        interrupted_item=progress.item,
        interrupted_unix_s=progress.unix_s,
        cautions=(*_position_cautions(progress, position), *point.not_restored),
    )


def _position_cautions(progress: FlightProgress, position: GlobalPosition | None) -> tuple[str, ...]:
    """A caution if the vehicle is not where the interrupted flight took off."""
    home = progress.home
    if home is None or position is None:
        return ()
    away_m = distance_m(position.lat_deg, position.lon_deg, home.lat_deg, home.lon_deg)
    if away_m < REPORTED_DISTANCE_M:
        return ()
    return (
        f"The vehicle is {away_m:.0f} m from where the interrupted flight took off. Home will be here, and "
        "altitudes above home are measured from the ground here.",
    )


log = logging.getLogger(__name__)

FORMAT = 1
MAX_TEXT, MAX_ITEM = 300, 100_000


@dataclass(frozen=True, slots=True)
class FlightProgress:
    """How far a vehicle has flown its plan."""

    mission_id: Annotated[int, Field(ge=0, lt=2**32)]
    """The vehicle's checksum of the mission."""
    name: Annotated[str, Field(max_length=MAX_TEXT)] | None
    """Name of the stored plan."""
    item: Annotated[int, Field(ge=0, le=MAX_ITEM)]
    """Index of the item to which the vehicle was flying."""
    leg_start: Annotated[int, Field(ge=0, le=MAX_ITEM)]
    """Index of the item at which that leg begins."""
    finished: bool
    """Whether the vehicle has flown the plan to its end."""
    unix_s: StoredTime
    """Time at which the flight was interrupted, or at which this leg began [s since 1970]."""
    home: HomePosition | None
    """Where the flight took off."""


class ProgressStore:
    """The newest progress of each vehicle.

    Args:
        records: storage; None: nothing is stored for the next start of the server.
    """

    def __init__(self, records: Records | None = None) -> None:
        self._records = records
        self._stored: dict[str, FlightProgress] = {}
        self._problems: dict[str, str] = {}

    async def load(self) -> None:
        """Reads the records; unreadable records become warnings."""
        if self._records is None:
            return
        try:
            records = await asyncio.to_thread(self._records.read_all)
        except OSError as error:
            folder, reason = self._records.folder, error.strerror or error
            self._add_problem(
                "", f"The folder {folder} cannot be read: {reason}. Interrupted flights cannot be resumed."
            )
            return
        for name, content in records.items():
            try:
                if isinstance(content, Unreadable):
                    raise ValueError(content)
                self._stored[name] = _progress_of(content)
            except (ValueError, TypeError, KeyError) as error:
                reason = (str(error).splitlines() or [type(error).__name__])[0]
                self._add_problem(
                    name,
                    f"The file {self._file(name)} cannot be read: {reason}. Its flight cannot be resumed.",
                )

    def find(self, key: VehicleKey) -> FlightProgress | None:
        """The progress of a vehicle's newest flight; None: not known."""
        return self._stored.get(key.name)

    def save(self, key: VehicleKey, progress: FlightProgress) -> None:
        """Replaces the progress of a vehicle; a thread writes the record."""
        if self._stored.get(key.name) == progress:
            return
        if key.name not in self._stored and len(self._stored) >= MAX_RECORDS:
            self._forget_oldest()
        self._stored[key.name] = progress
        if self._records is not None:
            future = self._records.write(key.name, {"format": FORMAT, **_record_of(progress)})
            future.add_done_callback(lambda done: self._on_written(key.name, done))

    def warnings(self) -> list[str]:
        """Messages about records that cannot be read or written."""
        return list(self._problems.values())

    def close(self) -> None:
        """Waits for pending writes."""
        if self._records is not None:
            self._records.close()

    def _forget_oldest(self) -> None:
        oldest = min(self._stored, key=lambda name: self._stored[name].unix_s)
        del self._stored[oldest]
        if self._records is not None:
            self._records.write(oldest, None)

    def _on_written(self, name: str, done: Future[None]) -> None:
        """Updates the warnings after a write; called in the writing thread."""
        error = done.exception()
        if error is None:
            self._problems.pop(name, None)
        elif name not in self._problems:
            reason = (error.strerror if isinstance(error, OSError) else None) or error
            self._add_problem(
                name,
                f"The file {self._file(name)} cannot be written: {reason}. After a restart of the server, "
                "its flight cannot be resumed.",
            )

    def _add_problem(self, name: str, text: str) -> None:
        self._problems[name] = text
        log.warning(text)

    def _file(self, name: str) -> str:
        return "" if self._records is None else str(self._records.folder / f"{name}.json")


def _record_of(progress: FlightProgress) -> dict[str, object]:
    home = None if progress.home is None else progress.home.model_dump()
    name = None if progress.name is None else progress.name[:MAX_TEXT]
    values = {field: getattr(progress, field) for field in FlightProgress.__slots__}
    return {**values, "name": name, "home": home}


def _progress_of(content: Mapping[str, Any]) -> FlightProgress:
    if content.get("format") != FORMAT:
        raise ValueError(f"format {content.get('format')!r} is not known")
    return typed(FlightProgress, {name: value for name, value in content.items() if name != "format"})
