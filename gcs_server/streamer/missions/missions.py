"""The offboard missions of all vehicles; updates each of them ten times a second."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.streamer.missions.flight import MissionFlight, Start
from gcs_server.streamer.missions.status import OffboardMissionStatus
from gcs_server.streamer.offboard.streamer import Streamer
from gcs_server.streamer.schedule.streams import Streams
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.vehicle import Vehicle

CHECK_PERIOD_S = 0.1


class OffboardMissions:
    """The newest mission of each vehicle.

    Args:
        clock: the server's.
        streamer: has the setpoint stream of each vehicle.
        streams: the streams of all vehicles.
        supervisor: runs background tasks.
    """

    def __init__(self, clock: Clock, streamer: Streamer, streams: Streams, supervisor: Supervisor) -> None:
        self._clock, self._streamer, self._streams = clock, streamer, streams
        self._supervisor = supervisor
        self._flights: dict[str, MissionFlight] = {}
        """By vehicle id."""

    def attach(self, vehicle: Vehicle) -> None:
        """Sets the vehicle's attribute `offboard_mission`."""
        vehicle.offboard_mission = VehicleMission(self, vehicle.id)

    def detach(self, vehicle: Vehicle) -> None:
        """Drops the mission of a removed vehicle."""
        self._flights.pop(vehicle.id, None)

    def start(self) -> None:
        """Starts the periodic update."""
        self._supervisor.start("offboard-missions", self._update_periodically)

    def begin(self, vehicle_id: str, start: Start) -> MissionFlight:
        """Starts a mission.

        Raises:
            Refused: the vehicle already flies a mission or has a setpoint stream, the path leaves the limits,
                or an estimate is missing.
        """
        control = self._streamer.offboard(vehicle_id)
        vehicle = control.vehicle
        vehicle.require_commandable()
        flown = self._flights.get(vehicle_id)
        if flown is not None and not flown.over:
            raise Refused(
                f"Vehicle {vehicle_id} has the mission {flown.status().name!r}.",
                remedy="Abort it first (offboard_mission/abort).",
            )
        if self._streams.state(vehicle_id).phase != "idle":
            raise Refused(
                f"Vehicle {vehicle_id} already has a setpoint stream.",
                remedy="Stop the setpoint stream first.",
            )
        control.check_segments(start.timeline.segments)

        def spawn(name: str, work: object) -> object:
            return self._supervisor.spawn(f"vehicle {vehicle_id}: {name}", work)  # type: ignore[arg-type]

        flight = MissionFlight(self._clock, control, self._streams, spawn, start)  # type: ignore[arg-type]
        flight.begin()
        self._flights[vehicle_id] = flight
        return flight

    def flight(self, vehicle_id: str) -> MissionFlight:
        """The newest mission of a known vehicle.

        Raises:
            Refused: there is none.
        """
        flight = self._flights.get(vehicle_id)
        if flight is None:
            raise Refused(
                f"Vehicle {vehicle_id} has no offboard mission.",
                remedy="Start one (POST …/offboard_mission/start).",
            )
        return flight

    def status(self, vehicle_id: str) -> OffboardMissionStatus | None:
        """Status of the newest mission of a vehicle; None: there has been none."""
        flight = self._flights.get(vehicle_id)
        return None if flight is None else flight.status()

    def update(self) -> None:
        """Updates each mission. A fault of one affects only that one: its stream is no longer renewed."""
        for vehicle_id, flight in list(self._flights.items()):
            vehicle = self._streamer.offboard(vehicle_id).vehicle
            vehicle.isolation.run("the update of its offboard mission", flight.tick)

    async def _update_periodically(self) -> None:
        while True:
            self.update()
            await self._clock.sleep(CHECK_PERIOD_S)


@dataclass(frozen=True, slots=True)
class VehicleMission:
    """A vehicle's attribute `offboard_mission`."""

    missions: OffboardMissions
    vehicle_id: str

    def status(self) -> OffboardMissionStatus | None:
        """Current status; None before the first mission."""
        return self.missions.status(self.vehicle_id)
