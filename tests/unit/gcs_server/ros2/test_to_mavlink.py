"""Recorded ROS 2 messages of a real PX4, converted to MAVLink messages."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.ros2.message_types import MalformedMessage
from gcs_server.ros2.to_mavlink import MavlinkConverter
from gcs_server.ros2.topics import SUBSCRIPTIONS
from gcs_server.vehicle import decoders, reducers
from tests.support.dds_samples import server_samples

Decoder = Callable[[Mapping[int, bytes]], tuple[Any, float | None]]
TYPES = {each.name: each.message for each in SUBSCRIPTIONS}
STATUS, LAND_DETECTED = "/fmu/out/vehicle_status", "/fmu/out/vehicle_land_detected"
LOCAL_POSITION, GLOBAL_POSITION = "/fmu/out/vehicle_local_position", "/fmu/out/vehicle_global_position"
HOME_POSITION, FAILSAFE_FLAGS = "/fmu/out/home_position", "/fmu/out/failsafe_flags"


def _values(topic: str, **changes: Any) -> dict[str, Any]:
    return TYPES[topic].decode(server_samples()[topic]) | changes


class ConverterSetup:
    """A converter with its newest MAVLink messages by name."""

    def __init__(self) -> None:
        self.converter = MavlinkConverter()
        self.by_name: dict[str, Any] = {}
        self.convert("/fmu/out/timesync_status")
        self.convert(STATUS)

    def convert(self, topic: str, *, now_s: float = 0.0, **changes: Any) -> list[Any]:
        messages = self.converter.convert(topic, _values(topic, **changes), now_s)
        self.by_name |= {message.get_type(): message for message in messages}
        return messages

    def sample(self, name: str, decoder: Decoder) -> tuple[Any, float | None]:
        message = self.by_name[name]
        return decoder({message.get_msgId(): encode_payload(message)})


@pytest.fixture
def setup() -> ConverterSetup:
    return ConverterSetup()


@pytest.mark.parametrize(
    ("nav_state", "custom_mode"),
    [
        (4, 0x03040000),
        (14, 0x00060000),
        (17, 0x02040000),
        (18, 0x06040000),
        (12, 0x06040000),
        (23, 0x0B040000),
        (200, 0),
    ],
)
def test_a_status_has_the_mode_that_px4_would_send_over_mavlink(
    setup: ConverterSetup, nav_state: int, custom_mode: int
) -> None:
    setup.convert(STATUS, nav_state=nav_state, nav_state_user_intention=4)
    assert setup.by_name["HEARTBEAT"].custom_mode == custom_mode
    assert setup.by_name["CURRENT_MODE"].intended_custom_mode == 0x03040000


@pytest.mark.parametrize(
    ("arming_state", "failsafe", "armed", "state"),
    [
        (1, False, False, d.MAV_STATE_STANDBY),
        (2, False, True, d.MAV_STATE_ACTIVE),
        (2, True, True, d.MAV_STATE_CRITICAL),
    ],
)
def test_a_status_has_the_arming_state_and_the_failsafe_state(
    setup: ConverterSetup, arming_state: int, failsafe: bool, armed: bool, state: int
) -> None:
    setup.convert(STATUS, arming_state=arming_state, failsafe=failsafe)
    payload = encode_payload(setup.by_name["HEARTBEAT"])
    flight_state = reducers.heartbeat(reducers.FlightState(), payload, 1.0)
    assert (flight_state.armed, flight_state.system_status, flight_state.autopilot) == (
        armed,
        state,
        d.MAV_AUTOPILOT_PX4,
    )
    assert not flight_state.hil


@pytest.mark.parametrize(
    ("landed", "nav_state", "state"),
    [(True, 4, "on_ground"), (False, 17, "taking_off"), (False, 18, "landing"), (False, 14, "in_air")],
)
def test_the_landed_state_depends_on_the_mode(
    setup: ConverterSetup, landed: bool, nav_state: int, state: str
) -> None:
    setup.convert(LAND_DETECTED, landed=landed)
    setup.convert(STATUS, nav_state=nav_state)
    payload = encode_payload(setup.by_name["EXTENDED_SYS_STATE"])
    assert reducers.extended_sys_state(reducers.FlightState(), payload, 1.0).landed_state == state


def test_positions_velocity_and_time_since_boot_are_converted_unchanged(setup: ConverterSetup) -> None:
    local, position = _values(LOCAL_POSITION), _values(GLOBAL_POSITION)
    offset_us = _values("/fmu/out/timesync_status")["estimated_offset"]
    setup.convert(LOCAL_POSITION)
    value, boot_s = setup.sample("LOCAL_POSITION_NED", decoders.local_position)
    assert value.position_ned_m == (local["x"], local["y"], local["z"])
    assert value.velocity_ned_m_s == (local["vx"], local["vy"], local["vz"])
    assert boot_s == pytest.approx((local["timestamp"] + offset_us) / 1e6, abs=1e-3)
    setup.convert(HOME_POSITION)
    setup.convert(GLOBAL_POSITION)
    value, _ = setup.sample("GLOBAL_POSITION_INT", decoders.global_position)
    assert (value.lat_deg, value.lon_deg) == pytest.approx((position["lat"], position["lon"]), abs=1e-7)
    assert value.alt_home_m == pytest.approx(position["alt"] - _values(HOME_POSITION)["alt"], abs=2e-3)
    assert value.heading_deg == pytest.approx(math.degrees(local["heading"]) % 360, abs=0.01)


def test_attitude_battery_gps_and_home_are_converted(setup: ConverterSetup) -> None:
    setup.convert("/fmu/out/vehicle_odometry")
    setup.convert("/fmu/out/vehicle_attitude")
    value, _ = setup.sample("ATTITUDE_QUATERNION", decoders.attitude_quaternion)
    assert value.q_ned_frd == _values("/fmu/out/vehicle_attitude")["q"]
    assert value.rates_frd_rad_s == _values("/fmu/out/vehicle_odometry")["angular_velocity"]
    setup.convert("/fmu/out/battery_status", remaining=0.42, current_a=3.5, voltage_v=15.8)
    value, _ = setup.sample("BATTERY_STATUS", decoders.battery)
    assert (value.remaining_percent, value.current_a, value.voltage_v) == (42, 3.5, 15.8)
    setup.convert("/fmu/out/vehicle_gps_position")
    value, _ = setup.sample("GPS_RAW_INT", decoders.gps)
    assert (value.fix_type, value.satellites, value.hdop) == (3, 10, 0.7)
    setup.convert(HOME_POSITION)
    value, _ = setup.sample("HOME_POSITION", decoders.home)
    assert value.alt_amsl_m == pytest.approx(_values(HOME_POSITION)["alt"], abs=1e-3)


@pytest.mark.parametrize("valid_flag", ["xy_valid", "z_valid", "v_xy_valid", "v_z_valid"])
def test_an_invalid_estimate_is_not_shown_and_its_flag_is_cleared(
    setup: ConverterSetup, valid_flag: str
) -> None:
    setup.convert(LOCAL_POSITION)
    flags_before = setup.by_name["ESTIMATOR_STATUS"].flags
    messages = setup.convert(LOCAL_POSITION, **{valid_flag: False})
    assert [each.get_type() for each in messages] == ["ESTIMATOR_STATUS"]
    assert flags_before & ~messages[0].flags


def test_health_has_the_prearm_check_and_manual_control(setup: ConverterSetup) -> None:
    setup.convert(FAILSAFE_FLAGS, attitude_invalid=False, manual_control_signal_lost=True)
    value, _ = setup.sample("SYS_STATUS", decoders.health)
    assert value.ready_to_arm is True
    assert not value.sensors_present & d.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    setup.convert(FAILSAFE_FLAGS, manual_control_signal_lost=False)
    setup.convert(STATUS, pre_flight_checks_pass=False)
    value, _ = setup.sample("SYS_STATUS", decoders.health)
    assert value.ready_to_arm is False
    assert value.sensors_healthy & d.MAV_SYS_STATUS_SENSOR_RC_RECEIVER


def test_the_home_of_a_vehicle_disarmed_on_the_ground_is_its_position_until_px4_sends_it(
    setup: ConverterSetup,
) -> None:
    setup.convert(LOCAL_POSITION)
    assert not [each for each in setup.convert(GLOBAL_POSITION) if each.get_type() == "HOME_POSITION"]
    setup.convert(LAND_DETECTED, landed=True)
    setup.convert(GLOBAL_POSITION)
    assumed_home = setup.by_name["HOME_POSITION"]
    assert assumed_home.altitude == round(_values(GLOBAL_POSITION)["alt"] * 1000)
    setup.convert(HOME_POSITION, alt=500.0)
    setup.convert(GLOBAL_POSITION)
    assert setup.by_name["HOME_POSITION"].altitude == 500_000
    assert setup.converter.latched(d.MAVLINK_MSG_ID_HOME_POSITION) is setup.by_name["HOME_POSITION"]


def test_in_flight_no_home_is_assumed(setup: ConverterSetup) -> None:
    setup.convert(STATUS, arming_state=2)
    setup.convert(LAND_DETECTED, landed=False)
    setup.convert(LOCAL_POSITION)
    setup.convert(GLOBAL_POSITION)
    assert "HOME_POSITION" not in setup.by_name


def test_the_navigators_position_setpoint_becomes_the_goto_target(setup: ConverterSetup) -> None:
    setup.convert(
        "/fmu/out/position_setpoint_triplet",
        **{"current.valid": True, "current.lat": 47.4, "current.lon": 8.5, "current.alt": 500.0},
    )
    target = setup.by_name["POSITION_TARGET_GLOBAL_INT"]
    assert (target.lat_int, target.lon_int, target.alt) == (474_000_000, 85_000_000, 500.0)
    assert not setup.convert("/fmu/out/position_setpoint_triplet", **{"current.valid": False})


@pytest.mark.parametrize("changes", [{"system_id": 0}, {"system_id": 255}, {"component_id": 0}])
def test_an_invalid_system_or_component_id_is_malformed(changes: dict[str, int]) -> None:
    with pytest.raises(MalformedMessage, match="not valid"):
        MavlinkConverter().convert(STATUS, _values(STATUS, **changes), 0.0)


@pytest.mark.parametrize("lat", [math.nan, math.inf, 91.0, -1e300])
def test_an_invalid_latitude_is_malformed(setup: ConverterSetup, lat: float) -> None:
    setup.convert(LOCAL_POSITION)
    with pytest.raises(MalformedMessage, match="not a position"):
        setup.convert(GLOBAL_POSITION, lat=lat)


@pytest.mark.parametrize("topic", [each.name for each in SUBSCRIPTIONS if each.type != "VehicleCommandAck"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3e38, -3e38])
def test_extreme_numbers_are_converted_or_refused_as_malformed(topic: str, value: float) -> None:
    setup = ConverterSetup()
    setup.convert(LOCAL_POSITION)
    setup.convert(LAND_DETECTED, landed=True)
    floats = [each for each in TYPES[topic].primitive_fields if each.type.startswith("float")]
    extreme_fields: dict[str, Any] = {
        each.name: (value,) * each.length if each.length else value for each in floats
    }
    try:
        messages = setup.convert(topic, **extreme_fields)
    except MalformedMessage:
        return
    for message in messages:
        encode_payload(message)


def test_before_the_first_status_no_message_is_converted() -> None:
    converter = MavlinkConverter()
    assert converter.convert(LAND_DETECTED, _values(LAND_DETECTED), 0.0) == []
    assert converter.address is None


def test_texts_name_the_missing_requirements_of_a_mode(setup: ConverterSetup) -> None:
    flags = {
        "global_position_invalid": True,
        "mode_req_global_position": 1 << 5,
        "mode_req_prevent_arming": 1,
    }
    setup.convert(FAILSAFE_FLAGS, **flags, battery_unhealthy=True)
    assert setup.converter.problems(5) == ["no valid global position estimate", "battery unhealthy"]
    assert "no valid global position estimate" not in setup.converter.problems(4)
