"""Several fake vehicles without physics that fly one mission together on one clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.offboard.roles import compile_roles
from missions.offboard.state import MissionVehicle
from missions.runner.group import GroupRunner
from missions.runner.requests import Request
from tests.support.mission_vehicle import FakeFlight


class GroupFlight:
    """A runner for all roles of a mission, and a fake vehicle for each role.

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
        self.runner = GroupRunner({role: flight.runner for role, flight in self.flights.items()})
        self.now_s = 100.0

    def start(self) -> GroupFlight:
        self.execute(self.runner.start(self.now_s, self.readings()))
        return self

    def readings(self):
        return {role: flight.reading for role, flight in self.flights.items()}

    def execute(self, requests: dict[str, list[Request]]) -> None:
        for role, role_requests in requests.items():
            self.flights[role].execute(role_requests)

    def step(self) -> None:
        """Updates each vehicle, then the runner."""
        for flight in self.flights.values():
            flight.step()
        self.now_s = next(iter(self.flights.values())).now_s
        self.execute(self.runner.update(self.now_s, self.readings()))

    def until(self, condition: Callable[[], bool], within_s: float = 300.0) -> GroupFlight:
        """Flies until the condition is true.

        Raises:
            AssertionError: the condition was not true in time.
        """
        end_s = self.now_s + within_s
        while not condition():
            assert self.now_s < end_s, f"not within {within_s} s: {self.states()}"
            self.step()
        return self

    def fly(self, for_s: float) -> GroupFlight:
        """Flies for this time [s]."""
        end_s = self.now_s + for_s
        return self.until(lambda: self.now_s >= end_s, for_s + 1.0)

    def states(self) -> dict[str, str]:
        return {role: flight.status.state for role, flight in self.flights.items()}

    def current_steps(self) -> dict[str, str | None]:
        """The current step of each role, such as "lead, step 2"."""
        return {role: flight.status.place for role, flight in self.flights.items()}

    def until_states(self, **states: str) -> GroupFlight:
        """Flies until each of these roles is in its state."""
        return self.until(lambda: states.items() <= self.states().items())
