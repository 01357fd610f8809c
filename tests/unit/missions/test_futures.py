"""Futures of a command: many flights from one state, their corridor, and what they come near to."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from missions.dry_run.clearance import FenceDistance
from missions.dry_run.setup import Obstacle
from missions.errors import PlanError
from missions.frames import q_from_euler
from missions.geodesy import LocalOrigin
from missions.setpoints import Actuators, Attitude, Position, Rates, ThrustTorque, Trajectory, Velocity
from missions.values import FenceCircle, Point
from missions.what_if.futures.commands import GoTo, Hold, Land, Orbit
from missions.what_if.futures.corridor import corridor
from missions.what_if.futures.document import FuturesSpread
from missions.what_if.futures.flight import Flight, Tracks, simulated_parameters
from missions.what_if.futures.futures import Place, fly_futures
from missions.what_if.futures.start import Delay, Deviations, OtherVehicle, Start

HOME = LocalOrigin(47.0, 8.0, 400.0)
START = Start(
    position_ned_m=(0.0, 0.0, -20.0), velocity_ned_m_s=(0.0, 0.0, 0.0), q_ned_frd=(1.0, 0.0, 0.0, 0.0),
    rates_frd_rad_s=(0.0, 0.0, 0.0), ground_down_m=0.0, position_error_m=0.0, height_error_m=0.0,
    wind_ne_m_s=(0.0, 0.0), in_hold=True, hold_target_ned_m=None, battery_share=0.8,
    parameters={}, px4="1.17",
)  # fmt: skip
DELAY = Delay(0.1, 0.1)
EXACT = FuturesSpread(*[0.0] * len(asdict(FuturesSpread())))
"""All flights are the same."""
FLIGHTS = 20


def place(fence=(), radius_m=0.0, height_m=0.0, **around):
    return Place((0.0, 0.0, 0.0), FenceDistance(fence, HOME, radius_m, height_m), **around)


def futures(command, *, start=START, around=None, spread=None, horizon_s=10.0, **options):
    return fly_futures(
        start, command, DELAY, around or place(), text="test", flights=FLIGHTS, horizon_s=horizon_s,
        spread=spread, **options,
    )  # fmt: skip


def streamed(setpoint):
    return lambda _state: setpoint


def end(result):
    return result.corridor.position_ned_m[-1]


def test_a_vehicle_that_hovers_in_still_air_stays():
    result = futures(Hold(), spread=EXACT)
    assert end(result) == pytest.approx((0.0, 0.0, -20.0), abs=0.1)
    assert max(result.corridor.horizontal_m) < 0.3
    assert result.clear
    assert (result.touched_ground, result.lost_control, result.landed) == (0, 0, 0)


def test_a_go_to_arrives_and_the_corridor_grows_with_what_is_not_known():
    result = futures(GoTo((30.0, 0.0, -20.0)), horizon_s=20.0)
    assert result.arrived == FLIGHTS
    assert 9.0 < result.arrival_s.p5 <= result.arrival_s.p50 <= result.arrival_s.p95 < 11.0
    assert math.dist(end(result), (30.0, 0.0, -20.0)) < 1.5
    exact = futures(GoTo((30.0, 0.0, -20.0)), spread=EXACT)
    worse = futures(GoTo((30.0, 0.0, -20.0)), start=replace(START, position_error_m=2.0))
    assert exact.corridor.horizontal_m[25] < result.corridor.horizontal_m[25]
    assert result.corridor.horizontal_m[0] < worse.corridor.horizontal_m[0]


def test_directions_are_equal():
    north = end(futures(GoTo((30.0, 0.0, -20.0), yaw_ned_rad=0.0), spread=EXACT))
    east = end(
        futures(
            GoTo((0.0, 30.0, -20.0), yaw_ned_rad=math.pi / 2),
            start=replace(START, q_ned_frd=q_from_euler(0.0, 0.0, math.pi / 2)),
            spread=EXACT,
        )
    )
    assert (north[0], north[1]) == pytest.approx((east[1], -east[0]), abs=0.05)


def test_equal_seeds_give_equal_futures():
    first, same, other = (futures(GoTo((30.0, 5.0, -25.0)), seed=seed) for seed in (3, 3, 4))
    assert first == same
    assert first.corridor != other.corridor


def test_95_of_100_flights_stay_in_the_corridor():
    draws = Deviations.draw(START, DELAY, FuturesSpread(), 100, 1, 1.0)
    tracks = Flight(START, simulated_parameters(START), GoTo((20.0, 0.0, -20.0)), draws, 0.2, 1).fly(8.0)
    found = corridor(tracks)
    off = tracks.position_ned_m[::2] - np.array(found.position_ned_m)[:, None]
    across = np.hypot(off[:, :, 0], off[:, :, 1]) <= np.array(found.horizontal_m)[:, None] + 0.01
    above = np.abs(off[:, :, 2]) <= np.array(found.vertical_m)[:, None] + 0.01
    assert 95 <= int((across & above).all(axis=0).sum()) < 100


def test_a_corridor_of_equal_flights_has_the_least_width():
    position = np.zeros((3, FLIGHTS, 3))
    flags = np.zeros(FLIGHTS, dtype=bool)
    tracks = Tracks(np.arange(3) * 0.1, position, position, flags, flags, flags, np.ones(FLIGHTS))
    assert corridor(tracks).horizontal_m == [0.0, 0.0]


def test_a_geofence_in_the_way_is_named_with_the_distance():
    center = Point(lat_deg=HOME.lat_deg, lon_deg=HOME.lon_deg)
    fence = (FenceCircle(inclusion=True, center=center, radius_m=15.0),)
    result = futures(GoTo((30.0, 0.0, -20.0)), around=place(fence), spread=EXACT, horizon_s=20.0)
    assert result.fence.touched == FLIGHTS
    assert result.fence.distance_m == pytest.approx(-15.5, abs=2.0)
    assert not result.clear
    inside = futures(GoTo((30.0, 0.0, -20.0)), around=place(radius_m=100.0), spread=EXACT, horizon_s=20.0)
    assert (inside.fence.touched, inside.clear) == (0, True)
    assert inside.fence.distance_m == pytest.approx(69.0, abs=2.0)
    too_high = futures(GoTo((0.0, 0.0, -30.0)), around=place(height_m=25.0), spread=EXACT)
    assert too_high.fence.touched == FLIGHTS


def test_an_obstacle_and_another_vehicle_in_the_way_are_named():
    tower = Obstacle("tower", 15.0, 0.0, 4.0, 4.0, 40.0)
    times = np.array([0.0, 20.0])
    near = OtherVehicle("2", times, np.array([[30.0, 0.0, -20.0], [30.0, 0.0, -20.0]]))
    far = OtherVehicle("3", times, np.array([[90.0, 0.0, -20.0], [90.0, 0.0, -20.0]]))
    around = place(obstacles=[tower, replace(tower, name="mast", east_m=50.0)], others=[far, near])
    result = futures(GoTo((30.0, 0.0, -20.0)), around=around, spread=EXACT, horizon_s=20.0)
    assert (result.obstacle.name, result.obstacle.touched) == ("tower", FLIGHTS)
    assert (result.vehicle.name, result.vehicle.touched) == ("2", FLIGHTS)
    assert result.vehicle.t_s > result.obstacle.t_s
    away = futures(GoTo((-30.0, 0.0, -20.0)), around=around, spread=EXACT)
    assert (away.obstacle.touched, away.vehicle.touched, away.clear) == (0, 0, True)


def test_another_vehicle_is_compared_at_the_same_time():
    crossing = OtherVehicle("2", np.array([0.0, 20.0]), np.array([[5.0, 0.0, -20.0], [205.0, 0.0, -20.0]]))
    result = futures(GoTo((30.0, 0.0, -20.0)), around=place(others=[crossing]), spread=EXACT)
    assert (result.vehicle.touched, result.vehicle.t_s) == (0, 0.0)
    assert result.vehicle.distance_m == pytest.approx(5.0, abs=0.1)


def test_a_landing_ends_on_the_ground_and_a_descent_by_setpoints_touches_it():
    low = replace(START, position_ned_m=(0.0, 0.0, -4.0))
    landing = futures(Land(), start=low, horizon_s=15.0)
    assert (landing.landed, landing.touched_ground, landing.clear) == (FLIGHTS, 0, True)
    descent = futures(streamed(Velocity((0.0, 0.0, 1.0))), start=low)
    assert (descent.touched_ground, descent.clear) == (FLIGHTS, False)


@pytest.mark.parametrize("speed_m_s", [3.0, -3.0])
def test_an_orbit_goes_to_the_circle_and_around_it(speed_m_s):
    result = futures(Orbit((30.0, 0.0, -20.0), 15.0, speed_m_s), horizon_s=25.0, spread=EXACT)
    path = np.array(result.corridor.position_ned_m)
    around = path[90:]
    assert np.abs(np.hypot(around[:, 0] - 30.0, around[:, 1]) - 15.0).max() < 1.5
    angle = np.unwrap(np.arctan2(around[:, 1], around[:, 0] - 30.0))
    flown_s = 0.2 * (len(around) - 1)
    part = (angle[-1] - angle[0]) / flown_s / (speed_m_s / 15.0)
    assert 0.7 < part < 1.02, "as PX4's, its velocity lags behind a setpoint that turns"
    assert np.abs(path[:, 2] + 20.0).max() < 1.0


@pytest.mark.parametrize(
    ("setpoint", "expected"),
    [
        (Position((10.0, 0.0, -22.0), 0.5), (10.0, 0.0, -22.0)),
        (Trajectory((10.0, 0.0, -22.0), (0.0, 0.0, 0.0), yaw_ned_rad=0.5), (10.0, 0.0, -22.0)),
        (Velocity((2.0, 0.0, 0.0), 0.0), (15.7, 0.0, -20.0)),
    ],
)
def test_setpoints_with_a_position_or_velocity_lead_there(setpoint, expected):
    result = futures(streamed(setpoint), spread=EXACT, target_ned_m=expected)
    assert math.dist(end(result), expected) < 1.5
    assert result.arrived == FLIGHTS


def test_low_level_setpoints_drift_and_motors_that_stop_let_the_vehicle_fall():
    ahead = futures(streamed(Attitude(q_from_euler(0.0, -0.2, 0.0), 0.5)), horizon_s=4.0)
    assert end(ahead)[0] > 3.0
    assert ahead.corridor.horizontal_m[-1] > 2.0
    turning = futures(streamed(Rates((0.0, 0.0, 0.5), 0.5)), horizon_s=4.0, spread=EXACT)
    assert math.hypot(*end(turning)[:2]) < 2.0
    level = futures(streamed(ThrustTorque((0.0, 0.0, -0.5), (0.0, 0.0, 0.0))), horizon_s=2.0, spread=EXACT)
    assert abs(end(level)[2] + 20.0) < 3.0
    stopped = futures(streamed(Actuators((None, None, None, None))), horizon_s=4.0)
    assert stopped.touched_ground == FLIGHTS


def test_the_battery_is_used_and_unknown_drain_is_said():
    draining = replace(START, parameters={"SIM_BAT_DRAIN": 600.0, "SIM_BAT_MIN_PCT": 0.0})
    short, long = (
        futures(Hold(), start=draining, battery_known=True, horizon_s=each).battery_end_share
        for each in (5.0, 20.0)
    )
    assert 0.8 > short.p50 > long.p50 > 0.7
    assert long.p5 < long.p50 < long.p95
    assert futures(Hold()).battery_end_share is None
    unknown = replace(draining, battery_share=None)
    assert futures(Hold(), start=unknown, battery_known=True).battery_end_share is None


def test_the_tilt_of_a_hovering_vehicle_tells_the_wind():
    tilt = q_from_euler(0.0, math.atan(2.0 / 9.80665), 0.0)
    leaning = replace(START, q_ned_frd=tilt, wind_ne_m_s=None)
    draws = Deviations.draw(leaning, DELAY, EXACT, FLIGHTS, 0, 1.0)
    assert draws.wind_ne_m_s[0] == pytest.approx((2.0, 0.0), abs=0.01), (
        "it leans against a wind from the south"
    )
    fast = replace(leaning, velocity_ned_m_s=(5.0, 0.0, 0.0))
    assert Deviations.draw(fast, DELAY, EXACT, FLIGHTS, 0, 1.0).wind_ne_m_s[0] == pytest.approx((0.0, 0.0))


def test_parameters_of_no_aircraft_are_refused():
    with pytest.raises(PlanError, match="SIH_T_MAX"):
        futures(Hold(), start=replace(START, parameters={"SIH_T_MAX": 0.0}))


def test_flights_end_when_they_are_cancelled():
    calls = []

    def cancelled():
        calls.append(None)
        if len(calls) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        futures(Hold(), cancelled=cancelled)
    assert len(calls) == 3
