"""The mission runner returns to its path inside the geofence, skips a round of a repeat, and waits for a
vehicle that lags."""

import math

import pytest

from missions.runner.requests import SetMode, StreamScript
from missions.values import FenceCircle, FencePolygon, Point
from tests.support.mission_vehicle import FakeFlight
from tests.support.offboard_missions import HOME, flight_steps, mission

CORNER_MISSION = mission(
    flight_steps("step: fly, points: [{offset_ned_m: [60, 0, -10]}, {offset_ned_m: [60, 60, -10]}]")
)
DEG_PER_M = 1.0 / 111_195.0
"""Degrees of latitude per metre."""


def fence_circle(radius_m, *, inclusion, north_m=0.0):
    center = Point(lat_deg=HOME.lat_deg + north_m * DEG_PER_M, lon_deg=HOME.lon_deg)
    return FenceCircle(inclusion=inclusion, center=center, radius_m=radius_m)


def exclusion_square(north_m, half_side_m):
    south, north = (HOME.lat_deg + (north_m + m) * DEG_PER_M for m in (-half_side_m, half_side_m))
    east = half_side_m * DEG_PER_M / math.cos(math.radians(HOME.lat_deg))
    corners = ((south, -east), (south, east), (north, east), (north, -east))
    points = tuple(Point(lat_deg=lat, lon_deg=HOME.lon_deg + lon) for lat, lon in corners)
    return FencePolygon(inclusion=False, polygon=points)


@pytest.mark.parametrize(
    ("zones", "north_m", "is_flown"),
    [
        ((), -40.0, True),
        ((fence_circle(100, inclusion=True),), -40.0, True),
        # From outside the fence, the path back into the fence is flown.
        ((fence_circle(100, inclusion=True),), -140.0, True),
        ((fence_circle(100, inclusion=True), fence_circle(8, inclusion=False, north_m=-20)), -40.0, False),
        ((exclusion_square(-20, 8),), -40.0, False),
        ((exclusion_square(-20, 8),), 30.0, True),
    ],
)
def test_a_return_path_outside_the_missions_geofence_is_not_flown(zones, north_m, is_flown):
    fake = FakeFlight(CORNER_MISSION.model_copy(update={"home": HOME, "fence": zones})).start()
    fake.until_state("flying").fly(5.0)
    fake.change_mode("hold", "command", "Bob commanded 'hold'")
    fake.until_state("suspended")
    fake.set_reading(position_ned_m=(north_m, 0.0, -10.0))
    streamed_scripts, modes = fake.count_requests(StreamScript), fake.count_requests(SetMode)
    fake.resume()
    assert fake.count_requests(StreamScript) == streamed_scripts + is_flown
    assert (fake.status.state == "suspended") != is_flown
    if not is_flown:
        assert "leaves the mission's geofence" in str(fake.status.reason)
        assert fake.requested_modes()[modes:] == ["hold"]


def test_skipping_in_a_repeat_skips_one_round_and_continues_with_the_next_round():
    fake = FakeFlight(mission(flight_steps("step: repeat, times: 3, steps: [{step: hold, duration_s: 30}]")))
    fake.start().until_state("flying").fly(1.0)
    skipped_s = fake.now_s
    fake.skip()
    fake.until_state("landing")
    assert fake.now_s - skipped_s == pytest.approx(60.0, abs=3.0)


def test_the_mission_waits_for_a_vehicle_that_lags_and_reports_the_delay_once():
    fake = FakeFlight(mission(flight_steps("step: fly, points: [{offset_ned_m: [60, 0, -10]}]"))).start()
    fake.until_state("flying").fly(3.0)
    blocked_at = fake.block()
    fake.fly(30.0)
    assert fake.status.state == "not_following"
    assert 8.0 < fake.status.deviation_m < 16.0
    assert sum("the mission waits" in text for text in fake.event_texts) == 1
    assert fake.reading.position_ned_m == blocked_at
    fake.unblock()
    fake.until_state("done")
    assert math.dist(fake.flown_path[-1][:2], (60.0, 0.0)) < 1.0


def test_a_path_ends_only_after_the_vehicle_has_arrived():
    fake = FakeFlight(mission(flight_steps("step: fly, points: [{offset_ned_m: [20, 0, -10]}]"))).start()
    fake.until(lambda: fake.status.state == "flying" and fake.flown_path[-1][0] > 14.0)
    fake.block()
    fake.fly(20.0)
    assert fake.status.place == "step 2"
    assert fake.requested_modes() == []
    fake.unblock()
    fake.until_state("done")
