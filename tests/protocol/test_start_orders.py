"""Server, agent, vehicle and ROS 2 program start and restart in any order: the server has one vehicle, over
MAVLink and DDS, within five seconds after the last one is there."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

import pytest

pytest.importorskip("cyclonedds")

from gcs_server.ros2.client_settings import ClientSettings
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import TICK_S
from tests.protocol.start_orders import Domain, World, use_domain_table
from vehicle_sim.px4_version import V1_16, V1_17, Px4Version

FOUND_WITHIN_S = 5.0
NAMES = ("server", "agent", "vehicle", "program")
ORDERS: list[tuple[str, ...]] = list(itertools.permutations(NAMES))


def run_world(run_simulated: Any, world: World, scenario: Callable[[], Awaitable[None]]) -> None:
    async def run() -> None:
        async def step() -> None:
            while True:
                world.step(asyncio.get_running_loop().time())
                await asyncio.sleep(TICK_S)

        stepping = asyncio.ensure_future(step())
        try:
            await scenario()
            assert not stepping.done()
        finally:
            stepping.cancel()
            await world.close()

    run_simulated(run)


async def until_found(world: World) -> None:
    for _ in range(round(FOUND_WITHIN_S / 0.1)):
        if world.is_found():
            return
        await sleep(0.1)
    seen = [(vehicle.id, vehicle.links) for vehicle in world.vehicles()]
    raise AssertionError(f"not found in {FOUND_WITHIN_S:g} s: {seen}, {world.link_text()!r}")


async def restart_each(world: World, order: Sequence[str]) -> None:
    """Ends and starts each one in turn; while one is missing, the operator is told."""
    for name in order:
        await world.stop(name)
        await sleep(6.0)
        if name == "agent":
            assert "sends nothing more" in world.link_text()
            assert not world.vehicles()[0].status.link_lost
        elif name == "vehicle":
            assert world.vehicles()[0].status.link_lost
        world.start(name)
        await until_found(world)
        assert [vehicle.id for vehicle in world.vehicles()] == ["1"]
        await sleep(1.5)
        assert world.link_text() == ""


@pytest.mark.parametrize("order", ORDERS, ids=" ".join)
def test_one_vehicle_is_found_in_any_order_of_starts(
    run_simulated: Any, monkeypatch: Any, order: Sequence[str]
) -> None:
    use_domain_table(monkeypatch)
    world = World(px4=(V1_16, V1_17)[ORDERS.index(tuple(order)) % 2])

    async def scenario() -> None:
        for name in order:
            await sleep(0.7)
            assert not world.is_found()
            world.start(name)
        await until_found(world)
        assert [vehicle.id for vehicle in world.vehicles()] == ["1"]

    run_world(run_simulated, world, scenario)


@pytest.mark.parametrize("px4", [V1_16, V1_17], ids=lambda px4: px4.name)
def test_after_a_restart_of_each_it_is_the_same_vehicle(
    run_simulated: Any, monkeypatch: Any, px4: Px4Version
) -> None:
    use_domain_table(monkeypatch)
    world = World(px4=px4)

    async def scenario() -> None:
        for name in NAMES:
            world.start(name)
        await until_found(world)
        await restart_each(world, NAMES)

    run_world(run_simulated, world, scenario)


@pytest.mark.story
@pytest.mark.parametrize("order", ORDERS[1:], ids=" ".join)
def test_after_restarts_in_any_order_it_is_the_same_vehicle(
    run_simulated: Any, monkeypatch: Any, order: Sequence[str]
) -> None:
    use_domain_table(monkeypatch)
    world = World()

    async def scenario() -> None:
        for name in order:
            world.start(name)
        await until_found(world)
        await restart_each(world, order)

    run_world(run_simulated, world, scenario)


def test_a_wrong_namespace_is_named_with_those_that_are_there(run_simulated: Any, monkeypatch: Any) -> None:
    use_domain_table(monkeypatch)
    world = World("px4_3", read="px4_1")

    async def scenario() -> None:
        for name in NAMES:
            world.start(name)
        await sleep(8.0)
        assert "No vehicle publishes /px4_1/fmu/out/vehicle_status" in world.link_text()
        assert "Vehicles in this domain: /px4_3." in world.link_text()

    run_world(run_simulated, world, scenario)


def test_in_a_wrong_domain_the_link_says_so_and_names_what_finds_the_right_one(
    run_simulated: Any, monkeypatch: Any
) -> None:
    use_domain_table(monkeypatch)
    world = World(server_domain=Domain())

    async def scenario() -> None:
        for name in NAMES:
            world.start(name)
        await sleep(8.0)
        assert "No vehicle publishes /fmu/out/vehicle_status in DDS domain 0" in world.link_text()
        assert "gcs doctor ros2" in world.link_text()
        (vehicle,) = world.vehicles()
        assert vehicle.reach.protocols == ("MAVLink",)

    run_world(run_simulated, world, scenario)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"UXRCE_DDS_DOM_ID": 5}, "it publishes in DDS domain 5 (UXRCE_DDS_DOM_ID), which no link reads; add ros2://5."),
        ({}, "its domain 0 is that of the link, so its client does not reach an agent"),
    ],
)  # fmt: skip
def test_a_vehicle_that_no_ros2_link_finds_is_asked_over_mavlink_what_its_client_is_set_to(
    run_simulated: Any, monkeypatch: Any, parameters: dict[str, float], said: str
) -> None:
    use_domain_table(monkeypatch)
    world = World(server_domain=Domain(), parameters=parameters)

    async def scenario() -> None:
        for name in NAMES:
            world.start(name)
        server = world.server
        assert server is not None
        settings = ClientSettings(server.clock, server.fleet.all, server.router.connections)
        running = asyncio.ensure_future(settings.run())
        await sleep(7.0)
        assert settings.warnings() == [], "PX4 publishes some seconds after its boot"
        await sleep(13.0)
        (text,) = settings.warnings()
        assert text.startswith(f"Vehicle 1 is on no ROS 2 link: {said}")
        await world.stop("vehicle")
        await sleep(5.0)
        assert settings.warnings() == [], "a vehicle that is gone has no settings"
        running.cancel()

    run_world(run_simulated, world, scenario)


def test_a_vehicle_on_the_link_is_not_asked_for_its_settings(run_simulated: Any, monkeypatch: Any) -> None:
    use_domain_table(monkeypatch)
    world = World()

    async def scenario() -> None:
        for name in NAMES:
            world.start(name)
        await until_found(world)
        server = world.server
        assert server is not None
        settings = ClientSettings(server.clock, server.fleet.all, server.router.connections)
        running = asyncio.ensure_future(settings.run())
        await sleep(12.0)
        assert settings.warnings() == []
        running.cancel()

    run_world(run_simulated, world, scenario)
