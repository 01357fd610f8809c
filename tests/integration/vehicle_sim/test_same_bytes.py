"""The same seed gives every vehicle the same bytes, in a fleet of any size and in any number of processes."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from tests.support.fleet_bytes import digests

DURATION_WITH_FLIGHT_S = 10.5
"""Simulated time in which the vehicles boot, arm and take off."""


def test_a_vehicle_sends_the_same_bytes_alone_and_in_a_fleet():
    fleet, one_vehicle = digests(0, 3, 2.0), digests(2, 1, 2.0)
    assert fleet[2] == one_vehicle[2]
    assert len(set(fleet.values())) == 3, "two vehicles have the same noise"
    assert digests(2, 1, 2.0, seed=12) != one_vehicle


@pytest.mark.broad
def test_fleets_of_1_40_41_and_100_in_one_process_and_in_two_send_the_same_bytes():
    whole_fleet = digests(0, 100, DURATION_WITH_FLIGHT_S)
    for first, count in ((40, 1), (1, 40), (0, 41)):
        part = digests(first, count, DURATION_WITH_FLIGHT_S)
        assert part == {instance: whole_fleet[instance] for instance in part}, count
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        halves = processes.map(digests, (0, 50), (50, 50), (DURATION_WITH_FLIGHT_S, DURATION_WITH_FLIGHT_S))
        assert {instance: digest for half in halves for instance, digest in half.items()} == whole_fleet
