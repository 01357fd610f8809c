"""The script sampler: the setpoint at each time of a mission, also during pause and resume."""

import functools
import itertools
import math
import pickle
import random

import numpy as np
import pytest

from missions.runner.sampler import ScriptSampler
from missions.runner.script import Script, ScriptChange, TimeScaleLimits
from missions.runner.time_scale import BRAKING_FACTOR
from missions.setpoints import Attitude, Position, Trajectory, Velocity
from tests.support.offboard_missions import flight_steps, timeline

STEP_S = 0.02
LEGS = "step: fly, points: [{offset_ned_m: [40, 0, -10]}, {offset_ned_m: [40, 30, -14]}]"
ORBIT = "step: orbit, center: {offset_ned_m: [20, 0, -10]}, radius_m: 10, speed_m_s: 4, heading: along_path"
VELOCITY = "step: velocity, velocity_ned_m_s: [3, 0, 0], duration_s: 10"
ATTITUDE = "step: attitude, pitch_rad: -0.1, thrust: 0.5, duration_s: 5"
SHAPES = {
    "legs": LEGS,
    "orbit": ORBIT,
    "smooth": LEGS + ", curve: smooth",
    "eight": "step: figure_eight, center: {offset_ned_m: [0, 0, -10]}, length_m: 60, width_m: 30",
}


def script_of_steps(*steps: str) -> Script:
    segments = timeline(flight_steps(*steps)).segments
    return Script("Test", segments[1:-1])


@functools.cache
def script_and_path(name: str) -> tuple[Script, np.ndarray]:
    """A script, and positions of its flight without a pause, (N, 3)."""
    script = script_of_steps(SHAPES[name])
    times = [np.arange(0.0, segment.duration_s, 0.01) for segment in script.segments]
    positions = [
        segment.curve.sample(t).position_ned_m for segment, t in zip(script.segments, times, strict=True)
    ]
    return script, np.concatenate(positions)


def sample_setpoints(sampler: ScriptSampler, start_s: float, for_s: float, **motion):
    """(time, setpoint) of each sample."""
    times = [start_s + k * STEP_S for k in range(1, round(for_s / STEP_S) + 1)]
    return [(t, sampler.at(t, **motion)) for t in times]


def test_the_setpoints_of_a_script_without_a_pause_equal_the_timeline():
    script = script_of_steps(LEGS, "step: hold, duration_s: 3", ORBIT)
    sampler, begin_s = ScriptSampler(script, 0.0), 0.0
    for index, segment in enumerate(script.segments):
        for k in range(1, int(segment.duration_s / 0.1)):
            setpoint = sampler.at(begin_s + k * 0.1)
            assert sampler.progress.index == index
            assert setpoint.position_ned_m == pytest.approx(segment.at(k * 0.1).position_ned_m, abs=1e-6)
        begin_s += segment.duration_s
    assert sampler.at(begin_s + 0.1).position_ned_m == pytest.approx(script.segments[-1].end_ned_m)


@pytest.mark.parametrize("name", sorted(SHAPES))
@pytest.mark.parametrize("seed", range(5))
def test_a_pause_brakes_to_a_stop_on_the_path_within_the_acceleration_limit(name, seed):
    rng = random.Random(seed)
    before_pause_s, stopped_for_s, resumed_for_s = (
        rng.uniform(0.2, 20),
        rng.uniform(0.1, 6),
        rng.uniform(0.2, 4),
    )
    script, path = script_and_path(name)
    sampler = ScriptSampler(script, 0.0)
    sent = sample_setpoints(sampler, 0.0, before_pause_s)
    for paused, for_s in ((True, stopped_for_s), (False, resumed_for_s), (True, 8.0)):
        sampler.change_script(ScriptChange(paused=paused))
        sent += sample_setpoints(sampler, sent[-1][0], for_s)
    assert sampler.progress.rate == 0.0
    last = sent[-1][1]
    assert math.hypot(*(last.velocity_ned_m_s if isinstance(last, Trajectory) else (0.0,))) == 0.0
    # The tolerance of 0.1 m/s² is needed because the steps have a finite length.
    limit_m_s2 = BRAKING_FACTOR * TimeScaleLimits().acceleration_m_s2 + 0.1
    for (_, a), (_, b) in itertools.pairwise(sent):
        if not (isinstance(a, Trajectory) and isinstance(b, Trajectory)):
            continue
        north, east, down = b.acceleration_ned_m_s2
        assert math.hypot(north, east) <= limit_m_s2
        assert abs(down) <= limit_m_s2
        mean_m_s = [(y - x) / STEP_S for x, y in zip(a.position_ned_m, b.position_ned_m, strict=True)]
        expected_m_s = [(x + y) / 2 for x, y in zip(a.velocity_ned_m_s, b.velocity_ned_m_s, strict=True)]
        assert math.dist(mean_m_s, expected_m_s) < 0.25
        acceleration_m_s2 = math.dist(a.velocity_ned_m_s, b.velocity_ned_m_s) / STEP_S
        assert acceleration_m_s2 <= math.hypot(limit_m_s2, limit_m_s2)
    sent_ned_m = np.array([s.position_ned_m for _, s in sent[::5]])
    distance_m = np.linalg.norm(sent_ned_m[:, None] - path[None], axis=2).min(axis=1)
    assert distance_m.max() < 0.1
    sampler.change_script(ScriptChange())
    sample_setpoints(sampler, sent[-1][0], 120.0)
    assert sampler.progress.index == len(script.segments)
    assert math.dist(sampler.progress.position_ned_m, script.segments[-1].end_ned_m) < 1e-6


def test_a_wait_holds_until_a_script_change_ends_the_wait():
    script = script_of_steps(LEGS, "step: wait, until: person, timeout_s: 60", "step: hold, duration_s: 1")
    sampler = ScriptSampler(script, 0.0)
    sample_setpoints(sampler, 0.0, 60.0)
    assert (sampler.progress.waiting, sampler.progress.index) == (True, 1)
    sampler.change_script(ScriptChange(first_open_wait=2))
    sample_setpoints(sampler, 60.0, 0.5)
    assert (sampler.progress.waiting, sampler.progress.index) == (False, 2)
    sample_setpoints(sampler, 60.5, 5.0)
    assert sampler.progress.index == 3


def test_a_wait_that_ends_during_a_pause_moves_the_vehicle_only_after_the_pause():
    script = script_of_steps(LEGS, "step: wait, until: person, timeout_s: 60", ORBIT)
    sampler = ScriptSampler(script, 0.0)
    waiting_ned_m = sample_setpoints(sampler, 0.0, 60.0)[-1][1].position_ned_m
    sampler.change_script(ScriptChange(paused=True))
    sample_setpoints(sampler, 60.0, 3.0)
    sampler.change_script(ScriptChange(paused=True, first_open_wait=2))
    paused = sample_setpoints(sampler, 63.0, 5.0)
    assert not sampler.progress.waiting
    assert {setpoint.position_ned_m for _, setpoint in paused} == {waiting_ned_m}
    sampler.change_script(ScriptChange(first_open_wait=2))
    resumed = sample_setpoints(sampler, 68.0, 5.0)
    assert math.dist(resumed[-1][1].position_ned_m, waiting_ned_m) > 1.0


def test_segments_can_be_appended_while_the_vehicle_waits_at_the_end():
    segments = script_of_steps(LEGS, ORBIT).segments
    sampler = ScriptSampler(Script("Test", segments[:1]), 0.0)
    sent = sample_setpoints(sampler, 0.0, 60.0)
    assert sampler.progress.index == 1
    assert sent[-1][1].position_ned_m == pytest.approx(segments[0].end_ned_m)
    sampler.change_script(ScriptChange(appended=segments[1:]))
    sample_setpoints(sampler, 60.0, 1.0)
    assert sampler.progress.index == 1
    assert sampler.progress.t_s > 0.5


def test_a_paused_velocity_step_brakes_and_then_holds_the_position():
    sampler = ScriptSampler(script_of_steps(VELOCITY), 0.0)
    sample_setpoints(sampler, 0.0, 4.0, position_ned_m=(9.0, 0.0, -10.0))
    assert sampler.progress.position_ned_m is None
    sampler.change_script(ScriptChange(paused=True))
    sent = sample_setpoints(sampler, 4.0, 5.0, position_ned_m=(11.0, 0.5, -10.0))
    speeds = [s.velocity_ned_m_s[0] for _, s in sent if isinstance(s, Velocity)]
    assert speeds == sorted(speeds, reverse=True)
    assert max(a - b for a, b in itertools.pairwise(speeds)) / STEP_S <= 3.1
    assert sent[-1][1] == Position((11.0, 0.5, -10.0), 0.0)
    assert sampler.progress.diverted


def test_a_paused_attitude_step_brakes_the_vehicle():
    sampler = ScriptSampler(script_of_steps(ATTITUDE), 0.0)
    assert isinstance(sample_setpoints(sampler, 0.0, 2.0)[-1][1], Attitude)
    sampler.change_script(ScriptChange(paused=True))
    motion = {"position_ned_m": (3.0, 0.0, -9.0), "velocity_ned_m_s": (2.0, 0.0, 1.0)}
    first_setpoint = sampler.at(2.02, **motion)
    assert isinstance(first_setpoint, Velocity)
    assert first_setpoint.velocity_ned_m_s[0] == pytest.approx(2.0, abs=0.1)
    sent = sample_setpoints(sampler, 2.02, 6.0, **motion)
    assert isinstance(sent[-1][1], Position)


def test_the_segment_after_a_velocity_step_begins_only_at_its_start():
    script = script_of_steps(VELOCITY, LEGS)
    end_ned_m = script.segments[0].end_ned_m
    sampler = ScriptSampler(script, 0.0)
    drifted_ned_m = (end_ned_m[0] - 4.0, end_ned_m[1], end_ned_m[2])
    sent = sample_setpoints(sampler, 0.0, 12.0, position_ned_m=drifted_ned_m)
    assert sampler.progress.index == 0
    assert sent[-1][1] == Position(end_ned_m, 0.0)
    sample_setpoints(sampler, 12.0, 0.5, position_ned_m=end_ned_m)
    assert sampler.progress.index == 1


def test_the_setpoints_do_not_jump_ahead_after_a_stall_of_the_process():
    sampler = ScriptSampler(script_of_steps(LEGS), 0.0)
    setpoint_before = sample_setpoints(sampler, 0.0, 3.0)[-1][1]
    setpoint_after = sampler.at(8.0)
    assert math.dist(setpoint_before.position_ned_m, setpoint_after.position_ned_m) < 2.0


def test_previewing_setpoints_does_not_change_the_flight():
    script = script_of_steps(LEGS)
    previewed_sampler, other_sampler = ScriptSampler(script, 0.0), ScriptSampler(script, 0.0)
    for k in range(1, 100):
        assert previewed_sampler.at(k * STEP_S) == other_sampler.at(k * STEP_S)
        preview = previewed_sampler.setpoint_ahead(3.0)
    assert math.dist(preview.position_ned_m, previewed_sampler.at(100 * STEP_S).position_ned_m) > 1.0


def test_the_first_setpoint_is_repeated_until_the_flight_begins():
    sampler = ScriptSampler(script_of_steps(LEGS), 0.0)
    first_setpoints = [sampler.at(t / 10, waiting=True) for t in range(20)]
    assert len(set(map(str, first_setpoints))) == 1
    sampler.restart_time(2.0)
    assert sampler.at(2.02).position_ned_m == pytest.approx(first_setpoints[0].position_ned_m, abs=0.01)


def test_a_script_can_be_sent_to_another_process():
    script = script_of_steps(LEGS, ORBIT)
    copy = pickle.loads(pickle.dumps(script))
    a, b = ScriptSampler(script, 0.0), ScriptSampler(copy, 0.0)
    assert [a.at(t / 5) for t in range(100)] == [b.at(t / 5) for t in range(100)]


def test_the_sampler_reports_the_avoidance_of_the_current_segment():
    script = script_of_steps(LEGS + ", avoidance: around", "step: hold, duration_s: 3")
    sampler, avoidance = ScriptSampler(script, 0.0), []
    for second in range(1, round(script.segments[0].duration_s) + 3):
        for fifth in range(5):
            sampler.at(second + 0.2 * fifth)
        assert sampler.avoidance == ("around" if sampler.progress.index == 0 else None)
        avoidance.append(sampler.avoidance)
    assert (avoidance[0], avoidance[-1]) == ("around", None)


def test_the_path_ahead_is_reported_without_advancing_the_flight():
    script = script_of_steps(LEGS, "step: wait, until: person, timeout_s: 60")
    sampler = ScriptSampler(script, 0.0)
    for k in range(1, 26):
        sampler.at(0.2 * k)
    progress_before = sampler.progress
    ahead, now = sampler.setpoint_ahead(2.0), sampler.setpoint_ahead(0.0)
    assert sampler.progress == progress_before
    assert math.dist(ahead.position_ned_m, now.position_ned_m) > 1.0
    assert sampler.setpoint_ahead(1e6).position_ned_m == pytest.approx(script.segments[0].end_ned_m)
    sampler.change_script(ScriptChange(paused=True))
    assert sampler.setpoint_ahead(1.0) is None
