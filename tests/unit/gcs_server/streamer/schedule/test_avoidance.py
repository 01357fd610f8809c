"""Avoidance and brake in a setpoint stream: when they act, and what they report."""

import pytest

from gcs_server.streamer.schedule.pipeline import SetpointPipeline
from gcs_server.streamer.values.limit_values import Bounds
from gcs_server.streamer.values.snapshot import Snapshot
from missions.avoidance.scans import Scan
from missions.fence import Region
from missions.geodesy import LocalOrigin
from missions.runner.script import Script
from missions.setpoints import Path, PathPoint, Position, PositionGlobal, Trajectory, Velocity
from tests.support.offboard_missions import flight_steps, timeline

GOAL = Position((10.0, 0.0, -2.0), 0.0)
ORIGIN = LocalOrigin(47.4, 8.5, 480.0)
ZERO_VELOCITY = (0.0, 0.0, 0.0)


class Stream:
    """A setpoint pipeline of a vehicle 2 m above the origin, with fake sensors; also its fake transport."""

    def __init__(self):
        self.pipeline, self.now_s = SetpointPipeline(self), 100.0
        self.distance_ahead_m, self.avoidance, self.bounds, self.scan_age_s = 3.0, None, Bounds(), 0.0
        self.mission_avoidance = None
        self.position = (0.0, 0.0, -2.0)
        self.report_codes = []

    def load(self, setpoint):
        pass

    def snapshot(self):
        received_s = self.now_s - self.scan_age_s
        scans = (
            Scan(received_s, ((1.0, 0.0, 0.0),), (self.distance_ahead_m,), 20.0),
            Scan(received_s, ((0.0, 0.0, 1.0),), (2.0,), 30.0),
        )
        return Snapshot(
            self.now_s, "offboard", self.position, ZERO_VELOCITY, 0.0,
            bounds=self.bounds, scans=scans, avoidance=self.avoidance,
            mission_avoidance=self.mission_avoidance,
        )  # fmt: skip

    def send(self, setpoint, steps=1):
        """Sets a setpoint; returns the setpoint that is sent after this number of steps."""
        self.pipeline.accept(self.now_s, setpoint, self.snapshot())
        return self.continue_sending(steps)

    def continue_sending(self, steps=1):
        for _ in range(steps):
            self.now_s += 0.1
            self.pipeline.refresh(self.now_s, self.snapshot(), waiting=False)
            self.report_codes += [report.code for report in self.pipeline.take_reports()]
        return self.pipeline.sent


@pytest.fixture
def stream():
    return Stream()


def test_with_avoidance_off_only_the_brake_acts(stream):
    assert stream.send(GOAL).position_ned_m[0] < 2.0
    assert stream.pipeline.limited == ("position limited to stop before an obstacle",)
    assert stream.pipeline.avoiding is None
    assert stream.report_codes == ["limited"]


def test_the_operator_can_switch_off_the_brake_unless_avoidance_is_on(stream):
    stream.bounds = Bounds(obstacle_brake=False)
    assert stream.send(GOAL) == GOAL
    stream.avoidance, stream.distance_ahead_m = "over", 0.8
    velocity = Velocity((3.0, 0.0, 0.0))
    assert stream.send(velocity).velocity_ned_m_s[0] < 0.0


@pytest.mark.parametrize(
    "requested",
    [
        GOAL,
        Trajectory((10.0, 0.0, -2.0), (1.0, 0.0, 0.0), yaw_ned_rad=0.0),
        PositionGlobal(47.4 + 10.0 / 111_195.0, 8.5, 482.0, yaw_ned_rad=0.0),  # 10 m north
        Path((PathPoint(0.0, (0.0, 0.0, -2.0), 0.0), PathPoint(5.0, (10.0, 0.0, -2.0), 0.0))),
    ],
    ids=lambda requested: requested.type,
)
def test_with_avoidance_every_position_setpoint_climbs_over_the_obstacle(stream, requested):
    stream.avoidance, stream.bounds = "over", Bounds(origin=ORIGIN)
    sent = stream.send(requested, 3)
    assert isinstance(sent, Velocity)
    assert sent.velocity_ned_m_s[2] < -0.5
    assert stream.pipeline.avoiding.state == "over"
    assert stream.report_codes == ["avoidance"]


def test_avoidance_reports_that_it_ignores_velocities(stream):
    stream.avoidance = "over"
    sent = stream.send(Velocity((3.0, 0.0, 0.0)), 2)
    assert 0.0 < sent.velocity_ned_m_s[0] < 3.0  # braked
    assert "does not apply" in stream.pipeline.avoiding.text


def test_avoidance_can_be_switched_between_two_setpoints(stream):
    stream.send(GOAL)
    stream.avoidance = "over"
    assert isinstance(stream.continue_sending(), Velocity)
    stream.avoidance = None
    assert isinstance(stream.continue_sending(), Position)
    assert stream.pipeline.avoiding is None


def test_without_a_position_or_without_sensor_data_the_vehicle_is_stopped(stream):
    stream.avoidance = "over"
    stream.scan_age_s = 1.5
    assert stream.send(GOAL).position_ned_m == (0.0, 0.0, -2.0)
    assert stream.pipeline.avoiding.state == "stopped"
    stream.scan_age_s, stream.position = 0.0, None
    assert stream.continue_sending().velocity_ned_m_s == ZERO_VELOCITY
    assert "position estimate" in stream.pipeline.avoiding.text
    assert stream.report_codes.count("avoidance_stopped") == 1


def test_a_sensor_that_stops_sending_is_reported_once_and_the_stream_continues(stream):
    stream.distance_ahead_m = None
    stream.send(Position((3.0, 0.0, -2.0), 0.0), 2)
    stream.scan_age_s = 2.5
    assert stream.continue_sending(5) == Position((3.0, 0.0, -2.0), 0.0)
    assert stream.report_codes == ["obstacle_sensor_lost"]


@pytest.mark.parametrize("requested", [GOAL, Velocity((5.0, 0.0, 0.0))], ids=lambda requested: requested.type)
def test_a_sensor_that_stops_sending_does_not_release_a_braked_vehicle(stream, requested):
    stream.send(requested, 2)
    stream.scan_age_s = 2.5
    assert stream.continue_sending(5) == Position((0.0, 0.0, -2.0), 0.0)
    assert stream.report_codes == ["limited", "obstacle_sensor_lost"]
    assert stream.send(GOAL) == GOAL, "the setpoint after the report was limited"
    stream.scan_age_s = 0.0
    assert stream.continue_sending().position_ned_m[0] < 2.0


def test_a_position_hold_uses_no_avoidance(stream):
    stream.avoidance = "over"
    stream.send(GOAL)
    stream.pipeline.hold_position(stream.now_s, stream.snapshot())
    assert stream.pipeline.sent == Position((0.0, 0.0, -2.0), 0.0)
    assert stream.pipeline.avoiding is None


def test_the_fence_limits_a_detour_like_any_other_setpoint(stream):
    stream.avoidance = "over"
    stream.bounds = Bounds(region=Region(down_min_m=-2.2))
    sent = stream.send(GOAL, 3)
    assert stream.pipeline.avoiding.state == "stopped"
    assert isinstance(sent, Position)


def mission_script(step):
    """The script of a mission with one step, which flies 10 m north through the measured obstacle."""
    return Script("Test", timeline(flight_steps(step)).segments[1:-1])


AVOIDANCE_STEP, STEP_WITHOUT_AVOIDANCE, AROUND_STEP = (
    f"step: fly, points: [{{position_ned_m: [10, 0, -10]}}], avoidance: {avoidance}"
    for avoidance in ("true", "false", "around")
)


def test_avoidance_first_tries_the_way_that_the_mission_step_states(stream):
    stream.position, stream.mission_avoidance, stream.distance_ahead_m = (0.0, 0.0, -10.0), "over", 15.0
    for step, way in ((AVOIDANCE_STEP, "over"), (AROUND_STEP, "around"), (AVOIDANCE_STEP, "over")):
        stream.send(mission_script(step))
        assert stream.pipeline.avoiding.way == way
    stream.avoidance = "around"
    stream.send(mission_script(AVOIDANCE_STEP))
    assert stream.pipeline.avoiding.way == "around", "the mission overrode the operator's choice"


def test_avoidance_of_a_mission_acts_only_while_enabled_and_in_steps_with_avoidance(stream):
    stream.position, stream.mission_avoidance, stream.distance_ahead_m = (0.0, 0.0, -10.0), "over", 15.0
    for step, active in ((AVOIDANCE_STEP, True), (STEP_WITHOUT_AVOIDANCE, False)):
        stream.send(mission_script(step))
        assert (stream.pipeline.avoiding is not None) == active
    stream.mission_avoidance = None
    stream.send(mission_script(AVOIDANCE_STEP))
    assert stream.pipeline.avoiding is None
    stream.avoidance = "around"
    stream.send(mission_script(STEP_WITHOUT_AVOIDANCE))
    assert stream.pipeline.avoiding.state == "clear"


def test_a_detour_continues_into_a_step_without_avoidance(stream):
    stream.position, stream.mission_avoidance = (0.0, 0.0, -10.0), "over"
    stream.send(mission_script(AVOIDANCE_STEP), 3)
    assert stream.pipeline.avoiding.state == "over"
    stream.send(mission_script(STEP_WITHOUT_AVOIDANCE), 3)
    assert stream.pipeline.avoiding.state == "over"
