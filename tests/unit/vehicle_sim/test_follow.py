"""Follow Target: the vehicle follows the sender of FOLLOW_TARGET."""

import math

import pytest

from tests.unit.vehicle_sim.sim_station import Station

pytestmark = pytest.mark.flight

SPEED_M_S = 2.0
M_PER_DEG = 111_195.0


@pytest.mark.story
def test_a_moving_target_is_followed_and_faced_and_the_vehicle_holds_when_it_is_lost() -> None:
    s = Station(parameters={"FLW_TGT_DST": 8.0, "FLW_TGT_HT": 9.0})
    s.fly_to(10.0)
    home = s.sim.simulation.home
    estimate = s.sim.simulation.estimate
    start_s = s.now_s

    def walk() -> None:
        """Sends the target's position, moving north from 10 m north of home."""
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
    assert abs(float(estimate.velocity_ned_m_s[0, 0])) < 0.4, (
        "the target is lost after 3 s, and the vehicle holds"
    )
    assert not s.sim.autopilots[0].navigator.follow.has_target


class Beacon(Station):
    """A station that sends the target's position five times a second."""

    def __init__(self, north_m: float, alt_home_m: float, **parameters: float) -> None:
        super().__init__(parameters=parameters, sensor_noise=False)
        self._north_m, self._alt_home_m = north_m, alt_home_m

    def follow(self, seconds: float) -> None:
        self.run(seconds, self._send_target, tick_s=0.2)

    def _send_target(self) -> None:
        home = self.sim.simulation.home
        self.send(
            "FOLLOW_TARGET", timestamp=0, est_capabilities=1,
            lat=round((home.lat_deg + self._north_m / M_PER_DEG) * 1e7),
            lon=round(home.lon_deg * 1e7), alt=home.alt_amsl_m + self._alt_home_m,
        )  # fmt: skip

    @property
    def north_m(self) -> float:
        return float(self.sim.simulation.truth.position_ned_m[0, 0])


def test_follow_climbs_to_its_height_before_it_moves_horizontally() -> None:
    s = Beacon(60.0, 0.0, FLW_TGT_HT=16.0)
    s.fly_to(5.0)
    s.command(176, 1, 4, 8)
    s.follow(0.4)
    s.run_until(lambda: s.height_m > 12.5, 20, lambda: s.follow(0.02))
    assert abs(s.north_m) < 1.0, "the vehicle climbs first"
    s.follow(12.0)
    assert s.north_m > 20.0
    assert s.height_m == pytest.approx(16.0, abs=1.0)


@pytest.mark.story
def test_with_a_height_below_the_ground_the_vehicle_stays_above_the_ground() -> None:
    s = Beacon(20.0, -30.0, FLW_TGT_ALT_M=2, FLW_TGT_HT=8.0)
    s.fly_to(5.0)
    s.command(176, 1, 4, 8)
    s.follow(12.0)
    for _ in range(20):
        s.follow(0.5)
        assert 0.3 < s.height_m < 2.0, "the vehicle stays a metre above the ground"
