"""Several batteries, groups of outputs, gimbals and components of one vehicle: none replaces another."""

import asyncio

import pytest

from gcs_server.vehicle.samples import TOPICS
from tests.protocol.memory_testbed import run_with_vehicle
from vehicle_sim.mavlink import generated_dialect as sim

GIMBAL_1, GIMBAL_2 = sim.MAV_COMP_ID_GIMBAL, sim.MAV_COMP_ID_GIMBAL2


def send_battery(autopilot, battery_id, percent, millivolts):
    cells = [millivolts, *[65535] * 9]
    autopilot.send(sim.MAVLink_battery_status_message(battery_id, 0, 0, 0, cells, 100, 0, 0, percent))


def test_the_less_charged_of_two_batteries_is_shown(run_simulated):
    async def scenario(_testbed, autopilot, vehicle):
        shown_values = set()
        for _ in range(10):
            for battery_id, percent in ((0, 80), (1, 35)):
                send_battery(autopilot, battery_id, percent, 16000 - battery_id * 1000)
                await asyncio.sleep(0.5)
                battery = vehicle.topic("battery").value
                shown_values.add((battery.battery_id, battery.remaining_percent, battery.voltage_v))
        assert shown_values == {(0, 80, 16.0), (1, 35, 15.0)}, (
            "the shown battery had a value of the other one"
        )
        assert [(b.battery_id, b.remaining_percent) for b in battery.batteries] == [(0, 80), (1, 35)]
        # Without the first samples, in which battery 1 was not known yet.
        history = [s.value for s in vehicle.history(("battery",), 0.0)][2:]
        assert {b.battery_id for b in history} == {1}
        for _ in range(15):
            send_battery(autopilot, 0, 79, 16000)
            await asyncio.sleep(1.0)
        battery = vehicle.topic("battery").value
        assert (battery.battery_id, battery.batteries) == (0, ()), (
            "the other battery is still shown, more than 10 s after its last message"
        )

    run_with_vehicle(run_simulated, scenario)


def test_the_number_of_batteries_is_limited(run_simulated):
    async def scenario(_testbed, autopilot, vehicle):
        for battery_id in range(256):
            send_battery(autopilot, battery_id, 50, 16000)
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.1)
        assert len(vehicle.topic("battery").value.batteries) == 8

    run_with_vehicle(run_simulated, scenario)


def test_two_groups_of_outputs_are_stored_separately(run_simulated):
    async def scenario(_testbed, autopilot, vehicle):
        for _ in range(5):
            for port in (1, 0):
                autopilot.send(sim.MAVLink_servo_output_raw_message(0, port, *[1500 + port] * 4, 0, 0, 0, 0))
                await asyncio.sleep(0.1)
        autopilot.send(sim.MAVLink_servo_output_raw_message(0, 1, *[1501] * 4, 0, 0, 0, 0))
        await asyncio.sleep(0.1)
        motors = vehicle.topic("motors").value
        assert motors.pwm_us == (1500,) * 4
        assert [(g.port, g.pwm_us) for g in motors.groups] == [(0, (1500,) * 4), (1, (1501,) * 4)]

    run_with_vehicle(run_simulated, scenario)


def send_gimbal_attitude(autopilot, component, q):
    message = sim.MAVLink_gimbal_device_attitude_status_message(0, 0, autopilot.boot_ms(), 0, q, 0, 0, 0, 0)
    autopilot.send_raw(message.pack(sim.MAVLink(None, srcSystem=1, srcComponent=component)))


def test_the_gimbal_with_the_lower_component_id_is_shown_until_it_stops_sending(run_simulated):
    level_q, down_q = [1.0, 0.0, 0.0, 0.0], [0.7071068, 0.0, -0.7071068, 0.0]

    async def scenario(_testbed, autopilot, vehicle):
        for component, q in ((GIMBAL_2, down_q), (GIMBAL_1, level_q)) * 5:
            send_gimbal_attitude(autopilot, component, q)
            await asyncio.sleep(0.1)
        send_gimbal_attitude(autopilot, GIMBAL_2, down_q)
        await asyncio.sleep(0.1)
        assert vehicle.topic("gimbal").value.pitch_rad == pytest.approx(0.0, abs=1e-3)
        for _ in range(40):
            send_gimbal_attitude(autopilot, GIMBAL_2, down_q)
            await asyncio.sleep(0.1)
        assert vehicle.topic("gimbal").value.pitch_rad == pytest.approx(-1.5708, abs=1e-2)

    run_with_vehicle(run_simulated, scenario)


def test_a_companion_that_sends_the_autopilots_messages_changes_nothing(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        companion = sim.MAVLink(None, srcSystem=1, srcComponent=sim.MAV_COMP_ID_ONBOARD_COMPUTER)
        before = vehicle.topic("global_position").value
        boot_at_s = vehicle.endpoints[0].boot_at_s
        for _ in range(20):
            for message in (
                sim.MAVLink_heartbeat_message(18, 8, 128, 0, 5, 3),
                sim.MAVLink_heartbeat_message(2, 12, 128 | 1, 6 << 16, 4, 3),
                sim.MAVLink_global_position_int_message(5, 1, 2, 3000, 4, 0, 0, 0, 0),
                sim.MAVLink_attitude_message(5, 1.0, 0, 0, 0, 0, 0),
            ):
                autopilot.send_raw(message.pack(companion))
            await asyncio.sleep(0.1)
            assert (vehicle.status.armed, vehicle.status.mode) == (False, "hold")
            assert vehicle.topic("global_position").value == before
        assert [v.id for v in testbed.fleet.all()] == ["1"]
        assert vehicle.identity.component_id == 1
        assert vehicle.endpoints[0].boot_at_s == pytest.approx(boot_at_s, abs=0.5)

    run_with_vehicle(run_simulated, scenario)


def test_the_time_of_a_topic_is_that_of_its_newest_sample(run_simulated):
    async def scenario(_testbed, autopilot, vehicle):
        def check_times():
            for topic in TOPICS:
                received_s = vehicle.topic_received_s(topic)
                sample = vehicle.topic(topic)
                assert received_s == (None if sample is None else sample.received_monotonic_s), topic
            return vehicle.topic_received_s("status")

        before_s = check_times()
        await asyncio.sleep(1.5)
        later_s = check_times()
        autopilot.alive = False
        await asyncio.sleep(6)
        assert vehicle.status.link_lost
        lost_s = check_times()
        assert before_s < later_s < lost_s, "the lost connection gave no new sample of the status"

    run_with_vehicle(run_simulated, scenario)
