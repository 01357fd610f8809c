"""Futures of random commands beside what the simulated PX4 then does, and what they cost.

Vehicles in wind, half of them with gusts, hover or are still moving by an earlier command when a random one
is given: go-to, Hold, Land, position, velocity, acceleration, attitude, rates. Its futures are computed from
what the vehicle reports at that moment; a random delay later the vehicle has the command and flies it. A
command is inside if its true position never leaves the corridor.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.clearance import FenceDistance
from missions.dry_run.fleet import Vehicle
from missions.dry_run.offboard import send
from missions.frames import Vector3, q_from_euler
from missions.geodesy import LocalOrigin
from missions.setpoints import Acceleration, Attitude, DirectSetpoint, Position, Rates, Velocity
from missions.what_if.futures.commands import FlightState, GoTo, Hold, Land, ModeCommand
from missions.what_if.futures.document import Futures
from missions.what_if.futures.futures import Place, fly_futures
from missions.what_if.futures.start import Delay, Start
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.geodesy import to_local

TICK_S = 0.02
HORIZON_S = 20.0
KINDS = ("go to", "hold", "land", "position", "velocity", "acceleration", "attitude", "rates")
DIRECT_S = 4.0
"""Attitude and rates are flown so long: no stream holds them for 20 s."""
DELAY = Delay(0.05, 0.5)
Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Compared:
    """One command and its futures."""

    kind: str
    inside: bool
    over: float
    """Largest distance from the mean, as a part of the corridor there."""
    radius_m: float
    """Of the corridor at the end."""
    took_s: float


def compare(rounds: int, vehicles: int, seed: int = 5) -> list[Compared]:
    """Gives each vehicle of each round, new ones, a random command."""
    return [each for number in range(rounds) for each in _Flights(vehicles, seed + number).compared()]


class _Flights:
    def __init__(self, vehicles: int, seed: int) -> None:
        self._random, self._count = np.random.default_rng(seed), vehicles
        self._sim = SimulatedFleet(vehicles, links=(), seed=seed)
        self._vehicles = [Vehicle(*each) for each in zip(self._sim.autopilots, self._sim.nodes, strict=True)]
        for row in range(vehicles):
            self._sim.simulation.set_wind(np.array([*self._random.normal(0.0, 2.5, 2), 0.0]), row)
            self._sim.simulation.set_gusts(float(self._random.choice([0.0, 0.8])), row)
        self._streamed: list[DirectSetpoint | None] = [None] * vehicles
        self._take_off()

    def _take_off(self) -> None:
        commanders = [each.autopilot.commander for each in self._vehicles]
        while not all(each.took_off and each.active is NavState.HOLD for each in commanders):
            for each, commander in zip(self._vehicles, commanders, strict=True):
                if not commander.armed and commander.report.armable(NavState.TAKEOFF):
                    each.autopilot.navigator.request_takeoff(math.nan)
                    commander.set_mode(NavState.TAKEOFF)
                    commander.arm()
            self._run(0.5)
            if self._sim.time_s > 120.0:
                raise RuntimeError("not all vehicles have taken off")
        for row in range(self._count):
            self._goto(row, (0.0, 0.0, -30.0))
        self._run(25.0)

    def _run(self, duration_s: float, each: Callable[[float], None] | None = None) -> None:
        for tick in range(round(duration_s / TICK_S)):
            for row, vehicle in enumerate(self._vehicles):
                vehicle.autopilot.commander.checks.gcs_heartbeat_at_s = self._sim.time_s
                setpoint = self._streamed[row]
                if setpoint is not None:
                    send(vehicle.autopilot.offboard, setpoint, (0.0, 0.0, 0.0))
            if each is not None:
                each(tick * TICK_S)
            self._sim.step(TICK_S)

    def _goto(self, row: int, target_ned_m: Vector3) -> None:
        vehicle = self._vehicles[row].autopilot
        self._streamed[row] = None
        vehicle.commander.set_mode(NavState.HOLD)
        lat, lon, alt = vehicle.view.origin
        origin = LocalOrigin(float(lat or 0.0), float(lon or 0.0), alt)
        vehicle.navigator.goto(*origin.to_geodetic(target_ned_m), math.nan)

    def compared(self) -> list[Compared]:
        """One command of each vehicle."""
        rows = range(self._count)
        commands = [self._command(row) for row in rows]
        for row, (kind, _) in enumerate(commands):  # half of the vehicles are still moving
            if kind != "hold" and self._random.uniform() < 0.5:
                self._goto(row, self._around(row, 30.0))
        self._run(float(self._random.uniform(2.0, 5.0)))
        for row, (_, command) in enumerate(commands):
            if isinstance(command, DirectSetpoint | Hold):
                vn, ve, _ = self._random.uniform(-4.0, 4.0, 3) * isinstance(command, Hold)
                self._streamed[row] = Velocity((vn, ve, 0.0), yaw_ned_rad=self._view(row).yaw_ned_rad)
        self._run(1.0)
        for row, (_, command) in enumerate(commands):
            if isinstance(command, DirectSetpoint | Hold):
                self._vehicles[row].autopilot.commander.set_mode(NavState.OFFBOARD)
        self._run(1.0)
        starts = [self._start(row) for row in rows]
        delays = self._random.uniform(0.0, 0.45, self._count)
        given: set[int] = set()
        truth: list[Values] = []

        def fly(t_s: float) -> None:
            if round(t_s / TICK_S) % 5 == 0:
                truth.append(self._true_positions())
            for row in rows:
                if row not in given and delays[row] <= t_s:
                    given.add(row)
                    self._give(row, commands[row][1])
                if row in given and commands[row][0] in KINDS[-2:] and t_s >= DIRECT_S:
                    self._streamed[row] = Velocity((0.0, 0.0, 0.0))

        self._run(HORIZON_S, fly)
        tracks = np.array(truth)
        return [self._compared(commands[row], starts[row], tracks[:, row], row) for row in rows]

    def _view(self, row: int):
        return self._vehicles[row].autopilot.view.estimate

    def _around(self, row: int, within_m: float) -> Vector3:
        north, east, _ = self._view(row).position_ned_m
        dn, de, down = self._random.uniform(-1.0, 1.0, 3)
        return (north + within_m * dn, east + within_m * de, -30.0 + 8.0 * down)

    def _command(self, row: int) -> tuple[str, ModeCommand | DirectSetpoint]:
        kind = str(self._random.choice(KINDS, p=[0.3, 0.1, 0.1, 0.2, 0.15, 0.05, 0.05, 0.05]))
        yaw = float(self._random.uniform(-math.pi, math.pi))
        v = self._random.uniform(-1.0, 1.0, 3)
        match kind:
            case "go to":
                return kind, GoTo(self._around(row, 60.0))
            case "hold":
                return kind, Hold()
            case "land":
                return kind, Land()
            case "position":
                return kind, Position(self._around(row, 25.0), yaw)
            case "velocity":
                return kind, Velocity((5.0 * v[0], 5.0 * v[1], 0.5 * v[2]), yaw)
            case "acceleration":
                return kind, Acceleration((1.5 * v[0], 1.5 * v[1], 0.0), yaw)
            case "attitude":
                return kind, Attitude(q_from_euler(0.2 * v[0], 0.2 * v[1], yaw), 0.49)
            case _:
                return kind, Rates((0.0, 0.0, 0.5 * v[0]), 0.49)

    def _give(self, row: int, command: ModeCommand | DirectSetpoint) -> None:
        commander = self._vehicles[row].autopilot.commander
        match command:
            case GoTo(target_ned_m=target):
                self._goto(row, target)
            case Hold():
                self._streamed[row] = None
                commander.set_mode(NavState.HOLD)
            case Land():
                self._streamed[row] = None
                commander.set_mode(NavState.LAND)
            case _:
                self._streamed[row] = command

    def _start(self, row: int) -> Start:
        autopilot = self._vehicles[row].autopilot
        in_hold, (north, east, down) = (
            autopilot.commander.active is NavState.HOLD, autopilot.navigator.path.target_ned_m,
        )  # fmt: skip
        known = in_hold and north is not None and east is not None and down is not None
        simulation, view = self._sim.simulation, self._view(row)
        estimate, store = simulation.estimate, simulation.parameters[row]
        values = {name: float(value) for name, value in store.items()}
        return Start(
            position_ned_m=view.position_ned_m, velocity_ned_m_s=view.velocity_ned_m_s,
            q_ned_frd=view.q_ned_frd, rates_frd_rad_s=view.rates_frd_rad_s, ground_down_m=0.0,
            position_error_m=float(estimate.horizontal_accuracy_m[row]),
            height_error_m=float(estimate.vertical_accuracy_m[row]), wind_ne_m_s=None,
            in_hold=in_hold, hold_target_ned_m=(north, east, down) if known else None,  # type: ignore[arg-type]
            battery_share=0.9, parameters=values, px4="1.17",
        )  # fmt: skip

    def _true_positions(self) -> Values:
        """(N, 3) in each vehicle's local frame."""
        simulation = self._sim.simulation
        estimate, origin = simulation.estimate, simulation.origin
        north, east = to_local(
            estimate.origin_lat_deg, estimate.origin_lon_deg, np.full(self._count, origin.lat_deg),
            np.full(self._count, origin.lon_deg),
        )  # fmt: skip
        offset = np.stack([north, east, origin.alt_amsl_m - estimate.origin_alt_amsl_m], axis=1)
        return simulation.truth.position_ned_m - offset

    def _compared(
        self, named: tuple[str, ModeCommand | DirectSetpoint], start: Start, track: Values, seed: int
    ) -> Compared:
        kind, command = named
        direct = kind in KINDS[-2:]

        def streamed(_state: FlightState) -> DirectSetpoint:
            assert isinstance(command, DirectSetpoint)
            return command

        place = Place((0.0, 0.0, 0.0), FenceDistance([], LocalOrigin(0.0, 0.0, 0.0), 0.0, 0.0))
        horizon_s = DIRECT_S if direct else HORIZON_S
        begin_s = time.process_time()
        futures = fly_futures(
            start, command if isinstance(command, ModeCommand) else streamed, DELAY, place, text=kind,
            horizon_s=horizon_s, seed=seed,
        )  # fmt: skip
        took_s = time.process_time() - begin_s
        over = outside(futures, track)
        return Compared(kind, over <= 1.0, over, futures.corridor.horizontal_m[-1], took_s)


def outside(futures: Futures, track: Values) -> float:
    """Largest distance of a track (10 Hz) from the corridor's mean, as a part of the corridor there."""
    corridor = futures.corridor
    mean, at = np.array(corridor.position_ned_m), np.round(np.array(corridor.t_s) * 10.0).astype(int)
    at = at[at < len(track)]
    off = track[at] - mean[: len(at)]
    across = np.hypot(off[:, 0], off[:, 1]) / np.array(corridor.horizontal_m)[: len(at)]
    return float(max(across.max(), (np.abs(off[:, 2]) / np.array(corridor.vertical_m)[: len(at)]).max()))


def table() -> Iterator[str]:
    """Rows of Markdown."""
    found = compare(rounds=5, vehicles=40, seed=11)
    yield "| command | flown | inside the corridor | radius at the end, median | largest | CPU, median |"
    yield "|---|---|---|---|---|---|"
    for kind in (*KINDS, "all"):
        of_kind = [each for each in found if kind in (each.kind, "all")]
        if of_kind:
            radius = [each.radius_m for each in of_kind]
            yield (
                f"| {kind} | {len(of_kind)} | {sum(each.inside for each in of_kind)} | "
                f"{np.median(radius):.1f} m | {max(radius):.1f} m | "
                f"{np.median([each.took_s for each in of_kind]):.2f} s |"
            )
