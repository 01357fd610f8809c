"""How a fleet is split into processes."""

import pytest

from vehicle_sim import options
from vehicle_sim.simulation import row_east
from vehicle_sim.worker_pool import VEHICLES_PER_PROCESS, Shard, process_count, split_fleet


@pytest.mark.parametrize("vehicles", [1, 2, 7, 100, 250])
@pytest.mark.parametrize("processes", [1, 2, 3, 8])
def test_each_vehicle_is_in_exactly_one_shard(vehicles: int, processes: int) -> None:
    parts = split_fleet(vehicles, processes)
    assert [index for part in parts for index in range(part.first, part.first + part.count)] == list(
        range(vehicles)
    )
    assert len(parts) == min(vehicles, processes)
    assert max(part.count for part in parts) - min(part.count for part in parts) <= 1


def test_start_positions_are_the_same_as_in_one_process() -> None:
    row = row_east(5)
    for part in split_fleet(5, 2):
        assert (row_east(part.count, part.first) == row[part.first : part.first + part.count]).all()


def test_few_vehicles_stay_in_one_process() -> None:
    assert process_count(1) == process_count(VEHICLES_PER_PROCESS) == 1
    assert split_fleet(3, 1) == [Shard(0, 3)]


@pytest.mark.parametrize("arguments", [["--lockstep"], ["--speed", "max"]])
def test_options_that_need_one_clock_use_one_process(arguments: list[str]) -> None:
    assert options.parse(["--instances", "100", *arguments]).processes == 1
