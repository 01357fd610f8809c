"""All parameters of the simulated vehicle over links that lose packets, and their metadata."""

import asyncio

import pytest

from gcs_server.errors import Disconnected, InvalidRequest, NoReply
from gcs_server.mavlink import dialect as d
from gcs_server.storage.cache import Cache
from gcs_server.vehicle import metadata_files
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot

LIST, READ, SET, FTP = (
    d.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
    d.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    d.MAVLINK_MSG_ID_PARAM_SET,
    d.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
)
"""Message ids."""
PARAMETER_COUNT = 913
"""Number of the simulated vehicle's parameters."""
LOSS = [(0.0, 1), (0.05, 2), pytest.param(0.2, 3, marks=pytest.mark.broad)]
"""The share of packets lost in each direction, and the seed of the losses."""


async def run_inline(function):
    """Replaces the server's background thread."""
    return function()


async def read_inline(kind, packed, crc):
    return metadata_files.decode_document(kind, metadata_files.encode_document(kind, packed, crc))


def run_with_vehicle(run_simulated, scenario, *, loss=0.0, seed=0, cache=None):
    async def run():
        testbed = MemoryTestbed()
        autopilot = SimulatedAutopilot(testbed.link(), seed=seed)
        try:
            vehicle = await testbed.wait_for_vehicle()
            vehicle.metadata.cache, vehicle.metadata.run_in_thread = cache, run_inline
            vehicle.metadata.read = read_inline
            autopilot.loss = loss
            await scenario(testbed, vehicle, autopilot)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


def simulated_values(autopilot):
    return dict(autopilot.sim.simulation.parameters[0].items())


@pytest.mark.parametrize(("loss", "seed"), LOSS)
def test_all_parameters_have_exact_values_and_their_metadata(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot):
        assert vehicle.params.list.state == "unknown"
        assert autopilot.count(LIST) == autopilot.count(FTP) == 0  # nothing is read without a request
        result = await vehicle.params.refresh()
        assert (result.state, result.source) == ("ready", "vehicle")
        assert result.received == result.count == PARAMETER_COUNT
        assert result.facts, result.facts_problem
        values = simulated_values(autopilot)
        assert {p.name: p.value for p in vehicle.params.all()} == values
        assert all(isinstance(p.value, int) == p.is_integer for p in vehicle.params.all())
        assert all(vehicle.params.metadata_of(name) is not None for name in values)
        assert vehicle.params.metadata_of("MPC_XY_VEL_MAX").unit == "m/s"
        if not loss:
            # One request for the list and two for the checksum.
            assert (autopilot.count(LIST), autopilot.count(READ)) == (1, 2)

    run_with_vehicle(run_simulated, scenario, loss=loss, seed=seed)


def test_with_an_equal_checksum_nothing_is_read_again(run_simulated, tmp_path):
    cache = Cache(tmp_path)

    async def read_from_vehicle(testbed, vehicle, autopilot):
        await vehicle.params.refresh()

    async def read_from_cache(testbed, vehicle, autopilot):
        result = await vehicle.params.refresh()
        assert (result.state, result.source, result.received) == ("ready", "cache", PARAMETER_COUNT)
        assert (autopilot.count(LIST), autopilot.count(READ), autopilot.count(FTP)) == (0, 1, 0)
        assert result.facts
        assert {p.name: p.value for p in vehicle.params.all()} == simulated_values(autopilot)
        await vehicle.params.refresh()
        assert autopilot.count(LIST) == 0

        autopilot.sim.set_parameter(0, "MPC_XY_CRUISE", 3.0)  # another station sets a parameter
        await testbed.clock.sleep(0.5)
        values = {p.name: p.value for p in vehicle.params.all()}
        assert values["MPC_XY_CRUISE"] == 3.0  # sent by the vehicle without a request
        assert (await vehicle.params.refresh()).source == "vehicle"
        assert autopilot.count(LIST) == 1
        await vehicle.params.refresh(ignore_cache=True)
        assert autopilot.count(LIST) == 2

    run_with_vehicle(run_simulated, read_from_vehicle, cache=cache)
    run_with_vehicle(run_simulated, read_from_cache, cache=cache)


def test_a_value_is_checked_by_the_vehicles_metadata(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        params = vehicle.params
        await params.set("MPC_XY_CRUISE", 19.5)  # before its metadata is read: PX4 accepts any value
        await params.refresh()
        for name, value in (("MPC_XY_CRUISE", 30), ("COM_OBL_RC_ACT", 99), ("COM_OBL_RC_ACT", 1.5)):
            with pytest.raises(InvalidRequest) as caught:
                await params.set(name, value)
            assert caught.value.field == "value"
            assert name in str(caught.value)
        set_count = autopilot.count(SET)
        assert set_count == 1
        assert (await params.set("COM_OBL_RC_ACT", 99, force=True)).value == 99
        assert next(p for p in params.all() if p.name == "COM_OBL_RC_ACT").value == 99
        assert (await params.set("COM_RC_OVERRIDE", 3)).value == 3

    run_with_vehicle(run_simulated, scenario)


def test_a_lost_vehicle_ends_the_read_with_a_reason_and_the_read_can_be_repeated(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        reading = asyncio.ensure_future(vehicle.params.refresh())
        await testbed.clock.sleep(0.4)
        assert vehicle.params.list.state == "reading"
        assert 0 < vehicle.params.list.received < PARAMETER_COUNT
        autopilot.loss = 1.0
        with pytest.raises((Disconnected, NoReply)):
            await reading
        parameter_list = vehicle.params.list
        assert parameter_list.state == "failed"
        assert parameter_list.problem
        autopilot.loss = 0.0
        await testbed.clock.sleep(2)
        lists = await asyncio.gather(vehicle.params.refresh(), vehicle.params.refresh())
        assert {parameter_list.state for parameter_list in lists} == {"ready"}
        assert autopilot.count(LIST) == 2  # two simultaneous requests share one read
        autopilot.loss = 1.0
        await testbed.clock.sleep(5)
        autopilot.loss = 0.0
        await testbed.clock.sleep(2)
        assert vehicle.params.list.state == "outdated"

    run_with_vehicle(run_simulated, scenario)


def test_a_vehicle_that_sends_no_parameter_list_is_reported_and_accepts_single_parameters(run_simulated):
    async def run():
        testbed = MemoryTestbed()
        autopilot = testbed.autopilot(testbed.link())
        try:
            vehicle = await testbed.wait_for_vehicle()
            vehicle.metadata.run_in_thread, vehicle.metadata.read = run_inline, read_inline
            with pytest.raises(NoReply, match="did not send its parameters"):
                await vehicle.params.refresh()
            await vehicle.params.describe()
            assert "provides no component metadata" in vehicle.params.list.facts_problem
            assert (await vehicle.params.set("MPC_XY_VEL_MAX", 500)).value == 500
            assert autopilot.params["MPC_XY_VEL_MAX"][1] == 500
        finally:
            await testbed.close()

    run_simulated(run)


def test_event_texts_come_from_the_vehicles_metadata(run_simulated, tmp_path):
    async def scenario(testbed, vehicle, autopilot):
        before = (await vehicle.health.check()).findings
        vehicle.health.apply_definitions(await vehicle.metadata.events())
        after = vehicle.health.readiness
        assert (after.words, len(after.findings)) == ("vehicle", len(before))
        texts = {f.name: f.cause for f in after.findings}
        assert texts["check_modes_offboard_signal"] == "No offboard setpoints received."
        request_count = autopilot.count(FTP)
        await vehicle.metadata.events()
        assert autopilot.count(FTP) == request_count  # cached by its checksum
        assert len(list(tmp_path.iterdir())) == 2

    run_with_vehicle(run_simulated, scenario, cache=Cache(tmp_path), loss=0.05, seed=4)
