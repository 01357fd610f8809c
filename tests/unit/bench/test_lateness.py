"""The lateness in `make bench`, calculated for artificial schedules."""

from __future__ import annotations

import pytest

from tests.bench.stream import lateness_s

PERIOD_S = 0.02


def schedule(count: int) -> list[float]:
    """Arrivals with up to 0.4 ms of lateness, as on an idle machine."""
    return [100.003 + index * PERIOD_S + 0.0001 * (index % 5) for index in range(count)]


def test_small_lateness_is_measured_correctly():
    lateness, skipped = lateness_s(schedule(500), 1 / PERIOD_S)
    assert (min(lateness), max(lateness)) == (pytest.approx(0.0, abs=1e-6), pytest.approx(0.0004, abs=1e-6))
    assert skipped == 0


def test_a_setpoint_more_than_half_a_period_late_does_not_shift_the_schedule():
    arrivals = schedule(500)
    arrivals[100] += 0.012
    lateness, skipped = lateness_s(arrivals, 1 / PERIOD_S)
    assert sorted(lateness)[-2:] == [pytest.approx(0.0004, abs=1e-6), pytest.approx(0.012, abs=1e-6)]
    assert skipped == 0


def test_the_first_setpoint_after_a_stall_is_late_by_the_stall_and_deadlines_are_skipped():
    arrivals = schedule(500)
    arrivals[200:203] = [arrivals[202] + 0.005]  # one setpoint instead of three
    lateness, skipped = lateness_s(arrivals, 1 / PERIOD_S)
    assert max(lateness) == pytest.approx(2 * PERIOD_S + 0.0052, abs=1e-6)
    assert skipped == 2
