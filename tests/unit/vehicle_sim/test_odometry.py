"""ODOMETRY has the variances of position and velocity, in the places and of the size of a recorded PX4."""

import math

import pytest

from tests.contract.replay_vehicle import Vehicle
from vehicle_sim.mavlink.dialect import BY_NAME

RECORDED_POSITION_M2, RECORDED_HEIGHT_M2, RECORDED_SPEED_M2_S2 = 0.0422, 0.0956, 0.0114
"""14 s after the boot of a PX4 v1.16 in software in the loop."""


def test_odometry_has_px4s_variances_and_counts_resets():
    vehicle = Vehicle(1, {})
    vehicle.run(8.0)
    vehicle.compared_ids.add(BY_NAME["ODOMETRY"].id)
    vehicle.run(0.1)
    message = [fields for _, _, name, fields in vehicle.log if name == "ODOMETRY"][-1]
    pose, velocity = message["pose_covariance"], message["velocity_covariance"]
    assert pose[0] == pose[6] == pytest.approx(RECORDED_POSITION_M2, rel=0.2)
    assert pose[11] == pytest.approx(RECORDED_HEIGHT_M2, rel=0.2)
    assert velocity[0] == velocity[6] == velocity[11] == pytest.approx(RECORDED_SPEED_M2_S2, rel=0.2)
    assert all(math.isnan(each) for n, each in enumerate(pose) if n not in (0, 6, 11))
    assert message["reset_counter"] > 0
