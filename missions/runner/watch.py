"""Checks during a mission: control by a client, battery charge and estimates."""

from __future__ import annotations

from collections.abc import Iterator

from missions.runner.flight import Flight
from missions.runner.parts import Failure
from missions.runner.reading import Reading
from missions.setpoints import Estimate

ESTIMATE_LOST_S = 1.0
IN_FLIGHT: tuple[Estimate, ...] = ("position", "velocity", "heading")
"""Estimates that are needed during the whole flight. The global position is not needed, because the mission
was converted to local positions before its start."""

PX4_SOURCES = ("vehicle", "failsafe")
"""Sources of a mode change by PX4 itself. These sources do not show which party started the mission. While
the vehicle is disarmed, the source is always `vehicle`; after a failsafe in flight, PX4 itself returns to the
mission's mode."""


def missing_estimate(flight: Flight, reading: Reading, candidates: tuple[Estimate, ...]) -> str | None:
    """The first of these estimates that the mission needs and the vehicle does not have."""
    if reading.estimates is None:
        return None
    needed = (each for each in flight.needs if each in candidates)
    return next((each.replace("_", " ") for each in needed if each not in reading.estimates), None)


def takeover_reason(reading: Reading) -> str:
    """A message that names who took over control of the vehicle, and the new mode."""
    name = (reading.mode or "another mode").capitalize()
    party = {
        "command": reading.mode_text or "A command",
        "pilot": "The RC pilot",
        "failsafe": "The vehicle's failsafe",
        "station": "Another ground station",
    }.get(reading.mode_source or "", "Another party (RC pilot, another station, or the vehicle itself)")
    return party if reading.mode_source == "command" else f"{party} switched to {name}"


class FlightWatch:
    """Checks one mission.

    Args:
        flight: the flight to check.
        low_battery_share: battery charge at which the mission's low-battery action is executed.
    """

    def __init__(self, flight: Flight, low_battery_share: float) -> None:
        self._flight = flight
        self._low_battery_share = low_battery_share
        self._last_control_holder: str | None = None
        self._control_lost_reported = self._low_battery_reported = False
        self._estimate_lost_since_s: float | None = None

    def record_start(self, reading: Reading, *, may_be_selected: bool = True) -> None:
        """Records which party has started or resumed the mission: the client in control, or the pilot or
        other ground station that selected the flight mode of the mission.

        Args:
            reading: the vehicle's state.
            may_be_selected: whether the mission may have been started by selecting its flight mode; False: a
                request of a client has started or resumed the mission.
        """
        self._last_control_holder, self._control_lost_reported = reading.control_holder, False
        flight = self._flight
        selected = may_be_selected and flight.mode != "offboard" and reading.mode == flight.mode
        if not selected or reading.mode_source == "command":
            flight.started_by_pilot = False
        elif reading.mode_source not in PX4_SOURCES:
            flight.started_by_pilot = True

    def begin_part(self) -> None:
        """Resets the checks for a new part of the flight."""
        self._estimate_lost_since_s = None

    def problems(self, now_s: float, reading: Reading, *, by_setpoints: bool) -> Iterator[Failure]:
        """Yields each current problem; the caller may stop after the first.

        Args:
            now_s: monotonic time.
            reading: the vehicle's state.
            by_setpoints: whether the server's setpoints fly the vehicle, which requires its estimates.
        """
        yield from self._check_control(reading)
        yield from self._check_battery(reading)
        if by_setpoints and not reading.on_ground:
            yield from self._check_estimates(now_s, reading)

    def _check_control(self, reading: Reading) -> Iterator[Failure]:
        control_holder = reading.control_holder
        if control_holder == self._last_control_holder:
            return
        if self._flight.started_by_pilot:
            self._last_control_holder = control_holder
            party = "No client" if control_holder is None else reading.control_holder_name or "Another client"
            yield Failure("continue", f"{party} has control now, but another party selected this flight mode")
            return
        if control_holder is None:
            self._last_control_holder = None
            if not self._control_lost_reported:
                self._control_lost_reported = True
                yield Failure(self._flight.actions.control_lost, "No client has control")
            return
        control_changed, self._last_control_holder = self._last_control_holder is not None, control_holder
        self._control_lost_reported = False
        if control_changed:
            yield Failure("pause", f"{reading.control_holder_name or 'Another client'} has control now")

    def _check_battery(self, reading: Reading) -> Iterator[Failure]:
        share = reading.battery_share
        if share is not None and share <= self._low_battery_share and not self._low_battery_reported:
            self._low_battery_reported = True
            yield Failure(self._flight.actions.low_battery, f"Battery at {share:.0%}")

    def _check_estimates(self, now_s: float, reading: Reading) -> Iterator[Failure]:
        missing = missing_estimate(self._flight, reading, IN_FLIGHT)
        if missing is None:
            self._estimate_lost_since_s = None
            return
        if self._estimate_lost_since_s is None:
            self._estimate_lost_since_s = now_s
        if now_s - self._estimate_lost_since_s >= ESTIMATE_LOST_S:
            yield Failure("land", f"No valid estimate of {missing}")


CONFIRM_S = 1.0
"""Time to wait for the new mode, which shows who took control [s]."""
REPLACED = "Another party commands the vehicle: PX4 no longer accepts commands of the mission's mode"
"""Reason for suspending the mission if the mode has not changed within `CONFIRM_S`."""


class ExecutorControl:
    """Detects that the executor of the mission's mode is no longer in charge of the vehicle, because another
    party or a failsafe has changed the mode; without an executor, `is_lost` is never true.

    PX4 reports this separately from the new mode, either before or after it.
    """

    def __init__(self) -> None:
        self._was_in_charge = False
        self._lost_since_s: float | None = None

    def begin_part(self, reading: Reading) -> None:
        """Resets the detection when a new part of the mission (take-off, setpoints or landing) begins."""
        self._was_in_charge, self._lost_since_s = reading.executor_in_charge is True, None

    def is_lost(self, reading: Reading) -> bool:
        """Whether the executor was in charge during this part and is no longer in charge."""
        self._was_in_charge |= reading.executor_in_charge is True
        if self._was_in_charge and reading.executor_in_charge is False and reading.armed is not False:
            return True
        self._lost_since_s = None
        return False

    def loss_confirmed(self, now_s: float) -> bool:
        """Whether `is_lost` has been true for `CONFIRM_S`; call it only while `is_lost` is true."""
        if self._lost_since_s is None:
            self._lost_since_s = now_s
        return now_s - self._lost_since_s >= CONFIRM_S
