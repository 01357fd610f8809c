"""How a fleet is split into processes."""

import pytest

from vehicle_sim import options
from vehicle_sim.simulation import row_east
from vehicle_sim.worker_pool import VEHICLES_PER_PROCESS, Shard, process_count, split_fleet


@pytest.mark.parametrize("vehicles", [1, 2, 7, 100, 250])
@pytest.mark.parametrize("processes", [1, 2, 3, 8])
def test_each_vehicle_is_in_exactly_one_shard(vehicles: int, processes: int) -> None:
    shards = split_fleet(vehicles, processes)
    assert [index for shard in shards for index in range(shard.first, shard.first + shard.count)] == list(
        range(vehicles)
    )
    assert len(shards) == min(vehicles, processes)
    assert max(shard.count for shard in shards) - min(shard.count for shard in shards) <= 1


def test_start_positions_are_the_same_as_in_one_process() -> None:
    starts = row_east(5)
    for shard in split_fleet(5, 2):
        assert (row_east(shard.count, shard.first) == starts[shard.first : shard.first + shard.count]).all()


def test_few_vehicles_stay_in_one_process() -> None:
    assert process_count(1) == process_count(VEHICLES_PER_PROCESS) == 1
    assert split_fleet(3, 1) == [Shard(0, 3)]


@pytest.mark.parametrize("arguments", [["--lockstep"], ["--speed", "max"]])
def test_options_that_need_one_clock_use_one_process(arguments: list[str]) -> None:
    assert options.parse(["--instances", "100", *arguments]).processes == 1
