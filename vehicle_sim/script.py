"""Fault scripts: faults and their times in a flight, from a YAML file.

    name: GPS lost over the field
    events:
      - {at_s: 40, gps: lost}                      # 40 seconds since boot
      - {when: airborne, after_s: 5, wind_ned_m_s: [0, 8, 0], gusts_m_s: 2}
      - {when: mission, after_s: 20, vehicles: [1], motor: {number: 2, works: false}}
      - {above_m: 15, battery_percent: 12}
      - {when: landed, gps: ok, link: {name: gcs, up: true}}
      - {at_s: 60, driver: {name: sensor_baro_sim, runs: false}}
      - {when: disarmed, side_down: left}          # on its left side, for a calibration

Each event happens once for each vehicle, `after_s` after the vehicle reaches the event's condition.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.commands.sides import Side
from vehicle_sim.frames import quaternion_from_euler
from vehicle_sim.parameters import Parameters, ParameterValue, UnknownParameterError
from vehicle_sim.px4_version import VERSIONS
from vehicle_sim.sensors.suite import Driver
from vehicle_sim.simulation import Simulation
from vehicle_sim.yaml_fields import Fields, read_yaml

VEHICLE_STATES = ("armed", "disarmed", "airborne", "landed")
MODE_BY_NAME = {mode.name.lower(): mode for mode in NavState}
GPS_STATES = ("ok", "lost", "stuck")
LINK_NAMES = ("gcs", "api", "tcp", "all")
MAX_TIME_S = 1e6


class HasSystemId(Protocol):
    """A MAVLink node of a vehicle."""

    @property
    def system_id(self) -> int:
        """System id of the vehicle."""
        ...


class Fleet(Protocol):
    """The part of a simulated fleet that a script uses."""

    simulation: Simulation
    autopilots: list[Autopilot]

    @property
    def nodes(self) -> Sequence[HasSystemId]:
        """One node for each vehicle."""
        ...

    @property
    def time_s(self) -> float:
        """Simulated seconds since boot."""
        ...

    def set_link_up(self, row: int, link: str, up: bool) -> None:
        """Restores (`up`) or interrupts a link in both directions; link "all": all links of the vehicle."""
        ...

    def set_parameter(self, row: int, name: str, value: ParameterValue) -> None:
        """Changes a parameter of a vehicle."""
        ...


Action = Callable[[Fleet, int], None]
"""Changes one vehicle (row) of a fleet."""


@dataclass(frozen=True, slots=True)
class Event:
    """One event of a script, with exactly one condition: `at_s`, `state` or `above_m`."""

    at_s: float | None
    """Time since boot; None: not the condition."""
    state: str
    """State or mode; empty: not the condition."""
    above_m: float | None
    """True altitude above `Simulation.home`; None: not the condition."""
    after_s: float
    """Delay between the condition and the actions."""
    vehicles: tuple[int, ...]
    """System ids; empty: all vehicles."""
    actions: tuple[Action, ...]

    def condition_met(self, fleet: Fleet, row: int) -> bool:
        """Whether the vehicle in this row has reached the event's time, state or altitude."""
        if self.at_s is not None:
            return fleet.time_s >= self.at_s - 1e-9
        commander = fleet.autopilots[row].commander
        if self.above_m is not None:
            # The true state, because the estimate may already be faulty.
            return -float(fleet.simulation.truth.position_ned_m[row, 2]) > self.above_m
        if self.state in MODE_BY_NAME:
            return commander.armed and commander.active is MODE_BY_NAME[self.state]
        airborne = commander.armed and not commander.landed
        return {
            "armed": commander.armed,
            "disarmed": not commander.armed,
            "airborne": airborne,
            "landed": not airborne,
        }[self.state]


@dataclass(frozen=True, slots=True)
class Script:
    """All events of a file."""

    name: str
    events: tuple[Event, ...]


@dataclass(slots=True)
class _PendingEvent:
    """An event that has not happened yet for the vehicle in `row`."""

    event: Event
    row: int
    reached_at_s: float | None = None
    """Time at which the vehicle reached the condition; None: not reached yet."""


class ScriptRunner:
    """Runs a script on a fleet; call `step` after the step of the autopilots."""

    def __init__(self, script: Script, fleet: Fleet) -> None:
        self._fleet = fleet
        self._pending = [
            _PendingEvent(event, row)
            for event in script.events
            for row, node in enumerate(fleet.nodes)
            if not event.vehicles or node.system_id in event.vehicles
        ]
        self._has_flown = [False] * len(fleet.nodes)

    def step(self) -> None:
        """Executes the events that are due."""
        if not self._pending:
            return
        now_s = self._fleet.time_s
        for row, autopilot in enumerate(self._fleet.autopilots):
            self._has_flown[row] = self._has_flown[row] or (
                autopilot.commander.armed and not autopilot.commander.landed
            )
        still_pending: list[_PendingEvent] = []
        for pending in self._pending:
            event, row = pending.event, pending.row
            # "landed" is a landing after a flight, not the time before the first takeoff.
            possible = event.state != "landed" or self._has_flown[row]
            if pending.reached_at_s is None and event.condition_met(self._fleet, row) and possible:
                pending.reached_at_s = now_s
            if pending.reached_at_s is not None and now_s >= pending.reached_at_s + event.after_s - 1e-9:
                for action in event.actions:
                    action(self._fleet, row)
            else:
                still_pending.append(pending)
        self._pending = still_pending


def load_script(path: str) -> Script:
    """The script of a file.

    Raises:
        FileProblem: the file is invalid; the text names line, field and fix.
    """
    return script_from_fields(read_yaml(Path(path)))


def script_from_fields(fields: Fields) -> Script:
    """The script that a parsed file describes.

    Raises:
        FileProblem: a field is missing, unknown or invalid.
    """
    name = fields.text("name", "script")
    if not fields.has("events"):
        raise fields.problem(None, "lacks events; give a list, each entry with a dash")
    events = tuple(event_from_fields(entry) for entry in fields.items("events"))
    fields.finish()
    return Script(name, events)


def event_from_fields(fields: Fields) -> Event:
    """One event of a script.

    Raises:
        FileProblem: a field is missing, unknown or invalid.
    """
    conditions = [key for key in ("at_s", "when", "above_m") if fields.has(key)]
    if len(conditions) != 1:
        raise fields.problem(None, "needs one of at_s, when, above_m, to say when it happens")
    at_s = fields.number("at_s", None if "at_s" in conditions else 0.0, low=0.0, high=MAX_TIME_S)
    state = fields.text("when", "", choices=(*VEHICLE_STATES, *MODE_BY_NAME) if "when" in conditions else ())
    above_m = fields.number("above_m", None if "above_m" in conditions else 0.0, low=-500, high=20_000)
    after_s = fields.number("after_s", 0.0, low=0.0, high=MAX_TIME_S)
    vehicles = _vehicles(fields)
    actions = _actions(fields)
    fields.finish()
    if not actions:
        raise fields.problem(None, f"does nothing; give one of {', '.join(ACTIONS)}")
    return Event(
        at_s if "at_s" in conditions else None,
        state,
        above_m if "above_m" in conditions else None,
        after_s,
        vehicles,
        actions,
    )


def _vehicles(fields: Fields) -> tuple[int, ...]:
    if not fields.has("vehicles"):
        return ()
    return tuple(
        int(number) for number in fields.numbers("vehicles", None, "a list of system ids such as [1, 2]")
    )


def _actions(fields: Fields) -> tuple[Action, ...]:
    return tuple(create(fields) for key, create in ACTIONS.items() if fields.has(key))


def _gps_action(fields: Fields) -> Action:
    state = fields.text("gps", choices=GPS_STATES)

    def apply(fleet: Fleet, row: int) -> None:
        fleet.simulation.set_gps_enabled(row, state != "lost")
        fleet.simulation.set_gps_stuck(row, state == "stuck")
        if state == "ok":
            fleet.simulation.set_gps_offset(row, np.zeros(3))

    return apply


def _gps_offset_action(fields: Fields) -> Action:
    offset = np.array(fields.numbers("gps_offset_ned_m", 3, "[north, east, down] in metres"))
    return lambda fleet, row: fleet.simulation.set_gps_offset(row, offset)


def _driver_action(fields: Fields) -> Action:
    driver_fields = fields.mapping("driver")
    if driver_fields is None:
        raise fields.problem("driver", "must be {name: sensor_gps_sim, runs: false}")
    driver = Driver(driver_fields.text("name", choices=tuple(each.value for each in Driver)))
    runs = driver_fields.flag("runs", False)
    driver_fields.finish()
    return lambda fleet, row: fleet.simulation.set_driver(row, driver, runs)


def _side_action(fields: Fields) -> Action:
    side = Side(fields.text("side_down", choices=tuple(each.value for each in Side)))
    q_ned_frd = quaternion_from_euler(*side.roll_pitch_rad, 0.0)
    return lambda fleet, row: fleet.simulation.set_attitude_if_disarmed(row, q_ned_frd)


def _motor_action(fields: Fields) -> Action:
    motor_fields = fields.mapping("motor")
    if motor_fields is None:
        raise fields.problem("motor", "must be {number: 1, works: false}")
    number, works = motor_fields.integer("number", low=1, high=4), motor_fields.flag("works", False)
    thrust = motor_fields.number("thrust", 1.0 if works else 0.0, low=0.0, high=1.0)
    motor_fields.finish()

    def apply(fleet: Fleet, row: int) -> None:
        fleet.simulation.motor_health[row, number - 1] = thrust

    return apply


def _battery_action(fields: Fields) -> Action:
    remaining = fields.number("battery_percent", low=0.0, high=100.0) / 100.0
    return lambda fleet, row: fleet.simulation.set_battery_remaining(row, remaining)


def _wind_action(fields: Fields) -> Action:
    wind = np.array(fields.numbers("wind_ned_m_s", 3, "[north, east, down] in m/s"))
    return lambda fleet, row: fleet.simulation.set_wind(wind, row)


def _gusts_action(fields: Fields) -> Action:
    sigma_m_s = fields.number("gusts_m_s", low=0.0, high=30.0)
    return lambda fleet, row: fleet.simulation.set_gusts(sigma_m_s, row)


def _noise_action(fields: Fields) -> Action:
    factor = fields.number("sensor_noise", low=0.0, high=100.0)
    return lambda fleet, row: fleet.simulation.set_sensor_noise(row, factor)


def _vibration_action(fields: Fields) -> Action:
    sigma_m_s2 = fields.number("vibration_m_s2", low=0.0, high=1000.0)

    def apply(fleet: Fleet, row: int) -> None:
        fleet.simulation.sensor_faults.vibration_m_s2[row] = sigma_m_s2

    return apply


def _jamming_action(fields: Fields) -> Action:
    indicator = fields.integer("gps_jamming", low=0, high=255)

    def apply(fleet: Fleet, row: int) -> None:
        fleet.simulation.sensor_faults.gps_jamming[row] = indicator

    return apply


def _resistance_action(fields: Fields) -> Action:
    ohm = fields.number("battery_resistance_ohm", low=0.0, high=10.0)
    return lambda fleet, row: fleet.simulation.set_battery_resistance(row, ohm)


def _load_action(fields: Fields) -> Action:
    load = fields.number("cpu_load", low=0.0, high=1.0)

    def apply(fleet: Fleet, row: int) -> None:
        fleet.simulation.cpu_load[row] = load

    return apply


def _link_action(fields: Fields) -> Action:
    link_fields = fields.mapping("link")
    if link_fields is None:
        raise fields.problem("link", "must be {name: gcs, up: false}")
    name, up = link_fields.text("name", "all", choices=LINK_NAMES), link_fields.flag("up", False)
    link_fields.finish()
    return lambda fleet, row: fleet.set_link_up(row, name, up)


def _parameter_action(fields: Fields) -> Action:
    parameter_fields = fields.mapping("parameter")
    if parameter_fields is None:
        raise fields.problem("parameter", "must be {name: …, value: …}")
    name = parameter_fields.text("name")
    value = parameter_fields.number("value", low=-math.inf, high=math.inf)
    stores = [Parameters(px4=px4) for px4 in VERSIONS.values()]
    store = next((each for each in stores if name in each), stores[0])
    try:
        store.set(name, value)
    except (UnknownParameterError, ValueError) as error:
        raise parameter_fields.problem("name", f"cannot be set: {error}") from None
    parameter_fields.finish()

    def apply(fleet: Fleet, row: int) -> None:
        with contextlib.suppress(UnknownParameterError):  # the vehicle is another version of PX4
            fleet.set_parameter(row, name, value)

    return apply


ACTIONS: dict[str, Callable[[Fields], Action]] = {
    "gps": _gps_action,
    "gps_offset_ned_m": _gps_offset_action,
    "driver": _driver_action,
    "side_down": _side_action,
    "motor": _motor_action,
    "battery_percent": _battery_action,
    "wind_ned_m_s": _wind_action,
    "gusts_m_s": _gusts_action,
    "sensor_noise": _noise_action,
    "vibration_m_s2": _vibration_action,
    "gps_jamming": _jamming_action,
    "battery_resistance_ohm": _resistance_action,
    "cpu_load": _load_action,
    "link": _link_action,
    "parameter": _parameter_action,
}
"""Functions that create an action, by the name of the field that they read."""
