"""What `make bench` calls late, on schedules made up here."""

from __future__ import annotations

import pytest

from tests.bench.stream import lateness_s

PERIOD_S = 0.02


def schedule(count: int) -> list[float]:
    """With up to 0.4 ms of lateness, as on a quiet machine."""
    return [100.003 + index * PERIOD_S + 0.0001 * (index % 5) for index in range(count)]


def test_small_lateness_is_seen_as_it_is():
    late, left_out = lateness_s(schedule(500), 1 / PERIOD_S)
    assert (min(late), max(late)) == (pytest.approx(0.0, abs=1e-6), pytest.approx(0.0004, abs=1e-6))
    assert left_out == 0


def test_one_that_is_more_than_half_a_period_late_does_not_shift_the_rest():
    arrivals = schedule(500)
    arrivals[100] += 0.012
    late, left_out = lateness_s(arrivals, 1 / PERIOD_S)
    assert sorted(late)[-2:] == [pytest.approx(0.0004, abs=1e-6), pytest.approx(0.012, abs=1e-6)]
    assert left_out == 0


def test_a_stall_is_late_by_all_of_it_and_leaves_deadlines_out():
    arrivals = schedule(500)
    arrivals[200:203] = [arrivals[202] + 0.005]  # instead of three, one
    late, left_out = lateness_s(arrivals, 1 / PERIOD_S)
    assert max(late) == pytest.approx(0.0452, abs=1e-6)
    assert left_out == 2
