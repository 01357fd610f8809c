"""External vision and odometry: the position source without GPS, if EKF2_EV_CTRL enables them."""

import math

import numpy as np
import pytest

from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.frames import euler_of

pytestmark = pytest.mark.flight

WITHOUT_GPS = {"EKF2_GPS_CTRL": 0, "SYS_HAS_GPS": 0}


def truth(station):
    return station.sim.simulation.truth


def send_vision(station):
    """Sends the true position as VISION_POSITION_ESTIMATE, at about 30 Hz."""
    x, y, z = truth(station).position_ned_m[0]
    roll, pitch, yaw = euler_of(truth(station).q_ned_frd)[0]
    station.send("VISION_POSITION_ESTIMATE", x=x, y=y, z=z, roll=roll, pitch=pitch, yaw=yaw,
                 covariance=[math.nan] * 21)  # fmt: skip


def send_odometry(station, frame=1, frame_yaw_rad=0.0):
    """Sends the true pose and velocity as ODOMETRY in a frame that is turned by this yaw from NED."""
    c, s = math.cos(frame_yaw_rad), math.sin(frame_yaw_rad)
    position, velocity = (
        np.array([c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]])
        for v in (truth(station).position_ned_m[0], truth(station).velocity_ned_m_s[0])
    )
    half_turn_rad = -frame_yaw_rad / 2
    rw, rz = math.cos(half_turn_rad), math.sin(half_turn_rad)
    qw, qx, qy, qz = truth(station).q_ned_frd[0]
    q = [rw * qw - rz * qz, rw * qx - rz * qy, rw * qy + rz * qx, rw * qz + rz * qw]
    x, y, down = position
    vx, vy, vz = velocity
    station.send("ODOMETRY", x=x, y=y, z=down, q=q, vx=vx, vy=vy, vz=vz, frame_id=frame, child_frame_id=frame,
                 pose_covariance=[math.nan] * 21, velocity_covariance=[math.nan] * 21)  # fmt: skip


def estimate(station):
    return station.sim.simulation.estimate


def test_without_gps_and_vision_there_is_no_position():
    station = Station(parameters=WITHOUT_GPS)
    station.run(10)
    assert not estimate(station).valid_position[0]


def test_vision_is_ignored_unless_the_parameter_enables_it():
    station = Station(parameters=WITHOUT_GPS)
    station.run(10, lambda: send_vision(station))
    assert not estimate(station).valid_position[0]


@pytest.mark.story
def test_vision_gives_a_position_which_is_invalid_after_vision_stops():
    station = Station(parameters={**WITHOUT_GPS, "EKF2_EV_CTRL": 15})
    truth(station).position_ned_m[0] = (4.0, -3.0, 0.0)
    station.run(12, lambda: send_vision(station))
    assert estimate(station).valid_position[0]
    assert estimate(station).position_ned_m[0, :2] == pytest.approx([4.0, -3.0], abs=0.15)
    station.run(12)
    assert not estimate(station).valid_position[0]


@pytest.mark.parametrize(("frame", "frame_yaw_rad", "max_error_m"), [(1, 0.0, 0.5), (20, 1.2, 2.5)])
def test_the_estimate_follows_odometry_of_a_moving_vehicle_in_both_frames(frame, frame_yaw_rad, max_error_m):
    """The vehicle rotates frame 20 (local FRD) by its estimated heading, which has an error of some
    degrees."""
    station = Station(parameters={**WITHOUT_GPS, "EKF2_EV_CTRL": 7})
    station.run(4, lambda: send_odometry(station, frame, frame_yaw_rad))
    truth(station).position_ned_m[0, 2] = -200.0
    truth(station).velocity_ned_m_s[0] = (6.0, 2.0, 0.0)
    station.run(3, lambda: send_odometry(station, frame, frame_yaw_rad))
    error = estimate(station).position_ned_m[0] - truth(station).position_ned_m[0]
    assert np.abs(error[:2]).max() < max_error_m
    error = estimate(station).velocity_ned_m_s[0] - truth(station).velocity_ned_m_s[0]
    assert np.abs(error[:2]).max() < 0.4 + 0.3 * max_error_m


def test_an_outlier_of_vision_is_rejected():
    station = Station(parameters={**WITHOUT_GPS, "EKF2_EV_CTRL": 3})
    station.run(6, lambda: send_vision(station))
    before_ned_m = estimate(station).position_ned_m[0].copy()
    station.send("VISION_POSITION_ESTIMATE", x=500.0, y=0.0, z=0.0, covariance=[math.nan] * 21)
    station.run(0.1)
    assert np.abs(estimate(station).position_ned_m[0] - before_ned_m).max() < 0.2


def test_with_gps_a_vision_outlier_has_no_effect():
    station = Station(parameters={"EKF2_EV_CTRL": 15})
    station.run(10)
    station.send("VISION_POSITION_ESTIMATE", x=50.0, y=0.0, z=0.0, covariance=[math.nan] * 21)
    station.run(0.5)
    assert abs(estimate(station).position_ned_m[0, 0]) < 2.0
