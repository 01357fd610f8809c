"""The offboard missions of all vehicles; updates each of them ten times a second."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.flights.group_mission import GroupMission
from gcs_server.flights.groups import Groups
from gcs_server.flights.mission_flight import MissionFlight
from gcs_server.flights.mission_values import OffboardMissionStatus, Start
from gcs_server.streamer.offboard.streamer import Streamer
from gcs_server.streamer.process.streams import Streams
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions.runner.runner import LOW_BATTERY_SHARE

UPDATE_PERIOD_S = 0.1


class OffboardMissions:
    """The newest mission of each vehicle.

    Args:
        clock: the server's clock.
        streamer: the setpoint control of all vehicles.
        streams: the streams in the stream process.
        groups: keeps the vehicles of one mission together.
        supervisor: runs background tasks.
    """

    def __init__(
        self, clock: Clock, streamer: Streamer, streams: Streams, groups: Groups, supervisor: Supervisor
    ) -> None:
        self._clock, self._streamer, self._streams = clock, streamer, streams
        self._groups, self._supervisor = groups, supervisor
        self._flights: dict[str, MissionFlight] = {}
        """By vehicle id."""

    def attach(self, vehicle: Vehicle) -> None:
        """Sets the vehicle's attribute `offboard_mission`."""
        vehicle.offboard_mission = VehicleMission(self, vehicle.id)

    def detach(self, vehicle: Vehicle) -> None:
        """Drops the mission of a removed vehicle."""
        flight = self._flights.pop(vehicle.id, None)
        if flight is not None and flight.group is not None and not flight.over:
            flight.group.stop(f"Vehicle {vehicle.id} was removed: all hold")

    def start(self) -> None:
        """Starts the periodic update."""
        self._supervisor.repeat("offboard-missions", self.update, UPDATE_PERIOD_S)

    def begin(
        self, starts: Mapping[str, Start], tickets: Mapping[str, Ticket], minimum_m: float | None = None
    ) -> None:
        """Starts a mission: all its vehicles begin, or none.

        Args:
            starts: each vehicle's part of the mission, by vehicle id.
            tickets: ticket of the command that starts it, by vehicle id; missing: opened here.
            minimum_m: the minimum separation of any two vehicles; not used for one vehicle.

        Raises:
            Interrupted: a ticket was cancelled.
            Refused: a vehicle already flies a mission or has a setpoint stream, its path leaves the limits,
                or an estimate is missing.
        """
        flights = [self._prepare(vehicle_id, start) for vehicle_id, start in starts.items()]
        with ExitStack() as stack:
            for flight in flights:
                own = tickets.get(flight.vehicle_id) or flight.vehicle.tickets.open("start the mission")
                stack.enter_context(closing(own))
                stack.enter_context(flight.commanded(own))
            if len(flights) == 1:
                flights[0].begin()
            else:
                assert minimum_m is not None
                self._groups.begin_mission(GroupMission(flights, self._clock), minimum_m)
        self._flights |= {flight.vehicle_id: flight for flight in flights}

    def require_free(self, vehicle_id: str) -> None:
        """Called before a start is prepared, and again when it begins.

        Raises:
            Refused: the vehicle flies a mission, or has a setpoint stream.
        """
        self._streamer.offboard(vehicle_id).vehicle.require_commandable()
        previous = self._flights.get(vehicle_id)
        if previous is not None and not previous.over:
            raise Refused(
                f"Vehicle {vehicle_id} has the mission {previous.status().name!r}.",
                remedy="Abort it first (offboard_mission/abort).",
            )
        if self._streams.state(vehicle_id).phase != "idle":
            raise Refused(
                f"Vehicle {vehicle_id} already has a setpoint stream.",
                remedy="Stop the setpoint stream first.",
            )

    async def ready(self) -> None:
        """Returns once streams and guards can run; raises Refused if they cannot."""
        await self._streams.ready()

    def _prepare(self, vehicle_id: str, start: Start) -> MissionFlight:
        self.require_free(vehicle_id)
        control = self._streamer.offboard(vehicle_id)
        control.check_segments(start.timeline.segments, start.mode)

        def spawn(name: str, work: Coroutine[Any, Any, None]) -> asyncio.Task[Any]:
            return self._supervisor.spawn(f"vehicle {vehicle_id}: {name}", work)

        return MissionFlight(self._clock, control, self._streams, spawn, start)

    def flight(self, vehicle_id: str) -> MissionFlight:
        """The newest mission of a vehicle.

        Raises:
            Refused: the vehicle has had no mission.
        """
        flight = self._flights.get(vehicle_id)
        if flight is None:
            raise Refused(
                f"Vehicle {vehicle_id} has no offboard mission.",
                remedy="Start one (POST …/offboard_mission/start).",
            )
        return flight

    def find_flight(self, vehicle_id: str) -> MissionFlight | None:
        """The newest mission of a vehicle; None: the vehicle has had no mission."""
        return self._flights.get(vehicle_id)

    def flown_in(self, vehicle_id: str, mode: str) -> MissionFlight | None:
        """The vehicle's mission that is flown in this mode and has not ended; None: no such mission."""
        flight = self._flights.get(vehicle_id)
        return flight if flight is not None and flight.mode == mode and not flight.over else None

    def others_on_mission(self, vehicle_id: str) -> tuple[str, ...]:
        """Ids of the other vehicles that fly the same mission as this vehicle."""
        flight = self._flights.get(vehicle_id)
        group = None if flight is None else flight.group
        return () if flight is None or group is None or group.over else group.other_vehicle_ids(flight)

    def status(self, vehicle_id: str) -> OffboardMissionStatus | None:
        """Status of a vehicle's newest mission; None: the vehicle has had no mission."""
        flight = self._flights.get(vehicle_id)
        return None if flight is None else flight.status()

    def update(self) -> None:
        """Updates each mission; a group updates the flights of its members. A fault in one mission affects
        only that mission: its stream is no longer renewed."""
        for flight in list(self._flights.values()):
            if flight.group is None or flight.group.over:
                flight.run_isolated(flight.update)


def low_battery_share(vehicle: Vehicle) -> float:
    """Battery charge (0 to 1) below which a mission executes its low-battery action."""
    low = vehicle.params.known("BAT_LOW_THR")
    return LOW_BATTERY_SHARE if low is None else float(low.value)


@dataclass(frozen=True, slots=True)
class VehicleMission:
    """A vehicle's attribute `offboard_mission`."""

    missions: OffboardMissions
    vehicle_id: str

    def status(self) -> OffboardMissionStatus | None:
        """Current status; None before the first mission."""
        return self.missions.status(self.vehicle_id)

    @property
    def active(self) -> bool:
        """Whether the newest mission has not ended."""
        flight = self.missions.find_flight(self.vehicle_id)
        return flight is not None and not flight.over

    @property
    def flown_by_pilot(self) -> bool:
        """Whether a pilot or another station has started the mission that is flown now."""
        flight = self.missions.find_flight(self.vehicle_id)
        return flight is not None and flight.runner.in_charge and flight.runner.flight.started_by_pilot
