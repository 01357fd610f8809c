"""A program gets messages at the rates that it asks."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from gcs_server.guard.rates import ArrivingRates, AskedRates

ATTITUDE = 30


@given(st.floats(0.5, 100), st.floats(1, 200), st.randoms(use_true_random=False))
def test_the_rate_is_what_was_asked_within_what_arrives(asked_hz, arriving_hz, random):
    rates = AskedRates()
    rates.ask(ATTITUDE, 1e6 / asked_hz)
    duration_s = 40.0 / min(asked_hz, arriving_hz)
    arrivals = [
        n / arriving_hz * (1 + random.uniform(-0.01, 0.01)) for n in range(int(duration_s * arriving_hz))
    ]
    passed = sum(rates.passes(ATTITUDE, 1, t) for t in sorted(arrivals))
    expected = duration_s * min(asked_hz, arriving_hz)
    assert passed <= duration_s * asked_hz * 1.3 + 2
    assert passed >= 0.5 * expected - 2


def test_messages_that_were_not_asked_for_pass_and_stopped_ones_do_not():
    rates = AskedRates()
    assert all(rates.passes(ATTITUDE, 1, t / 100) for t in range(100))
    rates.ask(ATTITUDE, -1)
    assert not any(rates.passes(ATTITUDE, 1, t / 100) for t in range(100))
    rates.ask(ATTITUDE, 0)
    assert rates.passes(ATTITUDE, 1, 2.0)


def test_the_vehicle_is_asked_only_for_what_does_not_arrive_as_fast():
    arriving = ArrivingRates()
    assert arriving.is_slower(ATTITUDE, 100_000)
    assert not arriving.is_slower(ATTITUDE, -1)
    for n in range(30):
        arriving.take(ATTITUDE, n / 50)
    assert not arriving.is_slower(ATTITUDE, 100_000)
    assert not arriving.is_slower(ATTITUDE, 20_000)
    assert arriving.is_slower(ATTITUDE, 10_000)
    assert not arriving.is_slower(ATTITUDE, 0)
