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
COMPARED_IDS = {0, 33, 436, 245, 265, 285, 31}
"""Message ids: heartbeat, global position, mode, landed state, mount, gimbal, attitude quaternion."""
COMPARED_EVERY = 199


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
def test_the_api_shows_the_values_of_the_log(shared, run_simulated, name):
    path = shared / "px4" / "tlogs" / name

    async def scenario():
        testbed = MemoryTestbed()
        link = testbed.link("tape", replay=True)
        reference_decoder, newest, vehicle, compared = sim.MAVLink(None), {}, None, 0
        last_us = None
        try:
            for count, (time_us, raw) in enumerate(records(path)):
                testbed.loop.now_s += 0 if last_us is None else (time_us - last_us) / 1e6
                last_us = time_us
                link.inject(raw, "log")
                msg_id = raw[7] | raw[8] << 8 | raw[9] << 16
                if msg_id in COMPARED_IDS and raw[6] == 1 and raw[5] < 200:
                    newest[msg_id] = reference_decoder.decode(bytearray(raw))
                    newest["mode"] = newest[msg_id].custom_mode if msg_id in (0, 436) else newest.get("mode")
                if count % COMPARED_EVERY or len(newest) < 6:
                    continue
                (vehicle,) = testbed.fleet.all()
                compared += compare(vehicle, newest)
            await asyncio.sleep(0)
            assert compared > 20
            assert vehicle.identity.replayed
            assert link.sent == []
            assert testbed.router.connection("tape").counts()["log"].bytes_skipped == 0
        finally:
            await testbed.close()

    run_simulated(scenario)


def compare(vehicle, newest):
    status = vehicle.status
    assert status.armed == bool(newest[0].base_mode & 128)
    assert status.custom_mode == newest["mode"]
    assert not status.mode.startswith("px4_")
    assert not status.link_lost
    if 245 in newest:
        states = {0: "unknown", 1: "on_ground", 2: "in_air", 3: "taking_off", 4: "landing"}
        assert status.landed_state == states[newest[245].landed_state]
    if 33 in newest:
        position = vehicle.topic("global_position").value
        assert position.alt_amsl_m == newest[33].alt / 1e3
        assert position.alt_home_m == newest[33].relative_alt / 1e3
        assert position.lat_deg == newest[33].lat / 1e7
        assert vehicle.topic("global_position").vehicle_time_boot_s == newest[33].time_boot_ms / 1e3
    if 265 in newest and 285 in newest:
        gimbal = vehicle.topic("gimbal").value
        if newest[265].time_boot_ms > newest[285].time_boot_ms:
            assert math.degrees(gimbal.pitch_rad) == pytest.approx(newest[265].pitch, abs=1e-4)
            yaw = gimbal.yaw_ned_rad if newest[285].flags & 16 else gimbal.yaw_frd_rad
            yaw_error_deg = (math.degrees(yaw) - newest[265].yaw + 180) % 360 - 180
            assert yaw_error_deg == pytest.approx(0, abs=1e-3) or gimbal.flags != newest[285].flags
        else:
            assert gimbal.q == pytest.approx(tuple(newest[285].q), abs=1e-6)
    return 1
