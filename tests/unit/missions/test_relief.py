"""The ground around a position: fine in the middle, coarse at the edge, unknown where it is not known."""

import numpy as np
import pytest

from missions.geodesy import distance_m
from missions.terrain.relief import FINE_STEP_M, Relief, axes_deg, offsets_m


def relief(lat_deg, lon_deg, altitude):
    lats, lons = axes_deg(lat_deg, lon_deg)
    all_lons, all_lats = np.meshgrid(lons, lats)
    return Relief(lat_deg, lon_deg, altitude(all_lats, all_lons).astype(np.float32))


def test_the_grid_is_fine_in_the_middle_and_reaches_kilometres():
    offsets = offsets_m()
    steps = np.diff(offsets)
    assert len(offsets) <= 201
    assert offsets[len(offsets) // 2] == 0.0
    assert steps.min() == pytest.approx(FINE_STEP_M)
    assert 2800.0 < offsets[-1] == -offsets[0] < 3200.0
    assert (np.diff(steps[len(steps) // 2 :]) > -1e-9).all()


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(47.4, 8.5), (-70.0, 179.999), (10.0, -180.0)])
def test_altitudes_are_interpolated(lat_deg, lon_deg):
    def slope(lats, lons):
        return 500.0 + 1000.0 * (lats - lat_deg) - 300.0 * (lons - lon_deg)

    ground = relief(lat_deg, lon_deg, slope)
    d_lat, d_lon = np.random.default_rng(1).uniform(-0.02, 0.02, (2, 100))
    known = ground.altitudes_amsl_m(lat_deg + d_lat, (lon_deg + d_lon + 180.0) % 360.0 - 180.0)
    assert known == pytest.approx(500.0 + 1000.0 * d_lat - 300.0 * d_lon, abs=0.01)
    lats, lons = ground.positions_deg()
    assert distance_m(lat_deg, lon_deg, lats[-1], lon_deg) == pytest.approx(offsets_m()[-1], rel=1e-3)
    assert ground.altitude_amsl_m(lats[-1] + 1e-4, lon_deg) is None
    assert ground.altitude_amsl_m(lat_deg, lons[0] - 1e-4) is None


def test_beside_an_unknown_point_the_ground_is_unknown():
    ground = relief(47.4, 8.5, lambda lats, lons: np.where(lats > 47.401, np.nan, 500.0))
    assert ground.altitude_amsl_m(47.4, 8.5) == 500.0
    assert ground.altitude_amsl_m(47.402, 8.5) is None
