"""What is seen, and what is remembered of it."""

import math

import pytest

from missions.avoidance.corridor import first_on_line
from missions.avoidance.memory import KEPT_S, MAX_COLUMNS, ObstacleMemory, along
from missions.avoidance.scans import Scan, fresh, measures_down, measures_level, measures_outwards, range_at_m

AHEAD = Scan(10.0, ((1.0, 0.0, 0.0),), (5.0,), 20.0)
DOWN = Scan(10.0, ((0.0, 0.0, 1.0),), (3.0,), 30.0)


def test_old_measurements_are_none():
    assert fresh((AHEAD, DOWN), 11.0, 1.0) == (AHEAD, DOWN)
    assert fresh((AHEAD,), 11.1, 1.0) == ()


def test_a_sensor_sees_where_it_looks_and_one_that_looks_down_sees_no_way():
    assert range_at_m((AHEAD, DOWN), math.radians(10)) == 20.0
    assert range_at_m((AHEAD, DOWN), math.radians(20)) is None
    assert range_at_m((AHEAD,), math.radians(90), turned_rad=math.radians(90)) == 20.0
    assert (measures_level(AHEAD), measures_down(AHEAD), measures_outwards(AHEAD)) == (True, False, True)
    assert (measures_level(DOWN), measures_down(DOWN), measures_outwards(DOWN)) == (False, True, False)


@pytest.mark.parametrize(
    "scan",
    [
        Scan(math.nan, ((1.0, 0.0, 0.0),), (5.0,), 20.0),
        Scan(1.0, ((math.nan, 0.0, 0.0),), (5.0,), 20.0),
        Scan(1.0, ((1.0, 0.0, 0.0),), (math.inf,), 20.0),
        Scan(1.0, ((1.0, 0.0, 0.0),), (-1.0,), 20.0),
        Scan(1.0, ((1.0, 0.0, 0.0),), (5.0,), math.inf),
        Scan(1.0, ((1.0, 0.0, 0.0),), (), 20.0),
    ],
)
def test_numbers_that_cannot_be_are_no_measurement(scan):
    assert not scan.plausible
    assert AHEAD.plausible


def test_a_point_is_remembered_where_it_was_and_for_a_while():
    memory = ObstacleMemory()
    memory.add(AHEAD, (1.0, 2.0, -3.0), 0.0)
    assert memory.above(2.0, 11.0).tolist() == [[6.0, 2.0, 3.0]]
    assert not len(memory.above(3.0, 11.0))
    assert not len(memory.above(2.0, 10.0 + KEPT_S + 0.1))


def test_of_one_place_the_highest_point_counts_and_low_ones_are_left_out():
    memory = ObstacleMemory()
    for height_m in (1.0, 3.0, 2.0):
        memory.add(AHEAD, (0.0, 0.0, -height_m), 0.5)
    memory.add(AHEAD, (0.0, 3.0, -0.4), 0.5)
    assert memory.above(0.0, 10.0).tolist() == [[5.0, 0.0, 3.0]]


def test_memory_is_bounded_and_the_oldest_makes_room():
    memory = ObstacleMemory()
    for number in range(MAX_COLUMNS + 10):
        memory.add(AHEAD, (0.0, float(number), -1.0), 0.0)
    kept = memory.above(0.0, 10.0)
    assert len(kept) == MAX_COLUMNS
    assert kept[:, 1].min() == 10.0


def test_a_line_sees_columns_along_it_and_beside_it():
    memory = ObstacleMemory()
    memory.add(AHEAD, (0.0, 1.0, -1.0), 0.0)
    seen = along(memory.above(0.0, 10.0), (0.0, 0.0), (8.0, 0.0))
    assert seen.along_m.tolist() == [5.0]
    assert seen.across_m.tolist() == [1.0]
    assert seen.from_start_m[0] == pytest.approx(math.sqrt(26.0))
    assert seen.from_end_m[0] == pytest.approx(math.sqrt(10.0))


@pytest.mark.parametrize(
    ("there", "first_m"),
    [
        ((9.0, 0.0, -2.0), 5.0),
        ((4.0, 0.0, -2.0), None),  # it ends before
        ((9.0, 9.0, -2.0), None),  # it passes beside
        ((9.0, 0.0, -8.0), 5.0),  # it climbs, beginning at the obstacle's height
        ((-9.0, 0.0, -2.0), None),
    ],
)
def test_what_is_measured_on_a_straight_way_is_found(there, first_m):
    assert first_on_line((AHEAD, DOWN), (0.0, 0.0, -2.0), there) == first_m
    assert first_on_line((DOWN,), (0.0, 0.0, -2.0), there) is None
