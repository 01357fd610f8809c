"""Two runs with the same seed and stimulus are equal: every byte on every link, and the true state."""

import hashlib

import numpy as np
import pytest

from tests.unit.vehicle_sim.sim_station import NAN, Station
from vehicle_sim.script import script_from_fields
from vehicle_sim.world.files import load_world
from vehicle_sim.yaml_fields import parse_yaml

pytestmark = [pytest.mark.flight, pytest.mark.story]

FAULTS = """
events:
  - {when: airborne, after_s: 1, gusts_m_s: 2}
  - {when: airborne, after_s: 4, gps_offset_ned_m: [3, 0, 0]}
"""


EARLY_S, WHOLE_S = 5.2, 9.0
"""Times after the take-off command; the second fault occurs at about 7 s."""


def flight(seed: int, until_s: float = WHOLE_S, count: int = 2) -> tuple[str, np.ndarray, np.ndarray]:
    """Digest of all received bytes; positions of the vehicles at the early time and at the end."""
    station = Station(
        count=count,
        seed=seed,
        world=load_world("yard"),
        script=script_from_fields(parse_yaml(FAULTS, "faults")),
    )
    digest = hashlib.sha256()
    original = station.sim.frames

    def record(instance: int, link: str) -> list[bytes]:
        frames = original(instance, link)
        digest.update(b"".join(frames))
        return frames

    station.sim.frames = record
    station.run_until(lambda: station.ready, 15)
    station.command(400, 1)
    station.run(0.1)
    station.command(22, -1, 0, 0, NAN, NAN, NAN, station.sim.autopilots[0].home.alt_amsl_m + 5.0)
    station.run(EARLY_S)
    early = station.sim.simulation.truth.position_ned_m.copy()
    station.run(until_s - EARLY_S)
    return digest.hexdigest(), early, station.sim.simulation.truth.position_ned_m.copy()


def test_two_runs_with_the_same_seed_are_bit_identical_and_another_seed_gives_another_flight() -> None:
    bytes_a, early_a, truth_a = flight(7)
    bytes_b, _, truth_b = flight(7)
    _, early_c, _ = flight(8, EARLY_S)
    assert truth_a[0, 2] < -2.0, "the vehicle did not take off"
    assert bytes_a == bytes_b
    assert np.array_equal(truth_a, truth_b)
    assert early_a[0, 2] < -0.2
    assert not np.array_equal(early_a, early_c)
