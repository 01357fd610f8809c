"""One mission of several vehicles. The vehicles start and end together, and the separation guard of groups
keeps them apart."""

from __future__ import annotations

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.streamer.missions.flight import RENEWAL_TIMEOUT_S, MissionFlight, call_runner
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.separation.guard import Finding
from gcs_server.streamer.separation.mission_guard import MissionGuard
from missions.runner.reading import Reading
from missions.runner.together import JointRunner, Requests


class JointMission:
    """A mission of several vehicles, from its start to its end.

    Args:
        name: name of the mission's guard.
        flights: each vehicle's flight, by role.
        clock: the server's clock.
        streams: sends the setpoints, and runs the guard.
        minimum_m: the minimum separation of any two vehicles.
    """

    def __init__(
        self, name: str, flights: dict[str, MissionFlight], clock: Clock, streams: Streams, minimum_m: float
    ) -> None:
        self.name, self.flights = name, flights
        self._clock, self._streams, self._minimum_m = clock, streams, minimum_m
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
        self._streams.watch(guard)

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
