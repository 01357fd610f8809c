"""Follow Target: where the vehicle flies beside somebody who tells where he is."""

import math

import pytest

from tests.unit.vehicle_sim.sim_station import Station

pytestmark = pytest.mark.flight

SPEED_M_S = 2.0
M_PER_DEG = 111_195.0


def test_it_flies_behind_a_walker_looks_at_him_and_holds_without_him() -> None:
    s = Station(parameters={"FLW_TGT_DST": 8.0, "FLW_TGT_HT": 9.0})
    s.fly_to(10.0)
    home = s.sim.simulation.home
    estimate = s.sim.simulation.estimate
    start_s = s.now_s

    def walk() -> None:
        """North from 10 m north of home."""
        north = 10.0 + SPEED_M_S * (s.now_s - start_s)
        s.send(
            "FOLLOW_TARGET", timestamp=0, est_capabilities=3,
            lat=round((home.lat_deg + north / M_PER_DEG) * 1e7),
            lon=round(home.lon_deg * 1e7), alt=home.alt_amsl_m,
            vel=(SPEED_M_S, 0.0, 0.0),
        )  # fmt: skip

    s.command(176, 1, 4, 8)
    s.run(18, walk, tick_s=0.2)
    north, east, down = estimate.position_ned_m[0]
    target_north = 10.0 + SPEED_M_S * (s.now_s - start_s)
    assert target_north - north == pytest.approx(8.0, abs=1.5)
    assert (east, -down) == (pytest.approx(0.0, abs=1.2), pytest.approx(9.0, abs=1.0))
    assert math.degrees(s.sim.autopilots[0].view.estimate.yaw_ned_rad) == pytest.approx(0.0, abs=6)
    s.run(6)
    assert abs(float(estimate.velocity_ned_m_s[0, 0])) < 0.4, "lost after 3 s, it stays"
    assert not s.sim.autopilots[0].navigator.follow.tracks
