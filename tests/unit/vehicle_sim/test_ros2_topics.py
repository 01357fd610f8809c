"""Names, rates, contents and times of the messages that a simulated vehicle publishes over ROS 2."""

from __future__ import annotations

import json
import math

import pytest

from tests.support.ros2_vehicle import Ros2Vehicle
from vehicle_sim.fleet import DEFAULT_BOOT_TIME_UNIX_S
from vehicle_sim.ros2.topics import INPUTS, OUTPUTS, SERVICE_REPLY, SERVICE_REQUEST, dds_name

BOOT_US = int(DEFAULT_BOOT_TIME_UNIX_S * 1e6)
BOOT_TIME_FIELDS = {"nav_state_timestamp", "armed_time", "takeoff_time", "ref_timestamp"}


@pytest.fixture(scope="module")
def idle_vehicle() -> Ros2Vehicle:
    return Ros2Vehicle(time_since_boot_s=12.4, parameters={})


def test_topic_names_and_types_match_the_recording(reference_data):
    recordings = json.loads((reference_data / "px4" / "dds" / "topics.json").read_text())
    recorded = {(t["name"], t["ros_type"].split("/")[-1], t["direction"]) for t in recordings["topics"]}
    simulated = {(t.name, t.type, "out") for t in OUTPUTS} | {(t.name, t.type, "in") for t in INPUTS}
    assert simulated == recorded
    assert {dds_name(t.name) for t in (*OUTPUTS, *INPUTS)} == {t["dds_topic"] for t in recordings["topics"]}
    assert {dds_name(SERVICE_REQUEST), dds_name(SERVICE_REPLY)} == {
        s["dds_topic"] for s in recordings["services"]
    }
    for name in recordings["namespaces"][0]["examples"]:
        assert name in {dds_name(t, "px4_1") for t in simulated_names()}


def simulated_names() -> set[str]:
    return {t.name for t in (*OUTPUTS, *INPUTS)} | {SERVICE_REQUEST, SERVICE_REPLY}


@pytest.mark.parametrize(
    ("topic", "hz"),
    [("vehicle_attitude", 100), ("vehicle_odometry", 100), ("vehicle_local_position", 100),
     ("vehicle_global_position", 100), ("sensor_combined", 100), ("battery_status", 100),
     ("position_setpoint_triplet", 20), ("vehicle_gps_position", 8), ("vehicle_status_v1", 2),
     ("vehicle_control_mode", 2), ("failsafe_flags", 1.8), ("vehicle_land_detected", 1),
     ("estimator_status_flags", 1), ("timesync_status", 1), ("home_position", 0), ("airspeed_validated", 0),
     ("vtol_vehicle_status", 0), ("vehicle_command_ack", 0)],
)  # fmt: skip
def test_a_disarmed_vehicle_publishes_at_the_recorded_rate(idle_vehicle, topic, hz):
    count = len(idle_vehicle.all_fields(f"/fmu/out/{topic}", since_s=7.4))
    assert abs(count - 5.0 * hz) <= max(1.5, 0.1 * hz)


def test_the_first_message_is_sent_when_the_dds_client_has_connected(idle_vehicle):
    assert 6.3 < min(at_s for at_s, _, _ in idle_vehicle.received_messages) < 6.5
    assert len(idle_vehicle.all_fields("/fmu/out/home_position")) == 1


def test_timestamps_are_unix_time_and_other_times_count_from_boot(idle_vehicle):
    for at_s, topic, fields in idle_vehicle.received_messages:
        now_us = BOOT_US + at_s * 1e6
        assert abs(fields["timestamp"] - now_us) < 25_000, topic
        assert abs(fields.get("timestamp_sample", now_us) - now_us) < 200_000 or topic.endswith("setpoint")
        assert all(fields[name] < 1e9 for name in BOOT_TIME_FIELDS & fields.keys()), topic


def test_without_time_synchronization_all_times_count_from_boot_and_messages_are_sent_sooner():
    vehicle = Ros2Vehicle(time_since_boot_s=3.0)
    assert min(at_s for at_s, _, _ in vehicle.received_messages) < 1.5
    assert vehicle.newest_fields("/fmu/out/vehicle_attitude")["timestamp"] == pytest.approx(3e6, abs=10_000)
    assert not vehicle.all_fields("/fmu/out/timesync_status")


def test_topics_have_the_values_of_a_vehicle_on_the_ground(idle_vehicle):
    status = idle_vehicle.newest_fields("/fmu/out/vehicle_status_v1")
    assert (status["arming_state"], status["nav_state"], status["system_id"]) == (1, 4, 1)
    local = idle_vehicle.newest_fields("/fmu/out/vehicle_local_position")
    assert local["xy_valid"]
    assert local["z_valid"]
    assert max(abs(local[axis]) for axis in "xyz") < 1.0
    assert math.isinf(local["vxy_max"])
    odometry = idle_vehicle.newest_fields("/fmu/out/vehicle_odometry")
    assert odometry["pose_frame"] == odometry["velocity_frame"] == 1
    assert odometry["position"] == (local["x"], local["y"], local["z"])
    assert math.hypot(*odometry["q"]) == pytest.approx(1.0)
    flags = idle_vehicle.newest_fields("/fmu/out/failsafe_flags")
    assert flags["mode_req_offboard_signal"] == 1 << 14
    assert flags["offboard_control_signal_lost"]
    assert not flags["local_position_invalid"]
    assert not idle_vehicle.newest_fields("/fmu/out/position_setpoint_triplet")["current.valid"]


def test_the_battery_message_has_the_values_of_the_logged_topic(idle_vehicle):
    simulated = idle_vehicle.newest_fields("/fmu/out/battery_status")
    logged = next(t for t in idle_vehicle.sim._states[0].topics if t.layout.name == "battery_status").read()
    assert simulated["voltage_v"] == pytest.approx(logged["voltage_v"])
    assert (simulated["cell_count"], simulated["connected"]) == (logged["cell_count"], True)


def test_the_position_setpoint_has_the_type_of_the_mode_as_recorded_for_a_landing():
    vehicle = Ros2Vehicle()
    vehicle.hover()
    triplets = vehicle.all_fields("/fmu/out/position_setpoint_triplet")
    assert {t["current.type"] for t in triplets if t["current.valid"]} == {2, 3}
    assert {t["current.type"] for t in triplets if not t["current.valid"]} == {5}
    vehicle.command(21)
    vehicle.run(1.0)
    landing = vehicle.newest_fields("/fmu/out/position_setpoint_triplet")
    assert (landing["current.valid"], landing["current.type"], landing["current.alt"]) == (True, 4, 0.0)
    assert (landing["next.valid"], landing["next.type"]) == (False, 5)
