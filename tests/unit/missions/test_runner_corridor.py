"""The runner compares the vehicle's position with the corridor of the dry run and with the sent position."""

import math

import pytest

from missions.runner.corridor import OUTSIDE_FOR_S, TOLERANCE_M, Corridor, CorridorWatch
from missions.runner.flown import MAX_SAMPLES, FlownTrack, Stopwatch, state_in_mission
from missions.runner.reading import Reading
from missions.runner.script import ScriptProgress
from tests.support.mission_vehicle import FakeFlight
from tests.support.offboard_missions import flight_steps, mission

CORRIDOR = Corridor(
    ((0.0, 0.0, -10.0), (30.0, 0.0, -10.0), (30.0, 40.0, -10.0)), (1.0, 2.0, 2.0), (1.0,) * 3, (0.5,) * 3
)


@pytest.mark.parametrize(
    ("position", "outside_m"),
    [
        ((10.0, 0.0, -10.0), 0.0),
        ((10.0, 2.0 + TOLERANCE_M, -10.0), 0.0),
        ((10.0, 5.0 + TOLERANCE_M, -10.0), 3.0),
        ((10.0, 0.0, -11.0 - TOLERANCE_M), 0.0),
        ((10.0, 0.0, -14.0 - TOLERANCE_M), 3.0),
        ((10.0, 0.0, -8.5 + TOLERANCE_M), 1.0),
        ((10.0, 5.0 + TOLERANCE_M, -15.0 - TOLERANCE_M), 5.0),
        ((32.0, 20.0, -10.0), 0.0),
        ((-6.0 - TOLERANCE_M, 0.0, -10.0), 4.0),
    ],
)
def test_the_distance_outside_is_measured_from_the_nearest_part_of_the_corridor(position, outside_m):
    watch = CorridorWatch(CORRIDOR)
    watch.update(0.0, position)
    assert watch.outside_m == pytest.approx(outside_m, abs=1e-6)


def test_only_a_long_time_outside_the_corridor_is_reported_and_only_once():
    watch = CorridorWatch(CORRIDOR)
    outside, inside = (10.0, 20.0, -10.0), (10.0, 0.0, -10.0)
    assert not watch.update(0.0, outside)
    assert not watch.update(OUTSIDE_FOR_S - 0.1, outside)
    assert not watch.update(OUTSIDE_FOR_S, inside)
    assert not watch.update(2.0, outside)
    assert watch.update(2.0 + OUTSIDE_FOR_S, outside)
    assert not watch.update(9.0, None)
    assert watch.has_left
    assert watch.update(10.0, inside)
    assert not watch.has_left


@pytest.mark.parametrize("changes", [{"beside_m": (1.0,)}, {"position_ned_m": ((0.0, 0.0, 0.0),)}])
def test_a_corridor_without_bounds_for_each_position_is_refused(changes):
    fields = {
        "position_ned_m": CORRIDOR.position_ned_m,
        "beside_m": (1.0,) * 3,
        "above_m": (1.0,) * 3,
        "below_m": (1.0,) * 3,
    }
    with pytest.raises(ValueError, match="each with its bounds"):
        Corridor(**{**fields, **changes})


def test_leaving_and_reentering_the_corridor_are_reported():
    fake = FakeFlight(
        mission(flight_steps("step: fly, points: [{offset_ned_m: [30, 0, -10]}]")), corridor=CORRIDOR
    ).start()
    fake.until(lambda: fake.flown_path[-1:] != [] and fake.flown_path[-1][0] > 10.0)
    assert fake.status.outside_corridor_m == 0.0
    fake.set_reading(position_ned_m=(12.0, 7.0, -10.0))
    fake.block()
    fake.fly(3.0)
    fake.unblock()
    fake.fly(2.0)
    assert [text for text in fake.event_texts if "corridor" in text][-2:] == [
        "The vehicle is 4.5 m outside the corridor of the dry run.",
        "The vehicle is inside the corridor of the dry run again.",
    ]
    fake.until_state("done")
    assert fake.status.outside_corridor_m is None


def test_flown_and_sent_positions_are_recorded_with_a_limited_length():
    fake = FakeFlight(mission(flight_steps("step: hold, duration_s: 5"))).start().until_state("flying")
    track, status = FlownTrack(), fake.status
    reading_in_flight = Reading(
        position_ned_m=(3.0, 4.0, -10.0),
        stream="flying",
        progress=ScriptProgress(position_ned_m=(0.0, 0.0, -10.0)),
    )
    for tick in range(10 * 4 * MAX_SAMPLES):
        track.record(tick / 10, reading_in_flight.position_ned_m, state_in_mission(reading_in_flight, status))
    assert MAX_SAMPLES / 2 <= len(track.samples) <= MAX_SAMPLES
    assert track.samples[-1].t_s > 3.9 * MAX_SAMPLES
    assert (track.samples[0].deviation_m, track.samples[0].place) == (5.0, "step 2")
    without_setpoints = FlownTrack()
    on_ground = Reading(position_ned_m=(0.0, 0.0, 0.0))
    without_setpoints.record(0.0, on_ground.position_ned_m, state_in_mission(on_ground, status))
    assert (without_setpoints.samples[0].planned_ned_m, without_setpoints.samples[0].deviation_m) == (
        None,
        None,
    )
    assert math.isfinite(without_setpoints.samples[0].t_s)


def test_a_stopwatch_measures_only_while_it_is_running():
    watch = Stopwatch()
    for now_s, running in enumerate([False, True, None, True, False, None, False, True]):
        watch.update(float(now_s), running)
    assert watch.read(9.0) == (4.0 - 1.0) + (9.0 - 7.0)
    watch.update(10.0, is_counted=False)
    assert watch.read(99.0) == 6.0
