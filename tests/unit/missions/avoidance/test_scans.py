"""Obstacle measurements, and the memory of measured points."""

import math

import pytest

from missions.avoidance.corridor import first_on_line
from missions.avoidance.memory import KEPT_S, MAX_COLUMNS, ObstacleMemory, along_line
from missions.avoidance.scans import (
    Scan,
    measures_down,
    measures_level,
    measures_outwards,
    recent_scans,
    sensor_range_m,
)

SCAN_AHEAD = Scan(10.0, ((1.0, 0.0, 0.0),), (5.0,), 20.0)
SCAN_DOWN = Scan(10.0, ((0.0, 0.0, 1.0),), (3.0,), 30.0)


def test_old_measurements_are_not_used():
    assert recent_scans((SCAN_AHEAD, SCAN_DOWN), 11.0, 1.0) == (SCAN_AHEAD, SCAN_DOWN)
    assert recent_scans((SCAN_AHEAD,), 11.1, 1.0) == ()


def test_a_sensor_measures_only_in_its_direction():
    assert sensor_range_m((SCAN_AHEAD, SCAN_DOWN), math.radians(10)) == 20.0
    assert sensor_range_m((SCAN_AHEAD, SCAN_DOWN), math.radians(20)) is None
    assert sensor_range_m((SCAN_AHEAD,), math.radians(90), yaw_change_rad=math.radians(90)) == 20.0
    for scan, directions in ((SCAN_AHEAD, (True, False, True)), (SCAN_DOWN, (False, True, False))):
        assert (measures_level(scan), measures_down(scan), measures_outwards(scan)) == directions


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
def test_a_scan_with_impossible_values_is_implausible(scan):
    assert not scan.plausible
    assert SCAN_AHEAD.plausible


def test_a_measured_point_is_remembered_at_its_position_for_a_limited_time():
    memory = ObstacleMemory()
    memory.add(SCAN_AHEAD, (1.0, 2.0, -3.0), 0.0)
    assert memory.columns_above(2.0, 11.0).tolist() == [[6.0, 2.0, 3.0]]
    assert not len(memory.columns_above(3.0, 11.0))
    assert not len(memory.columns_above(2.0, 10.0 + KEPT_S + 0.1))


def test_only_the_highest_point_of_a_cell_is_used_and_low_points_are_ignored():
    memory = ObstacleMemory()
    for height_m in (1.0, 3.0, 2.0):
        memory.add(SCAN_AHEAD, (0.0, 0.0, -height_m), 0.5)
    memory.add(SCAN_AHEAD, (0.0, 3.0, -0.4), 0.5)
    assert memory.columns_above(0.0, 10.0).tolist() == [[5.0, 0.0, 3.0]]


def test_memory_is_limited_and_the_oldest_points_are_dropped():
    memory = ObstacleMemory()
    for number in range(MAX_COLUMNS + 10):
        memory.add(SCAN_AHEAD, (0.0, float(number), -1.0), 0.0)
    columns = memory.columns_above(0.0, 10.0)
    assert len(columns) == MAX_COLUMNS
    assert columns[:, 1].min() == 10.0


def test_columns_have_positions_along_and_beside_a_line():
    memory = ObstacleMemory()
    memory.add(SCAN_AHEAD, (0.0, 1.0, -1.0), 0.0)
    columns = along_line(memory.columns_above(0.0, 10.0), (0.0, 0.0), (8.0, 0.0))
    assert columns.along_m.tolist() == [5.0]
    assert columns.across_m.tolist() == [1.0]
    assert columns.from_start_m[0] == pytest.approx(math.sqrt(26.0))
    assert columns.from_end_m[0] == pytest.approx(math.sqrt(10.0))


@pytest.mark.parametrize(
    ("end", "first_m"),
    [
        ((9.0, 0.0, -2.0), 5.0),
        ((4.0, 0.0, -2.0), None),  # the line ends before the obstacle
        ((9.0, 9.0, -2.0), None),  # the line passes beside the obstacle
        ((9.0, 0.0, -8.0), 5.0),  # the line climbs; it starts at the obstacle's altitude
        ((-9.0, 0.0, -2.0), None),
    ],
)
def test_a_measured_obstacle_on_a_straight_line_is_found(end, first_m):
    assert first_on_line((SCAN_AHEAD, SCAN_DOWN), (0.0, 0.0, -2.0), end) == first_m
    assert first_on_line((SCAN_DOWN,), (0.0, 0.0, -2.0), end) is None
