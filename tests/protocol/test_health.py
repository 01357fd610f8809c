"""Events and arming reports over links that lose packets: each arrives once and in order."""

import pytest

from gcs_server.errors import NoReply
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from tests.protocol.fake_autopilot import HOLD_MODE, OFFBOARD_MODE
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.one_vehicle import HOLD_MODE_BIT, run_scenario, send_arming_report
from tests.protocol.simulated_autopilot import SimulatedAutopilot

LOSS = [(0.0, 1), (0.05, 2), (0.2, 3), (0.2, 4)]
"""The share of packets lost in each direction, and the seed of the losses."""
ARMED_EVENT = 26266355
POSITION_ONLY = 0b110111111000
"""type_mask of a setpoint that has only a position."""


def run_with_simulated_vehicle(run_simulated, scenario, *, loss=0.0, seed=0, **options):
    async def run():
        testbed = MemoryTestbed()
        autopilot = SimulatedAutopilot(testbed.link(), seed=seed, **options)
        try:
            vehicle = await testbed.wait_for_vehicle()
            autopilot.loss = loss
            await scenario(testbed, vehicle, autopilot)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


async def until(testbed, condition, awaited, timeout_s=20.0):
    end_s = testbed.loop.time() + timeout_s
    while not condition():
        assert testbed.loop.time() < end_s, f"timeout while waiting for {awaited}"
        await testbed.clock.sleep(0.05)


def readiness_by_mode(vehicle):
    return {m.mode: m for m in vehicle.health.readiness.modes}


@pytest.mark.parametrize(("loss", "seed"), LOSS)
def test_the_reasons_that_prevent_arming_are_known_for_each_mode_and_updated(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot):
        readiness_events = []
        vehicle.events.subscribe(lambda e: readiness_events.append(e) if e.kind == "readiness" else None)
        health = vehicle.health

        def report_matches():
            report = autopilot.sim.autopilots[0].commander.checks.report
            return health.report is not None and health.report.can_arm == report.can_arm

        await until(testbed, report_matches, "the first report")
        assert readiness_by_mode(vehicle)["hold"].can_arm
        offboard = readiness_by_mode(vehicle)["offboard"]
        assert not offboard.can_arm
        assert [c.name for c in offboard.arming] == ["check_modes_offboard_signal"]
        assert "stream" in offboard.arming[0].remedy

        readiness_events.clear()
        target = d.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, POSITION_ONLY, 0, 0, -5, 0, 0, 0, 0, 0, 0, 0, 0
        )
        for _ in range(200):
            vehicle.send_payload(target.get_msgId(), encode_payload(target))
            await testbed.clock.sleep(0.05)
        assert readiness_by_mode(vehicle)["offboard"].can_arm
        assert readiness_events
        assert all(e.severity == d.MAV_SEVERITY_DEBUG for e in readiness_events)
        await until(
            testbed,
            lambda: not readiness_by_mode(vehicle)["offboard"].can_arm,
            "Offboard to be unavailable without a stream",
        )
        assert report_matches()

    run_with_simulated_vehicle(run_simulated, scenario, loss=loss, seed=seed)


@pytest.mark.parametrize(("loss", "seed"), LOSS)
def test_lost_events_are_recovered_and_reported_once(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot):
        announcer = autopilot.sim.autopilots[0].announcer
        for n in range(12):
            announcer.event("commander_rtl" if n % 2 else "commander_takeoff_detected")
            await testbed.clock.sleep(0.3)

        def event_counts():
            texts = [e.text for e in vehicle.events.since(0) if e.kind == "event"]
            return texts.count("Returning to launch"), texts.count("Take-off detected")

        # CURRENT_EVENT_SEQUENCE shows that the last event was lost.
        await until(testbed, lambda: event_counts() == (6, 6), "all events")
        await testbed.clock.sleep(5.0)
        assert event_counts() == (6, 6)
        if not loss:
            assert autopilot.count(d.MAVLINK_MSG_ID_REQUEST_EVENT) == 0

    run_with_simulated_vehicle(run_simulated, scenario, loss=loss, seed=seed)


def test_a_report_that_is_never_sent_is_requested_once(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        await testbed.clock.sleep(30)
        requests = autopilot.received_commands(d.MAV_CMD_RUN_PREARM_CHECKS)
        assert 1 <= len(requests) <= 4  # one request and its repeats
        with pytest.raises(NoReply, match="did not report its checks"):
            await vehicle.health.check()
        assert vehicle.health.readiness.known is False

    async def run():
        testbed = MemoryTestbed()
        autopilot = testbed.autopilot(testbed.link())  # acknowledges none of these requests
        try:
            await scenario(testbed, await testbed.wait_for_vehicle(), autopilot)
        finally:
            await testbed.close()

    run_simulated(run)


def test_checks_run_on_request_and_a_reboot_discards_the_report(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        await testbed.clock.sleep(15)
        report = await vehicle.health.check()
        assert report.known
        assert report.words == "own"
        revision = vehicle.health.revision
        payload = encode_payload(
            d.MAVLink_event_message(0, 0, ARMED_EVENT, 5000, 1, 0x66, [4, *[0] * 39])  # 5 s after a boot
        )
        vehicle.health.take_event(payload)
        assert vehicle.health.revision == revision + 1
        assert vehicle.health.readiness.known is False

    run_with_simulated_vehicle(run_simulated, scenario)


def test_after_landing_in_offboard_another_mode_is_suggested_until_it_is_selected(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        readiness_events = []
        vehicle.events.subscribe(lambda e: readiness_events.append(e) if e.kind == "readiness" else None)
        autopilot.mode = OFFBOARD_MODE
        await testbed.clock.sleep(3)
        send_arming_report(autopilot, HOLD_MODE_BIT)
        await testbed.clock.sleep(3)
        (suggestion,) = vehicle.health.readiness.offers
        assert (suggestion.code, suggestion.mode, suggestion.label) == ("choose_mode", "hold", "Hold")
        assert suggestion.text == "The vehicle is in Offboard and cannot be armed in it. Choose Hold."
        event_count = len(readiness_events)
        autopilot.mode = HOLD_MODE
        await testbed.clock.sleep(3)
        assert vehicle.health.readiness.offers == ()
        assert len(readiness_events) > event_count

    run_scenario(run_simulated, scenario)
