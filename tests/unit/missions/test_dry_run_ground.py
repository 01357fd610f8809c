"""Dry runs over the ground of elevation files."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from missions.dry_run.group import dry_run_group
from missions.dry_run.monte_carlo import monte_carlo
from missions.dry_run.result import dry_run
from missions.dry_run.setup import Conditions, GroundGrid, Site
from missions.dry_run.task import MARGIN_M, MAX_SIDE, ground_grid
from missions.offboard.reader import read
from missions.terrain.ground import Ground
from missions.values import HomePosition
from tests.support.dry_runs import AIRCRAFT, HOME, ORIGIN, flyable_plan, short_plan

STEP_DEG = 1e-4
"""Size of a cell; about 11 m from north to south."""
CELLS = 41
"""Cells from north to south, and from west to east."""


def ground(amsl_m_at) -> Ground:
    """Elevation data around home; `amsl_m_at` returns the ground's altitude AMSL [m] at a distance north of
    home [m]."""
    north_deg = HOME.lat_deg + STEP_DEG * (CELLS // 2)
    rows = [float(amsl_m_at(111_195.0 * STEP_DEG * (CELLS // 2 - row))) for row in range(CELLS)]
    amsl_m = np.repeat(np.array(rows, dtype=np.float32)[:, None], CELLS, axis=1)
    return Ground(north_deg, HOME.lon_deg - STEP_DEG * (CELLS // 2), STEP_DEG, STEP_DEG, amsl_m)


def position_deg(north_m: float) -> tuple[float, float]:
    lat_deg, lon_deg, _ = ORIGIN.to_geodetic((north_m, 0.0, 0.0))
    return (lat_deg, lon_deg)


def plateau(height_m: float, from_m: float = 25.0) -> GroundGrid:
    """Level ground that rises to a plateau of this height, over 10 m from `from_m` north of home."""
    north_m = -60.0 + 5.0 * np.arange(40)
    rows = np.clip((north_m - from_m) / 10.0, 0.0, 1.0) * height_m
    return GroundGrid(-60.0, -60.0, 5.0, np.repeat(rows[:, None], 25, axis=1))


def test_heights_are_relative_to_the_ground_at_the_start():
    grid, assumed = ground_grid(ground(lambda north_m: 700.0 + 0.1 * north_m), ORIGIN, [position_deg(80.0)])
    assert grid is not None
    row, column = (round(-start / grid.spacing_m) for start in (grid.north_m, grid.east_m))
    assert grid.altitudes_home_m[row, column] == pytest.approx(0.0, abs=1e-6)
    northernmost_m = grid.north_m + grid.spacing_m * (len(grid.altitudes_home_m) - 1)
    assert northernmost_m >= 80.0 + MARGIN_M
    assert grid.altitudes_home_m[-1, column] == pytest.approx(0.1 * northernmost_m, abs=0.1)
    assert assumed == ["The dry run flies over the ground of the elevation files, on a grid of 11 m."]


def test_a_large_plan_has_a_coarser_grid():
    grid, _ = ground_grid(ground(lambda _: 700.0), ORIGIN, [position_deg(20_000.0)])
    assert grid is not None
    assert max(grid.altitudes_home_m.shape) <= MAX_SIDE
    assert grid.spacing_m == pytest.approx(20_100.0 / (MAX_SIDE - 2))


def test_unknown_ground_is_level_and_reported():
    grid, assumed = ground_grid(
        ground(lambda north_m: math.nan if north_m > 60.0 else 700.0 + 0.2 * north_m),
        ORIGIN,
        [position_deg(80.0)],
    )
    assert grid is not None
    assert np.isfinite(grid.altitudes_home_m).all()
    assert "Where the elevation files have no data" in assumed[1]
    grid, assumed = ground_grid(ground(lambda _: math.nan), ORIGIN, [position_deg(80.0)])
    assert grid is None
    assert assumed == ["The elevation files do not cover the start: the dry run flies over level ground."]


@pytest.mark.flight
def test_a_vehicle_lands_on_higher_ground():
    run = dry_run(flyable_plan(short_plan(45.0)), AIRCRAFT, site=Site(ground=plateau(2.0)))
    assert (run.finished, run.landed) == (True, True)
    assert run.track is not None
    assert run.track.position_ned_m[-1][2] == pytest.approx(-2.0, abs=0.1)
    path = run.document()["path"]
    assert len(path["ground_m"]) == len(path["t_s"])
    assert (path["ground_m"][0], path["ground_m"][-1]) == (0.0, 2.0)


@pytest.mark.flight
def test_every_flight_of_a_path_into_rising_ground_ends_with_a_collision():
    batch = monte_carlo(flyable_plan(short_plan(45.0)), AIRCRAFT, flights=1, site=Site(ground=plateau(20.0)))
    (finding,) = [each for each in batch.nominal.findings if each.code == "obstacle_hit"]
    assert "the ground" in finding.text
    assert finding.position_ned_m is not None
    assert 20.0 < finding.position_ned_m[0] < 35.0
    assert batch.chances["obstacle_hit"].count == 1


@pytest.mark.story
@pytest.mark.flight
def test_a_flight_that_touches_a_gentle_slope_has_a_finding_with_its_position():
    slope = GroundGrid(-60.0, -60.0, 10.0, np.repeat(np.arange(25.0)[:, None] * 0.8, 13, axis=1))
    site = Site(ground=replace(slope, altitudes_home_m=slope.altitudes_home_m - 4.8))
    run = dry_run(flyable_plan(short_plan(100.0)), AIRCRAFT, site=site)
    (finding,) = [each for each in run.findings if each.code == "ground_touched"]
    assert (finding.severity, finding.step) == ("error", "item 2")
    assert finding.position_ned_m is not None
    assert 35.0 < finding.position_ned_m[0] < 70.0


@pytest.mark.story
@pytest.mark.flight
def test_each_vehicle_of_a_mission_starts_on_its_own_ground():
    steps = "[{step: take_off, height_m: 3}, {step: meet, meeting: up}, {step: land}]"
    mission = read(f"name: Hops\nroles:\n  lead: {{steps: {steps}}}\n  left: {{steps: {steps}}}\n")
    lat_deg, lon_deg = position_deg(45.0)
    upper_aircraft = replace(
        AIRCRAFT, home=HomePosition(lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=HOME.alt_amsl_m)
    )
    site = Site(ground=plateau(8.0))
    result = dry_run_group(mission, {"lead": AIRCRAFT, "left": upper_aircraft}, Conditions(), site=site)
    for role, height_m in (("lead", 0.0), ("left", 8.0)):
        run = result.roles[role]
        assert (run.finished, run.landed) == (True, True)
        assert run.track is not None
        heights_m = -run.track.position_ned_m[:, 2]
        assert heights_m[0] == pytest.approx(height_m, abs=0.1)
        assert heights_m.max() == pytest.approx(height_m + 3.0, abs=1.0)
