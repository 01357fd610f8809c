"""Pure functions about a vehicle: decoders, texts, events, modes, and unknown values."""

import json
import lzma
import math

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.vehicle import decoders, samples
from gcs_server.vehicle.autopilot import autopilot_of
from gcs_server.vehicle.event_logger import TextJoiner
from gcs_server.vehicle.gimbal_decoder import gimbal
from gcs_server.vehicle.identity import read_version
from gcs_server.vehicle.px4 import events, modes
from missions.frames import q_from_euler


def payloads(*messages):
    return {m.get_msgId(): encode_payload(m) for m in messages}


def test_unknown_values_are_decoded_as_none():
    gps = d.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 65535, 65535, 0, 0, 255)
    value, _ = decoders.gps(payloads(gps))
    assert value == samples.Gps(3, None, None, None)
    battery = d.MAVLink_battery_status_message(0, 0, 0, 32767, [65535] * 10, -1, -1, -1, -1)
    assert decoders.battery(payloads(battery))[0] == samples.Battery(
        None, None, None, None, None, battery_id=0
    )
    without_current = d.MAVLink_battery_status_message(0, 0, 0, 32767, [16000, *[65535] * 9], -100, 0, -1, 90)
    assert decoders.battery(payloads(without_current))[0].current_a is None
    position = d.MAVLink_global_position_int_message(1500, 1, 2, 3000, 4000, 100, -200, 300, 65535)
    value, boot_s = decoders.global_position(payloads(position))
    assert (value.heading_deg, value.velocity_ned_m_s, boot_s) == (None, (1.0, -2.0, 3.0), 1.5)


def test_battery_values_come_from_sys_status_until_battery_status_is_received():
    sys_status = d.MAVLink_sys_status_message(0, 0, 0, 250, 16200, 1234, 77, 0, 0, 0, 0, 0, 0)
    value, _ = decoders.battery(payloads(sys_status))
    assert value == samples.Battery(77, 16.2, 12.34, None, None)
    battery = d.MAVLink_battery_status_message(0, 0, 0, 2500, [16100, *[65535] * 9], 500, 120, -1, 66, 300)
    value, _ = decoders.battery(payloads(sys_status, battery))
    assert value == samples.Battery(66, 16.1, 5.0, 120, 300, battery_id=0)


@pytest.mark.parametrize(
    ("voltages", "extra_voltages", "sum_v", "cells"),
    [
        ([16100, *[65535] * 9], [0] * 4, 16.1, None),
        ([4020, 4010, 4030, 4000, *[65535] * 6], [0] * 4, 16.06, (4.02, 4.01, 4.03, 4.0)),
        ([4000] * 10, [4100, 4200, 0, 0], 48.3, (*[4.0] * 10, 4.1, 4.2)),
        ([65534, 4000, *[65535] * 8], [0] * 4, 69.534, None),
    ],
)
def test_cell_voltages_are_shown_if_reported(voltages, extra_voltages, sum_v, cells):
    message = d.MAVLink_battery_status_message(
        0, 0, 0, 2500, voltages, 500, 120, -1, 66, 300, voltages_ext=extra_voltages
    )
    value, _ = decoders.battery(payloads(message))
    assert value.voltage_v == pytest.approx(sum_v)
    assert value.cell_voltages_v == cells


def test_ready_to_arm_is_decoded_for_px4_and_ardupilot():
    bit = d.MAV_SYS_STATUS_PREARM_CHECK
    for present, healthy, expected in ((bit, bit, True), (bit, 0, False), (1, bit, True), (0, 0, None)):
        status = d.MAVLink_sys_status_message(present, 0, healthy, 250, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        value, _ = decoders.health(payloads(status))
        assert (value.ready_to_arm, value.cpu_load) == (expected, 0.25)


def test_ignored_target_axes_are_none():
    target = d.MAVLink_position_target_local_ned_message(
        2000, 1, 8 | 1024 | 256, 1.0, 2.0, math.nan, 9.0, 4.0, 5.0, 6.0, 7.0, 9.0, 3.0, 0.5
    )
    value, boot_s = decoders.target_local(payloads(target))
    assert value == samples.TargetLocal((1, 2, None), (None, 4, 5), (6, 7, None), None, 0.5)
    assert boot_s == 2.0
    all_nan = d.MAVLink_attitude_target_message(1, 0, [math.nan] * 4, 0, 0, 0, 0)
    assert decoders.target_attitude(payloads(all_nan)) is None


def test_the_attitude_is_equal_from_a_quaternion_and_from_angles():
    q = q_from_euler(0.1, -0.4, 2.5)
    from_quaternion, _ = decoders.attitude_quaternion(
        payloads(d.MAVLink_attitude_quaternion_message(1, *q, 1, 2, 3))
    )
    from_angles, _ = decoders.attitude(payloads(d.MAVLink_attitude_message(1, 0.1, -0.4, 2.5, 1, 2, 3)))
    assert from_quaternion.q_ned_frd == pytest.approx(from_angles.q_ned_frd, abs=1e-6)
    angles = (from_quaternion.roll_rad, from_quaternion.pitch_rad, from_quaternion.yaw_ned_rad)
    assert angles == pytest.approx((0.1, -0.4, 2.5), abs=1e-6)


@pytest.mark.parametrize(
    ("flags", "in_earth_frame"),
    # GIMBAL_DEVICE_FLAGS: yaw lock 16, yaw in vehicle frame 32, yaw in earth frame 64
    [(0, False), (16, True), (12, False), (28, True), (32, False), (48, False), (64, True), (80, True)],
)
def test_the_gimbals_yaw_is_converted_to_both_frames(flags, in_earth_frame):
    device = d.MAVLink_gimbal_device_attitude_status_message(
        0, 0, 1000, flags, list(q_from_euler(0, -0.5, 1.0)), 0, 0, 0, 0, 0, 0, 1
    )
    attitude = d.MAVLink_attitude_message(1000, 0, 0, 0.25, 0, 0, 0)
    value, _ = gimbal(payloads(device, attitude), 1, 1)
    assert value.pitch_rad == pytest.approx(-0.5, abs=1e-6)
    assert (value.yaw_ned_rad, value.yaw_frd_rad) == pytest.approx(
        (1.0, 0.75) if in_earth_frame else (1.25, 1.0), abs=1e-6
    )
    assert value.yaw_in_earth_frame == in_earth_frame
    without_attitude, _ = gimbal(payloads(device), 1, 1)
    assert (without_attitude.yaw_frd_rad if in_earth_frame else without_attitude.yaw_ned_rad) is None


def test_gimbal_limits_are_decoded_from_px4s_degrees_and_from_radians():
    device = d.MAVLink_gimbal_device_attitude_status_message(0, 0, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0, 0, 0, 1)
    px4_limits = d.MAVLink_gimbal_manager_information_message(
        1, 132530, 1, 3e-41, 2e-44, -90.0, 90.0, -360.0, 360.0
    )
    value, _ = gimbal(payloads(device, px4_limits), 1, 1)
    assert (value.pitch_min_rad, value.pitch_max_rad) == pytest.approx((-math.pi / 2, math.pi / 2))
    assert value.yaw_max_rad == pytest.approx(2 * math.pi)
    limits_in_radians = d.MAVLink_gimbal_manager_information_message(1, 0, 1, 0, 0, -1.5, 0.5, -3.0, 3.0)
    value, _ = gimbal(payloads(device, limits_in_radians), 1, 1)
    assert (value.pitch_min_rad, value.yaw_max_rad) == pytest.approx((-1.5, 3.0))
    invalid_limits = d.MAVLink_gimbal_manager_information_message(1, 0, 1, 0, 0, math.nan, 1, 0, 0)
    assert gimbal(payloads(device, invalid_limits), 1, 1)[0].pitch_min_rad is None
    status = d.MAVLink_gimbal_manager_status_message(5, 16, 1, 0, 0, 0, 0)
    assert gimbal(payloads(device, status), 1, 1)[0].primary_control is None
    assert gimbal(payloads(status), 1, 1) is None


def status_text(value, text_id=0, chunk=0):
    return encode_payload(d.MAVLink_statustext_message(6, value, text_id, chunk))


def test_chunks_of_a_status_text_are_joined_in_any_order_and_gaps_are_shown():
    joiner = TextJoiner()
    assert joiner.feed(status_text(b"b" * 10, 5, 1), 0.0) == []
    assert joiner.feed(status_text(b"a" * 50, 5, 0), 0.1) == [(6, "a" * 50 + "b" * 10)]
    assert joiner.feed(status_text(b"whole"), 0.2) == [(6, "whole")]
    assert joiner.feed(status_text(b"c" * 50, 6, 0), 1.0) == []
    assert joiner.feed(status_text(b"end", 6, 2), 1.1) == []
    assert joiner.expire(3.0) == [(6, "c" * 50 + "‹…›" + "end")]
    assert joiner.feed(status_text(b"d" * 50, 7, 0), 4.0) == []
    assert joiner.feed(status_text(b"e" * 50, 7, 0), 4.1) == [(6, "d" * 50 + "‹…›")]


def test_px4_defines_all_event_ids_in_the_servers_code(reference_data):
    metadata = json.loads(lzma.decompress((reference_data / "px4" / "events.json.xz").read_bytes()))
    px4_event_ids = set()
    for component, content in metadata["components"].items():
        for group in content.get("event_groups", {}).values():
            px4_event_ids |= {int(component) << 24 | int(event) for event in group["events"]}
    event_ids_in_code = {
        *events.CHECKS,
        *events.TEXTS,
        events.ARMING_SUMMARY_ID,
        events.HEALTH_SUMMARY_ID,
    }
    assert event_ids_in_code - px4_event_ids == set()


def test_each_mode_has_its_own_name_and_custom_mode():
    assert len(modes.BY_NAME) == len(modes.MODES) == len(modes.BY_CUSTOM_MODE)
    assert modes.BY_NAME["hold"].custom_mode == 50593792
    assert modes.mode_name(33816576) == ("takeoff", "Take off")
    assert modes.mode_name(99 << 16) == ("px4_99_0", "PX4 mode 99/0")
    assert autopilot_of(3).mode_name(5) == ("custom_5", "Mode 5")


def test_the_modes_match_the_list_of_px4(reference_data):
    px4_modes = set()
    for line in (reference_data / "px4" / "dialogues" / "request_message.jsonl").read_text().splitlines():
        for received in json.loads(line)["received"]:
            if received["msg"] == "AVAILABLE_MODES":
                px4_modes.add(received["fields"]["custom_mode"])
    assert px4_modes
    assert px4_modes - set(modes.BY_CUSTOM_MODE) == set()


def test_a_vehicles_uid_is_read_from_uid2_or_uid(reference_data):
    def version(uid, uid2=(0,) * 18, vendor=0):
        message = d.MAVLink_autopilot_version_message(
            1, 0x011000FF, 0, 0, 1, [0] * 8, [0] * 8, [0] * 8, vendor, 0, uid, list(uid2)
        )
        return read_version(encode_payload(message))

    sitl = version(5283920058631409231)
    assert (sitl.unique, sitl.is_sitl, sitl.firmware) == (False, True, "1.16.0")
    hardware = version(0x1122, vendor=0x26AC)
    assert (hardware.unique, hardware.is_sitl, hardware.uid) == (True, False, "0000000000001122")
    assert version(5, (1,) * 18).uid == "01" * 18
    assert version(0).uid is None
