"""Every message of the dialect with each field at extreme values, from the link to every output.

The test checks all outputs: REST, history, telemetry, the streams' snapshots, the 3D view. Nothing may fail
(a message that the server skips after an error counts as a failure), every output must be JSON, and the
values of a second vehicle must not change.
"""

import itertools
import json
import math
import re
import struct
from typing import Any

import pytest

from gcs_server.api.responses import history_pieces, history_view, json_response, vehicle_view
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_frame, encode_payload, full_payload
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.scenarios.simulated_time import run_on_simulated_time
from gcs_server.scene.texts import metres_text
from gcs_server.scene.tracks import Tracks
from gcs_server.scene.views import world_pose
from gcs_server.streamer.schedule.scheduler import StreamScheduler
from gcs_server.streamer.values.limit_values import VEHICLE_PARAMETERS
from gcs_server.telemetry.hub import ALL_TOPICS, EncodedSamples
from gcs_server.vehicle import decoders, gimbal_decoder
from gcs_server.vehicle.px4.stream_loss import PARAMETERS as FAILSAFE_PARAMETERS
from gcs_server.vehicle.samples import TOPICS
from tests.protocol.fake_autopilot import OFFBOARD_MODE
from tests.protocol.offboard_testbed import OffboardTestbed, stream_request

PEERS = ("a", "b")
"""The peers of vehicles 1 and 2."""
FLOATS = [math.nan, math.inf, -math.inf, 1e38, -1e38, 3.4e38, 1e15, 0.0, 1e-45, -1.0]
DECODED = sorted(
    {
        *decoders.FORMATS,
        d.MAVLINK_MSG_ID_HEARTBEAT,
        d.MAVLINK_MSG_ID_CURRENT_MODE,
        d.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        d.MAVLINK_MSG_ID_STATUSTEXT,
        d.MAVLINK_MSG_ID_EVENT,
        d.MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE,
        d.MAVLINK_MSG_ID_RESPONSE_EVENT_ERROR,
        d.MAVLINK_MSG_ID_PARAM_VALUE,
        d.MAVLINK_MSG_ID_COMMAND_ACK,
        d.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
        d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,
    }
)
BITS = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32, "q": 64, "Q": 64}


def extreme_values(code: str) -> list[Any]:
    """Test values of a field of this type."""
    if code in "fd":
        return FLOATS
    if code == "c":
        return [b"\0", b"\xff", b"<"]
    bits = BITS[code]
    if code.isupper():
        return [0, 1, 2**bits - 1, 2 ** (bits - 1)]
    return [0, -1, 2 ** (bits - 1) - 1, -(2 ** (bits - 1))]


def type_codes(msg_id: int) -> list[str]:
    """The type of each element of a payload, in wire order; texts are bytes."""
    codes: list[str] = []
    for count, code in re.findall(r"(\d*)([a-zA-Z])", LAYOUTS[msg_id].unpacker.format):
        codes += ["s" + (count or "1")] if code == "s" else [code] * int(count or 1)
    return codes


def payloads_of(msg_id: int, valid_payload: bytes, *, each_field: bool) -> list[bytes]:
    """Payloads with all fields at extreme values; `each_field`: also the valid payload with one field at a
    time at each of its extreme values."""
    packer, codes = LAYOUTS[msg_id].unpacker, type_codes(msg_id)
    valid_values = list(packer.unpack(valid_payload))
    texts = [b"", b"\xff\xfe\xc3(\xed\xa0\x80", b"<script>", b"\x1b[2J"]
    values_of_fields = [texts if code[0] == "s" else extreme_values(code) for code in codes]
    payloads = [
        packer.pack(*(values[n % len(values)] for values in values_of_fields)) for n in range(len(FLOATS))
    ]
    if each_field:
        for index, values in enumerate(values_of_fields):
            for value in values:
                payloads.append(packer.pack(*valid_values[:index], value, *valid_values[index + 1 :]))
    return payloads


class OutputChecker:
    """Checks all outputs for two vehicles, step by step on simulated time."""

    def __init__(self, testbed: OffboardTestbed, link: Any) -> None:
        self.testbed, self.link = testbed, link
        self.invalid_vehicle, self.other_vehicle = (testbed.fleet.get(v) for v in ("1", "2"))
        """The vehicle that sends extreme values, and a vehicle that these values must not affect."""
        self.sample_encoder = EncodedSamples(testbed.clock, testbed.fleet)
        self.tracks = Tracks(testbed.fleet, None, testbed.clock)
        self.seq = itertools.count()
        latest = self.other_vehicle._state.latest.values()
        self.valid_messages = [(f.msg_id, full_payload(f)) for f in latest if f.msg_id in decoders.FORMATS]
        self.valid_messages.append(
            (d.MAVLINK_MSG_ID_HEARTBEAT, full_payload(self.other_vehicle._state.latest[0]))
        )
        self.expected = self.other_vehicle_values()

    def inject(self, msg_id: int, payload: bytes, system: int = 1, component: int = 1) -> None:
        raw = encode_frame(msg_id, payload, next(self.seq) & 0xFF, system, component)
        self.link.inject(raw, PEERS[system - 1])

    def send_valid_messages(self) -> None:
        self.testbed.loop.now_s += 0.02
        for system, (msg_id, payload) in itertools.product((2, 1), self.valid_messages):
            self.inject(msg_id, payload, system)

    def other_vehicle_values(self) -> dict[str, Any]:
        topics = self.views()[1]["topics"]
        return {name: sample["value"] for name, sample in topics.items() if name != "status"}

    def views(self) -> list[Any]:
        def refuse_constant(name: str) -> None:
            raise AssertionError(f"{name} is not JSON")

        body = json_response([vehicle_view(vehicle) for vehicle in self.testbed.fleet.all()]).body
        json.dumps(views := json.loads(body, parse_constant=refuse_constant), allow_nan=False)
        return views

    def check_all(self) -> None:
        testbed, streams = self.testbed, self.testbed.streamer._streams
        assert self.other_vehicle_values() == self.expected
        for vehicle in (self.invalid_vehicle, self.other_vehicle):
            assert all(
                b"NaN" not in sample
                for sample in self.sample_encoder.new_samples(vehicle, sorted(ALL_TOPICS), {})
            )
            vehicle.offboard.available()
        testbed.streamer.update_once()
        streams.step()
        assert streams.state("2").phase == "streaming", streams.state("2").last_end
        now_s = testbed.loop.time()
        tracks = self.tracks.update(now_s, 0.03)
        assert list(tracks) == ["1", "2"]
        for mode, track in itertools.product(("chase", "top", "gimbal"), tracks.values()):
            pose = world_pose(mode, track.smoother.pose, track.smoother.heading_enu_rad)
            assert all(map(math.isfinite, (*pose.position_m, *pose.q)))
            metres_text(track.smoother.pose.position_enu_m[2])
        self.check_no_faults()

    def check_no_faults(self) -> None:
        for vehicle in (self.invalid_vehicle, self.other_vehicle):
            assert vehicle.isolation.faults == []
            assert not [reason for reason in vehicle.unusable().values() if "could not be decoded" in reason]
        assert self.tracks.isolation.faults == []
        assert self.testbed.streamer.faults() == []
        assert self.other_vehicle.unusable() == {}

    def ensure_streams(self) -> None:
        """Starts the streams to both vehicles that are idle: invalid messages can end the first vehicle's
        stream by another mode or heartbeat."""
        streams = self.testbed.streamer._streams
        for vehicle in (self.invalid_vehicle, self.other_vehicle):
            if streams.state(vehicle.id).phase == "idle":
                snapshot = vehicle.offboard.snapshot()
                number = StreamScheduler.begin(
                    streams, vehicle.id, stream_request(valid_for_s=600.0), 50.0, snapshot
                )
                StreamScheduler.engage(streams, vehicle.id, snapshot, number)


def run_with_outputs(scenario: Any) -> None:
    async def run() -> None:
        testbed = OffboardTestbed()
        try:
            link = testbed.link()
            autopilots = [testbed.offboard_autopilot(link, peer=PEERS[n], system=n + 1) for n in range(2)]
            for autopilot in autopilots:
                autopilot.set_hovering()
            await testbed.wait_for_vehicle("1")
            await testbed.wait_for_vehicle("2")
            for autopilot in autopilots:
                autopilot.mode = autopilot.requested_mode = OFFBOARD_MODE
                autopilot.has_stream = lambda: True
                autopilot.send_heartbeat()
                autopilot.send_autopilot_version()
            await testbed.clock.sleep(0.2)
            for autopilot in autopilots:
                autopilot.alive = False
            messages = [
                d.MAVLink_battery_status_message(0, 0, 0, 2500, [16100, *[65535] * 9], 500, 120, -1, 66, 300),
                d.MAVLink_sys_status_message(1, 1, 1, 250, 16200, 1234, 77, 0, 0, 0, 0, 0, 0),
                d.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 100, 100, 0, 0, 12),
                d.MAVLink_vfr_hud_message(1, 1, 0, 50, 1, 1),
                d.MAVLink_estimator_status_message(0, 0xFFFF, 0, 0, 0, 0, 0, 0, 1, 1),
                d.MAVLink_servo_output_raw_message(0, 0, *[1500] * 8),
                d.MAVLink_attitude_target_message(0, 0, [1, 0, 0, 0], 0, 0, 0, 0.5),
                d.MAVLink_gimbal_device_attitude_status_message(0, 0, 0, 12, [1, 0, 0, 0], 0, 0, 0, 0),
            ]
            for system, message in itertools.product((1, 2), messages):
                raw = encode_frame(message.get_msgId(), encode_payload(message), 0, system, 1)
                link.inject(raw, PEERS[system - 1])
            assert [v.status.mode for v in testbed.fleet.all()] == ["offboard", "offboard"]
            outputs = OutputChecker(testbed, link)
            outputs.ensure_streams()
            scenario(outputs)
        finally:
            await testbed.close()

    run_on_simulated_time(run)


@pytest.mark.parametrize("msg_id", DECODED, ids=lambda msg_id: LAYOUTS[msg_id].name)
def test_extreme_values_of_decoded_messages_affect_no_other_vehicle(msg_id):
    def scenario(outputs: OutputChecker) -> None:
        valid_payload = dict(outputs.valid_messages).get(msg_id, bytes(LAYOUTS[msg_id].unpacker.size))
        component = 154 if msg_id in gimbal_decoder.IDS else 1  # 154: a gimbal
        for n, payload in enumerate(payloads_of(msg_id, valid_payload, each_field=True)):
            outputs.send_valid_messages()
            outputs.ensure_streams()
            outputs.inject(msg_id, payload)
            outputs.inject(msg_id, payload, component=component)
            outputs.check_all()
            if n % 25 == 0:
                outputs.testbed.fleet.tick()
        outputs.testbed.fleet.tick()
        for vehicle in (outputs.invalid_vehicle, outputs.other_vehicle):
            pieces = list(history_pieces(vehicle, vehicle.history(tuple(TOPICS), 0.0)))
            history_body = json_response(history_view(pieces)).body
            assert len(json.loads(history_body)["samples"]) > 10
        outputs.testbed.fleet.warnings()
        outputs.check_no_faults()

    run_with_outputs(scenario)


def test_undecoded_messages_affect_no_other_vehicle():
    def scenario(outputs: OutputChecker) -> None:
        for msg_id in sorted(set(LAYOUTS) - set(DECODED)):
            outputs.send_valid_messages()
            outputs.ensure_streams()
            for payload in payloads_of(msg_id, bytes(LAYOUTS[msg_id].unpacker.size), each_field=False):
                outputs.inject(msg_id, payload)
            outputs.check_all()
        outputs.testbed.fleet.tick()
        outputs.check_no_faults()

    run_with_outputs(scenario)


def test_invalid_parameters_of_limits_and_failsafes_affect_no_other_vehicle():
    def scenario(outputs: OutputChecker) -> None:
        name_and_type = struct.Struct("<fHH16sB")
        for name, value in itertools.product((*FAILSAFE_PARAMETERS, *VEHICLE_PARAMETERS), FLOATS):
            outputs.send_valid_messages()
            outputs.ensure_streams()
            for param_type in (9, 6, 0, 255):  # float, int32 and two unknown types
                payload = name_and_type.pack(value, 1, 0, name.encode(), param_type)
                outputs.inject(d.MAVLINK_MSG_ID_PARAM_VALUE, payload)
            outputs.invalid_vehicle.offboard._configuration._read_values[name] = value
            outputs.invalid_vehicle.offboard.limits()
            outputs.check_all()

    run_with_outputs(scenario)
