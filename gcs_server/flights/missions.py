"""The offboard missions of all vehicles; updates each of them ten times a second."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.flights.guards import Guards
from gcs_server.flights.mission_flight import RENEWAL_TIMEOUT_S, MissionFlight, call_runner
from gcs_server.flights.mission_values import OffboardMissionStatus, Start
from gcs_server.streamer.offboard.streamer import Streamer
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.separation import Finding, MissionGuard
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions.runner.reading import Reading
from missions.runner.runner import LOW_BATTERY_SHARE
from missions.runner.together import JointRunner, Requests

UPDATE_PERIOD_S = 0.1


class OffboardMissions:
    """The newest mission of each vehicle.

    Args:
        clock: the server's clock.
        streamer: the setpoint control of all vehicles.
        streams: the streams in the stream process.
        guards: the guards of groups and missions.
        supervisor: runs background tasks.
    """

    def __init__(
        self, clock: Clock, streamer: Streamer, streams: Streams, guards: Guards, supervisor: Supervisor
    ) -> None:
        self._clock, self._streamer, self._streams = clock, streamer, streams
        self._guards, self._supervisor = guards, supervisor
        self._flights: dict[str, MissionFlight] = {}
        """By vehicle id."""
        self._joint_missions: dict[str, JointMission] = {}
        """Missions of several vehicles that are being flown, by the name of their guard."""
        self._count = 0

    def attach(self, vehicle: Vehicle) -> None:
        """Sets the vehicle's attribute `offboard_mission`."""
        vehicle.offboard_mission = VehicleMission(self, vehicle.id)

    def detach(self, vehicle: Vehicle) -> None:
        """Drops the mission of a removed vehicle."""
        flight = self._flights.pop(vehicle.id, None)
        if flight is not None and flight.joint is not None and not flight.over:
            flight.joint.stop(f"Vehicle {vehicle.id} was removed: all hold")

    def start(self) -> None:
        """Starts the periodic update."""
        self._supervisor.repeat("offboard-missions", self.update, UPDATE_PERIOD_S)

    def begin(self, vehicle_id: str, start: Start, ticket: Ticket | None = None) -> MissionFlight:
        """Starts a mission.

        Args:
            vehicle_id: the vehicle.
            start: the mission.
            ticket: ticket of the command that starts it; None: opened here.

        Raises:
            Interrupted: the ticket was cancelled.
            Refused: the vehicle already flies a mission or has a setpoint stream, the path leaves the limits,
                or an estimate is missing.
        """
        flight = self._prepare(vehicle_id, start)
        own = ticket or flight.vehicle.tickets.open("start the mission")
        with closing(own), flight.commanded(own):
            flight.begin()
        self._flights[vehicle_id] = flight
        return flight

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

    def begin_together(
        self,
        starts: Mapping[str, tuple[str, Start]],
        minimum_m: float,
        tickets: Mapping[str, Ticket] | None = None,
    ) -> JointMission:
        """Starts a mission of several vehicles: all vehicles begin, or none.

        Args:
            starts: for each role the vehicle's id and its start.
            minimum_m: the minimum separation of any two vehicles.
            tickets: the ticket of the command, by vehicle id; None: opened here.

        Raises:
            Refused: `begin` would refuse one of the vehicles.
        """
        flights = {role: self._prepare(vehicle_id, start) for role, (vehicle_id, start) in starts.items()}
        self._count += 1
        joint = JointMission(
            f"mission {self._count}", flights, self._clock, self._streams, self._guards, minimum_m
        )
        with ExitStack() as stack:
            for flight in flights.values():
                given = None if tickets is None else tickets[flight.vehicle_id]
                own = given or flight.vehicle.tickets.open("start the mission")
                stack.enter_context(closing(own))
                stack.enter_context(flight.commanded(own))
            joint.begin()
        self._joint_missions[joint.name] = joint
        self._flights |= {flight.vehicle_id: flight for flight in flights.values()}
        return joint

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
        joint = None if flight is None else flight.joint
        return () if flight is None or joint is None or joint.over else joint.other_vehicle_ids(flight)

    def status(self, vehicle_id: str) -> OffboardMissionStatus | None:
        """Status of a vehicle's newest mission; None: the vehicle has had no mission."""
        flight = self._flights.get(vehicle_id)
        return None if flight is None else flight.status()

    def update(self) -> None:
        """Updates each mission. A fault in one mission affects only that mission: its stream is no longer
        renewed."""
        # before the missions, so that a stop by the guard is not handled as a failure of the mission
        self._guards.collect()
        for flight in list(self._flights.values()):
            flight.run_isolated(flight.update)

        for name, joint in list(self._joint_missions.items()):
            next(iter(joint.flights.values())).run_isolated(joint.update)
            if joint.over:
                del self._joint_missions[name]
                self._guards.forget(name)


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


class JointMission:
    """A mission of several vehicles, from its start to its end.

    Args:
        name: name of the mission's guard.
        flights: each vehicle's flight, by role.
        clock: the server's clock.
        streams: sends the setpoints, and runs the guard.
        guards: the guards of groups and missions.
        minimum_m: the minimum separation of any two vehicles.
    """

    def __init__(
        self,
        name: str,
        flights: dict[str, MissionFlight],
        clock: Clock,
        streams: Streams,
        guards: Guards,
        minimum_m: float,
    ) -> None:
        self.name, self.flights = name, flights
        self._clock, self._streams, self._guards, self._minimum_m = clock, streams, guards, minimum_m
        self._runner = JointRunner({role: flight.runner for role, flight in flights.items()})
        self._guarded = False

    @property
    def over(self) -> bool:
        """Whether the mission has ended for all vehicles."""
        return self._runner.over

    def other_vehicle_ids(self, flight: MissionFlight) -> tuple[str, ...]:
        """Ids of the other vehicles of the mission."""
        return tuple(each.vehicle_id for each in self.flights.values() if each is not flight)

    @property
    def vehicles(self) -> dict[str, str]:
        """The vehicle of each role."""
        return {role: flight.vehicle_id for role, flight in self.flights.items()}

    def begin(self) -> None:
        """Starts all vehicles, or none.

        Raises:
            Refused: one vehicle cannot start.
        """
        for flight in self.flights.values():
            flight.require_attitude()
        requests = call_runner(self._runner.start, self._now_s, self._readings())
        self._start_guard()
        self._guarded = True
        for flight in self.flights.values():
            flight.joint = self
        self._execute(requests)

    def update(self) -> None:
        """Updates the mission; called after the update of each flight."""
        if not self._guarded:
            return
        if self._streams.guard(self.name) is None:  # the stream process was restarted
            self._start_guard()
        readings = self._readings()
        not_updated = [
            f.vehicle_id for f in self.flights.values() if self._now_s - f.updated_s > RENEWAL_TIMEOUT_S
        ]
        if not_updated and not self._runner.over:
            self.stop(
                f"The mission of vehicle {not_updated[0]} was not updated for "
                f"{RENEWAL_TIMEOUT_S:g} s: all hold"
            )
        else:
            self._execute(self._runner.update(self._now_s, readings))
        if self._runner.over:
            self._guarded = False
            self._streams.unwatch(self.name)

    def stop_on_finding(self, finding: Finding) -> None:
        """Puts the other vehicles into Hold as well and ends the mission; called when the guard has stopped
        the vehicles that fly by setpoints.
        """
        self.stop(f"{finding.text.rstrip('.')}: all hold")

    def stop(self, reason: str) -> None:
        """Puts all vehicles into Hold and ends the mission."""
        self._execute(self._runner.stop(self._readings(), reason))

    # --- requests of clients ----------------------------------------------------------------------

    def pause(self, by: str) -> None:
        """Pauses all vehicles. Raises Refused if this is not possible now."""
        self._execute(call_runner(self._runner.pause, self._now_s, self._readings(), by))

    def resume(self, by: str) -> None:
        """Resumes all vehicles, or none: raises Refused if one cannot resume."""
        self._execute(call_runner(self._runner.resume, self._now_s, self._readings(), by))

    def abort(self, by: str, then: str) -> None:
        """Ends the mission. Raises Refused if the mission has ended, or for "return", because the vehicles'
        paths home may cross.
        """
        if then == "return":
            raise Refused(
                "The vehicles of one mission cannot return at the same time: their paths home may cross.",
                remedy="Abort with hold, then command Return for one vehicle at a time; or abort with land.",
            )
        self._execute(call_runner(self._runner.abort, self._readings(), by, then))

    # --- inside -----------------------------------------------------------------------------------

    @property
    def _now_s(self) -> float:
        return self._clock.monotonic_s()

    def _start_guard(self) -> None:
        vehicles = self.vehicles.values()
        guard = MissionGuard(self.name, vehicles, minimum_m=self._minimum_m, now_s=self._now_s)
        self._guards.watch(guard, self.stop_on_finding)

    def _readings(self) -> dict[str, Reading]:
        return {role: flight.reading() for role, flight in self.flights.items()}

    def _execute(self, requests: Requests) -> None:
        """Executes each vehicle's requests separately, so that a fault of one vehicle does not stop the
        others from holding.
        """
        for role, vehicle_requests in requests.items():
            self.flights[role].run_isolated(
                lambda f=self.flights[role], r=vehicle_requests: f.execute_requests(r)
            )
