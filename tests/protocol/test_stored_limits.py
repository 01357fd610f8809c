"""The operator's limits are stored per vehicle, restored after a restart, and reported; no other vehicle gets
them."""

import asyncio
import json
import os
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_server.api import offboard_routes
from gcs_server.api.offboard_models import LimitsRequest
from gcs_server.api.setpoints import StartRequest
from gcs_server.control.principal import Principal
from gcs_server.scenarios.in_loop_scheduler import InLoopScheduler
from gcs_server.storage.records import MAX_BYTES, Records
from gcs_server.streamer.offboard.limit_store import LimitRecord, LimitStore, VehicleKey
from gcs_server.streamer.offboard.streamer import SNAPSHOT_PERIOD_S, Streamer
from gcs_server.streamer.values.limit_values import OperatorLimits
from missions.fence import CircleFence, PolygonFence
from tests.protocol.api_calls import json_of, new_station
from tests.protocol.offboard_testbed import OffboardTestbed, offboard_event_codes, sleep, stream_request

SITL_UID = 0x4954414C44494E4F
START = StartRequest.model_validate({"setpoint": {"type": "velocity", "velocity_ned_m_s": [9, 0, 0]}})
LIMITS = OperatorLimits(speed_max_m_s=4.0, height_max_m=30.0, fence=CircleFence(47.397742, 8.545594, 60.0))


def parse_limits(stored):
    return LimitsRequest.model_validate(stored).to_limits()


def run_server(run_simulated, folder, scenario, *, uid=7, sends_version=True, second_uid=None):
    """Runs a server once with this data folder and a vehicle in flight with system id 1.

    Args:
        uid: uid of the vehicle; 0: the vehicle has none.
        sends_version: whether the vehicle sends AUTOPILOT_VERSION, which has the uid.
        second_uid: uid of a second vehicle with the same system id; None: no second vehicle.
    """

    async def run():
        testbed = OffboardTestbed()
        store = LimitStore(Records(folder), parse_limits)
        await store.load()
        await testbed.supervisor.close()  # ends the testbed's streamer, which does not use this store
        testbed.streamer = Streamer(testbed.clock, InLoopScheduler(testbed.clock), store)
        testbed.fleet._on_added.clear()
        testbed.fleet.on_vehicle_added(testbed.streamer.attach)
        testbed.supervisor.repeat("beat", testbed.streamer.update_once, SNAPSHOT_PERIOD_S)
        testbed.supervisor.start("scheduler", testbed._run_scheduler)
        testbed.router.start()
        testbed.fleet.start()
        autopilot = testbed.offboard_autopilot(testbed.link(), uid=uid)
        autopilot.sends_version = sends_version
        autopilot.set_hovering()
        if second_uid is not None:
            second_autopilot = testbed.offboard_autopilot(
                testbed.link("two"), uid=second_uid, booted_at_s=500.0
            )
            second_autopilot.set_hovering()
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            await scenario(testbed, vehicle, store)
        finally:
            await testbed.close()
            store.close()

    run_simulated(run)


def set_limits(run_simulated, folder, **options):
    async def scenario(testbed, vehicle, store):
        await vehicle.offboard.operator_limits.set(LIMITS, by="anna")
        assert vehicle.offboard.operator_limits.origin().kept

    run_server(run_simulated, folder, scenario, **options)


@pytest.mark.parametrize(("uid", "recognised_by"), [(7, "uid"), (SITL_UID, "system_id"), (0, "system_id")])
def test_limits_are_restored_after_a_restart_and_reported(run_simulated, tmp_path, uid, recognised_by):
    set_limits(run_simulated, tmp_path, uid=uid)

    async def check_restored(testbed, vehicle, store):
        origin = vehicle.offboard.status().limits_origin
        assert vehicle.offboard.limits().operator == LIMITS
        assert (origin.active, origin.restored, origin.kept) == (True, True, True)
        assert (origin.set_by, origin.recognised_by, origin.warning) == ("anna", recognised_by, None)
        assert origin.set_unix_s > 0
        assert "restored after a restart, set by anna" in origin.text
        assert offboard_event_codes(vehicle) == ["limits_restored"]
        bob = Principal.from_identity("bob")
        response = json_of(await offboard_routes.start("1", START, new_station(testbed), bob))
        assert response["limits"]["operator"]["speed_max_m_s"] == 4.0
        origin_view = response["limits"]["origin"]
        assert (origin_view["restored"], origin_view["set_by"], origin_view["set_unix_s"]) == (
            True,
            "anna",
            origin.set_unix_s,
        )
        # Reported again to the client that starts a stream.
        assert offboard_event_codes(vehicle).count("limits_restored") == 2
        await sleep(0.3)
        assert vehicle.offboard.status().setpoint["velocity_ned_m_s"][0] == pytest.approx(4.0)

    run_server(run_simulated, tmp_path, check_restored, uid=uid)


@pytest.mark.parametrize(("uid_before", "uid_after"), [(7, 8), (7, SITL_UID), (SITL_UID, 7)])
def test_another_vehicle_with_the_same_system_id_gets_no_stored_limits(
    run_simulated, tmp_path, uid_before, uid_after
):
    set_limits(run_simulated, tmp_path, uid=uid_before)

    async def scenario(testbed, vehicle, store):
        assert vehicle.offboard.limits().operator == OperatorLimits()
        assert not vehicle.offboard.status().limits_origin.active
        assert offboard_event_codes(vehicle) == []

    run_server(run_simulated, tmp_path, scenario, uid=uid_after)


def test_two_vehicles_with_the_same_system_id_do_not_share_stored_limits(run_simulated, tmp_path):
    set_limits(run_simulated, tmp_path, uid=7)

    async def check_different_uids(testbed, vehicle, store):
        vehicle_by_uid = {v.identity.uid: v for v in testbed.fleet.all()}
        assert len(vehicle_by_uid) == 2
        assert vehicle_by_uid[f"{7:016x}"].offboard.limits().operator == LIMITS
        assert vehicle_by_uid[f"{8:016x}"].offboard.limits().operator == OperatorLimits()

    run_server(run_simulated, tmp_path, check_different_uids, uid=7, second_uid=8)

    async def check_equal_uids(testbed, vehicle, store):
        first, second = testbed.fleet.all()
        await first.offboard.operator_limits.set(LIMITS, by="anna")
        await second.offboard.operator_limits.set(OperatorLimits(speed_max_m_s=1.0), by="bob")
        assert first.offboard.operator_limits.origin().kept
        assert not second.offboard.operator_limits.origin().kept
        assert "not stored" in second.offboard.operator_limits.origin().warning
        assert second.offboard.limits().operator.speed_max_m_s == 1.0  # applied, not stored

    run_server(run_simulated, tmp_path / "other", check_equal_uids, uid=SITL_UID, second_uid=SITL_UID)


def test_limits_are_removed_when_the_vehicle_sends_another_uid(run_simulated, tmp_path):
    set_limits(run_simulated, tmp_path, uid=7)

    async def scenario(testbed, vehicle, store):
        assert vehicle.offboard.limits().operator == LIMITS
        autopilot = next(iter(testbed.router._connections.values())).link.autopilots["peer"]
        autopilot.uid = 8
        autopilot.send_autopilot_version()
        await sleep(0.3)
        assert vehicle.offboard.limits().operator == OperatorLimits()
        assert "limits_other_vehicle" in offboard_event_codes(vehicle)

    run_server(run_simulated, tmp_path, scenario, uid=7)


def test_without_an_identity_the_start_of_a_stream_warns_that_limits_are_missing(run_simulated, tmp_path):
    set_limits(run_simulated, tmp_path, uid=7)

    async def scenario(testbed, vehicle, store):
        await vehicle.offboard.start(stream_request())
        origin = vehicle.offboard.status().limits_origin
        assert "has not sent its identity" in origin.warning
        assert offboard_event_codes(vehicle) == ["limits_warning"]
        await vehicle.offboard.operator_limits.set(OperatorLimits(speed_max_m_s=1.0), by="bob")
        assert "once the vehicle is identified" in vehicle.offboard.operator_limits.origin().warning

    run_server(run_simulated, tmp_path, scenario, sends_version=False)


def test_removed_limits_are_not_restored_after_a_restart(run_simulated, tmp_path):
    set_limits(run_simulated, tmp_path)

    async def remove_limits(testbed, vehicle, store):
        await vehicle.offboard.operator_limits.set(OperatorLimits(), by="bob")

    run_server(run_simulated, tmp_path, remove_limits)

    async def scenario(testbed, vehicle, store):
        assert not vehicle.offboard.status().limits_origin.active
        assert offboard_event_codes(vehicle) == []

    run_server(run_simulated, tmp_path, scenario)


def stored_record(tmp_path):
    return json.loads((tmp_path / f"uid-{7:016x}.json").read_text())


CORRUPTIONS = {
    "empty": lambda record: b"",
    "cut off": lambda record: json.dumps(record).encode()[:60],
    "not text": lambda record: bytes(range(256)),
    "deeply nested": lambda record: b"[" * 50_000,
    "a list": lambda record: b"[1, 2]",
    "too long": lambda record: json.dumps({**record, "more": "x" * MAX_BYTES}).encode(),
    "another format": lambda record: json.dumps({**record, "format": 2}).encode(),
    "another vehicle's": lambda record: json.dumps({**record, "uid": "8" * 16}).encode(),
    "no time": lambda record: json.dumps({**record, "set_unix_s": "yesterday"}).encode(),
    "NaN": lambda record: json.dumps({**record, "limits": {"speed_max_m_s": float("nan")}}).encode(),
    "out of range": lambda record: json.dumps({**record, "limits": {"speed_max_m_s": 900}}).encode(),
    "unknown limit": lambda record: json.dumps({**record, "limits": {"colour": "red"}}).encode(),
    "half a fence": lambda record: json.dumps({**record, "limits": {"fence": {"kind": "circle"}}}).encode(),
}


@pytest.mark.parametrize("name", list(CORRUPTIONS))
def test_an_unreadable_file_causes_a_warning_and_no_error(run_simulated, tmp_path, name):
    set_limits(run_simulated, tmp_path)
    path = tmp_path / f"uid-{7:016x}.json"
    path.write_bytes(CORRUPTIONS[name](stored_record(tmp_path)))

    async def scenario(testbed, vehicle, store):
        origin = vehicle.offboard.status().limits_origin
        assert not origin.active
        assert "not in force" in origin.warning
        assert str(path) in origin.warning
        assert len(store.warnings()) == 1
        await vehicle.offboard.start(stream_request())
        assert offboard_event_codes(vehicle) == ["limits_warning"] * 2
        await vehicle.offboard.operator_limits.set(LIMITS, by="bob")  # replaces the file
        assert vehicle.offboard.operator_limits.origin().warning is None
        assert store.warnings() == []

    run_server(run_simulated, tmp_path, scenario)
    set_limits(run_simulated, tmp_path)


def test_a_named_pipe_or_folder_instead_of_a_file_does_not_block(run_simulated, tmp_path):
    os.mkfifo(tmp_path / f"uid-{7:016x}.json")
    (tmp_path / f"uid-{8:016x}.json").mkdir()

    async def scenario(testbed, vehicle, store):
        assert "not a file" in vehicle.offboard.status().limits_origin.warning

    run_server(run_simulated, tmp_path, scenario)


def test_an_unreadable_folder_is_reported_for_every_vehicle(run_simulated, tmp_path):
    folder = tmp_path / "limits"
    folder.write_text("a file")

    async def scenario(testbed, vehicle, store):
        assert "cannot be read" in vehicle.offboard.status().limits_origin.warning
        await vehicle.offboard.operator_limits.set(LIMITS, by="anna")
        assert vehicle.offboard.limits().operator == LIMITS  # applied, not stored
        assert "lost when the server restarts" in vehicle.offboard.operator_limits.origin().warning
        assert len(store.warnings()) == 2

    run_server(run_simulated, folder, scenario)


def test_the_event_loop_never_waits_for_the_disk(tmp_path, monkeypatch):
    key, disk_released = VehicleKey(1, "ab"), threading.Event()
    fsync = os.fsync

    def slow_fsync(descriptor):
        disk_released.wait(5)
        fsync(descriptor)

    async def run():
        store = LimitStore(Records(tmp_path), parse_limits)
        await store.save(key, LimitRecord(OperatorLimits(speed_max_m_s=1.0), 1.0, "a"))
        monkeypatch.setattr(os, "fsync", slow_fsync)
        saving = asyncio.ensure_future(store.save(key, LimitRecord(LIMITS, 2.0, "b")))
        ticks = 0
        while not saving.done():
            await asyncio.sleep(0.01)
            ticks += 1
            if ticks == 20:  # the loop continued; the file is still the previous one
                stored = json.loads((tmp_path / "uid-ab.json").read_text())
                assert stored["limits"] == {"speed_max_m_s": 1.0}
                disk_released.set()
        assert await saving is None
        store.close()

    asyncio.run(run())
    assert json.loads((tmp_path / "uid-ab.json").read_text())["set_by"] == "b"
    assert [path.name for path in tmp_path.iterdir()] == ["uid-ab.json"]


speeds = st.none() | st.floats(0.1, 20)
altitudes = st.none() | st.floats(-1000, 4000)
corners = st.tuples(st.floats(-90, 90), st.floats(-180, 180))
fences = (
    st.none()
    | st.builds(CircleFence, st.floats(-90, 90), st.floats(-180, 180), st.floats(5, 10_000))
    | st.lists(corners, min_size=3, max_size=200).map(lambda points: PolygonFence(tuple(points)))
)


@settings(max_examples=40)
@given(
    st.builds(
        OperatorLimits,
        speed_max_m_s=speeds,
        climb_max_m_s=speeds,
        sink_max_m_s=speeds,
        height_min_m=altitudes,
        distance_max_m=st.none() | st.floats(5, 10_000),
        fence=fences,
    )
)
def test_stored_limits_are_read_back_unchanged(tmp_path_factory, limits):
    folder = tmp_path_factory.mktemp("limits")
    key = VehicleKey(3, None)

    async def run():
        store = LimitStore(Records(folder), parse_limits)
        assert await store.save(key, LimitRecord(limits, 12.5, "anna")) is None
        store.close()
        reopened = LimitStore(Records(folder), parse_limits)
        await reopened.load()
        return reopened.find(key)

    restored = asyncio.run(run())
    assert restored == (None if limits == OperatorLimits() else LimitRecord(limits, 12.5, "anna"))
