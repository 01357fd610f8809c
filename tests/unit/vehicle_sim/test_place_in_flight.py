"""A vehicle that flies is moved to a moment of another flight, and flies on from there in a mode."""

import math

import numpy as np
import pytest

from tests.unit.vehicle_sim.prepared_stations import station_in_hover, station_on_ground
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.state import FlightMoment

NOT_CONTROLLED = (math.nan, math.nan, math.nan)


def moment(position_ned_m, velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_ned_rad=0.0):
    half = 0.5 * yaw_ned_rad
    return FlightMoment(
        position_ned_m=np.array(position_ned_m),
        velocity_ned_m_s=np.array(velocity_ned_m_s),
        q_ned_frd=np.array([math.cos(half), 0.0, 0.0, math.sin(half)]),
        rates_frd_rad_s=np.zeros(3),
        rotor_thrust=np.full(4, 0.5),
        velocity_integral=np.zeros(3),
        rate_integral=np.zeros(3),
        hover_thrust=0.5,
    )


def moved(mode, to):
    station = station_in_hover(Station, 5.0)
    station.sim.simulation.place_in_flight(0, to)
    at = tuple(to.position_ned_m.tolist()), tuple(to.velocity_ned_m_s.tolist()), NOT_CONTROLLED
    assert station.sim.autopilots[0].fly_on(mode, at)
    return station


def truth(station):
    state = station.sim.simulation.truth
    return state.position_ned_m[0], state.velocity_ned_m_s[0]


@pytest.mark.parametrize("yaw_ned_rad", [0.0, 2.0, -3.0])
def test_it_holds_where_it_was_moved_to_and_its_estimator_resets_nothing(yaw_ned_rad):
    place = (300.0, -200.0, -60.0)
    station = moved(NavState.HOLD, moment(place, yaw_ned_rad=yaw_ned_rad))
    since_s, resets = station.now_s, station.sim.simulation.fusion.resets.copy()
    station.run(15.0)
    position, _ = truth(station)
    assert position == pytest.approx(place, abs=1.0)
    assert station.sim.simulation.estimate.heading_rad[0] == pytest.approx(yaw_ned_rad, abs=0.1)
    assert (station.sim.simulation.fusion.resets == resets).all()
    assert station.status_texts(since_s) == []


def test_it_goes_on_with_its_speed_and_returns_home():
    station = moved(NavState.RTL, moment((150.0, 0.0, -80.0), (-5.0, 0.0, 0.0), math.pi))
    station.run(0.3)
    slowed_by_drag = -5.0 * math.exp(-0.3)  # SIH_KDV / SIH_MASS is 1/s
    assert truth(station)[1] == pytest.approx([slowed_by_drag, 0.0, 0.0], abs=0.4)
    station.run_until(lambda: not station.armed, 240)
    assert truth(station)[0] == pytest.approx([0.0, 0.0, 0.0], abs=1.5)


def test_it_lands_below_a_moment_of_its_landing():
    station = moved(NavState.LAND, moment((40.0, 30.0, -8.0), (0.0, 0.0, 0.7)))
    station.run_until(lambda: not station.armed, 60)
    assert truth(station)[0] == pytest.approx([40.0, 30.0, 0.0], abs=1.0)


def test_a_mode_that_cannot_run_is_not_flown_on():
    station = station_in_hover(Station, 5.0)
    assert not station.sim.autopilots[0].fly_on(NavState.MISSION, (NOT_CONTROLLED,) * 3)


def test_only_a_vehicle_that_flies_is_moved_and_only_into_the_air():
    on_ground = station_on_ground(Station)
    with pytest.raises(ValueError, match="vehicle 0 is on the ground"):
        on_ground.sim.simulation.place_in_flight(0, moment((0.0, 0.0, -10.0)))
    in_air = station_in_hover(Station, 5.0)
    with pytest.raises(ValueError, match="not above the ground"):
        in_air.sim.simulation.place_in_flight(0, moment((0.0, 0.0, 1.0)))
