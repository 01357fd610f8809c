"""A program on a guarded link, which knows only MAVLink. It uses the dialect of the simulator: so the
codec of the server is checked against independent code."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from gcs_server.guard.guards import Guards
from gcs_server.links.base import GuardOptions
from gcs_server.scenarios.memory_link import MemoryLink
from tests.protocol.api_calls import new_station
from tests.protocol.fake_autopilot import OFFBOARD_MODE
from tests.protocol.offboard_testbed import OffboardTestbed, sleep
from vehicle_sim.mavlink import generated_dialect as sim

START_S = 4.0
"""Longer than Offboard takes to start: this vehicle lacks some parameters, which the server waits for [s]."""
LOCAL_NED, BODY_NED = 1, 8
POSITION_MASK, VELOCITY_MASK = 0b110111111000, 0b110111000111


class Streaming:
    """A program that sends again and again, until it hangs."""

    _stream: asyncio.Task[None] | None = None

    def stream(self, send: Callable[[], None], rate_hz: float = 20.0) -> None:
        """Sends the same setpoint again and again, until `hang`."""
        self.hang()

        async def run() -> None:
            while True:
                send()
                await asyncio.sleep(1.0 / rate_hz)

        self._stream = asyncio.get_running_loop().create_task(run())

    def hang(self) -> None:
        """Stops sending, as a program that hangs or was killed."""
        if self._stream is not None:
            self._stream.cancel()
            self._stream = None


class GuardedProgram(Streaming):
    """A program with its own ids, connected to a guarded link."""

    def __init__(self, link: MemoryLink, peer: str = "program", ids: tuple[int, int] = (245, 190)) -> None:
        self.link, self.peer = link, peer
        self.ids = ids
        self.mav = sim.MAVLink(None, srcSystem=ids[0], srcComponent=ids[1])
        self.parser = sim.MAVLink(None)
        self.received: list[Any] = []
        self.target_system = 1
        link.programs[peer] = self  # type: ignore[attr-defined]

    def send(self, message: Any) -> None:
        raw = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        self.link.inject(raw, self.peer)

    def receive(self, data: bytes) -> None:
        self.received += self.parser.parse_buffer(data) or []

    def heartbeat(self) -> None:
        self.send(sim.MAVLink_heartbeat_message(sim.MAV_TYPE_ONBOARD_CONTROLLER, 8, 0, 0, 4, 3))

    def position(self, north: float, east: float, down: float, mask: int = POSITION_MASK) -> None:
        self._local(LOCAL_NED, mask, (north, east, down), (0, 0, 0))

    def velocity(self, north: float, east: float, down: float, frame: int = LOCAL_NED) -> None:
        self._local(frame, VELOCITY_MASK, (0, 0, 0), (north, east, down))

    def _local(self, frame: int, mask: int, position: Any, velocity: Any) -> None:
        self.send(
            sim.MAVLink_set_position_target_local_ned_message(
                0, self.target_system, 1, frame, mask, *position, *velocity, 0, 0, 0, 0, 0
            )
        )

    def command(self, command: int, *params: float) -> None:
        values = (*params, *(0.0,) * (7 - len(params)))
        self.send(sim.MAVLink_command_long_message(self.target_system, 1, command, 0, *values))

    def set_mode(self, custom_mode: int) -> None:
        self.command(sim.MAV_CMD_DO_SET_MODE, 1, custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF)

    async def fly_offboard(self) -> None:
        """Streams a position, and asks for Offboard."""
        self.stream(lambda: self.position(0, 0, -5))
        await sleep(0.5)
        self.set_mode(OFFBOARD_MODE)
        await sleep(START_S)

    def acks(self, command: int) -> list[int]:
        """Results of the acknowledgements of a command to this program."""
        return [
            m.result
            for m in self.received
            if m.get_type() == "COMMAND_ACK"
            and m.command == command
            and (m.target_system, m.target_component) == self.ids
        ]

    def texts(self) -> list[str]:
        """The texts of the guard, joined from their pieces."""
        whole: dict[int, str] = {}
        single: list[str] = []
        for message in self.received:
            if message.get_type() == "STATUSTEXT":
                text = message.text if isinstance(message.text, str) else message.text.decode()
                if message.id:
                    whole[message.id] = whole.get(message.id, "") + text
                else:
                    single.append(text)
        return [text for text in (*single, *whole.values()) if text.startswith("GCS: ")]

    def of(self, kind: str) -> list[Any]:
        """Received messages of a type."""
        return [m for m in self.received if m.get_type() == kind]


def guarded_link(testbed: OffboardTestbed, name: str = "guard", **options: Any) -> MemoryLink:
    """A guarded link without a network; its programs receive what the server sends to them."""
    programs: dict[str, GuardedProgram] = {}

    def outgoing(data: bytes, peer: Any) -> None:
        if peer.name in programs:
            programs[peer.name].receive(data)

    link = MemoryLink(name, outgoing=outgoing)
    link.guard = replace(GuardOptions("ask"), **options)
    link.programs = programs  # type: ignore[attr-defined]
    testbed.router.add(link)
    return link


async def scene_with_program(testbed: Any, vehicle: Any, **options: Any) -> SimpleNamespace:
    """The server's routes, a guarded link and a program on it, for a vehicle that is connected."""
    station = new_station(testbed)
    station.authority.start()
    station.guards = Guards(station, testbed.router, testbed.supervisor)
    station.guards.start()
    link = guarded_link(testbed, **options)
    program = GuardedProgram(link)
    program.heartbeat()
    await sleep(1.5)
    return SimpleNamespace(testbed=testbed, station=station, vehicle=vehicle, link=link, program=program)


def run_with_program(
    run_simulated: Any,
    scenario: Callable[[Any], Awaitable[None]],
    *,
    loss: float = 0.0,
    seed: int = 0,
    **options: Any,
) -> None:
    """Runs a scenario with a scripted vehicle that hovers, the server, a guarded link and a program on it."""

    async def run() -> None:
        testbed = OffboardTestbed()
        autopilot = testbed.offboard_autopilot(testbed.link(), loss=loss, seed=seed)
        autopilot.set_hovering()
        scene: SimpleNamespace | None = None
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            scene = await scene_with_program(testbed, vehicle, **options)
            scene.autopilot = autopilot
            await scenario(scene)
        finally:
            if scene is not None:
                scene.program.hang()
            await testbed.close()

    run_simulated(run)
