"""How the server identifies vehicles: system ids, uids, peers, links, recordings, other stations."""

import asyncio
from types import SimpleNamespace

import pytest

from gcs_server.errors import InvalidRequest, Refused, UnknownLink, UnknownVehicle
from tests.protocol.command_numbers import ARM_DISARM, REQUEST_MESSAGE, SET_MESSAGE_INTERVAL
from tests.protocol.fake_autopilot import OFFBOARD_MODE, TAKEOFF_MODE
from tests.protocol.memory_testbed import MemoryTestbed, run_test
from tests.protocol.offboard_testbed import OffboardTestbed, setpoint_gaps_s, stream_request
from vehicle_sim.mavlink import generated_dialect as sim

HARDWARE_UID_A, HARDWARE_UID_B = 0x0011223344556677, 0x0011223344556688
SIMULATOR_UID = 0x4954414C44494E4F
"""PX4's simulators all have this uid."""
TAKEOFF_DETECTED = 21054825
"""Number of PX4's event."""


def vehicle_ids(testbed):
    return [v.id for v in testbed.fleet.all()]


def test_a_simulator_is_identified_by_its_uid(run_simulated):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link())
        vehicle = await testbed.wait_for_vehicle()
        assert (vehicle.identity.simulated, vehicle.identity.replayed) == (True, False)
        assert vehicle.identity.firmware == "1.16.0"
        assert vehicle.identity.uid == "4954414c44494e4f"
        assert len(autopilot.received_commands(REQUEST_MESSAGE)) >= 1
        with pytest.raises(UnknownVehicle):
            testbed.fleet.get("9")

    run_test(run_simulated, scenario)


def test_several_vehicles_share_a_link(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        autopilots = [testbed.autopilot(link, peer=f"127.0.0.1:{18570 + n}", system=n + 1) for n in range(3)]
        await testbed.wait_for_vehicle("3")
        assert vehicle_ids(testbed) == ["1", "2", "3"]
        await testbed.fleet.get("2").command.arm()
        assert [autopilot.armed for autopilot in autopilots] == [False, True, False]
        assert testbed.fleet.warnings() == []

    run_test(run_simulated, scenario)


@pytest.mark.parametrize(
    ("first_uid", "second_uid"), [(HARDWARE_UID_A, HARDWARE_UID_B), (SIMULATOR_UID, SIMULATOR_UID), (0, 0)]
)
def test_two_peers_with_the_same_system_id_are_two_vehicles(run_simulated, first_uid, second_uid):
    async def scenario(testbed):
        link = testbed.link()
        first_autopilot = testbed.autopilot(link, peer="a", uid=first_uid)
        await testbed.wait_for_vehicle("1")
        second_autopilot = testbed.autopilot(link, peer="b", uid=second_uid, booted_at_s=500.0)
        second_autopilot.position[2] = 600.0
        other = await testbed.wait_for_vehicle("1~2")
        vehicle = testbed.fleet.get("1")
        for _ in range(20):
            await asyncio.sleep(0.1)
            assert vehicle.topic("global_position").value.alt_amsl_m == pytest.approx(489.0)
            assert other.topic("global_position").value.alt_amsl_m == pytest.approx(600.0)
        await other.command.arm()
        assert (first_autopilot.armed, second_autopilot.armed) == (False, True)
        assert "system id 1" in vehicle.identity.warnings[0]
        assert {warning.vehicle for warning in testbed.fleet.warnings()} == {"1", "1~2"}

    run_test(run_simulated, scenario)


def test_a_vehicle_with_a_hardware_uid_that_is_connected_over_two_links_is_shown_once(run_simulated):
    async def scenario(testbed):
        cable, radio = testbed.link("cable"), testbed.link("radio")
        testbed.autopilot(cable, uid=HARDWARE_UID_A)
        second = testbed.autopilot(radio, uid=HARDWARE_UID_A)
        vehicle = await testbed.wait_for_vehicle()
        await asyncio.sleep(5)
        assert vehicle_ids(testbed) == ["1"]
        assert set(vehicle.links) == {"cable", "radio"}
        await testbed.router.remove_link("cable")
        await vehicle.command.arm()
        assert second.armed
        assert not vehicle.status.link_lost

    run_test(run_simulated, scenario)


# The first simulator booted at 900 s.
@pytest.mark.parametrize(("other_boot_s", "expected"), [(900.2, ["1"]), (700.0, ["1", "1~2"])])
def test_simulators_on_two_links_are_distinguished_by_their_boot_time(run_simulated, other_boot_s, expected):
    async def scenario(testbed):
        testbed.autopilot(testbed.link("gcs"))
        await testbed.wait_for_vehicle()
        testbed.autopilot(testbed.link("api"), booted_at_s=other_boot_s)
        await asyncio.sleep(6)
        assert vehicle_ids(testbed) == expected

    run_test(run_simulated, scenario)


def test_one_vehicle_on_two_links_is_shown_twice_until_its_uid_is_known(run_simulated):
    async def scenario(testbed):
        first = testbed.autopilot(testbed.link("a"), uid=HARDWARE_UID_A)
        second = testbed.autopilot(testbed.link("b"), uid=HARDWARE_UID_A)
        for autopilot in (first, second):
            autopilot.sends_version = autopilot.has_position = False
        await asyncio.sleep(8)
        assert vehicle_ids(testbed) == ["1", "1~2"]
        first.sends_version = second.sends_version = True
        await asyncio.sleep(65)
        assert vehicle_ids(testbed) == ["1"]
        assert testbed.fleet.get("1").identity.warnings == ()
        assert any(e.kind == "vehicle_removed" for e in testbed.fleet.events.since())

    run_test(run_simulated, scenario)


@pytest.mark.parametrize("streamed", ["1", "1~2"])
def test_two_vehicles_that_are_one_stay_two_with_a_warning_while_one_is_streamed(run_simulated, streamed):
    async def run():
        testbed = OffboardTestbed()
        autopilots = [testbed.offboard_autopilot(testbed.link(i), uid=HARDWARE_UID_A) for i in ("a", "b")]
        for boot_s, autopilot in zip((900.0, 700.0), autopilots, strict=True):
            autopilot.sends_version, autopilot.booted_at_s = False, boot_s
            autopilot.set_hovering()
        try:
            vehicle = await testbed.wait_for_vehicle(streamed)
            await asyncio.sleep(5)
            await vehicle.offboard.start(stream_request(valid_for_s=600))
            flown = next(autopilot for autopilot in autopilots if autopilot.mode == OFFBOARD_MODE)
            for autopilot in autopilots:
                autopilot.sends_version = True
            await asyncio.sleep(45)
            assert vehicle_ids(testbed) == ["1", "1~2"]
            assert any("are one vehicle" in warning.text for warning in testbed.fleet.warnings())
            assert vehicle.offboard.status().streaming
            assert max(setpoint_gaps_s(flown)) < 0.05
            await vehicle.offboard.stop()
            await asyncio.sleep(1)
            assert vehicle_ids(testbed) == ["1"]
            assert testbed.fleet.warnings() == []
        finally:
            await testbed.close()

    run_simulated(run)


def test_the_vehicle_in_use_remains_when_two_vehicles_are_merged(run_simulated):
    async def scenario(testbed):
        autopilots = [testbed.autopilot(testbed.link(link), uid=HARDWARE_UID_A) for link in ("a", "b")]
        for autopilot in autopilots:
            autopilot.sends_version = autopilot.has_position = False
        await asyncio.sleep(8)
        vehicle = testbed.fleet.get("1~2")
        vehicle.offboard_mission = SimpleNamespace(active=True)
        for autopilot in autopilots:
            autopilot.sends_version = True
        await asyncio.sleep(65)
        assert vehicle_ids(testbed) == ["1~2"]
        assert set(vehicle.links) == {"a", "b"}

    run_test(run_simulated, scenario)


def test_boot_times_revise_later_whether_two_links_belong_to_one_vehicle(run_simulated):
    async def scenario(testbed):
        testbed.autopilot(testbed.link("gcs"))
        other = testbed.autopilot(testbed.link("api"), booted_at_s=930.0)
        await testbed.wait_for_vehicle("1~2")
        other.booted_at_s = 900.016
        await asyncio.sleep(4)
        assert vehicle_ids(testbed) == ["1", "1~2"]
        await asyncio.sleep(3)
        assert vehicle_ids(testbed) == ["1"]
        other.booted_at_s = 930.0
        await asyncio.sleep(8)
        assert vehicle_ids(testbed) == ["1"]
        await asyncio.sleep(6)
        assert vehicle_ids(testbed) == ["1", "1~2"]
        texts = [event.text for event in testbed.fleet.get("1").events.since()]
        assert any("belongs to another vehicle" in text for text in texts)

    run_test(run_simulated, scenario)


def test_a_streamed_vehicle_keeps_its_link_when_another_vehicles_link_is_separated(run_simulated):
    async def run():
        testbed = OffboardTestbed()
        autopilots = [testbed.offboard_autopilot(testbed.link(link)) for link in ("a", "b")]
        for autopilot in autopilots:
            autopilot.set_hovering()
        try:
            vehicle = await testbed.wait_for_vehicle()
            await asyncio.sleep(5)
            assert set(vehicle.links) == {"a", "b"}
            await vehicle.offboard.start(stream_request(valid_for_s=600))
            flown, other = sorted(autopilots, key=lambda autopilot: autopilot.mode != OFFBOARD_MODE)
            other.booted_at_s, other.mode, other.has_stream = 700.0, OFFBOARD_MODE, lambda: True
            await asyncio.sleep(15)
            assert len(vehicle.links) == 1
            assert vehicle_ids(testbed) == ["1", "1~2"]
            assert vehicle.offboard.status().streaming
            assert max(setpoint_gaps_s(flown)) < 0.05
        finally:
            await testbed.close()

    run_simulated(run)


def test_a_vehicle_that_returns_from_another_port_is_the_same_vehicle(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        first = testbed.autopilot(link, peer="a")
        await testbed.wait_for_vehicle()
        first.alive = False
        await asyncio.sleep(6)
        assert testbed.fleet.get("1").status.link_lost
        returned = testbed.autopilot(link, peer="b", booted_at_s=1010.0)
        await asyncio.sleep(5)
        assert vehicle_ids(testbed) == ["1"]
        await testbed.fleet.get("1").command.arm()
        assert returned.armed

    run_test(run_simulated, scenario)


def test_other_stations_and_companions_are_not_vehicles(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        autopilot = testbed.autopilot(link)
        vehicle = await testbed.wait_for_vehicle()
        for system, component in ((255, 190), (245, 191), (1, 191)):
            mav = sim.MAVLink(None, srcSystem=system, srcComponent=component)
            link.inject(sim.MAVLink_heartbeat_message(6, 8, 0xC0, 77, 4, 3).pack(mav), "other")
            link.inject(sim.MAVLink_heartbeat_message(6, 8, 0xC0, 77, 4, 3).pack(mav), "peer")
        assert vehicle_ids(testbed) == ["1"]
        assert vehicle.status.custom_mode == autopilot.mode

    run_test(run_simulated, scenario)


def test_a_recorded_vehicle_is_shown_beside_the_real_vehicle_and_refuses_commands(run_simulated):
    async def scenario(testbed):
        testbed.autopilot(testbed.link())
        await testbed.wait_for_vehicle()
        replay = testbed.link("replay", replay=True)
        testbed.autopilot(replay)
        vehicle = await testbed.wait_for_vehicle("1~2")
        assert (vehicle.identity.replayed, vehicle.identity.warnings) == (True, ())
        for call in (
            vehicle.command.arm(),
            vehicle.command.kill(),
            vehicle.gimbal.take_control(),
            vehicle.params.get("A"),
        ):
            with pytest.raises(Refused, match="recording"):
                await call
        assert not vehicle.send(sim.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        assert replay.sent_packets == []
        await testbed.router.remove_link("replay")
        assert vehicle_ids(testbed) == ["1"]

    run_test(run_simulated, scenario)


def test_heartbeats_are_sent_once_a_second_to_every_peer(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        autopilots = [testbed.autopilot(link, peer=p, system=n) for n, p in enumerate(("a", "b"), 1)]
        await testbed.wait_for_vehicle("2")
        before = [sum(m.get_type() == "HEARTBEAT" for m in a.received_messages) for a in autopilots]
        await asyncio.sleep(10)
        after = [sum(m.get_type() == "HEARTBEAT" for m in a.received_messages) for a in autopilots]
        assert [a - b for a, b in zip(after, before, strict=True)] == pytest.approx([10, 10], abs=1)
        newest = autopilots[0].received_messages[-1]
        assert (newest.get_srcSystem(), newest.get_srcComponent()) == (42, 190)
        for autopilot in autopilots:  # sequence numbers per peer, without gaps
            seqs = [m.get_seq() for m in autopilot.received_messages]
            assert seqs == [(seqs[0] + i) % 256 for i in range(len(seqs))]

    run_test(run_simulated, scenario, lambda: MemoryTestbed(system_id=42))


def test_stream_rates_are_not_changed(run_simulated):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link())
        await testbed.wait_for_vehicle()
        await asyncio.sleep(30)
        assert autopilot.received_commands(SET_MESSAGE_INTERVAL) == []
        assert not [m for m in autopilot.received_messages if m.get_type() == "REQUEST_DATA_STREAM"]

    run_test(run_simulated, scenario)


def test_another_station_gets_all_messages_and_its_command_reaches_only_the_target(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        autopilots = [testbed.autopilot(link, peer=p, system=n) for n, p in enumerate(("a", "b"), 1)]
        station = testbed.link("qgc", forward=True)
        qgc = sim.MAVLink(None, srcSystem=255, srcComponent=190)
        station.inject(sim.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(qgc), "qgc")
        await testbed.wait_for_vehicle("2")
        system_ids = {system_id_of(frame) for frame, _ in station.sent_packets}
        assert system_ids == {1, 2}
        before = [len(autopilot.received_commands(ARM_DISARM)) for autopilot in autopilots]
        station.inject(
            sim.MAVLink_command_long_message(2, 1, ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0).pack(qgc), "qgc"
        )
        await asyncio.sleep(0.05)
        assert [
            len(a.received_commands(ARM_DISARM)) - b for a, b in zip(autopilots, before, strict=True)
        ] == [0, 1]
        # A frame of vehicle 1 that the station sends back must not reach the vehicles.
        vehicle_1 = sim.MAVLink(None, srcSystem=1, srcComponent=1)
        station.inject(sim.MAVLink_ping_message(1, 2, 0, 0).pack(vehicle_1), "qgc")
        await asyncio.sleep(0.02)
        assert not [
            m for autopilot in autopilots for m in autopilot.received_messages if m.get_type() == "PING"
        ]
        assert vehicle_ids(testbed) == ["1", "2"]

    run_test(run_simulated, scenario)


def system_id_of(frame):
    return frame[5]


def test_a_link_name_is_unique_and_an_unknown_link_cannot_be_removed(run_simulated):
    async def scenario(testbed):
        testbed.link("one")
        with pytest.raises(InvalidRequest, match="already"):
            testbed.link("one")
        with pytest.raises(UnknownLink):
            await testbed.router.remove_link("two")
        await testbed.router.remove_link("one")
        assert testbed.router.links() == []

    run_test(run_simulated, scenario)


def test_each_text_event_and_mode_change_is_reported_once(run_simulated):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link())
        vehicle = await testbed.wait_for_vehicle()
        start = vehicle.events.last_index
        autopilot.send_text("A text without an event", 4)
        autopilot.send_text("x" * 60 + " end", 6, 9)
        autopilot.send_text("Takeoff detected\t", 6)
        autopilot.send_event(TAKEOFF_DETECTED, 0x66)
        autopilot.send_text("Only the text came\t", 4)
        await asyncio.sleep(1)
        autopilot.send_event(99999, 0x44)
        await asyncio.sleep(2)
        autopilot.armed, autopilot.mode = True, TAKEOFF_MODE
        await asyncio.sleep(2)
        reported = [(e.kind, e.text) for e in vehicle.events.since(start)]
        texts, changes = reported[:5], reported[5:]
        assert texts == [
            ("status_text", "A text without an event"),
            ("status_text", "x" * 60 + " end"),
            ("event", "Takeoff detected"),
            ("status_text", "Only the text came"),
            ("event", "unknown event 99999 from component 0 (common events)"),
        ]
        assert changes == sorted(changes)
        assert {kind for kind, _ in changes} == {"armed", "mode_changed"}

    run_test(run_simulated, scenario)


def test_the_history_has_four_samples_a_second_of_the_last_five_minutes(run_simulated):
    async def scenario(testbed):
        testbed.autopilot(testbed.link())
        vehicle = await testbed.wait_for_vehicle()
        await asyncio.sleep(20)
        samples = vehicle.history(("global_position",), testbed.clock.unix_s() - 10)
        assert len(samples) == pytest.approx(40, abs=3)
        times = [s.received_unix_s for s in samples]
        assert times == sorted(times)
        await asyncio.sleep(400)
        oldest = vehicle.history(("global_position", "status"), 0)[0]
        assert testbed.clock.unix_s() - oldest.received_unix_s == pytest.approx(300, abs=2)

    run_test(run_simulated, scenario)


def test_a_topic_is_decoded_once_for_each_message(run_simulated):
    async def scenario(testbed):
        testbed.autopilot(testbed.link())
        vehicle = await testbed.wait_for_vehicle()
        assert vehicle.topic("home") is vehicle.topic("home")
        assert vehicle.topic("battery") is None
        with pytest.raises(KeyError):
            vehicle.topic("nothing")

    run_test(run_simulated, scenario)
