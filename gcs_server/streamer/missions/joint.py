"""One mission of several vehicles: they begin and end together, and the guard of groups keeps them apart."""

from __future__ import annotations

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.streamer.missions.flight import RENEWAL_TIMEOUT_S, MissionFlight, asked
from gcs_server.streamer.schedule.streams import Streams
from gcs_server.streamer.separation.guard import Finding
from gcs_server.streamer.separation.mission_guard import MissionGuard
from missions.runner.reading import Reading
from missions.runner.together import Requests, Together


class JointMission:
    """From its start to its end.

    Args:
        name: of its guard.
        flights: by role.
        clock: the server's.
        streams: what sends, and runs the guard.
        minimum_m: the minimum separation of any two vehicles.
    """

    def __init__(
        self, name: str, flights: dict[str, MissionFlight], clock: Clock, streams: Streams, minimum_m: float
    ) -> None:
        self.name, self.flights = name, flights
        self._clock, self._streams, self._minimum_m = clock, streams, minimum_m
        self._together = Together({role: flight.runner for role, flight in flights.items()})
        self._watched = False

    @property
    def over(self) -> bool:
        """Whether none of them flies it any more."""
        return self._together.over

    def others(self, flight: MissionFlight) -> tuple[str, ...]:
        """The vehicles that fly it together with this one."""
        return tuple(each.vehicle_id for each in self.flights.values() if each is not flight)

    @property
    def vehicles(self) -> dict[str, str]:
        """The vehicle of each role."""
        return {role: flight.vehicle_id for role, flight in self.flights.items()}

    def begin(self) -> None:
        """Starts all, or none.

        Raises:
            Refused: one cannot start.
        """
        for flight in self.flights.values():
            flight.require_attitude()
        requests = asked(self._together.start, self._now_s, self._readings())
        self._watch()
        self._watched = True
        for flight in self.flights.values():
            flight.joint = self
        self._do(requests)

    def look(self) -> None:
        """After each flight has looked at its vehicle."""
        if not self._watched:
            return
        if self._streams.guard(self.name) is None:  # the streams' process was started again
            self._watch()
        readings = self._readings()
        unseen = [f.vehicle_id for f in self.flights.values() if self._now_s - f.looked_s > RENEWAL_TIMEOUT_S]
        if unseen and not self._together.over:
            self.stop(f"Nothing has looked after vehicle {unseen[0]} for {RENEWAL_TIMEOUT_S:g} s: all hold")
        else:
            self._do(self._together.look(self._now_s, readings))
        if self._together.over:
            self._watched = False
            self._streams.unwatch(self.name)

    def found(self, finding: Finding) -> None:
        """The guard has stopped the vehicles that fly by setpoints; the others hold too, and it is over."""
        self.stop(f"{finding.text.rstrip('.')}: all hold")

    def stop(self, why: str) -> None:
        """All hold, and the mission is over."""
        self._do(self._together.stop(self._readings(), why))

    # --- what people ask for ----------------------------------------------------------------------

    def pause(self, by: str) -> None:
        """Raises Refused where it cannot."""
        self._do(asked(self._together.pause, self._now_s, self._readings(), by))

    def resume(self, by: str) -> None:
        """Raises Refused where one of them cannot; then none is resumed."""
        self._do(asked(self._together.resume, self._now_s, self._readings(), by))

    def abort(self, by: str, then: str) -> None:
        """Raises Refused where it is over, or all were to return: their ways home may cross."""
        if then == "return":
            raise Refused(
                "The vehicles of one mission do not return together: their ways home may cross.",
                remedy="Abort with hold, then command Return of one after the other; or abort with land.",
            )
        self._do(asked(self._together.abort, self._readings(), by, then))

    # --- inside -----------------------------------------------------------------------------------

    @property
    def _now_s(self) -> float:
        return self._clock.monotonic_s()

    def _watch(self) -> None:
        vehicles = self.vehicles.values()
        guard = MissionGuard(self.name, vehicles, minimum_m=self._minimum_m, now_s=self._now_s)
        self._streams.watch(guard)

    def _readings(self) -> dict[str, Reading]:
        return {role: flight.reading() for role, flight in self.flights.items()}

    def _do(self, requests: Requests) -> None:
        """Each vehicle's apart: a fault with one keeps none of the others from holding."""
        for role, mine in requests.items():
            self.flights[role].isolated(lambda f=self.flights[role], r=mine: f.carry_out(r))
