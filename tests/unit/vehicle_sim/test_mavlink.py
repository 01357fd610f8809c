"""MAVLink of the simulator: framing, streams, parameters, missions, files, clocks and identity."""

import math
import random
import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.vehicle_sim.sim_station import GCS_AND_API_LINKS, Station
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import BY_NAME, pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.mavlink.link import API, GCS

pytestmark = pytest.mark.flight

REQUEST_MESSAGE, ARM = 512, 400
ONLY_IN_ORBIT = {"ORBIT_EXECUTION_STATUS"}
NOT_ON_GROUND = {"POSITION_TARGET_GLOBAL_INT"} | ONLY_IN_ORBIT

BOOTED_S = 2.0
"""By this time the vehicle has sent the parameters that it changed at boot."""


def frame(name: str, sequence: int = 0, **fields: object) -> bytes:
    layout, payload = pack(name, **fields)
    return frame_v2(layout, payload, sequence, 255, 190)


@given(st.lists(st.binary(max_size=40), min_size=1, max_size=8), st.integers(1, 50))
@settings(max_examples=40, deadline=None)
def test_every_frame_is_found_between_garbage_in_pieces_of_any_length(noise: list[bytes], size: int) -> None:
    chunks = [bytes(b for b in chunk if b not in (0xFD, 0xFE)) for chunk in noise]
    stream = b"".join(chunk + frame("PING", n, seq=n, time_usec=1) for n, chunk in enumerate(chunks))
    parser = FrameParser()
    found = [m for start in range(0, len(stream), size) for m in parser.feed(stream[start : start + size])]
    assert [m.seq for m in found] == list(range(len(chunks)))


def test_frames_after_random_bytes_are_handled() -> None:
    station = Station()
    station.run(1)
    rng = random.Random(1)
    for _ in range(50):
        station.sim.feed(0, "gcs", rng.randbytes(2000))
    station.sim.feed(0, "gcs", bytes(600))
    station.command(REQUEST_MESSAGE, 148)
    station.run(0.1)
    assert station.acks(REQUEST_MESSAGE) == [0]


def test_a_frame_with_a_wrong_checksum_is_counted_and_not_handled() -> None:
    parser = FrameParser()
    damaged = bytearray(frame("PING", seq=1))
    damaged[12] ^= 0xFF
    assert parser.feed(bytes(damaged) + frame("PING", seq=2))[0].seq == 2
    assert parser.counts.bad_crc == 1


def test_streams_are_sent_at_the_rates_of_the_table() -> None:
    station = Station(links=GCS_AND_API_LINKS)
    station.run(6)
    start_s = station.now_s
    station.run(10)
    for link, table in (("gcs", GCS), ("api", API)):
        for name, hz in table.items():
            if name in NOT_ON_GROUND:
                continue
            message_count = len(station.received(name, link, start_s))
            assert message_count == pytest.approx(hz * 10, abs=max(1.0, 0.02 * hz * 10)), (link, name)


def test_the_table_has_the_rates_of_a_real_vehicle(reference_data) -> None:
    import json

    streams = json.loads((reference_data / "px4" / "streams.json").read_text(encoding="utf-8"))
    for key, table in (("gcs_14550", GCS), ("api_14540", API)):
        measured = {row["name"]: row["flying_hold"]["hz"] for row in streams[key].values()}
        assert set(measured) == set(table) - ONLY_IN_ORBIT  # measured in Hold
        for name, hz in measured.items():
            assert table[name] == pytest.approx(hz, rel=0.03, abs=0.05), name


def test_sequence_numbers_have_no_gaps_on_each_link() -> None:
    sim = SimulatedFleet()
    sim.step(3.0)
    for link in ("gcs", "api"):
        sequences = [f[4] for f in sim.frames(0, link)]
        assert len(sequences) > 500
        assert all((b - a) & 0xFF == 1 for a, b in pairwise(sequences))


def test_events_but_not_texts_are_sent_before_a_ground_station_is_connected() -> None:
    station = Station(heartbeats=False)
    station.run(6)
    station.command(ARM, 1)
    station.run(0.2)
    assert station.status_texts() == []
    assert "commander_armed_by" in station.events()


def test_all_parameters_are_sent_within_a_second_beginning_with_the_hash() -> None:
    station = Station()
    station.run(BOOTED_S)
    requested_s = station.now_s
    station.send("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    station.run(1.0)
    values = station.received("PARAM_VALUE", since_s=requested_s)
    assert values[0].param_id == "_HASH_CHECK"
    assert [m.param_index for m in values[1:]] == list(range(values[1].param_count))


def test_parameters_are_set_bytewise_and_invalid_requests_get_no_reply() -> None:
    station = Station(links=GCS_AND_API_LINKS)
    station.run(BOOTED_S)
    requested_s = station.now_s
    integer_as_float = struct.unpack("<f", struct.pack("<i", 3))[0]

    def set_parameter(name: str, value: float, kind: int) -> None:
        station.send("PARAM_SET", target_system=1, target_component=1, param_id=name, param_value=value,
               param_type=kind)  # fmt: skip

    set_parameter("NAV_DLL_ACT", integer_as_float, 6)
    station.run(0.1)
    assert station.sim.simulation.parameters[0].get("NAV_DLL_ACT") == 3
    assert len(station.received("PARAM_VALUE", "gcs", requested_s)) == 2
    assert len(station.received("PARAM_VALUE", "api", requested_s)) == 1
    set_parameter("NAV_DLL_ACT", 2.0, 9)
    set_parameter("NO_SUCH_PARAM", 2.0, 9)
    station.send("PARAM_REQUEST_READ", target_system=1, target_component=1, param_id="NOPE", param_index=-1)
    station.send("PARAM_REQUEST_READ", target_system=1, target_component=1, param_index=5000)
    station.run(0.1)
    assert len(station.received("PARAM_VALUE", "gcs", requested_s)) == 2


def test_an_impossible_airframe_does_not_end_the_simulation() -> None:
    station = Station()
    station.run(BOOTED_S)
    station.send(
        "PARAM_SET", target_system=1, target_component=1, param_id="SIH_MASS", param_value=0.0, param_type=9
    )
    station.run(0.5)
    assert station.newest_messages["PARAM_VALUE"].param_value == 0.0


def test_an_uploaded_plan_is_downloaded_unchanged() -> None:
    station = Station()
    station.run(0.5)
    station.send("MISSION_COUNT", target_system=1, target_component=1, count=2)
    station.run(0.3)
    assert station.newest_messages["MISSION_REQUEST_INT"].seq == 0
    for seq in (0, 0, 1):
        station.send("MISSION_ITEM_INT", target_system=1, target_component=1, seq=seq, frame=6, command=16,
               x=473977432 + seq, y=85455942, z=10.0 + seq, autocontinue=1)  # fmt: skip
    station.run(0.1)
    uploaded = station.newest_messages["MISSION_ACK"]
    assert uploaded.type == 0
    station.send("MISSION_REQUEST_LIST", target_system=1, target_component=1)
    for seq in (0, 1):
        station.send("MISSION_REQUEST_INT", target_system=1, target_component=1, seq=seq)
    station.run(0.1)
    assert station.newest_messages["MISSION_COUNT"].count == 2
    assert station.newest_messages["MISSION_COUNT"].opaque_id == uploaded.opaque_id != 0
    assert (station.newest_messages["MISSION_ITEM_INT"].x, station.newest_messages["MISSION_ITEM_INT"].z) == (
        473977433,
        11.0,
    )
    station.send("MISSION_ACK", target_system=1, target_component=1)
    station.send("MISSION_CLEAR_ALL", target_system=1, target_component=1)
    station.run(1.2)
    assert station.newest_messages["MISSION_CURRENT"].mission_id == 0


def test_an_interrupted_upload_times_out_with_a_text() -> None:
    station = Station()
    station.run(0.5)
    station.send("MISSION_COUNT", target_system=1, target_component=1, count=2)
    station.run(5.4)
    assert 15 <= len(station.received("MISSION_REQUEST_INT")) <= 22
    assert station.status_texts()[-1] == "Operation timeout\t"


def test_requests_for_files_clocks_and_pings_get_replies() -> None:
    station = Station()
    station.run(0.5)
    station.send("FILE_TRANSFER_PROTOCOL", target_system=1, target_component=1,
           payload=struct.pack("<HBBBBBBI", 7, 0, 4, 3, 0, 0, 0, 0) + b"a.b")  # fmt: skip
    station.send("TIMESYNC", ts1=123456789)
    station.send("PING", time_usec=777, seq=5)
    station.run(0.1)
    reply = bytes(station.newest_messages["FILE_TRANSFER_PROTOCOL"].payload)
    assert (reply[0], reply[3], reply[5], reply[12]) == (8, 129, 4, 10)
    assert station.newest_messages["TIMESYNC"].ts1 == 123456789
    assert station.newest_messages["TIMESYNC"].tc1 > 0
    assert [m.seq for m in station.received("PING") if m.target_system == 255] == [5]


def test_the_start_script_numbers_the_vehicles_whatever_was_stored():
    sim = SimulatedFleet(2, first_instance=3, parameters={"MAV_SYS_ID": 9})
    assert [each.view.parameters.get("MAV_SYS_ID") for each in sim.autopilots] == [4, 5]


def test_version_and_modes_can_be_requested() -> None:
    sim = SimulatedFleet(2, first_instance=3)
    for row in range(2):
        layout, payload = pack(
            "COMMAND_LONG", target_system=4 + row, target_component=1, command=REQUEST_MESSAGE, param1=148
        )
        sim.feed(row, "gcs", frame_v2(layout, payload, 0, 255, 190))
        messages = FrameParser().feed(sim.drain(row, "gcs"))
        version = next(m for m in messages if m.name == "AUTOPILOT_VERSION")
        assert version.system_id == 4 + row
        assert version.uid == 5283920058631409231, "all vehicles of PX4's simulator have the same uid"
    station = Station()
    station.run(0.2)
    station.command(REQUEST_MESSAGE, 435, 0)
    station.run(0.1)
    assert [m.mode_index for m in station.received("AVAILABLE_MODES")] == list(range(1, 27))


def test_heartbeats_of_a_ground_station_are_forwarded_to_the_other_link() -> None:
    station = Station(links=GCS_AND_API_LINKS)
    station.run(0.1)
    parser = FrameParser()
    station.send("HEARTBEAT", type=6, autopilot=8)
    messages = parser.feed(station.sim.drain(0, "api"))
    assert [m.sender for m in messages if m.name == "HEARTBEAT"] == [(255, 190)]


def test_lost_events_can_be_requested() -> None:
    station = Station()
    station.run(3)
    newest = station.sim.autopilots[0].announcer.sequence
    event_count = len(station.received("EVENT"))
    station.send(
        "REQUEST_EVENT", target_system=1, target_component=1, first_sequence=newest, last_sequence=newest
    )
    station.send(
        "REQUEST_EVENT", target_system=1, target_component=1, first_sequence=60000, last_sequence=60000
    )
    station.run(0.1)
    assert len(station.received("EVENT")) == event_count + 1
    assert station.newest_messages["RESPONSE_EVENT_ERROR"].sequence == 60000


def test_every_streamed_message_is_known_to_the_dialect() -> None:
    assert set(GCS) | set(API) <= set(BY_NAME)


@pytest.mark.story
def test_extreme_values_in_commands_and_setpoints_do_not_end_the_simulation() -> None:
    """A ground station sends extreme values in all numbers while the vehicle flies."""
    station = Station()
    station.take_off_and_hover(4)
    rng = random.Random(2)
    values = (0.0, 1.0, -1.0, 2.0, -3.0, 300.0, 1e30, -1e30, math.inf, -math.inf, math.nan, 47.4, 8.5)
    numbers = [20, 21, 22, 23, 34, 35, 176, 178, 179, 185, 186, 192, 195, 197, 201, 205, 211, 245, 246, 262,
               300, 310, 400, 401, 510, 511, 512, 1000, 1001, 43004, 65000]  # fmt: skip
    for _ in range(200):
        station.command(rng.choice(numbers), *(rng.choice(values) for _ in range(7)))
        station.send(
            "SET_POSITION_TARGET_LOCAL_NED", coordinate_frame=rng.choice((1, 8, 3)),
            type_mask=rng.randrange(65536), x=rng.choice(values), y=rng.choice(values),
            z=rng.choice(values), vx=rng.choice(values), afx=rng.choice(values),
            yaw=rng.choice(values),
        )  # fmt: skip
        station.send(
            "SET_ATTITUDE_TARGET", type_mask=rng.randrange(256),
            q=[rng.choice(values) for _ in range(4)],
            thrust=rng.choice(values), body_roll_rate=rng.choice(values),
        )  # fmt: skip
        station.send(
            "GIMBAL_MANAGER_SET_ATTITUDE", target_system=1, target_component=1, flags=rng.randrange(64),
            q=[rng.choice(values) for _ in range(4)],
        )  # fmt: skip
        station.run(0.02)
    station.run(1.0)
    assert "HEARTBEAT" in station.newest_messages


def test_an_impossible_parameter_of_the_airframe_is_stored_and_reported() -> None:
    station = Station()
    station.run(1.2)
    station.send(
        "PARAM_SET", target_system=1, target_component=1, param_id="SIH_MASS", param_value=0.0, param_type=9
    )
    station.run(0.1)
    assert station.sim.simulation.parameters[0].get("SIH_MASS") == 0.0
    assert any("SIH_MASS stored but not applied: SIH_MASS is 0" in text for text in station.status_texts())
