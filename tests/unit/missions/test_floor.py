"""The floor of targets: home, or the known ground, lowered by the landing height."""

from __future__ import annotations

import numpy as np
import pytest

from missions.floor import Floor, TooLow
from missions.geodesy import LocalOrigin
from missions.terrain.ground import Ground

HOME = (47.397742, 8.545594, 488.0)
ORIGIN = LocalOrigin(*HOME)


def ground(below_home_m: float, at_home_m: float = 488.0) -> Ground:
    """Ground at `at_home_m` up to 50 m north of home, then changing to `below_home_m` lower within 10 m; it
    ends 1 km away."""
    step_deg = 10.0 / 111_195.0
    rows, columns = 201, 201
    north_m = 1000.0 - 10.0 * np.arange(rows)
    amsl_m = np.where(north_m > 50.0, at_home_m - below_home_m, at_home_m).astype(np.float32)
    grid = np.repeat(amsl_m[:, None], columns, axis=1)
    west_deg = HOME[1] - 100 * step_deg / np.cos(np.radians(HOME[0]))
    return Ground(
        HOME[0] + 100 * step_deg, float(west_deg), step_deg, step_deg / np.cos(np.radians(HOME[0])), grid
    )


def too_low(
    floor: Floor, north_m: float, up_m: float, vehicle: tuple[float, float] | None = None
) -> TooLow | None:
    """Whether a target is too low; positions are north of home and up from home [m]."""
    lat, lon, amsl = ORIGIN.to_geodetic((north_m, 0.0, -up_m))
    here = None if vehicle is None else ORIGIN.to_geodetic((vehicle[0], 0.0, -vehicle[1]))
    return floor.too_low(np.array([lat]), np.array([lon]), np.array([amsl]), here)


def test_without_known_ground_a_target_may_be_the_landing_height_below_home() -> None:
    floor = Floor(HOME)
    assert too_low(floor, 30, -1.0) is None
    refused = too_low(floor, 30, -20.0)
    assert refused is not None
    assert refused.text == "20.0 m below home"
    assert "at least 488 m AMSL, which is 0 m above home, or add elevation data" in refused.remedy
    assert too_low(Floor(HOME, landing_height_m=3.0), 30, -2.9) is None


def test_the_known_ground_replaces_home_where_it_is_lower_and_where_it_is_higher() -> None:
    valley, hill = Floor(HOME, (ground(30.0),)), Floor(HOME, (ground(-30.0),))
    assert too_low(valley, 200, -29.0) is None
    refused = too_low(valley, 200, -32.0)
    assert refused is not None
    assert refused.text == "2.0 m below the ground there, according to the elevation data"
    assert too_low(valley, 20, -5.0) is not None, "at home the ground is as high as home"
    assert too_low(valley, 2000, -5.0) is not None, "beyond the data home counts"
    into_the_hill = too_low(hill, 200, 10.0)
    assert into_the_hill is not None
    assert into_the_hill.text.startswith("20.0 m below the ground")
    assert too_low(hill, 200, 30.0) is None


@pytest.mark.parametrize(("difference_m", "lowest_amsl_m"), [(7.0, 457.0), (-7.0, 457.0), (12.0, 469.0)])
def test_elevation_data_are_shifted_to_home_if_they_nearly_agree_with_it(
    difference_m: float, lowest_amsl_m: float
) -> None:
    floor = Floor(HOME, (ground(30.0, at_home_m=488.0 + difference_m),))
    lat, lon, _ = ORIGIN.to_geodetic((200.0, 0.0, 0.0))
    assert floor.lowest_amsl_m(lat, lon) == pytest.approx(lowest_amsl_m)


def test_a_target_at_the_vehicles_own_place_is_never_too_low_unless_it_leads_down() -> None:
    floor = Floor(HOME)
    assert too_low(floor, 30, -8.0, vehicle=(30.2, -8.0)) is None, "holding where the vehicle is"
    assert too_low(floor, 30, -5.0, vehicle=(30.0, -8.0)) is None, "climbing"
    assert too_low(floor, 30, -8.5, vehicle=(30.0, -8.0)) is not None
    assert too_low(floor, 35, -8.0, vehicle=(30.0, -8.0)) is not None, "the ground there is not known"


def test_without_home_and_ground_nothing_is_refused() -> None:
    assert Floor().knows_nothing
    assert too_low(Floor(), 30, -500.0) is None
    assert Floor().lowest_amsl_m(47.0, 8.0) is None
    without_home = Floor(None, (ground(0.0),))
    assert too_low(without_home, 30, -5.0) is not None
    assert too_low(without_home, 2000, -5.0) is None


def test_the_first_target_of_many_that_is_too_low_is_named() -> None:
    lat, lon, amsl = ORIGIN.to_geodetic_arrays(np.array([[0.0, 0, -5], [1, 0, 0.9], [2, 0, 1.5], [3, 0, 9]]))
    refused = Floor(HOME).too_low(lat, lon, amsl)
    assert refused is not None
    assert (refused.index, refused.text) == (2, "1.5 m below home")


@pytest.mark.parametrize(
    "floor", [Floor(HOME), Floor(), Floor(HOME, (ground(20.0),)), Floor(None, (ground(20.0),))]
)
@pytest.mark.parametrize("up_m", [-30.0, -2.001, -2.0, 0.0, 50.0])
def test_a_clear_altitude_is_too_low_nowhere(floor: Floor, up_m: float) -> None:
    if floor.is_clear(HOME[2] + up_m):
        assert all(too_low(floor, north_m, up_m) is None for north_m in (-500.0, 0.0, 55.0, 500.0))
    assert not (floor.grounds and floor.is_clear(1e6))
    assert Floor(HOME).is_clear(HOME[2])
