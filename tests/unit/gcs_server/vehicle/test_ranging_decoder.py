"""DISTANCE_SENSOR and OBSTACLE_DISTANCE as topics, and as rays for the stream."""

import math

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.vehicle.decoders import distance_sensors, obstacle_distance
from gcs_server.vehicle.numbers import Unusable
from gcs_server.vehicle.samples import Sample
from gcs_server.vehicle.scans import scans_of
from missions.frames import q_from_euler

DOWN, CUSTOM = d.MAV_SENSOR_ROTATION_PITCH_270, d.MAV_SENSOR_ROTATION_CUSTOM
BODY = d.MAV_FRAME_BODY_FRD


def sensor(measured_cm, *, sensor_id=0, orientation=0, time_ms=1000, max_cm=2000, **more):
    message = d.MAVLink_distance_sensor_message(
        time_ms, 10, max_cm, measured_cm, 0, sensor_id, orientation, 0, **more
    )
    return {d.MAVLINK_MSG_ID_DISTANCE_SENSOR | sensor_id << 24: encode_payload(message)}


def obstacle_sectors(distances, *, step=5, max_cm=2000, **more):
    cm = [*distances, *[65535] * (72 - len(distances))]
    message = d.MAVLink_obstacle_distance_message(5_000_000, 0, cm, step, 10, max_cm, **more)
    return {d.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: encode_payload(message)}


def test_each_sensor_has_direction_distance_range_and_age():
    value, boot_s = distance_sensors(
        sensor(300, orientation=DOWN, time_ms=900) | sensor(1234, sensor_id=1, horizontal_fov=0.5)
    )
    down, ahead = value.sensors
    assert (down.direction_frd, down.distance_m, down.behind_s) == ((0.0, 0.0, 1.0), 3.0, 0.1)
    assert (ahead.direction_frd, ahead.distance_m, ahead.width_rad) == ((1.0, 0.0, 0.0), 12.34, 0.5)
    assert (ahead.range_min_m, ahead.range_max_m, ahead.behind_s, boot_s) == (0.1, 20.0, 0.0, 1.0)


def test_an_invalid_signal_is_unknown_and_a_sensor_without_a_known_direction_is_ignored():
    value, _ = distance_sensors(sensor(300, signal_quality=1))
    assert value.sensors[0].distance_m is None
    turned_right = q_from_euler(0.0, 0.0, math.pi / 2)
    value, _ = distance_sensors(sensor(300, orientation=CUSTOM, quaternion=turned_right))
    assert value.sensors[0].direction_frd == pytest.approx((0.0, 1.0, 0.0))
    for unusable in (
        sensor(300, orientation=13),
        sensor(300, orientation=CUSTOM, quaternion=[math.nan] * 4),
        sensor(300, max_cm=0),
    ):
        with pytest.raises(Unusable):
            distance_sensors(unusable)


def test_sectors_are_decoded_with_step_offset_and_frame():
    value, boot_s = obstacle_distance(
        obstacle_sectors([500, 2001], step=0, increment_f=7.5, angle_offset=-15.0, frame=BODY)
    )
    assert (value.frame, value.first_deg, value.step_deg, boot_s) == ("body", -15.0, 7.5, 5.0)
    assert value.distances_m[:3] == (5.0, 20.01, None)
    assert len(value.distances_m) == 48, "the sectors are more than a full circle"
    assert obstacle_distance(obstacle_sectors([500]))[0].frame == "north"
    for unusable in (
        obstacle_sectors([500], step=0),
        obstacle_sectors([500], max_cm=0),
        obstacle_sectors([500], angle_offset=math.nan),
    ):
        with pytest.raises(Unusable):
            obstacle_distance(unusable)


def sample(decoded, received_s=100.0):
    return Sample("x", None, 0.0, received_s, decoded[0])


def test_rays_turn_with_the_vehicle_and_have_their_time_of_measurement():
    facing_east = q_from_euler(0.0, 0.0, math.pi / 2)
    sensors = sample(distance_sensors(sensor(300, orientation=DOWN, time_ms=500) | sensor(2500, sensor_id=1)))
    sectors = sample(obstacle_distance(obstacle_sectors([500, 2001], frame=BODY)))
    down, ahead, sector_scan = scans_of((sensors, sectors), facing_east, 100.5)
    assert (down.directions_ned[0], down.distances_m, down.measured_s) == (
        pytest.approx((0.0, 0.0, 1.0)), (3.0,), 99.5,
    )  # fmt: skip
    assert ahead.directions_ned[0] == pytest.approx((0.0, 1.0, 0.0))
    assert ahead.distances_m == (None,), "a distance beyond the range of 20 m was used"
    assert sector_scan.directions_ned[0] == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)
    assert sector_scan.distances_m == (5.0, None)
    assert sector_scan.half_angle_rad == pytest.approx(math.radians(2.5))
    assert all(scan.plausible for scan in (down, ahead, sector_scan))
    assert scans_of((sensors, sectors, None), facing_east, 104.0) == ()


def test_sectors_in_the_body_frame_tilt_with_the_vehicle_and_sectors_in_the_north_frame_do_not():
    nose_down = q_from_euler(0.0, -0.3, 0.0)
    body = scans_of((sample(obstacle_distance(obstacle_sectors([500], frame=BODY))),), nose_down, 100.0)[0]
    north = scans_of((sample(obstacle_distance(obstacle_sectors([500], frame=0))),), nose_down, 100.0)[0]
    assert body.directions_ned[0][2] == pytest.approx(math.sin(0.3))
    assert north.directions_ned[0] == (1.0, 0.0, 0.0)
