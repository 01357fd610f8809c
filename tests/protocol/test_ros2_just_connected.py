"""Commands over ROS 2 within seconds of the server's start beside a PX4 that runs already, on simulated
time."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from gcs_server.api import offboard_routes
from gcs_server.api.setpoints import StartRequest
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, NotInControl, NotYet, Refused
from gcs_server.ros2.external_mode import CHECK_REPLY, UNREGISTER
from gcs_server.vehicle.settling import SETTLING_S
from tests.protocol.api_calls import ANNA, BOB, json_of
from tests.protocol.mission_modes_testbed import MODE_NAME, MissionModesTestbed, SlowPlanWork
from tests.protocol.offboard_testbed import sleep
from tests.protocol.ros2_testbed import Ros2Testbed
from tests.protocol.simulated_testbed import until

VELOCITY = {"type": "velocity", "velocity_ned_m_s": [0, 0, 0], "yaw_ned_rad": 0}
SETPOINT_TOPIC = "/fmu/in/trajectory_setpoint"
Scenario = Callable[[MissionModesTestbed], Awaitable[None]]


def run_just_connected(run_simulated: Any, scenario: Scenario, *, in_air: bool = False) -> None:
    """Runs a test that begins when the server has received the vehicle's first status: PX4 has been running
    for some time, in the air or on the ground, without this server."""

    async def run() -> None:
        testbed = Ros2Testbed(mavlink=True)
        testbed.mavlink_on = False
        try:
            if in_air:
                await testbed.take_off()
            else:
                testbed.ros2_on = False
                await sleep(16)
                testbed.ros2_on = True
                await until(testbed.fleet.all, 5)
            vehicle = testbed.fleet.get("1")
            await scenario(MissionModesTestbed(testbed, vehicle))
        finally:
            await testbed.close()

    run_simulated(run)


async def start_offboard(rig: MissionModesTestbed, *, by: Principal = ANNA) -> dict[str, Any]:
    request = StartRequest.model_validate({"setpoint": VELOCITY, "valid_for_s": 5})
    return json_of(await offboard_routes.start("1", request, rig.station, by))


def forget_layouts(rig: MissionModesTestbed, of: str = "", *, for_s: float = math.inf) -> None:
    """The server must learn all layouts again, and PX4 does not answer for some time: about one topic (its
    name inside PX4), or about all."""
    topics = rig.testbed.topics[0]
    topics.link.formats.reset()
    answers_s = rig.testbed.loop.time() + for_s
    on_response = topics.link.formats.on_response

    def answer(values: dict[str, Any]) -> None:
        name = bytes(values["topic_name"]).split(b"\0")[0].decode()
        if rig.testbed.loop.time() >= answers_s or not name.endswith(f"/{of}" if of else ""):
            on_response(values)

    topics.link.formats.on_response = answer  # type: ignore[method-assign]


def forget_connection(rig: MissionModesTestbed, ago_s: float) -> None:
    """The connection, and PX4's boot, are that long ago."""
    for endpoint in rig.vehicle.endpoints:
        endpoint.first_received_s = endpoint.boot_at_s = rig.testbed.loop.time() - ago_s


def test_a_mode_is_registered_with_the_layouts_that_become_known_while_its_mission_is_compiled(
    run_simulated: Any,
) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        await sleep(SETTLING_S)
        rig.station.flights.plan_work = SlowPlanWork(4.0)
        forget_layouts(rig, "arming_check_reply", for_s=5.0)
        assert (await rig.register())["state"] == "registered"

    run_just_connected(run_simulated, scenario)


def test_a_mode_is_registered_directly_after_the_first_status(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        progress: list[str] = []
        rig.vehicle.events.subscribe(lambda event: progress.append(event.text))
        began_s = rig.testbed.loop.time()
        assert (await rig.register())["state"] == "registered"
        assert rig.testbed.loop.time() - began_s < SETTLING_S
        waiting = "Waiting for vehicle 1, which has just connected. "
        assert any(text.startswith(waiting) for text in progress)

    run_just_connected(run_simulated, scenario)


def test_offboard_starts_directly_after_the_layouts_were_lost_in_flight(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        forget_connection(rig, 1.0)
        forget_layouts(rig, for_s=1.5)
        with pytest.raises(Refused, match="has not answered yet which layout"):
            rig.station.offboard("1")._availability.require_topics(["velocity"], in_offboard=True)
        assert (await start_offboard(rig))["streaming"]
        await rig.until_mode("offboard")

    run_just_connected(run_simulated, scenario, in_air=True)


def test_what_does_not_come_is_refused_at_the_limit_and_nothing_is_sent(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        forget_layouts(rig, "vehicle_local_position")
        await sleep(1.5)
        connected_s = rig.vehicle.endpoints[0].first_received_s
        with pytest.raises(NotYet, match="velocity estimate"):
            await start_offboard(rig)
        assert rig.testbed.loop.time() - connected_s == pytest.approx(SETTLING_S, abs=0.5)
        assert not rig.sent_messages(SETPOINT_TOPIC)
        with pytest.raises(NotYet, match="no valid position estimate"):
            await rig.register()
        assert rig.testbed.loop.time() - connected_s == pytest.approx(SETTLING_S, abs=0.5)

    run_just_connected(run_simulated, scenario)


def test_a_vehicle_that_has_been_connected_for_longer_is_refused_at_once(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        forget_connection(rig, SETTLING_S + 1)
        forget_layouts(rig, for_s=3.0)
        began_s = rig.testbed.loop.time()
        with pytest.raises(Refused, match="has not answered yet which layout"):
            await start_offboard(rig)
        assert rig.testbed.loop.time() == began_s

    run_just_connected(run_simulated, scenario, in_air=True)


def test_a_layout_that_px4_did_not_name_is_refused_before_the_limit(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        forget_connection(rig, 0.0)
        forget_layouts(rig, "trajectory_setpoint")
        began_s = rig.testbed.loop.time()
        with pytest.raises(Refused, match=r"did not answer which layout .*trajectory_setpoint has"):
            await start_offboard(rig)
        assert rig.testbed.loop.time() - began_s < SETTLING_S / 2
        assert not rig.sent_messages(SETPOINT_TOPIC)

    run_just_connected(run_simulated, scenario, in_air=True)


def test_hold_ends_a_start_that_waits(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        forget_connection(rig, 0.0)
        forget_layouts(rig, for_s=1.0)
        start = asyncio.ensure_future(start_offboard(rig))
        await sleep(0.5)
        rig.vehicle.tickets.open("hold").claim()
        with pytest.raises(GcsError, match="Interrupted by “hold”"):
            await start
        await sleep(5)
        assert not rig.sent_messages(SETPOINT_TOPIC)
        assert rig.vehicle.status.mode == "hold"

    run_just_connected(run_simulated, scenario, in_air=True)


def test_a_registration_that_waits_ends_with_control_and_can_be_cancelled(run_simulated: Any) -> None:
    async def scenario(rig: MissionModesTestbed) -> None:
        rig.station.flights.plan_work = SlowPlanWork(3.0)
        registration = asyncio.ensure_future(rig.register())
        await sleep(1)
        lease = rig.station.authority.control("1").lease
        lease.release(ANNA)
        lease.take(BOB)
        with pytest.raises(NotInControl):
            await registration
        assert rig.station.flights.mission_modes.all("1") == []

        registration = asyncio.ensure_future(rig.register(by=BOB))
        await until(lambda: rig.station.flights.mission_modes.all("1"), 10)
        (operation,) = [each for each in rig.station.operations.all() if each.state == "running"]
        assert operation.kind == "mission_modes/register"
        await rig.station.operations.cancel(operation.id)
        with pytest.raises(GcsError, match="was cancelled"):
            await registration
        await sleep(3)
        assert rig.station.flights.mission_modes.all("1") == []
        assert rig.sent_messages(UNREGISTER) or not rig.sent_messages(CHECK_REPLY)
        assert MODE_NAME not in await rig.other_station.selectable_modes()

    run_just_connected(run_simulated, scenario)
