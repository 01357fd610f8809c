"""Setpoints that flight tasks write in each tick, without a flight: climb, headings, estimator resets."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.path import TICK_S, Path
from vehicle_sim.autopilot.sticks import Deflection
from vehicle_sim.autopilot.tasks.climb import Climb
from vehicle_sim.autopilot.tasks.manual import StickTasks
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16, V1_17
from vehicle_sim.simulation import ControlLevel, Simulation


class SetpointRecorder:
    """Stores the last written setpoint; replaces `SetpointWriter`."""

    def trajectory(self, position=None, velocity=None, acceleration=None, yaw=math.nan, rate=math.nan):
        self.position, self.velocity, self.yaw, self.yaw_rate = position, velocity, yaw, rate


class FakeView:
    """A fake vehicle whose estimate is set by the test."""

    def __init__(self, px4=V1_16, **parameters):
        self.px4, self.parameters = px4, Parameters(parameters, px4=px4)
        self.parameter = self.parameters.finite_value
        self.choice = lambda name: int(self.parameters.get(name))
        self.row, self.parameter_changes, self.time_s, self.origin = 0, 0, 0.0, (47.0, 8.0, 500.0)
        self.fusion = SimpleNamespace(
            resets=np.zeros((4, 1), dtype=np.int64),
            heading_reset_counter=np.zeros(1, dtype=np.int64),
            heading_good_for_control=np.ones(1, dtype=np.bool_),
        )
        self.simulation = SimpleNamespace(fusion=self.fusion)
        self.estimate = SimpleNamespace(
            position_ned_m=(0.0, 0.0, 0.0), velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_ned_rad=0.3
        )


HOME = SimpleNamespace(position_ned_m=(0.0, 0.0, 0.0))


def climb_speeds(seconds, **parameters):
    """Vertical velocity setpoints of a take-off while the vehicle is still on the ground."""
    view, setpoints = FakeView(**parameters), SetpointRecorder()
    path = Path(view, setpoints)
    climb = Climb(view, SimpleNamespace(), path, HOME)
    path.restart(in_air=False)
    path.stay_at_vehicle()
    climb.begin(520.0)
    speeds = []
    for _ in range(round(seconds / TICK_S)):
        climb.run()
        speeds.append(setpoints.velocity[2])
    return np.array(speeds)


@pytest.mark.parametrize(("ramp_s", "acceleration_m_s2"), [(3.0, 0.5), (1.0, 1.5)])
def test_a_takeoff_ramp_begins_with_a_descent_setpoint_and_climbs_with_the_acceleration_of_the_ramp(
    ramp_s, acceleration_m_s2
):
    speeds = climb_speeds(8.0, MPC_TKO_RAMP_T=ramp_s)
    climb_begin_s = TICK_S * np.argmax(speeds < 0.0)
    assert speeds[0] == pytest.approx(0.7, abs=0.02)
    assert climb_begin_s == pytest.approx(0.7 / acceleration_m_s2 + acceleration_m_s2 / 8.0, abs=0.06)
    max_acceleration_m_s2 = np.abs(np.diff(speeds)).max() / TICK_S
    assert max_acceleration_m_s2 == pytest.approx(acceleration_m_s2, rel=0.02)
    assert speeds[-1] == pytest.approx(-1.5, abs=0.01)


def test_yaw_is_not_controlled_without_a_good_heading_and_the_current_yaw_is_kept_afterwards():
    view, setpoints = FakeView(), SetpointRecorder()
    path = Path(view, setpoints)
    path.restart(in_air=True)
    view.fusion.heading_good_for_control[0] = False
    view.estimate.yaw_ned_rad = -0.2
    path.write()
    assert math.isnan(setpoints.yaw)
    view.fusion.heading_good_for_control[0] = True
    path.write()
    assert setpoints.yaw == pytest.approx(-0.2)
    path.yaw_target_rad = 1.0
    view.fusion.heading_good_for_control[0] = False
    path.write()
    assert path.yaw_target_rad == 1.0, "the commanded heading was lost"


def turn_rates(view, seconds, north_m):
    """Fed-forward rates of the heading [rad/s] while the nose turns from north to a target in the north."""
    setpoints = SetpointRecorder()
    path = Path(view, setpoints)
    view.estimate.yaw_ned_rad = -2.0
    path.restart(in_air=True)
    path.target_ned_m, path.face_target = (north_m, 0.0, 0.0), True
    rates = []
    for _ in range(round(seconds / TICK_S)):
        path.fly_to_target()
        rates.append(setpoints.yaw_rate)
    return path, np.array(rates)


def test_v1_17_turns_with_limited_acceleration_as_recorded_and_v1_16_with_the_full_rate():
    # A turn of v1.17.0 in Hold: its rate grew by 0.0698 rad/s every 0.2 s, 20 °/s² (MPC_YAWRAUTO_ACC).
    _, rates = turn_rates(FakeView(V1_17), 1.2, 100.0)
    np.testing.assert_allclose(np.diff(rates[9::10]), 0.0698, atol=1e-4)
    path, rates = turn_rates(FakeView(V1_17), 6.0, 100.0)
    assert rates.max() == pytest.approx(math.sqrt(2.0 * math.radians(20.0)), abs=0.01)
    assert path.yaw.yaw_ned_rad == pytest.approx(0.0, abs=1e-3), "it stops at the target without overshoot"
    assert rates[-1] == pytest.approx(0.0, abs=1e-3)
    _, rates = turn_rates(FakeView(), 1.2, 100.0)
    assert rates[-1] > 0.99 * math.radians(45.0)


def test_v1_17_ends_a_turn_near_the_target_and_v1_16_completes_it():
    # The same turn: within 2 m of its target (NAV_ACC_RAD) the rate fell by as much, from 0.59 rad/s to zero.
    for px4, ends_early in ((V1_17, True), (V1_16, False)):
        view = FakeView(px4)
        path, rates = turn_rates(view, 1.4, 100.0)
        view.estimate.position_ned_m = (98.5, 0.0, 0.0)
        path.x.position_m = 98.5
        before_rad = path.yaw.yaw_ned_rad
        for _ in range(150):
            path.fly_to_target()
        if ends_early:
            braking_rad = rates[-1] ** 2 / (2.0 * math.radians(20.0))
            assert path.yaw.yaw_ned_rad == pytest.approx(before_rad + braking_rad, abs=0.01)
        else:
            assert path.yaw.yaw_ned_rad == pytest.approx(0.0, abs=1e-3)


def test_a_heading_reset_also_resets_the_yaw_setpoint():
    view, setpoints = FakeView(), SetpointRecorder()
    path = Path(view, setpoints)
    path.restart(in_air=True)
    path.follow_resets()
    path.write()
    view.estimate.yaw_ned_rad = 2.3
    view.fusion.heading_reset_counter[0] += 1
    path.follow_resets()
    assert path.yaw.yaw_ned_rad == pytest.approx(2.3)
    path.write()
    assert setpoints.yaw == pytest.approx(2.3 - math.radians(view.parameter("MPC_YAWRAUTO_MAX")) * TICK_S)


def test_centred_sticks_hold_position_altitude_and_heading_across_estimator_resets():
    view, setpoints = FakeView(), SetpointRecorder()
    sticks = SimpleNamespace(raw=Deflection(), shaped=Deflection, valid=True)
    stick_tasks = StickTasks(view, setpoints, sticks, HOME)
    stick_tasks.run(NavState.POSITION)
    assert setpoints.position == (0.0, 0.0, 0.0)
    view.estimate.position_ned_m, view.estimate.yaw_ned_rad = (30.0, 31.0, 32.0), 1.3
    stick_tasks.run(NavState.POSITION)
    assert setpoints.position == (0.0, 0.0, 0.0)
    assert setpoints.yaw == pytest.approx(0.3)
    view.estimate.position_ned_m, view.estimate.yaw_ned_rad = (40.0, 41.0, 42.0), 2.3
    view.fusion.resets[2:] += 1
    view.fusion.heading_reset_counter[0] += 1
    stick_tasks.run(NavState.POSITION)
    assert setpoints.position == (40.0, 41.0, 42.0)
    assert setpoints.yaw == pytest.approx(1.3)


def test_a_descent_limit_of_a_vehicle_replaces_the_default():
    sim = Simulation(2, sensor_noise=False)
    sim.setpoints.armed[:] = True
    sim.setpoints.level[:] = ControlLevel.TRAJECTORY
    sim.setpoints.position_ned_m[:] = (0.0, 0.0, 1000.0)
    sim.setpoints.descent_limit_m_s[1] = 1.8
    for _ in range(4):
        sim.step()
    assert sim.target.velocity_ned_m_s[:, 2].tolist() == [1.5, 1.8]
