"""All vehicles' offboard missions: who flies one, and the look at each ten times a second."""

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
        streamer: gives each vehicle's setpoint stream.
        streams: what sends.
        supervisor: owns what is done in the background.
    """

    def __init__(self, clock: Clock, streamer: Streamer, streams: Streams, supervisor: Supervisor) -> None:
        self._clock, self._streamer, self._streams = clock, streamer, streams
        self._supervisor = supervisor
        self._flights: dict[str, MissionFlight] = {}
        """By the vehicle's id."""

    def attach(self, vehicle: Vehicle) -> None:
        """Gives a vehicle its topic."""
        vehicle.offboard_mission = VehicleMission(self, vehicle.id)

    def detach(self, vehicle: Vehicle) -> None:
        """It is not known any more; its mission is over."""
        self._flights.pop(vehicle.id, None)

    def start(self) -> None:
        """Begins to look."""
        self._supervisor.start("offboard-missions", self._look_for_ever)

    def begin(self, vehicle_id: str, start: Start) -> MissionFlight:
        """Flies a mission.

        Raises:
            Refused: the vehicle flies one, something else streams to it, the path leaves the limits, or an
                estimate is missing.
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
        """The mission of a vehicle that is known.

        Raises:
            Refused: it has none.
        """
        flight = self._flights.get(vehicle_id)
        if flight is None:
            raise Refused(
                f"Vehicle {vehicle_id} has no offboard mission.",
                remedy="Start one (POST …/offboard_mission/start).",
            )
        return flight

    def status(self, vehicle_id: str) -> OffboardMissionStatus | None:
        """How the newest mission of a vehicle stands; None: there has been none."""
        flight = self._flights.get(vehicle_id)
        return None if flight is None else flight.status()

    def look(self) -> None:
        """At each mission; the fault of one costs that one only: nothing renews its stream any more."""
        for vehicle_id, flight in list(self._flights.items()):
            vehicle = self._streamer.offboard(vehicle_id).vehicle
            vehicle.isolation.run("the look at its offboard mission", flight.tick)

    async def _look_for_ever(self) -> None:
        while True:
            self.look()
            await self._clock.sleep(CHECK_PERIOD_S)


@dataclass(frozen=True, slots=True)
class VehicleMission:
    """A vehicle's attribute `offboard_mission`."""

    missions: OffboardMissions
    vehicle_id: str

    def status(self) -> OffboardMissionStatus | None:
        """Now; None before its first mission."""
        return self.missions.status(self.vehicle_id)
