"""Two runs with the same seed and stimulus are equal: every byte on every link, and the true state."""

import hashlib

import numpy as np
import pytest

from tests.unit.vehicle_sim.sim_station import ARM_DISARM, NAN, TAKEOFF_COMMAND, Station
from vehicle_sim.script import script_from_fields
from vehicle_sim.world.files import load_world
from vehicle_sim.yaml_fields import parse_yaml

pytestmark = [pytest.mark.flight, pytest.mark.story]

FAULTS = """
events:
  - {when: airborne, after_s: 1, gusts_m_s: 2}
  - {when: airborne, after_s: 4, gps_offset_ned_m: [3, 0, 0]}
"""


EARLY_S, END_S = 5.2, 9.0
"""Times after the take-off command, before and after the second fault (about 7 s)."""


def fly_with_faults(seed: int, until_s: float = END_S, count: int = 2) -> tuple[str, np.ndarray, np.ndarray]:
    """Digest of all received bytes; positions of the vehicles at the early time and at the end."""
    station = Station(
        count=count,
        seed=seed,
        world=load_world("yard"),
        script=script_from_fields(parse_yaml(FAULTS, "faults")),
    )
    digest = hashlib.sha256()
    original_frames = station.sim.frames

    def record(instance: int, link: str) -> list[bytes]:
        frames = original_frames(instance, link)
        digest.update(b"".join(frames))
        return frames

    station.sim.frames = record
    station.run_until(lambda: station.can_be_armed, 15)
    station.command(ARM_DISARM, 1)
    station.run(0.1)
    station.command(TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, station.sim.autopilots[0].home.alt_amsl_m + 5.0)
    station.run(EARLY_S)
    early_position_ned_m = station.sim.simulation.truth.position_ned_m.copy()
    station.run(until_s - EARLY_S)
    return digest.hexdigest(), early_position_ned_m, station.sim.simulation.truth.position_ned_m.copy()


def test_two_runs_with_the_same_seed_are_bit_identical_and_another_seed_gives_another_flight() -> None:
    digest_a, early_position_a, end_position_a = fly_with_faults(7)
    digest_b, _, end_position_b = fly_with_faults(7)
    _, early_position_c, _ = fly_with_faults(8, EARLY_S)
    assert end_position_a[0, 2] < -2.0, "the vehicle did not take off"
    assert digest_a == digest_b
    assert np.array_equal(end_position_a, end_position_b)
    assert early_position_a[0, 2] < -0.2
    assert not np.array_equal(early_position_a, early_position_c)
