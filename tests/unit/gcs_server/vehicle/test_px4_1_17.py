"""Messages and modes of PX4 v1.17 that differ from v1.16, in the server's decoders and tables."""

import json
import math
import struct
from dataclasses import asdict

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import FrameParser, encode_frame, encode_payload
from gcs_server.vehicle import decoders
from gcs_server.vehicle.autopilot import autopilot_of
from gcs_server.vehicle.identity import read_version
from gcs_server.vehicle.mode_cause import PILOT_MODES
from gcs_server.vehicle.px4 import modes
from gcs_server.vehicle.readiness import STICK_MODES

GLOBAL_POSITION = 296
"""A message of v1.17 that the dialect does not know."""


def test_an_airspeed_that_is_not_a_number_is_unknown() -> None:
    hud = encode_payload(d.MAVLink_vfr_hud_message(math.nan, 1.5, 90, 40, 489.0, 0.1))
    sample, _ = decoders.hud({d.MAVLINK_MSG_ID_VFR_HUD: hud})
    assert sample.airspeed_m_s is None
    assert sample.groundspeed_m_s == pytest.approx(1.5)
    assert "NaN" not in json.dumps(asdict(sample))


def test_mission_current_without_a_mission_is_decoded_as_zero_items_in_both_versions() -> None:
    for mission_state, mission_mode in ((0, 0), (1, 2)):
        message = d.MAVLink_mission_current_message(0, 65535, mission_state, mission_mode, 0, 0, 0)
        decoded = decoders.mission({d.MAVLINK_MSG_ID_MISSION_CURRENT: encode_payload(message)})
        assert decoded is not None
        assert decoded[0].count == 0


def test_altitude_cruise_is_a_manual_mode_of_vehicles_that_announce_it() -> None:
    name, label = modes.mode_name(0x000B0000)
    assert (name, label) == ("altitude_cruise", "Altitude cruise")
    assert name in PILOT_MODES
    mode = modes.BY_NAME[name]
    assert STICK_MODES >> mode.nav_state & 1
    assert mode.by_announcement, "v1.16 would accept the request and stay in its current mode"


def test_the_firmware_version_is_decoded() -> None:
    message = d.MAVLink_autopilot_version_message(0, 0x011100FF, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 1)
    assert read_version(encode_payload(message)).firmware == "1.17.0"


def test_a_message_unknown_to_the_dialect_does_not_affect_other_frames() -> None:
    heartbeat = encode_frame(0, encode_payload(d.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)), 7, 1, 1)
    payload = bytes(range(40))
    header = struct.pack("<7B", 0xFD, len(payload), 0, 0, 8, 1, 1) + GLOBAL_POSITION.to_bytes(3, "little")
    parser = FrameParser()
    frames = parser.feed(heartbeat + header + payload + b"\x12\x34" + heartbeat, 0.0)
    assert [frame.msg_id for frame in frames] == [0, GLOBAL_POSITION, 0]
    assert (parser.frames_unknown, parser.bytes_skipped, parser.crc_errors) == (1, 0, 0)


def test_a_release_that_is_older_or_newer_than_those_tested_is_told() -> None:
    texts = {
        v: autopilot_of(d.MAV_AUTOPILOT_PX4, v).untested for v in ("1.13.3", "1.14.0", "1.17.2", "1.18.0")
    }
    assert "PX4 v1.13, which is older" in str(texts["1.13.3"])
    assert "PX4 v1.18, which is newer" in str(texts["1.18.0"])
    assert (texts["1.14.0"], texts["1.17.2"]) == (None, None)
    assert autopilot_of(d.MAV_AUTOPILOT_PX4).untested is None
    assert autopilot_of(d.MAV_AUTOPILOT_ARDUPILOTMEGA, "4.5.0").untested is None
