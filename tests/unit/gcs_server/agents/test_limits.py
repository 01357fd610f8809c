"""The limit of an agent's calls."""

import pytest

from gcs_server.agents.limits import CallLimit


def test_calls_beyond_the_limit_wait_until_the_next_is_due():
    limit = CallLimit(30)
    assert [limit.take(100.0) for _ in range(30)] == [0.0] * 30
    assert limit.take(100.0) == pytest.approx(2.0)
    assert limit.take(101.0) == pytest.approx(1.0)
    assert limit.take(102.1) == 0.0
    assert limit.take(102.1) > 0.0


def test_a_long_silence_does_not_collect_more_calls_than_a_minutes():
    limit = CallLimit(30)
    limit.take(0.0)
    assert sum(limit.take(10_000.0) == 0.0 for _ in range(100)) == 30


def test_a_clock_that_steps_back_gives_no_calls():
    limit = CallLimit(1)
    assert limit.take(100.0) == 0.0
    assert limit.take(40.0) == pytest.approx(60.0)
    assert limit.take(99.0) > 0.0
