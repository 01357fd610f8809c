"""Simulated PX4 vehicles, each with another kind of step, that meet the same event at the same time."""

from __future__ import annotations

import asyncio
import functools
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from gcs_server.streamer.missions.flight import MissionFlight
from gcs_server.vehicle.vehicle import Vehicle
from tests.protocol.mission_flights import Missions
from tests.protocol.simulated_world import SimulatedWorld, until
from tests.support.offboard_missions import mission
from tests.support.snapshot import snapshot
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.fleet import VehicleSim
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import frame_v2

STEPS = {
    "path": "step: orbit, center: {offset_ned_m: [8, 0, 0]}, radius_m: 8, speed_m_s: 3",
    "wait": "step: wait, until: person, timeout_s: 200, message: Sharp?",
    "velocity": "step: velocity, velocity_ned_m_s: [1.5, 0, 0], duration_s: 14",
    "attitude": "step: attitude, thrust: 0.73, duration_s: 9",
    "take_off": "step: take_off, height_m: 9",
    "land": "step: land",
}
"""One step of each kind; those that PX4 flies itself are last."""
BY_PX4 = ("take_off", "land")
BY_SETPOINTS = tuple(kind for kind in STEPS if kind not in BY_PX4)
HEIGHT_M, APART_M = 12.0, 40.0
GROUNDED = "take_off"
BOOT_WITHIN_S, RISE_WITHIN_S = 30.0, 30.0


@functools.cache
def _climbed(kinds: tuple[str, ...]) -> VehicleSim:
    """Vehicles that hover at 12 m, except the one that is to take off."""
    places = np.zeros((len(kinds), 3))
    places[:, 1] = APART_M * np.arange(len(kinds))
    sim = VehicleSim(len(kinds), links=(("gcs", "gcs"),), seed=3, start_ned_m=places)
    up = [row for row, kind in enumerate(kinds) if kind != GROUNDED]
    commanders = [autopilot.commander for autopilot in sim.autopilots]
    _step_until(sim, BOOT_WITHIN_S, lambda: all(c.report.armable(NavState.TAKEOFF) for c in commanders))
    for row in up:
        autopilot = sim.autopilots[row]
        autopilot.navigator.request_takeoff(autopilot.home.alt_amsl_m + HEIGHT_M)
        assert autopilot.commander.set_mode(NavState.TAKEOFF)
        assert autopilot.commander.arm()
    _step_until(sim, RISE_WITHIN_S, lambda: all(commanders[row].active is NavState.HOLD for row in up))
    for row in range(len(kinds)):
        sim.drain(row, "gcs")
    return sim


def _step_until(sim: VehicleSim, within_s: float, condition: Callable[[], bool]) -> None:
    end_s = sim.time_s + within_s
    sim.step(1.0)
    while not condition():
        assert sim.time_s < end_s
        sim.step(0.1)


class Squadron:
    """The vehicles by the kind of their step, each in the middle of it."""

    def __init__(self, world: SimulatedWorld, missions: Missions, kinds: tuple[str, ...]) -> None:
        self.world, self.sim, self.missions, self.kinds = world, world.sim, missions, kinds
        self.flights: dict[str, MissionFlight] = {}
        self.vehicles: dict[str, Vehicle] = {}

    async def begin(self, **actions: str) -> None:
        """Starts all missions and flies to the middle of their steps."""
        for kind in self.kinds:
            vehicle = self.vehicles[kind] = await self.world.ready(str(self.row(kind) + 1))
            await until(lambda v=vehicle: v.topic("battery") is not None, 10)
        for kind, vehicle in self.vehicles.items():
            document = mission(f"- {{{STEPS[kind]}}}\n")
            actions_of = document.actions.model_copy(update=actions)
            document = document.model_copy(update={"actions": actions_of})
            self.flights[kind] = self.missions.begin(vehicle, document, in_air=kind != GROUNDED)
        begun = ("flying", "waiting", "taking_off", "landing")
        await self.reach({kind: begun for kind in self.kinds}, within_s=15)
        await asyncio.sleep(2.5)

    def row(self, kind: str) -> int:
        return self.kinds.index(kind)

    def state(self, kind: str) -> str:
        return self.flights[kind].status().state

    async def reach(self, states: dict[str, Iterable[str]], within_s: float = 30.0) -> None:
        """Flies until each is in one of its states."""
        for kind, wanted in states.items():
            allowed = {wanted} if isinstance(wanted, str) else set(wanted)
            try:
                await until(lambda k=kind, a=allowed: self.state(k) in a, within_s)
            except AssertionError:
                raise AssertionError(f"{kind}: {self.flights[kind].status()}, not {allowed}") from None

    def reasons(self) -> dict[str, str]:
        return {kind: str(flight.status().reason) for kind, flight in self.flights.items()}

    def modes(self) -> dict[str, str]:
        """The simulated mode of each vehicle."""
        return {kind: self.commander(kind).active.name.lower() for kind in self.kinds}

    def commander(self, kind: str) -> Any:
        return self.sim.autopilots[self.row(kind)].commander

    def place(self, kind: str) -> tuple[float, ...]:
        """Its true position."""
        return tuple(self.sim.simulation.truth.position_ned_m[self.row(kind)].tolist())

    async def stay(self, kinds: Iterable[str], for_s: float = 3.0, within_m: float = 2.0) -> None:
        """Checks that they hold their positions, within the accuracy of their estimates."""
        before = {kind: self.place(kind) for kind in kinds}
        await asyncio.sleep(for_s)
        moved = {kind: math.dist(self.place(kind), place) for kind, place in before.items()}
        assert max(moved.values()) < within_m, moved

    def move_sticks(self, forward: int) -> None:
        """Moves the sticks of each vehicle by a joystick of another station."""
        for row in range(len(self.kinds)):
            layout, payload = pack("MANUAL_CONTROL", target=row + 1, x=forward, y=0, z=500, r=0, buttons=0)
            self.sim.feed(row, "gcs", frame_v2(layout, payload, 0, 254, 190))

    async def end_normally(self, within_s: float = 60.0) -> None:
        """Flies until each mission ends normally."""
        if "wait" in self.kinds:
            await self.reach({"wait": "waiting"})
            self.flights["wait"].go_on("Alice")
        await self.reach(dict.fromkeys(self.kinds, "done"), within_s)
        assert all(self.modes()[kind] == "hold" for kind in self.kinds if kind != "land")
        assert "land" not in self.kinds or not self.commander("land").armed


def fly(jump: Any, tmp_path: Path, story: Any, kinds: Iterable[str] = tuple(STEPS), **actions: str) -> None:
    """Runs a test with vehicles in the middle of each kind of step."""

    async def run() -> None:
        chosen = tuple(kinds)
        world = SimulatedWorld(len(chosen), sim=snapshot(_climbed(chosen)))
        squadron = Squadron(world, Missions(world, tmp_path), chosen)
        try:
            await squadron.begin(**actions)
            await story(squadron)
        finally:
            await world.close()

    jump(run)
