"""Simulated PX4 vehicles; each flies a different kind of step while the same event occurs to all of them."""

from __future__ import annotations

import asyncio
import functools
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from gcs_server.flights.mission_flight import MissionFlight
from gcs_server.vehicle.vehicle import Vehicle
from missions.offboard.document import OffboardMission
from tests.protocol.mission_flights import MissionsTestbed
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.support.mission_steps import mission_for_two, mission_with_lists, slope
from tests.support.snapshot import snapshot
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import frame_v2

CIRCLE = "center: {offset_ned_m: [5, 0, 0]}, radius_m: 5, speed_m_s: 3"
HELIX = f"step: helix, {CIRCLE}, climb_m: 3"
SPIRAL = f"step: spiral, {CIRCLE}, end_radius_m: 7, turns: 0.5"
CALLED_STEP = "step: figure_eight, center: {offset_ned_m: [0, 0, 0]}, length_m: 16, width_m: 8, speed_m_s: 3"
STEPS: dict[str, tuple[str, ...]] = {
    "fly": ("step: fly, points: [{offset_ned_m: [25, 0, 0]}, {offset_ned_m: [25, 6, -3]}], speed_m_s: 3",),
    "hold": ("step: hold, duration_s: 10",),
    "table": ("step: table, file: slope",),
    "velocity": ("step: velocity, velocity_ned_m_s: [1.5, 0, 0], duration_s: 12",),
    "attitude": ("step: attitude, thrust: 0.73, duration_s: 9",),
    "gimbal": ("step: gimbal, track: sweep, sweep_yaw_rad: 1, period_s: 8", f"step: orbit, {CIRCLE}"),
    "photo": ("step: photo, count: 10, interval_s: 1",),
    "wait": ("step: wait, until: person, timeout_s: 200, message: Sharp?",),
    "repeat": (f"step: repeat, times: 2, steps: [{{{SPIRAL}}}]",),
    "branch": (f"step: branch, condition: {{value: battery_share, above: 0.05}}, then: [{{{HELIX}}}]",),
    "call": ("step: call, mission: stay",),
    "meet": ("step: meet, meeting: here",),
    "take_off": ("step: take_off, height_m: 9",),
    "land": ("step: land",),
}
"""The steps of each vehicle; the steps that PX4 flies itself are last. A step without a duration is combined
with a step that has a duration: the event occurs in the orbit after the gimbal step, or inside the repeat,
branch or call."""
FLOWN_BY_PX4 = ("take_off", "land")
FLOWN_BY_SETPOINTS = tuple(kind for kind in STEPS if kind not in FLOWN_BY_PX4)
ALTITUDE_M, SPACING_M = 12.0, 40.0
"""Altitude above home at which the vehicles hover, and the distance between neighbours."""
KIND_ON_GROUND = "take_off"
"""The kind of step whose vehicle is still on the ground."""
BOOT_TIMEOUT_S, CLIMB_TIMEOUT_S = 30.0, 30.0


@functools.cache
def _hovering_vehicles(kinds: tuple[str, ...]) -> SimulatedFleet:
    """Vehicles that hover, except the vehicle whose step is the take-off."""
    start_ned_m = np.zeros((len(kinds), 3))
    start_ned_m[:, 1] = SPACING_M * np.arange(len(kinds))
    sim = SimulatedFleet(len(kinds), links=(("gcs", "gcs"),), seed=3, start_ned_m=start_ned_m, camera=True)
    airborne_rows = [row for row, kind in enumerate(kinds) if kind != KIND_ON_GROUND]
    commanders = [autopilot.commander for autopilot in sim.autopilots]
    _step_until(sim, BOOT_TIMEOUT_S, lambda: all(c.report.armable(NavState.TAKEOFF) for c in commanders))
    for row in airborne_rows:
        autopilot = sim.autopilots[row]
        autopilot.navigator.request_takeoff(autopilot.home.alt_amsl_m + ALTITUDE_M)
        assert autopilot.commander.set_mode(NavState.TAKEOFF)
        assert autopilot.commander.arm()
    _step_until(
        sim, CLIMB_TIMEOUT_S, lambda: all(commanders[row].active is NavState.HOLD for row in airborne_rows)
    )
    for row in range(len(kinds)):
        sim.drain(row, "gcs")
    return sim


def _step_until(sim: SimulatedFleet, within_s: float, condition: Callable[[], bool]) -> None:
    end_s = sim.time_s + within_s
    sim.step(1.0)
    while not condition():
        assert sim.time_s < end_s
        sim.step(0.1)


def document_of(kind: str) -> OffboardMission:
    """The mission of a vehicle that flies this kind of step."""
    if kind == "meet":
        return mission_for_two(*STEPS["meet"])
    return mission_with_lists(
        "".join(f"- {{{step}}}\n" for step in STEPS[kind]), stay=CALLED_STEP, table=slope(0.0)
    )


def kinds_flown() -> set[str]:
    """The kinds of steps during which the events occur."""
    texts = [CALLED_STEP, *(step for steps in STEPS.values() for step in steps)]
    return {kind for text in texts for kind in re.findall(r"step: (\w+)", text)}


class MissionFleet:
    """The vehicles, each named by the kind of step that it flies."""

    def __init__(self, testbed: SimulatedTestbed, missions: MissionsTestbed, kinds: tuple[str, ...]) -> None:
        self.testbed, self.sim, self.missions, self.kinds = testbed, testbed.sim, missions, kinds
        self.flights: dict[str, MissionFlight] = {}
        self.vehicles: dict[str, Vehicle] = {}

    async def begin(self, **actions: str) -> None:
        """Starts all missions and flies to the middle of their steps."""
        for kind in self.kinds:
            vehicle = self.vehicles[kind] = await self.testbed.wait_for_vehicle(str(self.row(kind) + 1))
            await until(lambda v=vehicle: v.topic("battery") is not None, 10)
        for kind, vehicle in self.vehicles.items():
            document = document_of(kind)
            all_actions = document.actions.model_copy(update=actions)
            document = document.model_copy(update={"actions": all_actions})
            role = "lead" if document.roles else None
            flight = self.missions.begin(vehicle, document, in_air=kind != KIND_ON_GROUND, role=role)
            self.flights[kind] = flight
        started_states = ("flying", "waiting", "taking_off", "landing")
        await self.reach({kind: started_states for kind in self.kinds}, within_s=15)
        if "meet" in self.kinds:
            await self.leave_meeting()
        await asyncio.sleep(2.5)

    async def leave_meeting(self) -> None:
        """Ends the wait at the meeting point: no vehicle flies the other role of the mission "meet"."""
        flight = self.flights["meet"]
        await until(
            lambda: (part := flight.runner.setpoint_part) is not None and part.meeting is not None, 10
        )
        flight.runner.setpoint_part.leave_meeting()

    def row(self, kind: str) -> int:
        return self.kinds.index(kind)

    def state(self, kind: str) -> str:
        return self.flights[kind].status().state

    async def reach(self, states: dict[str, Iterable[str]], within_s: float = 30.0) -> None:
        """Waits until each vehicle's mission is in one of the given states."""
        for kind, states_of_kind in states.items():
            expected_states = {states_of_kind} if isinstance(states_of_kind, str) else set(states_of_kind)
            try:
                await until(lambda k=kind, a=expected_states: self.state(k) in a, within_s)
            except AssertionError:
                raise AssertionError(
                    f"{kind}: {self.flights[kind].status()}, not {expected_states}"
                ) from None

    def reasons(self) -> dict[str, str]:
        return {kind: str(flight.status().reason) for kind, flight in self.flights.items()}

    def modes(self) -> dict[str, str]:
        """The simulated mode of each vehicle."""
        return {kind: self.commander(kind).active.name.lower() for kind in self.kinds}

    def commander(self, kind: str) -> Any:
        return self.sim.autopilots[self.row(kind)].commander

    def position(self, kind: str) -> tuple[float, ...]:
        """The true position of this vehicle, NED [m]."""
        return tuple(self.sim.simulation.truth.position_ned_m[self.row(kind)].tolist())

    async def check_hover(self, kinds: Iterable[str], for_s: float = 3.0, within_m: float = 2.0) -> None:
        """Checks that these vehicles keep their positions within the accuracy of their estimates."""
        positions_before = {kind: self.position(kind) for kind in kinds}
        await asyncio.sleep(for_s)
        distances_m = {
            kind: math.dist(self.position(kind), position) for kind, position in positions_before.items()
        }
        assert max(distances_m.values()) < within_m, distances_m

    def move_sticks(self, forward: int) -> None:
        """Sends the stick positions of another station's joystick to each vehicle."""
        for row in range(len(self.kinds)):
            layout, payload = pack("MANUAL_CONTROL", target=row + 1, x=forward, y=0, z=500, r=0, buttons=0)
            self.sim.feed(row, "gcs", frame_v2(layout, payload, 0, 254, 190))

    async def end_normally(self, within_s: float = 60.0) -> None:
        """Waits until each mission has ended normally; confirms the wait and the meeting."""
        if "wait" in self.kinds:
            await self.reach({"wait": "waiting"})
            self.flights["wait"].go_on("Alice")
        if "meet" in self.kinds:
            await self.leave_meeting()
        await self.reach(dict.fromkeys(self.kinds, "done"), within_s)
        await until(lambda: all(self.modes()[kind] == "hold" for kind in self.kinds if kind != "land"), 3)
        assert "land" not in self.kinds or not self.commander("land").armed


def run_with_mission_fleet(
    run_simulated: Any, tmp_path: Path, scenario: Any, kinds: Iterable[str] = tuple(STEPS), **actions: str
) -> None:
    """Runs a test with vehicles that are in the middle of their steps."""

    async def run() -> None:
        chosen_kinds = tuple(kinds)
        testbed = SimulatedTestbed(len(chosen_kinds), sim=snapshot(_hovering_vehicles(chosen_kinds)))
        fleet = MissionFleet(testbed, MissionsTestbed(testbed, tmp_path), chosen_kinds)
        try:
            await fleet.begin(**actions)
            await scenario(fleet)
        finally:
            await testbed.close()

    run_simulated(run)
