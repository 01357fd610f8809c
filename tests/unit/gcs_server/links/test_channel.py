"""When a link is read: as data arrive, or in batches, by its measured rate."""

import pytest

from gcs_server.links.channel import ReadPace


class Source:
    """Sends pieces at a steady rate; a reading takes all that have arrived."""

    def __init__(self, pace):
        self.pace, self.now_s, self.period_s = pace, 100.0, 0.0

    def run(self, pieces_per_s, for_s):
        """Reads for some time; returns the time until the reading after the last."""
        end_s, unread = self.now_s + for_s, 0.0
        while self.now_s < end_s:
            wait_s = self.period_s or 1.0 / pieces_per_s
            self.now_s += wait_s
            unread += pieces_per_s * wait_s
            pieces, unread = int(unread + 1e-9), unread - int(unread + 1e-9)
            self.period_s = self.pace.period_s(pieces, self.now_s)
        return self.period_s


@pytest.mark.parametrize(
    ("pieces_per_s", "period_s"), [(50, 0.0), (500, 0.0), (900, 0.0), (1000, 0.010), (5000, 0.020)]
)
def test_the_rate_decides_how_often_a_link_is_read(pieces_per_s, period_s):
    assert Source(ReadPace()).run(pieces_per_s, for_s=2.0) == period_s


def test_a_link_near_a_limit_does_not_change_its_reading_again_and_again():
    source = Source(ReadPace())
    assert source.run(1000, for_s=1.0) == 0.010
    assert source.run(700, for_s=2.0) == 0.010
    assert source.run(500, for_s=1.0) == 0.0
    assert source.run(900, for_s=2.0) == 0.0


def test_a_flood_is_read_in_batches_before_the_window_ends():
    source = Source(ReadPace())
    source.run(50, for_s=1.0)
    assert source.run(10_000, for_s=0.1) == 0.020


def test_after_a_burst_a_link_is_read_as_data_arrive_again():
    source = Source(ReadPace())
    source.run(3000, for_s=0.2)
    assert source.period_s > 0.0
    assert source.run(50, for_s=0.6) == 0.0


def test_a_first_piece_after_a_pause_is_no_flood():
    pace = ReadPace()
    assert pace.period_s(1, 1.0) == 0.0
    assert pace.period_s(20, 500.0) == 0.0
