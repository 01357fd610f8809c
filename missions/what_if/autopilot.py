"""Flies on from a moment of a logged flight with the simulated PX4, which makes the setpoints itself: row 0
with what the log had, row 1 with changes.

Both vehicles take off at home and are then moved to the logged moment: motion, integrals of the controllers,
trajectory, battery, parameters, wind, mode and mission item are those of the log. Their sensors have no
noise. What came from outside later (commands, sticks, lost links) is not flown again; the ground is level at
home.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.fleet import SEVERITY_WARNING, TICK_S, Vehicle
from missions.dry_run.pilot import Step
from missions.dry_run.setup import USED_PARAMETERS_OF_SIMULATED, release_name, simulated_release
from missions.dry_run.waypoints import StoredPlan
from missions.errors import PlanError
from missions.plan import Plan
from missions.runner.runner import CannotDo
from missions.what_if.changed_plan import ItemChange, changed_plan
from missions.what_if.changed_step import StepChange, number_of
from missions.what_if.flight import LoggedAutopilot, LoggedFlight, NotFlyable
from missions.what_if.mission_moment import FlownMission
from missions.what_if.mission_pilot import Answers, MissionPilot
from missions.what_if.rerun import CHANGED, Change, RecordedParameters, Rerun, Track
from vehicle_sim.autopilot.announcer import Event, StatusText
from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.modes import MODES, NavState
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import VERSIONS
from vehicle_sim.simulation import SimulationOrigin
from vehicle_sim.state import FlightMoment, TruthState, Vector

Values = NDArray[np.float64]

MODES_FLOWN = (NavState.MISSION, NavState.HOLD, NavState.RTL, NavState.LAND)
"""Modes that can be begun at any moment of them."""
FROM_LOG = (*USED_PARAMETERS_OF_SIMULATED, "CBRK_FLIGHTTERM", "COM_*", "FD_*", "HTE_*", "NAV_*")
NOT_OF_REAL = ("EKF2_*", "IMU_*", "SIM_*")
"""Of `FROM_LOG`, those that only a simulated vehicle's log gives."""
FROM_BOOT = ("CA_ROTOR*", "MC_*", "MPC_THR_*", "SIH_*")
"""Parameters with which the vehicles already take off."""
TAKEOFF_WITHIN_S, HOVER_S = 90.0, 4.0
STREAMED_BEFORE_S = 1.0
"""Setpoints are streamed for this long before PX4 switches to Offboard."""
MIN_HEIGHT_M = 0.2
"""Above home."""
EVERY_TICKS = 5
"""A sample is taken every so many ticks: 10 Hz."""
Losable = Literal["data_link", "manual_control", "gps"]
LOSABLE: tuple[Losable, ...] = get_args(Losable)


@dataclass(frozen=True, slots=True)
class AutopilotChange:
    """What else is different in the changed flight from the moment on."""

    battery_share: float | None = None
    """Charge at the moment, 0 to 1; None: as logged."""
    lost: frozenset[Losable] = frozenset()
    item: ItemChange | None = None
    step: StepChange | None = None


@dataclass(slots=True)
class Flown:
    """One flight from the moment on, in the local frame of the log; a sample each 0.1 s."""

    positions_ned_m: list[Values] = field(default_factory=list["Values"])
    velocities_ned_m_s: list[Values] = field(default_factory=list["Values"])
    attitudes_ned_frd: list[Values] = field(default_factory=list["Values"])
    modes: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])
    """Times since the moment [s], and modes that became active."""
    warnings: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])
    """Times since the moment [s], and warnings of the vehicle or of its offboard mission."""
    steps: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])
    """Times since the moment [s], and steps of the offboard mission that began."""

    def note_mode(self, autopilot: Autopilot, t_s: float) -> None:
        """Notes the mode of an armed vehicle, if it has changed."""
        mode = MODES[autopilot.commander.active].name
        if autopilot.commander.armed and (not self.modes or self.modes[-1][1] != mode):
            self.modes.append((round(t_s, 2), mode))

    def note_step(self, step: Step | None, t_s: float) -> None:
        """Notes the step of an offboard mission, if another one has begun."""
        if step is not None:
            text = f"Step {number_of(step.place)}: {step.title}"
            if not self.steps or self.steps[-1][1] != text:
                self.steps.append((round(t_s, 2), text))

    def sample(self, truth: TruthState, row: int, home_ned_m: Values) -> None:
        """Adds a sample."""
        self.positions_ned_m.append(truth.position_ned_m[row] + home_ned_m)
        self.velocities_ned_m_s.append(truth.velocity_ned_m_s[row].copy())
        self.attitudes_ned_frd.append(truth.q_ned_frd[row].copy())

    @property
    def track(self) -> Track:
        """What the vehicle did."""
        return Track(*map(np.array, (self.positions_ned_m, self.velocities_ned_m_s, self.attitudes_ned_frd)))


class AutopilotFlights:
    """The two flights.

    Args:
        flight: the logged flight, from some seconds before the moment to a moment after it.
        logged: what its autopilot was doing at the moment.
        plan: the flown plan; None: not known.
        parameters: of the aircraft, including the model of its body (SIH_*).
        wind_ned_m_s: (N, 3) wind at each sample of the flight; after its end it blows as the mean of them.
        change, more: what is different in row 1.
        mission: the flown offboard mission at the moment; None: it flew none, or not in Offboard.

    Raises:
        NotFlyable: the vehicle is not in a mode that can be flown on, its plan is not known, or the change
            is none here.
    """

    def __init__(
        self,
        flight: LoggedFlight,
        logged: LoggedAutopilot,
        plan: Plan | None,
        parameters: Mapping[str, float],
        wind_ned_m_s: Values,
        change: Change,
        more: AutopilotChange,
        mission: FlownMission | None = None,
    ) -> None:
        self._flight, self._logged, self._plan = flight, logged, plan
        self._parameters, self._wind, self._mean_wind = parameters, wind_ned_m_s, wind_ned_m_s.mean(axis=0)
        self._change, self._more = change, more
        self._mission = mission
        self.mode = _mode(logged.nav_state, mission is not None)
        self.notes: list[str] = []
        self._stores: list[RecordedParameters] = []
        self._plans = (self._stored(None), self._stored(more.item))
        if more.step is not None and mission is None:
            text = f"The vehicle flew in {MODES[self.mode].name} then, in which no mission step is flown."
            raise NotFlyable(text, "step")
        self._px4 = VERSIONS[release_name(simulated_release(logged.release))]
        self._check_change()

    def _check_change(self) -> None:
        known = Parameters(px4=self._px4)
        unknown = sorted(name for name in self._change.parameters if name not in known)
        if unknown:
            text = f"{unknown[0]} is not a parameter of the simulated PX4 v{self._px4.name}."
            raise NotFlyable(text, "parameters")
        if any(self._change.moved_ned_m):
            text = "The simulated PX4 makes its own setpoints; move a plan item or a mission step instead."
            raise NotFlyable(text, "moved_ned_m")

    def _stored(self, item: ItemChange | None) -> tuple[StoredPlan, int] | None:
        """The plan as the vehicle stores it, and the index of its current item."""
        plan, current, in_mission = self._plan, self._logged.mission_item, self.mode is NavState.MISSION
        if not in_mission and item is not None:
            text = f"The vehicle flew in {MODES[self.mode].name} then, in which no plan item is flown."
            raise NotFlyable(text, "item")
        if plan is None:
            if in_mission:
                raise NotFlyable("This server does not know the plan that was flown.", "plan")
            return None
        if in_mission and current is None:
            raise NotFlyable("The log does not say at which item the mission was (mission_result).", "plan")
        current = current or 0
        count = sum(1 for _ in plan.simple_items())
        if in_mission and current >= count:
            text = f"The plan has {count} items and the log was at item {current + 1}: it is another plan."
            raise NotFlyable(text, "plan")
        try:
            changed = plan if item is None else changed_plan(plan, item, current)
            return StoredPlan.from_plan(changed), current
        except PlanError as error:
            raise NotFlyable(str(error), "plan" if item is None else "item") from error

    def fly(self, from_s: float, duration_s: float) -> tuple[Flown, Flown]:
        """Flies until both have landed and disarmed, or for `duration_s`.

        Raises:
            NotFlyable: the vehicle is not in the air then, or the simulated PX4 refuses the plan or the mode.
        """
        moment, trajectory = self._moment(from_s)
        boot = {n: v for n, v in self._parameters.items() if _matches(n, FROM_BOOT)}
        self._stores = [RecordedParameters(boot, self._px4) for _ in range(2)]
        logged = self._logged
        sim = SimulatedFleet(
            2, links=(), stores=self._stores, sensor_noise=False, start_ned_m=np.zeros((2, 3)),
            origin=SimulationOrigin(logged.home_lat_deg, logged.home_lon_deg, logged.home_alt_amsl_m),
        )  # fmt: skip
        links = _Links(sim, self._more.lost)
        _take_off(sim, links)
        vehicles = [Vehicle(*each) for each in zip(sim.autopilots, sim.nodes, strict=True)]
        flown = Flown(), Flown()
        pilots = self._pilots(sim, links, vehicles, flown, from_s)
        for row, vehicle in enumerate(vehicles):
            self._begin(sim, row, moment)
            if not vehicle.autopilot.fly_on(self.mode, trajectory):
                name = MODES[self.mode].name
                text = f"The simulated PX4 does not fly on in {name}: {vehicle.last_warning}."
                raise NotFlyable(text, "item" if row == CHANGED and self._more.item else "plan")
            self._set_target(vehicle.autopilot)
        for pilot in pilots:
            try:
                pilot.fly_on(sim.time_s)
            except CannotDo as error:
                raise NotFlyable(f"The mission cannot fly on: {error}.") from error
        self._cause(sim, links)
        self._run(sim, links, pilots, flown, from_s, duration_s)
        for name in sorted(set(self._change.parameters) - self._stores[CHANGED].used):
            self.notes.append(f"The simulated PX4 did not use {name} in this part: it changes nothing.")
        return flown

    def _pilots(
        self,
        sim: SimulatedFleet,
        links: _Links,
        vehicles: Sequence[Vehicle],
        flown: Sequence[Flown],
        from_s: float,
    ) -> list[MissionPilot]:
        """Those of an offboard mission, whose setpoints the vehicles already get."""
        mission, step = self._mission, self._more.step
        if mission is None:
            return []
        moments = mission.moment, mission.moment if step is None else mission.changed(step)
        self.notes += mission.notes
        changes: tuple[Mapping[str, float], ...] = {}, self._change.parameters
        north, east, down = self._logged.home_ned_m.tolist()
        begin_s = sim.time_s + STREAMED_BEFORE_S
        pilots = [
            MissionPilot(
                vehicle, mission.runner(moment, {**self._flight.parameters, **changed}), (north, east, down),
                Answers(self._flight, from_s), _noted(each.warnings, begin_s),
            )
            for vehicle, moment, changed, each in zip(vehicles, moments, changes, flown, strict=True)
        ]  # fmt: skip
        while sim.time_s < begin_s:
            for pilot in pilots:
                pilot.stream_hover()
            links.keep()
            sim.step(TICK_S)
        return pilots

    def _moment(self, from_s: float) -> tuple[FlightMoment, tuple[Vector, Vector, Vector]]:
        """The logged moment and the trajectory's setpoint, from home."""
        flight, home_ned_m = self._flight, self._logged.home_ned_m
        moment = Rerun(flight, self._parameters, self._wind, Change({})).moment(from_s)
        start = flight.first_after(from_s)
        trajectory = (
            self._from_home(flight.target_position_ned_m[start]),
            _vector(flight.target_velocity_ned_m_s[start]),
            _vector(flight.target_acceleration_ned_m_s2[start]),
        )
        position_ned_m = moment.position_ned_m - home_ned_m
        if position_ned_m[2] > -MIN_HEIGHT_M:
            raise NotFlyable("The vehicle is not above the height of its home then: the ground is there.")
        return replace(moment, position_ned_m=position_ned_m), trajectory

    def _set_target(self, autopilot: Autopilot) -> None:
        """The logged place of Hold, of a landing, or above which Return climbs."""
        if self.mode is NavState.MISSION or self._logged.target_ned_m is None:
            return
        path = autopilot.navigator.path
        north, east, down = self._from_home(self._logged.target_ned_m)
        path.target_ned_m = (north, east, down if self.mode is NavState.HOLD else path.target_ned_m[2])

    def _from_home(self, position_ned_m: Values | Vector) -> Vector:
        return _vector(np.asarray(position_ned_m) - self._logged.home_ned_m)

    def _begin(self, sim: SimulatedFleet, row: int, moment: FlightMoment) -> None:
        """Gives a vehicle the logged moment, and what its autopilot had then."""
        simulation, autopilot, logged = sim.simulation, sim.autopilots[row], self._logged
        simulated, store = "SIH_MASS" in self._flight.parameters, self._stores[row]
        for name, value in self._flight.parameters.items():
            usable = _matches(name, FROM_LOG) and (simulated or not _matches(name, NOT_OF_REAL))
            if usable and name in store and math.isfinite(value):
                store.set(name, value)
        if logged.battery is not None and not simulated:
            endurance_s = logged.battery.endurance_s
            store.set("SIM_BAT_ENABLE", endurance_s is not None)
            store.set("SIM_BAT_DRAIN", endurance_s or 0.0)
            store.set("SIM_BAT_MIN_PCT", 0.0)
        if row == CHANGED:
            for name, value in self._change.parameters.items():
                store.set(name, value)
        self._stores[row].used.clear()
        problem = simulation.reload_parameters(row)
        if problem is not None:
            raise NotFlyable(f"{problem}.", "parameters")
        if logged.battery is not None:
            simulation.set_battery_remaining(row, logged.battery.share)
        stored = self._plans[row]
        if stored is not None:
            plan, current = stored
            for mission_type, items in plan.parts:
                autopilot.plans.store(mission_type, items)
            autopilot.navigator.mission.set_current(current)
        simulation.place_in_flight(row, moment)

    def _blow(self, sim: SimulatedFleet, t_s: float) -> None:
        """The wind of a time of the log."""
        n = self._flight.first_after(t_s)
        wind = self._wind[n] if n < len(self._wind) else self._mean_wind
        changed = self._change.wind_ned_m_s
        sim.simulation.set_wind(np.array([wind, wind if changed is None else changed]))

    def _cause(self, sim: SimulatedFleet, links: _Links) -> None:
        """What happens to the changed vehicle at the moment."""
        more, simulation = self._more, sim.simulation
        simulation.motor_health[CHANGED] = self._change.motor_health
        if more.battery_share is not None:
            simulation.set_battery_remaining(CHANGED, more.battery_share)
        if "gps" in more.lost:
            simulation.set_gps_enabled(CHANGED, False)
        links.up[CHANGED] = False

    def _run(
        self,
        sim: SimulatedFleet,
        links: _Links,
        pilots: Sequence[MissionPilot],
        flown: Sequence[Flown],
        from_s: float,
        duration_s: float,
    ) -> None:
        begin_s = sim.time_s
        for each, autopilot in zip(flown, sim.autopilots, strict=True):
            autopilot.announcer.add_listener(_warnings_of(each, sim, begin_s))
        running = {row: sim.autopilots[row] for row in range(2)}
        for tick in range(round(duration_s / TICK_S) + 1):
            self._blow(sim, from_s + tick * TICK_S)
            for row, autopilot in running.items():
                flown[row].note_mode(autopilot, sim.time_s - begin_s)
                if pilots:
                    flown[row].note_step(pilots[row].step, sim.time_s - begin_s)
                if tick % EVERY_TICKS == 0:
                    flown[row].sample(sim.simulation.truth, row, self._logged.home_ned_m)
            running = {row: autopilot for row, autopilot in running.items() if autopilot.commander.armed}
            if not running:
                break
            links.keep()
            for row in running:
                if pilots and links.has_data_link(row):
                    pilots[row].tick(sim.time_s)
            sim.step(TICK_S)


class _Links:
    """Ground station and, if they are to be lost, sticks of both vehicles."""

    def __init__(self, sim: SimulatedFleet, lost: frozenset[Losable]) -> None:
        self._sim, self._lost = sim, lost
        self.up = [True, True]

    def has_data_link(self, row: int) -> bool:
        """Whether what the ground station sends reaches a vehicle."""
        return self.up[row] or "data_link" not in self._lost

    def keep(self) -> None:
        """Keeps the links that are there; called at each tick."""
        for row, autopilot in enumerate(self._sim.autopilots):
            checks, now_s = autopilot.commander.checks, self._sim.time_s
            if self.has_data_link(row):
                checks.gcs_heartbeat_at_s = now_s
            if self.up[row] and "manual_control" in self._lost:
                checks.manual_control_at_s = now_s


def _take_off(sim: SimulatedFleet, links: _Links) -> None:
    """Both vehicles take off and hover. Raises NotFlyable: they do not."""
    hovering_s = 0.0
    while hovering_s < HOVER_S:
        if sim.time_s > TAKEOFF_WITHIN_S:
            text = "The simulated vehicle does not take off with the body of this log."
            raise NotFlyable(text, "parameters")
        for autopilot in sim.autopilots:
            commander = autopilot.commander
            if not commander.armed and commander.report.armable(NavState.TAKEOFF):
                autopilot.navigator.request_takeoff(math.nan)
                commander.set_mode(NavState.TAKEOFF)
                commander.arm()
        links.keep()
        sim.step(TICK_S)
        commanders = [each.commander for each in sim.autopilots]
        hover = all(each.took_off and each.active is NavState.HOLD for each in commanders)
        hovering_s = hovering_s + TICK_S if hover else 0.0


def _warnings_of(flown: Flown, sim: SimulatedFleet, begin_s: float) -> Callable[[StatusText | Event], None]:
    note = _noted(flown.warnings, begin_s)

    def listen(message: StatusText | Event) -> None:
        if isinstance(message, StatusText) and message.severity <= SEVERITY_WARNING:
            note(sim.time_s, message.text.strip())

    return listen


def _noted(to: list[tuple[float, str]], begin_s: float) -> Callable[[float, str], None]:
    return lambda now_s, text: to.append((round(now_s - begin_s, 2), text))


def mode_name(nav_state: int) -> str:
    """PX4's name of a mode."""
    return MODES[NavState(nav_state)].name if nav_state in MODES else f"mode {nav_state}"


def _mode(nav_state: int, has_mission: bool) -> NavState:
    """Raises NotFlyable: the mode cannot be begun at any moment of it, or flies by foreign setpoints."""
    if nav_state in MODES_FLOWN or (nav_state == NavState.OFFBOARD and has_mission):
        return NavState(nav_state)
    if nav_state == NavState.OFFBOARD:
        text = "The vehicle flew in Offboard then, and this server does not know its offboard mission."
        raise NotFlyable(text, "plan")
    raise NotFlyable(
        f"The vehicle flew in {mode_name(nav_state)} then. The simulated PX4 flies on in Mission, Hold, "
        "Return and Land; in other modes the logged setpoints are flown again.",
        "flown_by",
    )


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _vector(values: Values) -> Vector:
    north, east, down = values.tolist()
    return north, east, down
