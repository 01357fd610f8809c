"""What a mission relies on while it flies: somebody in control, the battery, the estimates."""

from __future__ import annotations

from collections.abc import Iterator

from missions.runner.flight import Flight
from missions.runner.parts import Failure
from missions.runner.reading import Reading
from missions.setpoints import Estimate

ESTIMATE_LOST_S = 1.0
IN_FLIGHT: tuple[Estimate, ...] = ("position", "velocity", "heading")
"""Estimates that are needed all the time; places on the earth are local ones by then."""


def missing_estimate(flight: Flight, reading: Reading, wanted: tuple[Estimate, ...]) -> str | None:
    """One of these that the mission needs and the vehicle does not have."""
    if reading.estimates is None:
        return None
    needed = (each for each in flight.needs if each in wanted)
    return next((each.replace("_", " ") for each in needed if each not in reading.estimates), None)


def who_took_over(reading: Reading) -> str:
    """Who flies the vehicle instead of the mission, and how."""
    name = (reading.mode or "another mode").capitalize()
    who = {
        "command": reading.mode_text or "A command",
        "pilot": "The pilot",
        "failsafe": "The vehicle's failsafe",
        "station": "Another ground station",
    }.get(reading.mode_source or "", "Somebody else (pilot, another station, or the vehicle itself)")
    return who if reading.mode_source == "command" else f"{who} switched to {name}"


class FlightWatch:
    """Of one mission.

    Args:
        flight: what is flown.
        low_battery_share: below this the mission's action for low battery is taken.
    """

    def __init__(self, flight: Flight, low_battery_share: float) -> None:
        self._flight = flight
        self._low_battery_share = low_battery_share
        self._owner: str | None = None
        self._control_lost_told = self._low_battery_told = False
        self._estimate_lost_s: float | None = None

    def answered_for(self, reading: Reading) -> None:
        """Who has control now has started or resumed the mission."""
        self._owner, self._control_lost_told = reading.holder, False

    def begin_part(self) -> None:
        """Another part of the flight begins."""
        self._estimate_lost_s = None

    def look(self, now_s: float, reading: Reading, *, by_setpoints: bool) -> Iterator[Failure]:
        """What is wrong now, one after the other; whoever acts on one may leave out the rest.

        Args:
            now_s: monotonic.
            reading: the vehicle.
            by_setpoints: whether it is flown by setpoints of ours, which need its estimates.
        """
        yield from self._control(reading)
        yield from self._battery(reading)
        if by_setpoints and not reading.on_ground:
            yield from self._estimates(now_s, reading)

    def _control(self, reading: Reading) -> Iterator[Failure]:
        holder = reading.holder
        if holder == self._owner:
            return
        if holder is None:
            self._owner = None
            if not self._control_lost_told:
                self._control_lost_told = True
                yield Failure(self._flight.actions.control_lost, "No client has control")
            return
        taken, self._owner = self._owner is not None, holder
        self._control_lost_told = False
        if taken:
            yield Failure("pause", f"{reading.holder_name or 'Another client'} has control now")

    def _battery(self, reading: Reading) -> Iterator[Failure]:
        share = reading.battery_share
        if share is not None and share <= self._low_battery_share and not self._low_battery_told:
            self._low_battery_told = True
            yield Failure(self._flight.actions.low_battery, f"Battery at {share:.0%}")

    def _estimates(self, now_s: float, reading: Reading) -> Iterator[Failure]:
        missing = missing_estimate(self._flight, reading, IN_FLIGHT)
        if missing is None:
            self._estimate_lost_s = None
            return
        if self._estimate_lost_s is None:
            self._estimate_lost_s = now_s
        if now_s - self._estimate_lost_s >= ESTIMATE_LOST_S:
            yield Failure("land", f"No valid estimate of {missing}")
