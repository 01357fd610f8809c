"""Follow Target: the vehicle follows the sender of FOLLOW_TARGET."""

import math

import pytest

from tests.unit.vehicle_sim.sim_station import Station

pytestmark = pytest.mark.flight

SET_MODE = 176
SPEED_M_S = 2.0
M_PER_DEG = 111_195.0


@pytest.mark.story
def test_a_vehicle_follows_and_faces_a_moving_target_and_holds_when_the_target_is_lost() -> None:
    station = Station(parameters={"FLW_TGT_DST": 8.0, "FLW_TGT_HT": 9.0})
    station.take_off_and_hover(10.0)
    home = station.sim.simulation.origin
    estimate = station.sim.simulation.estimate
    start_s = station.now_s

    def send_moving_target() -> None:
        """Sends the position of a target that moves north, beginning 10 m north of home."""
        north_m = 10.0 + SPEED_M_S * (station.now_s - start_s)
        station.send(
            "FOLLOW_TARGET", timestamp=0, est_capabilities=3,
            lat=round((home.lat_deg + north_m / M_PER_DEG) * 1e7),
            lon=round(home.lon_deg * 1e7), alt=home.alt_amsl_m,
            vel=(SPEED_M_S, 0.0, 0.0),
        )  # fmt: skip

    station.command(SET_MODE, 1, 4, 8)
    station.run(18, send_moving_target, tick_s=0.2)
    north, east, down = estimate.position_ned_m[0]
    target_north_m = 10.0 + SPEED_M_S * (station.now_s - start_s)
    assert target_north_m - north == pytest.approx(8.0, abs=1.5)
    assert (east, -down) == (pytest.approx(0.0, abs=1.2), pytest.approx(9.0, abs=1.0))
    assert math.degrees(station.sim.autopilots[0].view.estimate.yaw_ned_rad) == pytest.approx(0.0, abs=6)
    station.run(6)
    assert abs(float(estimate.velocity_ned_m_s[0, 0])) < 0.4, (
        "the target is lost after 3 s, and the vehicle holds"
    )
    assert not station.sim.autopilots[0].navigator.follow.has_target


class TargetStation(Station):
    """A station that sends the target's position five times a second."""

    def __init__(self, north_m: float, alt_home_m: float, **parameters: float) -> None:
        super().__init__(parameters=parameters, sensor_noise=False)
        self._north_m, self._alt_home_m = north_m, alt_home_m

    def follow(self, seconds: float) -> None:
        self.run(seconds, self._send_target, tick_s=0.2)

    def _send_target(self) -> None:
        home = self.sim.simulation.origin
        self.send(
            "FOLLOW_TARGET", timestamp=0, est_capabilities=1,
            lat=round((home.lat_deg + self._north_m / M_PER_DEG) * 1e7),
            lon=round(home.lon_deg * 1e7), alt=home.alt_amsl_m + self._alt_home_m,
        )  # fmt: skip

    @property
    def north_m(self) -> float:
        return float(self.sim.simulation.truth.position_ned_m[0, 0])


def test_a_following_vehicle_climbs_before_it_moves_horizontally() -> None:
    station = TargetStation(60.0, 0.0, FLW_TGT_HT=16.0)
    station.take_off_and_hover(5.0)
    station.command(SET_MODE, 1, 4, 8)
    station.follow(0.4)
    station.run_until(lambda: station.height_m > 12.5, 20, lambda: station.follow(0.02))
    assert abs(station.north_m) < 1.0, "the vehicle moved before it had climbed"
    station.follow(12.0)
    assert station.north_m > 20.0
    assert station.height_m == pytest.approx(16.0, abs=1.0)


@pytest.mark.story
def test_a_vehicle_whose_target_is_below_the_ground_stays_above_the_ground() -> None:
    station = TargetStation(20.0, -30.0, FLW_TGT_ALT_M=2, FLW_TGT_HT=8.0)
    station.take_off_and_hover(5.0)
    station.command(SET_MODE, 1, 4, 8)
    station.follow(12.0)
    for _ in range(20):
        station.follow(0.5)
        assert 0.3 < station.height_m < 2.0, "not about a metre above the ground"
