"""The mission that the vehicles of a group fly, each of them its role."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.flights.mission_flight import RENEWAL_TIMEOUT_S, MissionFlight, call_runner
from missions.runner.group import GroupRunner, Requests
from missions.runner.reading import Reading


class GroupMission:
    """A mission of several vehicles, from its start to its end. The group ends with it.

    Args:
        flights: each vehicle's flight.
        clock: the server's clock.
    """

    def __init__(self, flights: Iterable[MissionFlight], clock: Clock) -> None:
        self.flights = {flight.start.role or "": flight for flight in flights}
        """By role."""
        start = next(iter(self.flights.values())).start
        self.name, self.client = start.mission.name, start.client
        self._clock = clock
        self._runner = GroupRunner({role: flight.runner for role, flight in self.flights.items()})

    @property
    def over(self) -> bool:
        """Whether the mission has ended for all vehicles."""
        return self._runner.over

    @property
    def end_reason(self) -> str:
        """Why the mission has ended."""
        reasons = (flight.status().reason for flight in self.flights.values())
        return next((f"{reason.rstrip('.')}." for reason in reasons if reason), "The mission is done.")

    def other_vehicle_ids(self, flight: MissionFlight) -> tuple[str, ...]:
        """Ids of the other vehicles of the mission."""
        return tuple(each.vehicle_id for each in self.flights.values() if each is not flight)

    def begin(self) -> Requests:
        """Begins the flights of all vehicles, or none; `execute` their first requests.

        Raises:
            Refused: one vehicle cannot start.
        """
        for flight in self.flights.values():
            flight.require_attitude()
        requests = call_runner(self._runner.start, self._clock.monotonic_s(), self._readings())
        for flight in self.flights.values():
            flight.group = self
        return requests

    def update(self) -> None:
        """Updates all flights, then the mission; ends it before that if a vehicle on the ground was given
        another command, so that none takes off."""
        for flight in self.flights.values():
            command = flight.overtaken_by
            if command is not None and not flight.over and not flight.vehicle.status.armed:
                self.stop(f"Vehicle {flight.vehicle_id} was given “{command.label}”")
        for flight in self.flights.values():
            flight.run_isolated(flight.update)
        now_s = self._clock.monotonic_s()
        late = [f.vehicle_id for f in self.flights.values() if now_s - f.updated_s > RENEWAL_TIMEOUT_S]
        if late and not self.over:
            timeout = f"{RENEWAL_TIMEOUT_S:g} s"
            self.stop(f"The mission of vehicle {late[0]} was not updated for {timeout}: all hold")
        else:
            self.execute(self._runner.update(now_s, self._readings()))

    def stop(self, reason: str) -> None:
        """Puts all vehicles into Hold and ends the mission."""
        self.execute(self._runner.stop(self._readings(), reason))

    def pause(self, by: str) -> None:
        """Pauses all vehicles. Raises Refused if this is not possible now."""
        now_s = self._clock.monotonic_s()
        self.execute(call_runner(self._runner.pause, now_s, self._readings(), by))

    def resume(self, by: str) -> None:
        """Resumes all vehicles, or none: raises Refused if one cannot resume."""
        now_s = self._clock.monotonic_s()
        self.execute(call_runner(self._runner.resume, now_s, self._readings(), by))

    def abort(self, by: str, then: str) -> None:
        """Ends the mission. Raises Refused if the mission has ended, or for "return", because the vehicles'
        paths home may cross.
        """
        if then == "return":
            raise Refused(
                "The vehicles of one mission cannot return at the same time: their paths home may cross.",
                remedy="Abort with hold, then command Return for one vehicle at a time; or abort with land.",
            )
        self.execute(call_runner(self._runner.abort, self._readings(), by, then))

    def execute(self, requests: Requests) -> None:
        """Executes each vehicle's requests separately, so that a fault of one vehicle does not stop the
        others from holding.
        """
        for role, vehicle_requests in requests.items():
            flight = self.flights[role]
            flight.run_isolated(lambda f=flight, r=vehicle_requests: f.execute_requests(r))

    def _readings(self) -> Mapping[str, Reading]:
        return {role: flight.reading() for role, flight in self.flights.items()}
