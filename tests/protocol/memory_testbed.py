"""The server's links and vehicles without a network, on simulated time."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from gcs_server.clock import LoopClock
from gcs_server.mavlink.router import Router, RouterSettings
from gcs_server.scenarios.memory_link import MemoryLink
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.fleet import Fleet
from tests.protocol.fake_autopilot import FakeAutopilot


class MemoryTestbed:
    """The server's MAVLink and vehicle layers, started on simulated time."""

    def __init__(self, **settings: Any) -> None:
        self.loop = asyncio.get_running_loop()
        self.may_have_faults = False
        """Whether the server may fail to handle a frame; otherwise `close` fails the test."""
        self.clock = LoopClock(self.loop)
        self.supervisor = Supervisor(self.clock)
        self.router = Router(self.clock, self.supervisor, RouterSettings(**settings))
        self.fleet = Fleet(self.clock, self.supervisor, self.router)
        self.router.start()
        self.fleet.start()

    def link(self, name: str = "memory", *, replay: bool = False, forward: bool = False) -> MemoryLink:
        """A memory link; frames to a peer are delivered to this peer's autopilot in `autopilots`."""
        autopilots: dict[str, FakeAutopilot] = {}
        sent: list[tuple[bytes, str]] = []

        def outgoing(data: bytes, peer: Any) -> None:
            sent.append((data, peer.name))
            if peer.name in autopilots:
                autopilots[peer.name].receive(data)

        link = MemoryLink(name, outgoing=outgoing, replay=replay, forward=forward)
        link.autopilots, link.sent_packets = autopilots, sent  # type: ignore[attr-defined]
        self.router.add(link)
        return link

    def autopilot(self, link: MemoryLink, *, peer: str = "peer", **options: Any) -> FakeAutopilot:
        autopilot = FakeAutopilot(link, peer=peer, **options)
        link.autopilots[peer] = autopilot  # type: ignore[attr-defined]
        return autopilot

    async def wait_for_vehicle(self, vehicle_id: str = "1", timeout_s: float = 20.0) -> Any:
        """Waits for a connected vehicle with a home, a position and a landed state; returns the vehicle."""
        end_s = self.loop.time() + timeout_s
        while self.loop.time() < end_s:
            await asyncio.sleep(0.1)
            vehicles = {v.id: v for v in self.fleet.all()}
            vehicle = vehicles.get(vehicle_id)
            if (
                vehicle
                and vehicle.topic("home")
                and vehicle.topic("global_position")
                and vehicle.flight_state.landed_state != "unknown"
            ):
                return vehicle
        raise AssertionError(f"vehicle {vehicle_id} is not connected")

    async def close(self) -> None:
        faults = [c.link.faults for c in self.router._connections.values()]
        assert self.may_have_faults or not [f.newest for f in faults if f.count]
        await self.fleet.close()
        await self.router.close()
        await self.supervisor.close()


def run_test(
    run_simulated: Any,
    scenario: Callable[[Any], Awaitable[None]],
    new_testbed: Callable[[], MemoryTestbed] = MemoryTestbed,
) -> Any:
    """Runs a scenario in a new testbed on simulated time."""

    async def run() -> None:
        testbed = new_testbed()
        try:
            await scenario(testbed)
        finally:
            await testbed.close()

    return run_simulated(run)


def run_with_vehicle(
    run_simulated: Any,
    scenario: Callable[..., Awaitable[None]],
    new_testbed: Callable[[], MemoryTestbed] = MemoryTestbed,
) -> Any:
    """Runs a scenario with a new testbed, a connected autopilot, and the server's object for the vehicle."""

    async def scenario_with_vehicle(testbed: MemoryTestbed) -> None:
        autopilot = testbed.autopilot(testbed.link())
        await scenario(testbed, autopilot, await testbed.wait_for_vehicle())

    return run_test(run_simulated, scenario_with_vehicle, new_testbed)
