"""SET_GPS_GLOBAL_ORIGIN: the local frame moves, the vehicle and its home do not."""

import math

import pytest

from tests.unit.vehicle_sim.sim_station import NAN, Station

LAT_1E7, LON_1E7, ALT_MM = 473977400, 85455900, 488000
ARM, M_PER_DEG = 400, 111_195.0  # metres per degree of latitude


def set_origin(station, lat=LAT_1E7, lon=LON_1E7, alt=ALT_MM, **extra):
    """Sets the origin; returns the origins that the vehicle then reports."""
    since_s = station.now_s
    station.send(
        "SET_GPS_GLOBAL_ORIGIN", target_system=station.system_id, latitude=lat, longitude=lon, altitude=alt,
        **extra,
    )  # fmt: skip
    station.run(0.1)
    return [
        (m.latitude, m.longitude, m.altitude) for m in station.received("GPS_GLOBAL_ORIGIN", since_s=since_s)
    ]


def test_an_origin_can_be_set_without_gps_but_the_position_stays_invalid():
    station = Station(parameters={"EKF2_GPS_CTRL": 0})
    station.run(6.0)
    view = station.sim.autopilots[0].view
    assert not view.origin[0] > 0, "the vehicle already has an origin"
    assert set_origin(station) == [(LAT_1E7, LON_1E7, ALT_MM)]
    station.run(3.0)
    assert not station.sim.autopilots[0].view.estimate.valid_position
    assert "check_modes_local_pos" in {
        finding.event for finding in station.sim.autopilots[0].commander.report.findings
    }


def test_vision_with_an_origin_gives_a_global_position():
    station = Station(parameters={"EKF2_GPS_CTRL": 0, "EKF2_EV_CTRL": 15})
    station.run(3.0)
    set_origin(station)

    def send_vision():
        station.send("VISION_POSITION_ESTIMATE", x=10.0, y=0.0, z=0.0, covariance=[NAN] * 21)

    station.run(4.0, send_vision)
    estimate = station.sim.autopilots[0].view.estimate
    assert estimate.valid_position
    assert estimate.lat_deg == pytest.approx(LAT_1E7 * 1e-7 + 10.0 / M_PER_DEG, abs=3e-6)
    assert station.sim.autopilots[0].commander.report.armable(station.sim.autopilots[0].commander.intended)


def test_a_new_origin_does_not_change_the_global_positions_of_vehicle_and_home():
    station = Station(sensor_noise=False)
    station.run_until(lambda: station.can_be_armed, 15)
    estimate_before = station.sim.autopilots[0].view.estimate
    home = station.sim.autopilots[0].home
    home_before = (home.lat_deg, home.lon_deg, home.alt_amsl_m)
    north_1e7, up_mm = round(100.0 / M_PER_DEG * 1e7), 20_000
    lat, lon, alt = station.sim.autopilots[0].view.origin
    set_origin(station, round(lat * 1e7) - north_1e7, round(lon * 1e7), round(alt * 1000) - up_mm)
    station.run(2.0)
    estimate = station.sim.autopilots[0].view.estimate
    assert estimate.lat_deg == pytest.approx(estimate_before.lat_deg, abs=2e-6)
    assert estimate.alt_amsl_m == pytest.approx(estimate_before.alt_amsl_m, abs=0.2)
    assert estimate.position_ned_m == pytest.approx((100.0, 0.0, -20.0), abs=0.3)
    assert (home.lat_deg, home.lon_deg, home.alt_amsl_m) == pytest.approx(home_before, abs=0.2)
    assert home.position_ned_m == pytest.approx((100.0, 0.0, -20.0), abs=0.3)
    assert station.can_be_armed, "the vehicle cannot be armed any more"


def test_an_origin_is_refused_while_armed_or_if_it_is_invalid_or_for_another_vehicle():
    station = Station()
    station.run_until(lambda: station.can_be_armed, 15)
    station.run(1.5)  # the vehicle has reported its own origin
    assert len(station.received("GPS_GLOBAL_ORIGIN")) == 1
    origin = station.sim.autopilots[0].view.origin
    for invalid_field in ({"lat": 910_000_000}, {"lon": 1_810_000_000}, {"alt": 200_000_000}):
        (reported,) = set_origin(station, **invalid_field)
        assert reported[0] == pytest.approx(origin[0] * 1e7, abs=1), "not the current origin"
    station.command(ARM, 1)
    station.run(0.2)
    assert station.armed
    set_origin(station, lat=LAT_1E7 + 50_000)
    assert station.sim.autopilots[0].view.origin == origin
    station.send(
        "SET_GPS_GLOBAL_ORIGIN", target_system=77, latitude=LAT_1E7, longitude=LON_1E7, altitude=ALT_MM
    )
    since_s = station.now_s
    station.run(0.2)
    assert station.received("GPS_GLOBAL_ORIGIN", since_s=since_s) == []


def test_after_an_invalid_origin_the_vehicle_still_reports_its_own_origin():
    station = Station()
    assert not math.isfinite(station.sim.autopilots[0].view.origin[0])
    set_origin(station, lat=910_000_000)
    station.run_until(lambda: station.can_be_armed, 15)
    station.run(1.5)
    reports = station.received("GPS_GLOBAL_ORIGIN")
    assert reports[-1].latitude == pytest.approx(station.sim.autopilots[0].view.origin[0] * 1e7, abs=1)
