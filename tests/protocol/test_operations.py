"""Reading a vehicle's parameters as an operation: progress, cancellation, a lost link."""

import asyncio
import json
from types import SimpleNamespace

import pytest

from gcs_server.api import control_routes, operation_routes, param_routes
from gcs_server.errors import Disconnected, NotInControl
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle import metadata_files
from tests.protocol.api_calls import ANNA, BOB, lines, station_of, view
from tests.protocol.offboard_world import OffboardWorld, seconds
from tests.protocol.sim_world import SimulatedAutopilot

WAIT = param_routes.RefreshRequest(wait=True)


async def inline(work):
    return work()


async def read_inline(kind, packed, crc):
    return metadata_files.decode_document(kind, metadata_files.encode_document(kind, packed, crc))


def scenario(jump, work):
    async def run():
        world = OffboardWorld()
        autopilot = SimulatedAutopilot(world.link(), seed=1)
        try:
            vehicle = await world.ready()
            vehicle.metadata.run_in_thread, vehicle.metadata.read = inline, read_inline
            station = station_of(world)
            await work(SimpleNamespace(world=world, vehicle=vehicle, autopilot=autopilot, station=station))
        finally:
            autopilot.alive = False
            await world.close()

    jump(run)


async def refresh(at, principal, body=None):
    return await param_routes.refresh_params(at.vehicle, at.station, principal, body)


async def newest(at):
    return view(await operation_routes.list_operations(at.station))["operations"][-1]


def test_reading_the_parameters_is_an_operation_with_progress(jump):
    async def work(at):
        first = await refresh(at, ANNA)
        assert (first.status_code, view(first)["state"]) == (202, "reading")
        second = await refresh(at, BOB)
        assert second.headers["Location"] == first.headers["Location"] == "/api/v1/operations/1"
        shares = []
        while (now := await newest(at))["state"] == "running":
            shares.append(now["progress"] or 0.0)
            await asyncio.sleep(0.02)
        assert shares == sorted(shares)
        assert any(0.1 < share < 0.9 for share in shares)
        assert (now["state"], now["progress"]) == ("succeeded", 1.0)
        assert (now["vehicle"], now["client"], now["client_key"]) == ("1", "anna", ANNA.key)
        assert now["result"] == {"received": 929, "source": "vehicle"}
        assert view(await refresh(at, ANNA, WAIT))["received"] == 929

    scenario(jump, work)


def test_an_operation_is_cancelled_by_its_client_or_by_any_client_if_nobody_else_has_control(jump):
    async def work(at):
        await control_routes.take("1", at.station, BOB)
        reading = asyncio.ensure_future(refresh(at, ANNA, WAIT))
        await asyncio.sleep(0.01)
        started = await newest(at)
        assert started["state"] == "running"
        await control_routes.release("1", at.station, BOB)
        await control_routes.take("1", at.station, ANNA)
        with pytest.raises(NotInControl):
            await operation_routes.cancel_operation(started["id"], at.station, BOB)
        assert lines(at.station)[-1] == ("bob", "operations/cancel", None, "not_in_control")
        ended = view(await operation_routes.cancel_operation(started["id"], at.station, ANNA))
        assert (ended["state"], ended["error"]) == ("cancelled", None)
        assert ("anna", "operations/cancel", None, "ok") in lines(at.station)
        with pytest.raises(Exception, match="was cancelled"):
            await reading
        assert at.vehicle.params.list.state == "failed"
        assert view(await refresh(at, ANNA, WAIT))["state"] == "ready"

    scenario(jump, work)


def test_a_link_lost_during_the_read_fails_the_operation_with_that_reason(jump):
    async def work(at):
        reading = asyncio.ensure_future(refresh(at, ANNA, WAIT))
        await asyncio.sleep(0.01)
        at.autopilot.alive = False
        with pytest.raises(Disconnected, match="was lost before it answered"):
            async with asyncio.timeout(60):
                await reading
        failed = await newest(at)
        assert (failed["state"], failed["error"]["code"], failed["error"]["status"]) == (
            "failed",
            "disconnected",
            503,
        )
        assert json.loads(json.dumps(failed)) == failed
        await seconds(2)

    scenario(jump, work)


def test_concurrent_reads_share_one_operation_and_one_request(jump):
    async def work(at):
        await asyncio.gather(refresh(at, ANNA, WAIT), refresh(at, BOB, WAIT))
        assert at.autopilot.count(d.MAVLINK_MSG_ID_PARAM_REQUEST_LIST) == 1
        assert len(at.station.operations.all()) == 1

    scenario(jump, work)
