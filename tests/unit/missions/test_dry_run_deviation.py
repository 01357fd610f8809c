"""The deviation of simulated flights from the nominal flight; delays are no deviation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from missions.dry_run.corridor import MAX_STATIONS, SPACING_M, Stations, corridor, deviation
from missions.dry_run.document import plain
from missions.dry_run.pilot import Step
from missions.dry_run.track import Track

TICK_S = 0.1
HEIGHT_M = 10.0
TURN = np.linspace(0.0, 2 * math.pi, 400)
PATHS = {
    "straight": np.array([[0.0, 0.0], [120.0, 0.0]]),
    "curved": np.stack([40.0 * np.sin(TURN / 3), 40.0 - 40.0 * np.cos(TURN / 3)], axis=1),
    "crossing itself": np.stack([40.0 * np.sin(TURN), 25.0 * np.sin(2 * TURN)], axis=1),
    "flown there and back twice": np.array([[0.0, 0.0], [30.0, 0.0]] * 2 + [[0.0, 0.0]]),
    "several rounds": np.stack([12.0 * np.cos(3 * TURN), 12.0 * np.sin(3 * TURN)], axis=1),
}


def fly(
    path: np.ndarray,
    *,
    speed_m_s: float = 5.0,
    waits_s: dict[float, float] | None = None,
    steps: Sequence[tuple[str, float]] = (("step 1", 0.0),),
    finished: bool = True,
) -> Track:
    """The track of a flight along a path.

    Args:
        path: corners of the path, (N, 2) at HEIGHT_M or (N, 3).
        speed_m_s: constant speed along the path.
        waits_s: waiting times, by the distance along the path.
        steps: names of the steps, and the distances along the path where they begin.
        finished: whether the flight has completed the plan.
    """
    if path.shape[1] == 2:
        path = np.column_stack([path, np.full(len(path), -HEIGHT_M)])
    corners_m = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    along_m = np.append(np.arange(0.0, corners_m[-1], speed_m_s * TICK_S), corners_m[-1])
    for wait_at_m, wait_s in (waits_s or {}).items():
        index = int(np.searchsorted(along_m, wait_at_m))
        along_m = np.insert(along_m, index, np.full(round(wait_s / TICK_S), min(wait_at_m, corners_m[-1])))
    position = np.stack([np.interp(along_m, corners_m, axis) for axis in path.T], axis=1)
    step_starts_m = [start_m for _, start_m in steps]
    step = np.searchsorted(step_starts_m, along_m, side="right") - 1
    track_steps = tuple(Step(name, "", None) for name, _ in steps)
    t_s = TICK_S * np.arange(len(along_m))
    return Track(t_s, position, np.ones(len(t_s)), step, track_steps, finished=finished)


def compare(nominal: Track, flight: Track) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions of the stations on the nominal path; horizontal and vertical deviation at each station."""
    path = Stations.from_track(nominal, SPACING_M, MAX_STATIONS)
    return path.position_ned_m, *deviation(path, flight)


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
@pytest.mark.parametrize("seed", range(3))
def test_a_flight_that_waits_anywhere_or_flies_slower_does_not_deviate(path, seed):
    random = np.random.default_rng(seed)
    waits = dict(zip(random.uniform(0.0, 120.0, 5), random.uniform(1.0, 60.0, 5), strict=True))
    _, across, above = compare(fly(path), fly(path, speed_m_s=random.uniform(1.0, 9.0), waits_s=waits))
    assert across == pytest.approx(0.0, abs=0.05)
    assert above == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("name", ["straight", "curved"])
def test_a_flight_beside_the_path_deviates_by_its_distance_and_delays_have_no_effect(name):
    path = PATHS[name]
    ahead = np.gradient(path, axis=0)
    right = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / np.linalg.norm(ahead, axis=1)[:, None]
    beside = np.column_stack([path + 4.0 * right, np.full(len(path), -HEIGHT_M - 1.5)])
    _, across, above = compare(fly(path), fly(beside, speed_m_s=3.0, waits_s={20.0: 30.0, 61.0: 8.0}))
    assert across == pytest.approx(4.0, abs=0.05)
    assert above == pytest.approx(1.5, abs=0.01)


def test_each_pass_of_a_path_that_retraces_itself_has_its_own_deviation():
    path = np.array([[0.0, 0.0], [60.0, 0.0], [0.0, 0.0]])
    flown_path = np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 5.0], [0.0, 5.0]])
    stations_ned_m, across, _ = compare(fly(path), fly(flown_path, waits_s={20.0: 40.0}))
    turn_index = int(stations_ned_m[:, 0].argmax())  # 12 stations are 6 m
    assert across[: turn_index - 12] == pytest.approx(0.0, abs=0.05)
    assert across[turn_index + 12 :] == pytest.approx(5.0, abs=0.05)


def test_each_pass_of_a_path_that_crosses_itself_has_its_own_deviation():
    path = np.array([[-40.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0], [0.0, -40.0]])
    flown_path = path + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [6.0, 0.0], [6.0, 0.0]])
    stations_ned_m, across, _ = compare(fly(path), fly(flown_path, speed_m_s=2.0, waits_s={40.0: 60.0}))
    crossing = np.flatnonzero(np.hypot(stations_ned_m[:, 0], stations_ned_m[:, 1]) < 3.0)
    first, second = crossing[crossing < 120], crossing[crossing >= 120]  # passes the origin twice
    assert min(len(first), len(second)) > 5
    assert across[first] == pytest.approx(0.0, abs=0.05)
    assert across[second] == pytest.approx(6.0, abs=0.05)


def test_the_climb_and_the_descent_at_one_position_are_compared_separately():
    vertical_path = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -30.0], [0.0, 0.0, 0.0]])
    flown_path = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -30.0], [3.0, 0.0, -30.0], [3.0, 0.0, 0.0]])
    stations_ned_m, across, above = compare(
        fly(vertical_path), fly(flown_path, waits_s={15.0: 20.0, 33.0: 9.0})
    )
    top_index = int(stations_ned_m[:, 2].argmin())  # 8 stations are 4 m
    assert across[: top_index - 8] == pytest.approx(0.0, abs=0.05)
    assert across[top_index + 8 :] == pytest.approx(3.0, abs=0.05)
    assert above == pytest.approx(0.0, abs=0.05)


def test_a_detour_and_a_drift_while_hovering_are_deviations_only_where_they_happen():
    path = np.array([[0.0, 0.0], [100.0, 0.0]])
    detour = np.array([[0.0, 0.0], [40.0, 0.0], [45.0, 7.0], [55.0, 7.0], [60.0, 0.0], [100.0, 0.0]])
    drift = np.array([[0.0, 0.0], [70.0, 0.0], [70.0, -9.0], [70.0, 0.0], [100.0, 0.0]])
    for flown_path, begin_m, end_m, greatest_m in ((detour, 40.0, 60.0, 7.0), (drift, 70.0, 70.0, 9.0)):
        stations_ned_m, across, _ = compare(fly(path), fly(flown_path, waits_s={52.0: 12.0}))
        assert across.max() == pytest.approx(greatest_m, abs=0.05)
        outside = (stations_ned_m[:, 0] < begin_m - 5.0) | (stations_ned_m[:, 0] > end_m + 5.0)
        assert across[outside] == pytest.approx(0.0, abs=0.05)


def test_a_short_deviation_between_two_stations_of_a_long_path_is_detected():
    path = np.array([[0.0, 0.0], [1500.0, 0.0], [1500.0, 30.0], [0.0, 30.0]])
    bump = np.array([[0.0, 0.0], [707.0, 0.0], [709.0, 3.0], [711.0, 0.0], [1500.0, 0.0], *path[2:].tolist()])
    stations_ned_m, across, _ = compare(fly(path, speed_m_s=10.0), fly(bump, speed_m_s=10.0))
    assert len(stations_ned_m) == MAX_STATIONS
    assert 2.0 < across.max() <= 3.01
    away_from_bump = (abs(stations_ned_m[:, 0] - 709.0) > 30.0) & (stations_ned_m[:, 0] < 1490.0)
    assert across[away_from_bump] == pytest.approx(0.0, abs=0.05)


# --- incomplete flights and other branches ----------------------------------------------------------

STEPS = (("step 1", 0.0), ("step 2", 40.0), ("step 3", 80.0))


@pytest.mark.parametrize("end_m", [25.0, 60.0, 110.0])
def test_a_flight_that_ends_early_is_compared_up_to_its_end(end_m):
    path = np.array([[0.0, 0.0], [120.0, 0.0]])
    flown_path = np.array([[0.0, 2.0], [end_m, 2.0]])
    steps = tuple(each for each in STEPS if each[1] < end_m)
    stations_ned_m, across, _ = compare(
        fly(path, steps=STEPS), fly(flown_path, speed_m_s=3.0, steps=steps, finished=False)
    )
    up_to_end = stations_ned_m[:, 0] <= end_m - SPACING_M
    assert across[up_to_end] == pytest.approx(2.0, abs=0.01)
    assert np.isnan(across[stations_ned_m[:, 0] > end_m + 2 * SPACING_M]).all()


def test_steps_after_the_end_of_an_incomplete_nominal_flight_are_not_compared():
    path, longer_path = np.array([[0.0, 0.0], [60.0, 0.0]]), np.array([[0.0, 1.0], [90.0, 1.0], [90.0, 90.0]])
    _, across, _ = compare(fly(path, steps=STEPS[:2], finished=False), fly(longer_path, steps=STEPS))
    assert across == pytest.approx(1.0, abs=0.05)


def test_the_steps_of_another_branch_are_not_compared():
    rounds = np.stack([40.0 + 15.0 * np.sin(TURN), 15.0 - 15.0 * np.cos(TURN)], axis=1)
    with_round = np.vstack([[[0.0, 0.0]], rounds, [[120.0, 0.0]]])
    circumference_m = 2 * math.pi * 15.0
    branch = (("step 1", 0.0), ("step 2.1", 40.0), ("step 3", 40.0 + circumference_m))
    nominal = fly(with_round, steps=branch)
    without_round = fly(np.array([[0.0, 0.0], [120.0, 0.0]]), steps=(("step 1", 0.0), ("step 3", 40.0)))
    stations_ned_m, across, _ = compare(nominal, without_round)
    on_round = stations_ned_m[:, 1] > 1.0
    assert np.isnan(across[on_round]).all()
    assert across[~np.isnan(across)] == pytest.approx(0.0, abs=0.1)
    # The share of the stations that belong to the common steps; the nominal path is 217 m long.
    straight_share = 120.0 / SPACING_M / (1 + 217.0 / SPACING_M)
    assert np.isfinite(across).sum() > 0.8 * straight_share * len(stations_ned_m)
    assert corridor(nominal, [without_round, nominal]).width_m < 0.1


def test_a_flight_without_any_common_step_is_not_compared():
    path = np.array([[0.0, 0.0], [60.0, 0.0]])
    _, across, above = compare(fly(path), fly(path, steps=(("step 9", 0.0),)))
    assert np.isnan(across).all()
    assert np.isnan(above).all()


# --- the corridor -----------------------------------------------------------------------------------


def test_a_corridor_has_the_quantiles_of_its_flights():
    path = np.array([[0.0, 0.0], [40.0, 0.0]])
    flights = [fly(path + np.array([0.0, 0.5 * k]), speed_m_s=3.0 + 0.2 * k) for k in range(21)]
    result = corridor(fly(path), flights)
    assert result.horizontal_m.p50[20] == pytest.approx(5.0, abs=0.05)
    assert result.horizontal_m.p95[20] == pytest.approx(9.5, abs=0.05)
    assert result.width_m == pytest.approx(10.0)
    assert result.vertical_m.greatest == pytest.approx(0.0, abs=1e-6)
    document = plain(result)
    assert len(document["t_s"]) == len(document["position_ned_m"]) == len(document["horizontal_m"]["p95"])


def test_an_incomplete_flight_widens_the_corridor_only_where_it_flew():
    path = np.array([[0.0, 0.0], [40.0, 0.0]])
    incomplete_flight = fly(np.array([[0.0, 5.0], [16.0, 5.0]]), finished=False)
    result = corridor(fly(path), [incomplete_flight, fly(path + np.array([0.0, -3.0]))])
    assert result.width_m == pytest.approx(5.0)
    assert result.horizontal_m.greatest[-1] == pytest.approx(3.0)


def test_the_stations_of_a_flight_without_motion_extend_from_its_start_to_its_end():
    hover_flight = fly(np.array([[0.0, 0.0], [0.0, 0.0]]), waits_s={0.0: 20.0})
    result = corridor(hover_flight, [replace(hover_flight, position_ned_m=hover_flight.position_ned_m + 2.0)])
    assert (result.t_s[0], result.t_s[-1]) == pytest.approx((0.0, 20.0))
    assert result.width_m == pytest.approx(2.0 * math.sqrt(2.0))
    assert result.vertical_m.greatest == pytest.approx(-2.0)
