"""Speed and direction of an orbit: at most 2 m/s² towards the centre and at most 12 m/s."""

import math

import pytest

from tests.unit.vehicle_sim.sim_station import Station

NAN, ORBIT = math.nan, 34


@pytest.mark.parametrize(
    ("radius_m", "requested_m_s", "flown_m_s"),
    [(10.0, 3.0, 3.0), (5.0, 9.0, math.sqrt(10.0)), (-5.0, 9.0, -math.sqrt(10.0)), (100.0, 50.0, 12.0)],
)
def test_the_orbit_speed_is_limited_by_the_radius(
    radius_m: float, requested_m_s: float, flown_m_s: float
) -> None:
    station = Station(sensor_noise=False)
    station.run_until(lambda: station.can_be_armed, 15)
    station.command(ORBIT, radius_m, requested_m_s, 0, NAN, NAN, NAN, NAN)
    station.run(0.1)
    circle = station.sim.autopilots[0].navigator.circle
    assert circle is not None
    assert (circle.radius_m, circle.speed_m_s) == (abs(radius_m), pytest.approx(flown_m_s))
