"""Several vehicles without physics that fly one mission together, with one clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.offboard.roles import compile_roles
from missions.offboard.state import MissionVehicle
from missions.runner.requests import Request
from missions.runner.together import JointRunner
from tests.support.mission_vehicle import FakeFlight


class Squad:
    """The roles of a mission, each with its vehicle.

    Args:
        text: YAML of the mission.
        in_air: roles whose vehicles are already flying.
    """

    def __init__(self, text: str, in_air: Iterable[str] = ()) -> None:
        mission = read(text)
        starts = {role: Start(in_air=role in in_air) for role in mission.roles}
        compiled = compile_roles(mission, dict.fromkeys(starts, MissionVehicle()), starts)
        self.flights = {
            role: FakeFlight(mission, timeline=timeline) for role, timeline in compiled.timelines.items()
        }
        for role in in_air:
            self.flights[role].set_reading(armed=True, landed="in_air")
        self.together = JointRunner({role: flight.runner for role, flight in self.flights.items()})
        self.now_s = 100.0

    def start(self) -> Squad:
        self.do(self.together.start(self.now_s, self.readings()))
        return self

    def readings(self):
        return {role: flight.reading for role, flight in self.flights.items()}

    def do(self, requests: dict[str, list[Request]]) -> None:
        for role, role_requests in requests.items():
            self.flights[role].do(role_requests)

    def step(self) -> None:
        """Updates each vehicle, then the runner."""
        for flight in self.flights.values():
            flight.step()
        self.now_s = next(iter(self.flights.values())).now_s
        self.do(self.together.update(self.now_s, self.readings()))

    def until(self, condition: Callable[[], bool], within_s: float = 300.0) -> Squad:
        """Flies until the condition is true.

        Raises:
            AssertionError: the condition was not true in time.
        """
        end_s = self.now_s + within_s
        while not condition():
            assert self.now_s < end_s, f"not within {within_s} s: {self.states()}"
            self.step()
        return self

    def fly(self, for_s: float) -> Squad:
        """Flies for this time."""
        end_s = self.now_s + for_s
        return self.until(lambda: self.now_s >= end_s, for_s + 1.0)

    def states(self) -> dict[str, str]:
        return {role: flight.status.state for role, flight in self.flights.items()}

    def places(self) -> dict[str, str | None]:
        return {role: flight.status.place for role, flight in self.flights.items()}

    def reach(self, **states: str) -> Squad:
        """Flies until each given role is in this state."""
        return self.until(lambda: states.items() <= self.states().items())
