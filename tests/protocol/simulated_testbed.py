"""The server without HTTP, with simulated PX4 vehicles on its links."""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest

from gcs_server.scenarios.memory_link import MemoryLink
from gcs_server.vehicle.vehicle import Vehicle
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.offboard_testbed import OffboardTestbed
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.px4_version import DEFAULT, VERSIONS, Px4Version

TICK_S = 0.02
both_versions = pytest.mark.parametrize(
    "px4",
    [each if each is DEFAULT else pytest.param(each, marks=pytest.mark.story) for each in VERSIONS.values()],
    ids=list(VERSIONS),
)
"""Runs a test with a vehicle of each version of PX4; the one that is not the default in `make nightly`."""


class SimulatedVehicles(MemoryTestbed):
    """A testbed with simulated vehicles that can fly."""

    async def wait_for_vehicle_ready_to_arm(self, vehicle_id: str = "1") -> Vehicle:
        """Waits until the vehicle can be armed; returns it."""
        vehicle = await self.wait_for_vehicle(vehicle_id, timeout_s=40)
        await until(lambda: (health := vehicle.topic("health")) and health.value.ready_to_arm, 30)
        return vehicle

    async def take_off(self, vehicle_id: str = "1", alt_home_m: float = 10.0) -> Vehicle:
        """Takes off and waits until the vehicle is in Hold; returns the vehicle."""
        vehicle = await self.wait_for_vehicle_ready_to_arm(vehicle_id)
        await vehicle.command.takeoff(alt_home_m)
        await until(lambda: vehicle.status.mode == "hold", 40)
        return vehicle


class SimulatedTestbed(OffboardTestbed, SimulatedVehicles):
    """Vehicles "1", "2", … in a row to the east, 3 m apart.

    Args:
        count: number of vehicles.
        parameters: parameters of all vehicles, set before boot.
        seed: seed of packet losses, and of sensor noise and gusts.
        sim: a fleet that is already flying, with a link "gcs"; the other arguments are then not used.
        camera: whether each vehicle has a camera.
        px4: the version of PX4 of all vehicles.
    """

    def __init__(
        self,
        count: int = 1,
        parameters: dict[str, float] | None = None,
        *,
        seed: int = 3,
        sim: SimulatedFleet | None = None,
        camera: bool = False,
        px4: Px4Version = DEFAULT,
    ) -> None:
        super().__init__()
        links = (("gcs", "gcs"),)
        self.loss = self.loss_to_vehicle = 0.0
        """The share of packets lost, in each direction and only to the vehicle; may be changed in flight."""
        self._random = random.Random(seed)
        self.sim = sim or SimulatedFleet(
            count, links=links, px4=px4, parameters=parameters, seed=seed, camera=camera
        )
        self._links = [MemoryLink(f"vehicle{row}", outgoing=self._feed_function(row)) for row in range(count)]
        for link in self._links:
            self.router.add(link)
        self.supervisor.start("simulator", self._simulate)

    def _feed_function(self, row: int) -> Any:
        def feed(data: bytes, _peer: Any) -> None:
            if self._packet_arrives(self.loss_to_vehicle):
                self.sim.feed(row, "gcs", data)

        return feed

    def _packet_arrives(self, loss: float = 0.0) -> bool:
        loss = max(loss, self.loss)
        return not loss or self._random.random() >= loss

    async def _run_scheduler(self) -> None:
        """Runs at the rate of the simulation's ticks: packets sent within a tick arrive at its end."""
        while True:
            self.streamer._streams.step()
            await self.clock.sleep(TICK_S)

    async def _simulate(self) -> None:
        while True:
            self.sim.step(TICK_S)
            for row, link in enumerate(self._links):
                if frames := [frame for frame in self.sim.frames(row, "gcs") if self._packet_arrives()]:
                    link.inject(b"".join(frames), "vehicle")
            await self.clock.sleep(TICK_S)


async def until(condition: Any, timeout_s: float) -> None:
    """Waits for a condition, which it checks ten times a second.

    Raises:
        AssertionError: the condition was not true in time.
    """
    for _ in range(int(timeout_s * 10)):
        if condition():
            return
        await asyncio.sleep(0.1)
    raise AssertionError(f"the condition was not true within {timeout_s:g} s")
