"""Recordings of a real PX4 through parser, router and vehicle, compared with pymavlink's decoding."""

import asyncio
import gzip
import math
import struct

import pytest

from tests.protocol.memory_testbed import MemoryTestbed
from vehicle_sim.mavlink import generated_dialect as sim

LOGS = [
    "failsafe-battery.tlog",
    "failsafe-datalink-rtl.tlog.gz",
    "failsafe-geofence-rtl.tlog.gz",
    "failsafe-offboard-loss-act0.tlog",
    "failsafe-offboard-loss-act3.tlog.gz",
    "failsafe-offboard-loss-act5.tlog.gz",
    "flight-takeoff-reposition-orbit-gimbal-rtl.tlog.gz",
    "mission-pause-resume.tlog.gz",
    "offboard-api.tlog.gz",
    "offboard.tlog.gz",
]
HEARTBEAT, GLOBAL_POSITION, CURRENT_MODE, LANDED_STATE = 0, 33, 436, 245
MOUNT, GIMBAL, ATTITUDE = 265, 285, 31
COMPARED_IDS = {HEARTBEAT, GLOBAL_POSITION, CURRENT_MODE, LANDED_STATE, MOUNT, GIMBAL, ATTITUDE}
COMPARE_EVERY = 199
"""The values are compared at every 199th record."""


def records(path):
    """Time [µs] and frame of each record of a telemetry log."""
    data = path.read_bytes()
    data = gzip.decompress(data) if path.suffix == ".gz" else data
    offset = 0
    while offset + 20 <= len(data):
        length = 12 + data[offset + 9] + (13 if data[offset + 10] & 1 else 0)
        yield struct.unpack_from(">Q", data, offset)[0], data[offset + 8 : offset + 8 + length]
        offset += 8 + length


@pytest.mark.parametrize("name", LOGS)
def test_the_topics_have_the_values_of_the_recording(reference_data, run_simulated, name):
    path = reference_data / "px4" / "tlogs" / name

    async def scenario():
        testbed = MemoryTestbed()
        link = testbed.link("replay", replay=True)
        reference_decoder, newest, vehicle, comparison_count = sim.MAVLink(None), {}, None, 0
        last_us = None
        try:
            for index, (time_us, raw) in enumerate(records(path)):
                testbed.loop.now_s += 0 if last_us is None else (time_us - last_us) / 1e6
                last_us = time_us
                link.inject(raw, "log")
                msg_id = raw[7] | raw[8] << 8 | raw[9] << 16
                system_id, component_id = raw[5], raw[6]
                if msg_id in COMPARED_IDS and component_id == 1 and system_id < 200:
                    newest[msg_id] = reference_decoder.decode(bytearray(raw))
                    newest["mode"] = (
                        newest[msg_id].custom_mode
                        if msg_id in (HEARTBEAT, CURRENT_MODE)
                        else newest.get("mode")
                    )
                if index % COMPARE_EVERY or len(newest) < 6:
                    continue
                (vehicle,) = testbed.fleet.all()
                compare(vehicle, newest)
                comparison_count += 1
            await asyncio.sleep(0)
            assert comparison_count > 20
            assert vehicle.identity.replayed
            assert link.sent_packets == []
            assert testbed.router.connection("replay").counts()["log"].bytes_skipped == 0
        finally:
            await testbed.close()

    run_simulated(scenario)


def compare(vehicle, newest):
    status = vehicle.status
    assert status.armed == bool(newest[HEARTBEAT].base_mode & 128)
    assert status.custom_mode == newest["mode"]
    assert not status.mode.startswith("px4_")
    assert not status.link_lost
    if LANDED_STATE in newest:
        states = {0: "unknown", 1: "on_ground", 2: "in_air", 3: "taking_off", 4: "landing"}
        assert status.landed_state == states[newest[LANDED_STATE].landed_state]
    if GLOBAL_POSITION in newest:
        position = vehicle.topic("global_position").value
        assert position.alt_amsl_m == newest[GLOBAL_POSITION].alt / 1e3
        assert position.alt_home_m == newest[GLOBAL_POSITION].relative_alt / 1e3
        assert position.lat_deg == newest[GLOBAL_POSITION].lat / 1e7
        assert (
            vehicle.topic("global_position").vehicle_time_boot_s == newest[GLOBAL_POSITION].time_boot_ms / 1e3
        )
    if MOUNT in newest and GIMBAL in newest:
        gimbal = vehicle.topic("gimbal").value
        if newest[MOUNT].time_boot_ms > newest[GIMBAL].time_boot_ms:
            assert math.degrees(gimbal.pitch_rad) == pytest.approx(newest[MOUNT].pitch, abs=1e-4)
            yaw = gimbal.yaw_ned_rad if newest[GIMBAL].flags & 16 else gimbal.yaw_frd_rad
            yaw_error_deg = (math.degrees(yaw) - newest[MOUNT].yaw + 180) % 360 - 180
            assert yaw_error_deg == pytest.approx(0, abs=1e-3) or gimbal.flags != newest[GIMBAL].flags
        else:
            assert gimbal.q == pytest.approx(tuple(newest[GIMBAL].q), abs=1e-6)
