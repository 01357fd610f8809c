"""The gimbal manager over MAVLink: control, and the motion of the gimbal."""

import math

import pytest

from tests.unit.vehicle_sim.plan_station import PlanStation
from tests.unit.vehicle_sim.sim_station import NAN, Station

pytestmark = pytest.mark.flight

GIMBAL_PITCH_YAW, GIMBAL_CONFIGURE, ROI_LOCATION, ROI_NEXT_WAYPOINT = 1000, 1001, 195, 196
ROI_NONE, REPOSITION, REQUEST_MESSAGE, MESSAGE_INTERVAL = 197, 192, 512, 511


def ready_station() -> Station:
    station = Station()
    station.run(2)
    return station


def pitch_rad(station: Station) -> float:
    w, x, y, z = station.newest_messages["GIMBAL_DEVICE_ATTITUDE_STATUS"].q
    return math.asin(2 * (w * y - z * x))


def take_control(station: Station) -> None:
    station.command(GIMBAL_CONFIGURE, 255, 190, -1, -1)
    station.run(0.1)


def test_a_client_takes_control_moves_the_gimbal_and_releases_control() -> None:
    """The client streams roll 90°, pitch 90° and zero, with yaw lock."""
    station = Station(parameters={"MNT_RANGE_ROLL": 180.0, "MNT_RANGE_PITCH": 180.0})
    take_control(station)
    assert station.acks(GIMBAL_CONFIGURE) == [0]

    def send_attitude(roll_deg: float, pitch_deg: float) -> None:
        cr, sr = math.cos(math.radians(roll_deg) / 2), math.sin(math.radians(roll_deg) / 2)
        cp, sp = math.cos(math.radians(pitch_deg) / 2), math.sin(math.radians(pitch_deg) / 2)
        station.send(
            "GIMBAL_MANAGER_SET_ATTITUDE", target_system=1, target_component=1, flags=28,
            q=(cr * cp, sr * cp, cr * sp, -sr * sp), angular_velocity_x=NAN, angular_velocity_y=NAN,
            angular_velocity_z=NAN,
        )  # fmt: skip

    station.run(4, lambda: send_attitude(90, 0), tick_s=0.1)
    assert station.newest_messages["MOUNT_ORIENTATION"].roll == pytest.approx(90, abs=1)
    station.run(4, lambda: send_attitude(0, 90), tick_s=0.1)
    assert abs(station.newest_messages["MOUNT_ORIENTATION"].pitch) == pytest.approx(90, abs=1)
    station.run(2, lambda: send_attitude(0, 0), tick_s=0.1)
    mount = station.newest_messages["MOUNT_ORIENTATION"]
    assert (mount.roll, mount.pitch) == (pytest.approx(0, abs=1), pytest.approx(0, abs=1))
    station.command(GIMBAL_CONFIGURE, -3, -3, -3, -3)
    station.run(2.5)
    assert station.newest_messages["GIMBAL_MANAGER_STATUS"].primary_control_sysid == 0


def test_gimbal_commands_without_control_are_denied_and_messages_ignored() -> None:
    station = ready_station()
    station.command(GIMBAL_PITCH_YAW, -20, 30, NAN, NAN)
    station.send(
        "GIMBAL_MANAGER_SET_MANUAL_CONTROL", target_system=1, target_component=1, pitch=-0.5, yaw=0.0,
        pitch_rate=NAN, yaw_rate=NAN,
    )  # fmt: skip
    station.run(2)
    assert station.acks(GIMBAL_PITCH_YAW) == [2]
    assert pitch_rad(station) == pytest.approx(0.0, abs=1e-6)


def test_servo_angles_change_at_once_and_stop_at_half_their_range() -> None:
    station = ready_station()
    take_control(station)
    gimbal = station.sim.autopilots[0].gimbal
    station.command(GIMBAL_PITCH_YAW, -30, 60, NAN, NAN)
    station.run(0.1)
    assert math.degrees(gimbal.actual.pitch_rad) == pytest.approx(-30)
    station.command(GIMBAL_PITCH_YAW, -60, 0, NAN, NAN)
    station.run(0.1)
    assert math.degrees(gimbal.actual.pitch_rad) == pytest.approx(-45)
    station.command(GIMBAL_PITCH_YAW, NAN, NAN, -10, 0)
    station.run(2)
    station.command(GIMBAL_PITCH_YAW, NAN, NAN, 10, 0)
    station.run(1)
    assert math.degrees(gimbal.actual.pitch_rad) == pytest.approx(-35, abs=0.5), (
        "the setpoint did not pass the end stop"
    )


def test_a_separate_device_turns_at_a_limited_rate_and_keeps_its_heading() -> None:
    station = Station(parameters={"MNT_MODE_OUT": 2})
    take_control(station)
    station.command(GIMBAL_PITCH_YAW, -60, 90, NAN, NAN, 16)
    station.run(0.3)
    gimbal = station.sim.autopilots[0].gimbal
    assert -45 < math.degrees(gimbal.actual.pitch_rad) < -10
    station.run(2)
    assert math.degrees(gimbal.actual.pitch_rad) == pytest.approx(-60, abs=0.5)
    station.sim.simulation.truth.q_ned_frd[0] = (math.cos(0.2), 0.0, 0.0, math.sin(0.2))
    station.run(4)
    assert math.degrees(gimbal.yaw_ned_rad) == pytest.approx(90, abs=1.5)
    assert math.degrees(gimbal.actual.yaw_rad) < 80, "the vehicle has turned"
    assert station.newest_messages["GIMBAL_MANAGER_STATUS"].gimbal_device_id == 154


def test_stabilization_keeps_the_yaw_of_servos_relative_to_north() -> None:
    station = Station(parameters={"MNT_DO_STAB": 2})
    take_control(station)
    station.command(GIMBAL_PITCH_YAW, 0, 90, NAN, NAN, 16)
    station.sim.simulation.truth.q_ned_frd[0] = (math.cos(0.2), 0.0, 0.0, math.sin(0.2))
    station.run(6)
    gimbal = station.sim.autopilots[0].gimbal
    assert math.degrees(gimbal.yaw_ned_rad) == pytest.approx(90, abs=0.5)
    assert math.degrees(gimbal.actual.yaw_rad) < 80


def test_assigned_outputs_have_the_gimbals_angles_when_armed_or_prearmed() -> None:
    station = Station(parameters={"PWM_MAIN_FUNC5": 421, "PWM_MAIN_FUNC7": 422})
    take_control(station)
    station.command(GIMBAL_PITCH_YAW, -22.5, 90, NAN, NAN)
    station.command(MESSAGE_INTERVAL, 36, 100000)
    station.run(1)
    assert station.newest_messages["SERVO_OUTPUT_RAW"].servo5_raw == 900, "outputs are off while disarmed"
    station.sim.simulation.parameters[0].set("COM_PREARM_MODE", 2)
    station.run(1)
    outputs = station.newest_messages["SERVO_OUTPUT_RAW"]
    assert (outputs.servo5_raw, outputs.servo6_raw, outputs.servo7_raw) == (1250, 900, 1750)
    assert outputs.servo1_raw == 900


def test_the_id_minus_two_gives_gimbal_control_to_the_vehicle_itself() -> None:
    station = ready_station()
    station.command(GIMBAL_CONFIGURE, -2, -2, -1, -1)
    station.run(0.1)
    station.command(GIMBAL_PITCH_YAW, -20, 0, NAN, NAN)
    station.run(2.5)
    assert station.acks(GIMBAL_PITCH_YAW) == [2]
    status = station.newest_messages["GIMBAL_MANAGER_STATUS"]
    assert (status.primary_control_sysid, status.primary_control_compid) == (1, 1)


def test_the_gimbal_keeps_its_heading_with_yaw_lock_and_turns_with_the_vehicle_without_lock() -> None:
    station = ready_station()
    take_control(station)
    gimbal = station.sim.autopilots[0].gimbal
    station.command(GIMBAL_PITCH_YAW, 0, 90, NAN, NAN, 16)
    station.run(2.5)
    assert math.degrees(gimbal.yaw_ned_rad) == pytest.approx(90, abs=1)
    assert gimbal.yaw_locked
    station.command(GIMBAL_PITCH_YAW, 0, 30, NAN, NAN, 0)
    station.run(2.5)
    assert math.degrees(gimbal.actual.yaw_rad) == pytest.approx(30, abs=0.5)


def test_rates_move_the_gimbal_until_nan_stops_it_and_an_incomplete_pair_of_angles_is_ignored() -> None:
    station = ready_station()
    take_control(station)
    station.command(GIMBAL_PITCH_YAW, NAN, NAN, -10, 0)
    station.run(2)
    gimbal = station.sim.autopilots[0].gimbal
    moved_pitch_deg = math.degrees(gimbal.actual.pitch_rad)
    assert moved_pitch_deg == pytest.approx(-20, abs=0.5)
    station.command(GIMBAL_PITCH_YAW, NAN, NAN, NAN, NAN)
    station.run(1)
    stopped_pitch_deg = math.degrees(gimbal.setpoint.pitch_rad)
    station.command(GIMBAL_PITCH_YAW, -50, NAN, NAN, NAN)
    station.run(1)
    assert math.degrees(gimbal.actual.pitch_rad) == pytest.approx(stopped_pitch_deg, abs=0.3)


def test_the_gimbal_points_at_a_region_of_interest_without_control() -> None:
    station = ready_station()
    station.run(4)
    position = station.newest_messages["GLOBAL_POSITION_INT"]
    # 50 m east; a degree of longitude has 75 270 m at this latitude.
    lat_deg, lon_deg = position.lat / 1e7, position.lon / 1e7 + 50 / 75270
    station.command(ROI_LOCATION, 0, 0, 0, 0, lat_deg, lon_deg, position.alt / 1000 - 50)
    station.run(3)
    gimbal = station.sim.autopilots[0].gimbal
    assert math.degrees(gimbal.yaw_ned_rad) == pytest.approx(90, abs=3)
    assert math.degrees(gimbal.actual.pitch_rad) == pytest.approx(-45, abs=3)
    station.command(ROI_NONE)
    station.run(2)
    assert gimbal.roi is None
    assert math.degrees(gimbal.actual.pitch_rad) == pytest.approx(0, abs=0.5)


def test_a_disabled_gimbal_sends_nothing() -> None:
    station = Station(parameters={"MNT_MODE_IN": -1})
    station.run(2)
    station.command(GIMBAL_PITCH_YAW, -20, 0, NAN, NAN)
    station.command(GIMBAL_CONFIGURE, 255, 190, -1, -1)
    station.command(REQUEST_MESSAGE, 280)
    station.run(1)
    assert station.acks(GIMBAL_PITCH_YAW) == []
    assert station.acks(GIMBAL_CONFIGURE) == []
    assert station.acks(REQUEST_MESSAGE) == [2]
    assert not station.received("GIMBAL_MANAGER_STATUS")


@pytest.mark.story
def test_the_gimbal_points_at_the_next_waypoint_and_ahead_without_a_waypoint() -> None:
    station = PlanStation(sensor_noise=False, parameters={"MNT_MODE_OUT": 2})
    station.wait_until_ready_to_arm()
    station.command(ROI_NEXT_WAYPOINT)
    station.run(1)
    assert pitch_rad(station) == pytest.approx(0.0, abs=1e-6), "the gimbal does not point ahead"
    station.take_off_and_hover(10.0)
    item = station.item(REPOSITION, 40.0, 0.0)
    alt_amsl_m = station.sim.autopilots[0].home.alt_amsl_m + 4
    station.command(REPOSITION, -1, 1, 0, NAN, item["x"] / 1e7, item["y"] / 1e7, alt_amsl_m)
    station.run(2.5)
    north, _ = station.position_ne_m
    waypoint = station.sim.autopilots[0].waypoint
    assert waypoint is not None
    assert pitch_rad(station) == pytest.approx(math.atan2(4.0 - station.height_m, 40.0 - north), abs=0.03)
    station.command(ROI_NEXT_WAYPOINT, 0, 0, 0, 0, -10)
    station.run(1.5)
    north, _ = station.position_ne_m
    expected = math.atan2(4.0 - station.height_m, 40.0 - north) - math.radians(10.0)
    assert pitch_rad(station) == pytest.approx(expected, abs=0.04), "without the pitch offset of the command"


@pytest.mark.parametrize(("output", "lock_flags"), [(0, 28), (2, 12)])
def test_a_neutral_gimbal_points_ahead_of_the_vehicle_with_any_lock(output: int, lock_flags: int) -> None:
    station = PlanStation(sensor_noise=False, parameters={"MNT_MODE_OUT": output})
    station.wait_until_ready_to_arm()
    take_control(station)
    station.command(GIMBAL_PITCH_YAW, -20, 90, NAN, NAN, 28)
    station.run(2)
    station.command(GIMBAL_PITCH_YAW, NAN, NAN, NAN, NAN, 2)
    station.run(2)
    assert station.acks(GIMBAL_PITCH_YAW) == [0, 0]
    assert station.newest_messages["MOUNT_ORIENTATION"].pitch == pytest.approx(0.0, abs=0.5)
    assert math.remainder(station.newest_messages["MOUNT_ORIENTATION"].yaw, 360.0) == pytest.approx(
        0.0, abs=1.0
    )
    assert station.newest_messages["GIMBAL_MANAGER_STATUS"].flags == lock_flags, "as recorded"
