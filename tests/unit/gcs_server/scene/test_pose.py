"""What the 3D view draws of a vehicle: gimbal, motors, target, label, measured points."""

import math

import pytest

from gcs_server.scene.placement import Placement
from gcs_server.scene.ports import OffboardTarget
from gcs_server.scene.pose import (
    DRAWN_FOR_S,
    HALF_HEIGHT_M,
    gimbal_in_body,
    motor_efforts,
    pose_of,
    upright_lines,
)
from gcs_server.vehicle.samples import DistanceSensor, DistanceSensors, ObstacleDistance, TargetLocal
from missions.frames import rotate
from tests.unit.gcs_server.scene.scene_fakes import (
    FakeIdentity,
    FakeVehicle,
    attitude,
    flying_vehicle,
    gimbal,
    global_position,
    local_position,
    motors,
    q_from_euler,
    status,
)


def drawn_pose(vehicle, offboard=None, now_s=0.0):
    return pose_of(vehicle, Placement().place(vehicle), offboard, now_s)


def target_local(position=(1.0, 2.0, -3.0), velocity=(None, None, None), yaw=0.0):
    return TargetLocal(position, velocity, (None, None, None), yaw, None)


def test_a_level_camera_pointing_ahead_has_no_rotation():
    q = gimbal_in_body(gimbal(q_from_euler(0, 0, 0), yaw_in_earth_frame=False), q_from_euler(0, 0, 1.0), 1.0)
    assert rotate(q, (1, 0, 0)) == pytest.approx((1, 0, 0), abs=1e-9)


def test_a_camera_pitched_down_points_down():
    q = gimbal_in_body(
        gimbal(q_from_euler(0, -math.pi / 2, 0), yaw_in_earth_frame=False), q_from_euler(0, 0, 1.0), 1.0
    )
    assert rotate(q, (1, 0, 0)) == pytest.approx((0, 0, -1), abs=1e-9)


def test_a_camera_yawed_right_points_right():
    q = gimbal_in_body(
        gimbal(q_from_euler(0, 0, math.pi / 2), yaw_in_earth_frame=False), q_from_euler(0, 0, 1.0), 1.0
    )
    assert rotate(q, (1, 0, 0)) == pytest.approx((0, -1, 0), abs=1e-9)


def test_a_camera_locked_to_north_points_north_while_the_vehicle_turns():
    q = gimbal_in_body(
        gimbal(q_from_euler(0, 0, 0), yaw_in_earth_frame=True), q_from_euler(0, 0, math.pi / 2), math.pi / 2
    )
    assert rotate(q, (1, 0, 0)) == pytest.approx((0, 1, 0), abs=1e-9)  # heading east, north is left


def test_a_stabilized_camera_stays_level_while_the_vehicle_tilts():
    q_vehicle = q_from_euler(0.3, -0.2, 0.7)
    q = gimbal_in_body(gimbal(q_from_euler(0, 0, 0), yaw_in_earth_frame=False), q_vehicle, 0.7)
    vehicle = FakeVehicle(values={"attitude": attitude(0.3, -0.2, 0.7)})
    forward = rotate(drawn_pose(vehicle).q_enu_flu, rotate(q, (1, 0, 0)))
    assert forward == pytest.approx((math.sin(0.7), math.cos(0.7), 0.0), abs=1e-9)


def test_without_a_gimbal_no_camera_is_drawn():
    assert gimbal_in_body(None, (1, 0, 0, 0), 0.0) is None
    assert gimbal_in_body(gimbal((0.0, 0.0, 0.0, 0.0), yaw_in_earth_frame=True), (1, 0, 0, 0), 0.0) is None
    assert (
        gimbal_in_body(gimbal((1.0, 0.0, 0.0, 0.0), yaw_in_earth_frame=False), (1, 0, 0, 0), math.nan) is None
    )


def test_motor_speeds_follow_the_outputs_and_are_zero_when_disarmed():
    assert motor_efforts(motors(1000, 1500, 2000, 900, 1), armed=True) == (0.0, 0.5, 1.0, 0.0)
    assert motor_efforts(motors(1500, 1500, 1500, 1500), armed=False) == (0.0, 0.0, 0.0, 0.0)
    assert motor_efforts(motors(1500), armed=True) is None
    assert motor_efforts(None, armed=True) is None


def test_the_target_of_a_stream_is_drawn_in_the_vehicles_frame():
    vehicle = flying_vehicle()
    target = drawn_pose(vehicle, OffboardTarget((1.0, 2.0, -12.0), yaw_ned_rad=0.0)).target
    assert target.position_enu_m == pytest.approx((2.0, 1.0, 12.0), abs=1e-6)
    assert target.yaw_enu_rad == pytest.approx(math.pi / 2)
    assert not target.is_velocity


def test_a_velocity_setpoint_is_drawn_as_a_velocity_target():
    target = drawn_pose(flying_vehicle(), OffboardTarget(velocity_ned_m_s=(2.0, 0.0, 0.0))).target
    assert target.position_enu_m == pytest.approx((0.0, 2.0, 10.0), abs=1e-6)
    assert target.is_velocity


def test_the_vehicles_own_target_is_drawn_while_it_is_fresh_and_the_vehicle_is_armed():
    vehicle = flying_vehicle()
    vehicle.values["target_local"] = target_local()
    assert drawn_pose(vehicle, now_s=1.0).target.position_enu_m == pytest.approx((2.0, 1.0, 3.0), abs=1e-6)
    assert drawn_pose(vehicle, now_s=2.0).target is None
    vehicle.values["status"] = status(armed=False)
    assert drawn_pose(vehicle, now_s=1.0).target is None


@pytest.mark.parametrize("position", [(None, None, -3.0), (math.nan, 0.0, 0.0)])
def test_an_incomplete_target_is_not_drawn(position):
    vehicle = flying_vehicle()
    vehicle.values["target_local"] = target_local(position=position)
    assert drawn_pose(vehicle).target is None


def test_labels_show_the_altitude_above_home_and_notes():
    vehicle = flying_vehicle()
    pose = drawn_pose(vehicle)
    assert (pose.label, pose.note) == ("1 · 10.0 m above home", "simulated")
    vehicle.values["local_position"] = local_position(0.0, 0.0, 0.04)
    vehicle.values["global_position"] = global_position(47.397742, 8.545594, 487.96)
    assert drawn_pose(vehicle).label == "1 · 0.0 m above home"
    vehicle.values["local_position"] = local_position(0.0, 0.0, 0.3)
    vehicle.values["global_position"] = global_position(47.397742, 8.545594, 487.7)
    assert drawn_pose(vehicle).label == "1 · \N{MINUS SIGN}0.3 m above home"


def test_a_lost_vehicle_is_labelled_and_has_no_target():
    vehicle = flying_vehicle()
    vehicle.values["status"] = status(lost=True)
    pose = drawn_pose(vehicle, OffboardTarget((0.0, 0.0, -5.0)))
    assert pose.lost
    assert pose.target is None
    assert pose.note == "connection lost, simulated"


def test_a_vehicle_without_telemetry_has_a_label_without_altitude():
    pose = drawn_pose(FakeVehicle("7", FakeIdentity(replayed=True)))
    assert (pose.label, pose.note) == ("7", "no position, replayed")


def test_measured_points_are_drawn_for_a_limited_time():
    vehicle = flying_vehicle()
    vehicle.values["attitude"] = attitude(yaw=math.pi / 2)
    assert drawn_pose(vehicle).measured_points_enu_m == ()
    sensor_ahead = DistanceSensor(1, (1.0, 0.0, 0.0), 4.0, 0.1, 20.0, None, 0.0)
    sensor_below = DistanceSensor(0, (0.0, 0.0, 1.0), 2.0, 0.1, 20.0, None, 0.0)
    vehicle.values["distance_sensors"] = DistanceSensors((sensor_ahead, sensor_below))
    vehicle.values["obstacle_distance"] = ObstacleDistance("north", 0.0, 5.0, (3.0, 20.01, None), 0.1, 20.0)
    pose = drawn_pose(vehicle)
    x, y, z = pose.position_enu_m
    assert pose.measured_points_enu_m == (
        pytest.approx((x + 4.0, y, z)),
        pytest.approx((x, y + 3.0, z)),
    )
    assert upright_lines(pose.measured_points_enu_m).shape == (2, 2, 3)
    assert upright_lines(((1.0, 2.0, 3.0),))[0, 1, 2] == pytest.approx(3.0 + HALF_HEIGHT_M)
    assert drawn_pose(vehicle, now_s=DRAWN_FOR_S + 0.1).measured_points_enu_m == ()
