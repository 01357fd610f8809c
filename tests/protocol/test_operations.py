"""The read of a vehicle's parameters as an operation: progress, cancellation, a lost link."""

import asyncio
import json
from types import SimpleNamespace

import pytest

from gcs_server.api import control_routes, operation_routes, param_routes
from gcs_server.errors import Disconnected, NotInControl
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle import metadata_files
from tests.protocol.api_calls import ANNA, BOB, journal_entries, json_of, new_station
from tests.protocol.offboard_testbed import OffboardTestbed, sleep
from tests.protocol.simulated_autopilot import SimulatedAutopilot

WAIT_FOR_END = param_routes.RefreshRequest(wait=True)


async def run_inline(function):
    return function()


async def read_inline(kind, packed, crc):
    return metadata_files.decode_document(kind, metadata_files.encode_document(kind, packed, crc))


def run_with_rig(run_simulated, scenario):
    async def run():
        testbed = OffboardTestbed()
        autopilot = SimulatedAutopilot(testbed.link(), seed=1)
        try:
            vehicle = await testbed.wait_for_vehicle()
            vehicle.metadata.run_in_thread, vehicle.metadata.read = run_inline, read_inline
            station = new_station(testbed)
            await scenario(
                SimpleNamespace(testbed=testbed, vehicle=vehicle, autopilot=autopilot, station=station)
            )
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


async def refresh(rig, principal, body=None):
    return await param_routes.refresh_params(rig.vehicle, rig.station, principal, body)


async def newest_operation(rig):
    return json_of(await operation_routes.list_operations(rig.station))["operations"][-1]


def test_reading_the_parameters_is_an_operation_with_progress(run_simulated):
    async def scenario(rig):
        first_response = await refresh(rig, ANNA)
        assert (first_response.status_code, json_of(first_response)["state"]) == (202, "reading")
        second_response = await refresh(rig, BOB)
        assert first_response.headers["Location"] == "/api/v1/operations/1"
        assert second_response.headers["Location"] == "/api/v1/operations/1"
        shares = []
        while (operation := await newest_operation(rig))["state"] == "running":
            shares.append(operation["progress"] or 0.0)
            await asyncio.sleep(0.02)
        assert shares == sorted(shares)
        assert any(0.1 < share < 0.9 for share in shares)
        assert (operation["state"], operation["progress"]) == ("succeeded", 1.0)
        assert (operation["vehicle"], operation["client"], operation["client_key"]) == ("1", "anna", ANNA.key)
        assert operation["result"] == {"received": 913, "source": "vehicle"}
        assert json_of(await refresh(rig, ANNA, WAIT_FOR_END))["received"] == 913

    run_with_rig(run_simulated, scenario)


def test_an_operation_is_cancelled_by_the_client_in_control_and_not_by_another_client(run_simulated):
    async def scenario(rig):
        await control_routes.take("1", rig.station, BOB)
        reading = asyncio.ensure_future(refresh(rig, ANNA, WAIT_FOR_END))
        await asyncio.sleep(0.01)
        started = await newest_operation(rig)
        assert started["state"] == "running"
        await control_routes.release("1", rig.station, BOB)
        await control_routes.take("1", rig.station, ANNA)
        with pytest.raises(NotInControl):
            await operation_routes.cancel_operation(started["id"], rig.station, BOB)
        assert journal_entries(rig.station)[-1] == ("bob", "operations/cancel", None, "not_in_control")
        ended = json_of(await operation_routes.cancel_operation(started["id"], rig.station, ANNA))
        assert (ended["state"], ended["error"]) == ("cancelled", None)
        assert ("anna", "operations/cancel", None, "ok") in journal_entries(rig.station)
        with pytest.raises(Exception, match="was cancelled"):
            await reading
        assert rig.vehicle.params.list.state == "failed"
        assert json_of(await refresh(rig, ANNA, WAIT_FOR_END))["state"] == "ready"

    run_with_rig(run_simulated, scenario)


@pytest.mark.parametrize(("in_control", "cancelled_by"), [(None, BOB), (BOB, ANNA)])
def test_an_operation_is_cancelled_without_control_of_others_or_by_the_client_that_started_it(
    run_simulated, in_control, cancelled_by
):
    async def scenario(rig):
        reading = asyncio.ensure_future(refresh(rig, ANNA, WAIT_FOR_END))
        await asyncio.sleep(0.01)
        started = await newest_operation(rig)
        if in_control is not None:
            await control_routes.take("1", rig.station, in_control)
        ended = json_of(await operation_routes.cancel_operation(started["id"], rig.station, cancelled_by))
        assert ended["state"] == "cancelled"
        with pytest.raises(Exception, match="was cancelled"):
            await reading

    run_with_rig(run_simulated, scenario)


def test_an_operation_fails_with_a_reason_if_the_link_is_lost_during_the_read(run_simulated):
    async def scenario(rig):
        reading = asyncio.ensure_future(refresh(rig, ANNA, WAIT_FOR_END))
        await asyncio.sleep(0.01)
        rig.autopilot.alive = False
        with pytest.raises(Disconnected, match="was lost before it answered"):
            async with asyncio.timeout(60):
                await reading
        failed = await newest_operation(rig)
        assert (failed["state"], failed["error"]["code"], failed["error"]["status"]) == (
            "failed",
            "disconnected",
            503,
        )
        assert json.loads(json.dumps(failed)) == failed
        await sleep(2)

    run_with_rig(run_simulated, scenario)


def test_concurrent_reads_share_one_operation_and_one_request(run_simulated):
    async def scenario(rig):
        await asyncio.gather(refresh(rig, ANNA, WAIT_FOR_END), refresh(rig, BOB, WAIT_FOR_END))
        assert rig.autopilot.count(d.MAVLINK_MSG_ID_PARAM_REQUEST_LIST) == 1
        assert len(rig.station.operations.all()) == 1

    run_with_rig(run_simulated, scenario)
