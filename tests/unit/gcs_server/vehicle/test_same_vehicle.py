"""Evidence, over time, that two endpoints belong to one vehicle or to two."""

import random
from types import SimpleNamespace

import pytest

from gcs_server.vehicle.endpoint import BOOT_TIME_EVERY_S
from gcs_server.vehicle.same_vehicle import SameVehicleWatch


class FakeEndpoint(SimpleNamespace):
    """An endpoint that reports its boot time."""

    __hash__ = object.__hash__

    def __eq__(self, other):
        return self is other


def endpoint(connection, uid=None):
    return FakeEndpoint(
        connection=connection, system_id=1, unique_uid=uid, boot_at_s=None, boot_next_s=float("-inf")
    )


def decisions(boots_of, seconds=30.0, uids=(None, None), connections=("a", "b")):
    """The decision after each of the updates; `boots_of` gives both boot times at a time."""
    first, second = (endpoint(c, uid) for c, uid in zip(connections, uids, strict=True))
    watch, results = SameVehicleWatch(), []
    for step in range(int(seconds * 4)):
        now_s = 1000.0 + step / 4
        for each, boot_s in zip((first, second), boots_of(step / 4), strict=True):
            if boot_s is not None:
                each.boot_at_s, each.boot_next_s = boot_s, now_s + BOOT_TIME_EVERY_S
        watch.update((first, second), now_s)
        results.append(watch.is_same(first, second, now_s))
    return results


def test_uids_decide_at_once_and_against_boot_times():
    assert decisions(lambda _: (900.0, 100.0), 0.5, uids=("x", "x")) == [True, True]
    assert decisions(lambda _: (900.0, 900.0), 60.0, uids=("x", "y"))[-1] is False


def test_agreeing_boot_times_decide_after_five_seconds_and_differing_ones_after_ten():
    same = decisions(lambda _: (900.0, 900.016))
    assert (same.index(True), same[-1]) == (20, True)
    other = decisions(lambda _: (900.0, 930.0))
    assert (other.index(False), other[-1]) == (40, False)


@pytest.mark.parametrize("seed", range(20))
def test_radio_delays_never_separate_a_vehicle_nor_merge_two(seed):
    rng = random.Random(seed)
    delays = decisions(lambda _: (900.0, 900.0 + rng.choice((0.0, 0.1, 1.0, 2.5))), 120.0)
    assert False not in delays
    two = decisions(lambda _: (900.0, 901.0 + rng.uniform(-0.2, 0.6)), 120.0)
    assert True not in two


def test_a_change_of_the_evidence_and_a_missing_boot_time_begin_anew():
    assert True not in decisions(lambda t_s: (900.0, 900.0 if t_s % 5 < 4 else 907.0), 60.0)
    assert decisions(lambda t_s: (900.0, 900.0 if t_s < 2 else None), 30.0).count(True) <= 2
    assert decisions(lambda _: (None, 900.0), 30.0)[-1] is None


def test_two_peers_that_send_on_one_link_are_two_vehicles():
    assert decisions(lambda _: (900.0, 900.0), connections=("a", "a"))[-1] is False
