"""MAVLink of the simulator: framing, streams, parameters, missions, files, clocks and identity."""

import math
import random
import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.vehicle_sim.sim_station import BOTH, Station
from vehicle_sim.fleet import VehicleSim
from vehicle_sim.mavlink.dialect import BY_NAME, pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.mavlink.rates import API, GCS

pytestmark = pytest.mark.flight

ONLY_IN_ORBIT = {"ORBIT_EXECUTION_STATUS"}
NOT_ON_GROUND = {"POSITION_TARGET_GLOBAL_INT"} | ONLY_IN_ORBIT

BOOTED_S = 2.0
"""By this time the vehicle has sent the parameters that it changed at boot."""


def frame(name: str, sequence: int = 0, **fields: object) -> bytes:
    layout, payload = pack(name, **fields)
    return frame_v2(layout, payload, sequence, 255, 190)


@given(st.lists(st.binary(max_size=40), min_size=1, max_size=8), st.integers(1, 50))
@settings(max_examples=40, deadline=None)
def test_every_frame_is_found_between_garbage_in_any_pieces(noise: list[bytes], cut: int) -> None:
    quiet = [bytes(b for b in chunk if b not in (0xFD, 0xFE)) for chunk in noise]
    stream = b"".join(chunk + frame("PING", n, seq=n, time_usec=1) for n, chunk in enumerate(quiet))
    parser = FrameParser()
    found = [m for at in range(0, len(stream), cut) for m in parser.feed(stream[at : at + cut])]
    assert [m.seq for m in found] == list(range(len(quiet)))


def test_after_random_bytes_the_next_frames_are_handled() -> None:
    s = Station()
    s.run(1)
    noise = random.Random(1)
    for _ in range(50):
        s.sim.feed(0, "gcs", noise.randbytes(2000))
    s.sim.feed(0, "gcs", bytes(600))
    s.command(512, 148)
    s.run(0.1)
    assert s.acks(512) == [0]


def test_a_frame_with_a_wrong_checksum_is_counted_and_not_handled() -> None:
    parser = FrameParser()
    good = bytearray(frame("PING", seq=1))
    good[12] ^= 0xFF
    assert parser.feed(bytes(good) + frame("PING", seq=2))[0].seq == 2
    assert parser.counts.bad_crc == 1


def test_streams_are_sent_at_the_rates_of_the_table() -> None:
    s = Station(links=BOTH)
    s.run(6)
    start = s.now_s
    s.run(10)
    for link, table in (("gcs", GCS), ("api", API)):
        for name, hz in table.items():
            if name in NOT_ON_GROUND:
                continue
            count = len(s.received(name, link, start))
            assert count == pytest.approx(hz * 10, abs=max(1.0, 0.02 * hz * 10)), (link, name)


def test_the_table_has_the_rates_of_a_real_vehicle(shared) -> None:
    import json

    streams = json.loads((shared / "px4" / "streams.json").read_text(encoding="utf-8"))
    for key, table in (("gcs_14550", GCS), ("api_14540", API)):
        measured = {row["name"]: row["flying_hold"]["hz"] for row in streams[key].values()}
        assert set(measured) == set(table) - ONLY_IN_ORBIT, "measured in Hold"
        for name, hz in measured.items():
            assert table[name] == pytest.approx(hz, rel=0.03, abs=0.05), name


def test_sequence_numbers_have_no_gaps_on_each_link() -> None:
    sim = VehicleSim()
    sim.step(3.0)
    for link in ("gcs", "api"):
        sequences = [f[4] for f in sim.frames(0, link)]
        assert len(sequences) > 500
        assert all((b - a) & 0xFF == 1 for a, b in pairwise(sequences))


def test_texts_wait_for_a_ground_station_and_events_do_not() -> None:
    s = Station(heartbeats=False)
    s.run(6)
    s.command(400, 1)
    s.run(0.2)
    assert s.texts() == []
    assert "commander_armed_by" in s.events()


def test_all_parameters_are_sent_within_a_second_beginning_with_the_hash() -> None:
    s = Station()
    s.run(BOOTED_S)
    requested_s = s.now_s
    s.send("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    s.run(1.0)
    values = s.received("PARAM_VALUE", since_s=requested_s)
    assert values[0].param_id == "_HASH_CHECK"
    assert [m.param_index for m in values[1:]] == list(range(values[1].param_count))


def test_parameters_are_set_bytewise_and_invalid_requests_get_no_reply() -> None:
    s = Station(links=BOTH)
    s.run(BOOTED_S)
    requested_s = s.now_s
    as_float = struct.unpack("<f", struct.pack("<i", 3))[0]

    def set_(name: str, value: float, kind: int) -> None:
        s.send("PARAM_SET", target_system=1, target_component=1, param_id=name, param_value=value,
               param_type=kind)  # fmt: skip

    set_("NAV_DLL_ACT", as_float, 6)
    s.run(0.1)
    assert s.sim.simulation.parameters[0].get("NAV_DLL_ACT") == 3
    assert len(s.received("PARAM_VALUE", "gcs", requested_s)) == 2
    assert len(s.received("PARAM_VALUE", "api", requested_s)) == 1
    set_("NAV_DLL_ACT", 2.0, 9)
    set_("NO_SUCH_PARAM", 2.0, 9)
    s.send("PARAM_REQUEST_READ", target_system=1, target_component=1, param_id="NOPE", param_index=-1)
    s.send("PARAM_REQUEST_READ", target_system=1, target_component=1, param_index=5000)
    s.run(0.1)
    assert len(s.received("PARAM_VALUE", "gcs", requested_s)) == 2


def test_an_impossible_airframe_does_not_end_the_simulation() -> None:
    s = Station()
    s.run(BOOTED_S)
    s.send(
        "PARAM_SET", target_system=1, target_component=1, param_id="SIH_MASS", param_value=0.0, param_type=9
    )
    s.run(0.5)
    assert s.last["PARAM_VALUE"].param_value == 0.0


def test_an_uploaded_plan_is_downloaded_unchanged() -> None:
    s = Station()
    s.run(0.5)
    s.send("MISSION_COUNT", target_system=1, target_component=1, count=2)
    s.run(0.3)
    assert s.last["MISSION_REQUEST"].seq == 0, "the first request after boot is for floats"
    for seq in (0, 0, 1):
        s.send("MISSION_ITEM_INT", target_system=1, target_component=1, seq=seq, frame=6, command=16,
               x=473977432 + seq, y=85455942, z=10.0 + seq, autocontinue=1)  # fmt: skip
    s.run(0.1)
    uploaded = s.last["MISSION_ACK"]
    assert uploaded.type == 0
    s.send("MISSION_REQUEST_LIST", target_system=1, target_component=1)
    for seq in (0, 1):
        s.send("MISSION_REQUEST_INT", target_system=1, target_component=1, seq=seq)
    s.run(0.1)
    assert s.last["MISSION_COUNT"].count == 2
    assert s.last["MISSION_COUNT"].opaque_id == uploaded.opaque_id != 0
    assert (s.last["MISSION_ITEM_INT"].x, s.last["MISSION_ITEM_INT"].z) == (473977433, 11.0)
    s.send("MISSION_ACK", target_system=1, target_component=1)
    s.send("MISSION_CLEAR_ALL", target_system=1, target_component=1)
    s.run(1.2)
    assert s.last["MISSION_CURRENT"].mission_id == 0


def test_an_interrupted_upload_times_out_with_a_text() -> None:
    s = Station()
    s.run(0.5)
    s.send("MISSION_COUNT", target_system=1, target_component=1, count=2)
    s.run(5.4)
    assert 15 <= len(s.received("MISSION_REQUEST")) <= 22
    assert s.texts()[-1] == "Operation timeout\t"


def test_files_clocks_and_pings_are_answered() -> None:
    s = Station()
    s.run(0.5)
    s.send("FILE_TRANSFER_PROTOCOL", target_system=1, target_component=1,
           payload=struct.pack("<HBBBBBBI", 7, 0, 4, 3, 0, 0, 0, 0) + b"a.b")  # fmt: skip
    s.send("TIMESYNC", ts1=123456789)
    s.send("PING", time_usec=777, seq=5)
    s.run(0.1)
    answer = bytes(s.last["FILE_TRANSFER_PROTOCOL"].payload)
    assert (answer[0], answer[3], answer[5], answer[12]) == (8, 129, 4, 10)
    assert s.last["TIMESYNC"].ts1 == 123456789
    assert s.last["TIMESYNC"].tc1 > 0
    assert [m.seq for m in s.received("PING") if m.target_system == 255] == [5]


def test_version_and_modes_can_be_requested() -> None:
    sim = VehicleSim(2, first_instance=3)
    for row in range(2):
        layout, payload = pack(
            "COMMAND_LONG", target_system=4 + row, target_component=1, command=512, param1=148
        )
        sim.feed(row, "gcs", frame_v2(layout, payload, 0, 255, 190))
        messages = FrameParser().feed(sim.drain(row, "gcs"))
        version = next(m for m in messages if m.name == "AUTOPILOT_VERSION")
        assert version.system_id == 4 + row
        assert version.uid == 5283920058631409231, "all vehicles of PX4's simulator have the same uid"
    s = Station()
    s.run(0.2)
    s.command(512, 435, 0)
    s.run(0.1)
    assert [m.mode_index for m in s.received("AVAILABLE_MODES")] == list(range(1, 26))


def test_heartbeats_of_one_links_ground_station_are_forwarded_to_the_other() -> None:
    s = Station(links=BOTH)
    s.run(0.1)
    raw = FrameParser()
    s.send("HEARTBEAT", type=6, autopilot=8)
    assert [m.sender for m in raw.feed(s.sim.drain(0, "api")) if m.name == "HEARTBEAT"] == [(255, 190)]


def test_lost_events_can_be_requested() -> None:
    s = Station()
    s.run(3)
    newest = s.sim.autopilots[0].announcer.sequence
    before = len(s.received("EVENT"))
    s.send("REQUEST_EVENT", target_system=1, target_component=1, first_sequence=newest, last_sequence=newest)
    s.send("REQUEST_EVENT", target_system=1, target_component=1, first_sequence=60000, last_sequence=60000)
    s.run(0.1)
    assert len(s.received("EVENT")) == before + 1
    assert s.last["RESPONSE_EVENT_ERROR"].sequence == 60000


def test_every_streamed_message_is_known_to_the_dialect() -> None:
    assert set(GCS) | set(API) <= set(BY_NAME)


@pytest.mark.story
def test_extreme_values_in_commands_and_setpoints_do_not_end_the_simulation() -> None:
    """Extreme values in all numbers that a station can send, in flight."""
    s = Station()
    s.fly_to(4)
    odd = random.Random(2)
    values = (0.0, 1.0, -1.0, 2.0, -3.0, 300.0, 1e30, -1e30, math.inf, -math.inf, math.nan, 47.4, 8.5)
    numbers = [20, 21, 22, 23, 34, 35, 176, 178, 179, 185, 186, 192, 195, 197, 201, 205, 211, 245, 246, 262,
               300, 310, 400, 401, 510, 511, 512, 1000, 1001, 43004, 65000]  # fmt: skip
    for _ in range(200):
        s.command(odd.choice(numbers), *(odd.choice(values) for _ in range(7)))
        s.send(
            "SET_POSITION_TARGET_LOCAL_NED", coordinate_frame=odd.choice((1, 8, 3)),
            type_mask=odd.randrange(65536), x=odd.choice(values), y=odd.choice(values), z=odd.choice(values),
            vx=odd.choice(values), afx=odd.choice(values), yaw=odd.choice(values),
        )  # fmt: skip
        s.send(
            "SET_ATTITUDE_TARGET", type_mask=odd.randrange(256), q=[odd.choice(values) for _ in range(4)],
            thrust=odd.choice(values), body_roll_rate=odd.choice(values),
        )  # fmt: skip
        s.send(
            "GIMBAL_MANAGER_SET_ATTITUDE", target_system=1, target_component=1, flags=odd.randrange(64),
            q=[odd.choice(values) for _ in range(4)],
        )  # fmt: skip
        s.run(0.02)
    s.run(1.0)
    assert "HEARTBEAT" in s.last


def test_an_impossible_parameter_of_the_airframe_is_stored_and_reported() -> None:
    s = Station()
    s.run(1.2)
    s.send(
        "PARAM_SET", target_system=1, target_component=1, param_id="SIH_MASS", param_value=0.0, param_type=9
    )
    s.run(0.1)
    assert s.sim.simulation.parameters[0].get("SIH_MASS") == 0.0
    assert any("SIH_MASS stored, not used: SIH_MASS is 0" in text for text in s.texts())
