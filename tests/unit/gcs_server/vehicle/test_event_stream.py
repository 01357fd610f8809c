"""Events over a link that loses and repeats messages: their order, and requests for missing events."""

from hypothesis import given
from hypothesis import strategies as st

from gcs_server.vehicle.event_stream import MAX_GAP, MAX_REQUESTS, REQUEST_PERIOD_S, EventStream


def started_stream(sequence):
    stream = EventStream()
    assert stream.take(sequence, sequence) == [sequence]
    return stream


@given(
    st.integers(0, 65535),
    st.lists(st.integers(0, 30), min_size=1, max_size=80).map(lambda offsets: [1, *offsets]),
)
def test_events_received_in_any_order_or_repeatedly_are_passed_on_once_and_in_order(first_sequence, offsets):
    stream, passed_on = started_stream(first_sequence), []
    for offset in offsets:
        sequence = (first_sequence + offset) & 0xFFFF
        passed_on += stream.take(sequence, sequence)
    received = set(offsets) | {0}
    first_missing = next(n for n in range(32) if n not in received)
    assert passed_on == [(first_sequence + n) & 0xFFFF for n in range(1, first_missing)]
    assert stream.lost == 0
    request = stream.next_request(0.0)
    after_gap = [n for n in received if n > first_missing]
    if after_gap:
        assert request == tuple((first_sequence + n) & 0xFFFF for n in (first_missing, min(after_gap) - 1))
    else:
        assert request is None


def test_a_gap_is_requested_again_and_finally_skipped():
    stream = started_stream(65534)
    assert stream.take(1, 1) == []
    now_s, requests = 0.0, 0
    for _ in range(200):
        assert stream.take(1, 1) == []  # a repeated event changes nothing
        request = stream.next_request(now_s)
        if request is not None:
            assert request == (65535, 0)
            requests += 1
        if stream.give_up(now_s):
            break
        now_s += 0.05
    assert requests == MAX_REQUESTS
    assert now_s >= MAX_REQUESTS * REQUEST_PERIOD_S
    assert (stream.lost, stream.expected) == (2, 2)


def test_a_recovered_event_releases_the_later_events():
    stream = started_stream(5)
    assert stream.take(7, 7) == []
    assert stream.next_request(0.0) == (6, 6)
    assert stream.is_missing(6)
    assert stream.take(6, 6) == [6, 7]
    assert stream.next_request(10.0) is None


def test_missing_events_after_the_last_received_event_are_found_by_the_current_sequence_number():
    stream = EventStream()
    stream.current(14, 0)
    assert stream.expected == 15  # earlier events are not requested
    assert stream.next_request(0.0) is None
    stream.current(16, 0)
    assert stream.next_request(0.0) == (15, 16)
    assert stream.take(15, 15) == [15]
    assert stream.next_request(1.0) == (16, 16)


def test_events_that_the_vehicle_no_longer_has_are_skipped():
    stream = started_stream(10)
    assert stream.take(20, 20) == []
    assert stream.skip_unavailable(14, 15) == []  # not the expected event
    assert stream.skip_unavailable(11, 18) == []
    assert (stream.expected, stream.lost) == (18, 7)
    assert stream.skip_unavailable(18, 65000) == []  # implausible: only the expected event is skipped
    assert stream.take(19, 19) == [19, 20]


def test_a_large_gap_or_a_reset_restarts_the_sequence():
    stream = started_stream(1000)
    assert stream.take(1000 + MAX_GAP + 2, "far") == ["far"]
    assert stream.take(3, "restarted") == ["restarted"]
    assert stream.lost == 2
    stream.current(500, 1)
    assert stream.take(501, "after") == ["after"]
