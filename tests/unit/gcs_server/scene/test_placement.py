"""Positions of vehicles in the common frame of the 3D view."""

import math

import pytest

from gcs_server.scene.labels import origin_text
from gcs_server.scene.placement import STANDING_HEIGHT_M, Placement
from tests.unit.gcs_server.scene.scene_fakes import (
    FakeVehicle,
    flying_vehicle,
    global_position,
    home,
    local_position,
    status,
)

LAT_DEG, LON_DEG = 47.397742, 8.545594
LAT_100_M_NORTH_DEG = LAT_DEG + 100.0 / 111177.0


def test_the_first_home_is_the_origin():
    place = Placement().place(flying_vehicle())
    assert place.position_enu_m == pytest.approx((0.0, 0.0, 10.0), abs=1e-6)
    assert place.ground_z_m == 0.0
    assert place.home_enu_m == (0.0, 0.0, 0.0)


def test_the_page_gets_the_origin_once_a_vehicle_has_reported_a_position():
    placement = Placement()
    placement.place(FakeVehicle())
    assert origin_text(placement.origin_deg_m) == ""
    placement.place(flying_vehicle())
    assert origin_text(placement.origin_deg_m) == "47.397742000,8.545594000,488.000"


def test_two_vehicles_with_different_local_frames_are_placed_correctly():
    placement = Placement()
    placement.place(flying_vehicle("1"))
    second = flying_vehicle("2")
    second.values["global_position"] = global_position(LAT_100_M_NORTH_DEG, LON_DEG, 493.0)
    second.values["home"] = home(LAT_100_M_NORTH_DEG, LON_DEG, 483.0, (0.0, 0.0, 0.0))
    place = placement.place(second)
    assert place.position_enu_m == pytest.approx((0.0, 100.0, 5.0), abs=0.1)
    assert place.ground_z_m == pytest.approx(-5.0)
    assert place.local_origin_enu_m == pytest.approx((0.0, 100.0, -5.0), abs=0.1)


def test_a_global_position_alone_places_a_vehicle():
    placement = Placement()
    placement.place(flying_vehicle("1"))
    place = placement.place(
        FakeVehicle("2", values={"global_position": global_position(LAT_100_M_NORTH_DEG, LON_DEG, 490.0)})
    )
    assert place.position_enu_m == pytest.approx((0.0, 100.0, 2.0), abs=0.1)
    assert place.position_known
    assert place.local_origin_enu_m is None


def test_a_local_position_alone_places_a_vehicle():
    place = Placement().place(FakeVehicle(values={"local_position": local_position(3.0, 4.0, -5.0)}))
    assert place.position_enu_m == (4.0, 3.0, 5.0)
    assert place.position_known


def test_a_vehicle_without_a_position_is_drawn_at_the_origin():
    place = Placement().place(FakeVehicle())
    assert place.position_enu_m == (0.0, 0.0, 0.0)
    assert not place.position_known


def test_a_difference_between_local_and_global_position_does_not_move_the_frame():
    placement, vehicle = Placement(), flying_vehicle()
    local_origin_before = placement.place(vehicle).local_origin_enu_m
    vehicle.values["global_position"] = global_position(LAT_DEG + 1e-5, LON_DEG, 498.5)  # 1 m farther north
    assert placement.place(vehicle).local_origin_enu_m == local_origin_before


def test_an_estimator_reset_moves_the_local_origin_and_not_the_vehicle():
    placement, vehicle = Placement(), flying_vehicle()
    position_before = placement.place(vehicle).position_enu_m
    vehicle.values["local_position"] = local_position(500.0, 0.0, -10.0)
    vehicle.values["home"] = home(LAT_DEG, LON_DEG, 488.0, None)
    assert placement.place(vehicle).position_enu_m == pytest.approx(position_before, abs=1e-6)


@pytest.mark.parametrize(
    "invalid_position", [global_position(math.nan, LON_DEG, 0.0), global_position(0.0, 0.0, 0.0)]
)
def test_an_invalid_position_is_not_used(invalid_position):
    vehicle = FakeVehicle(values={"global_position": invalid_position})
    assert not Placement().place(vehicle).position_known


def test_after_a_reset_of_the_scene_the_next_vehicle_sets_the_origin():
    placement = Placement()
    placement.place(flying_vehicle())
    placement.reset()
    distant_vehicle = FakeVehicle("2", values={"home": home(10.0, 20.0, 5.0)})
    assert placement.place(distant_vehicle).home_enu_m == (0.0, 0.0, 0.0)


def test_the_altitude_above_home_is_the_vehicles_own_value_after_its_estimate_has_drifted():
    """Values that a real PX4 sent after landing; it reported -0.618 m above home."""
    vehicle = flying_vehicle()
    placement = Placement()
    placement.place(vehicle)
    vehicle.values["local_position"] = local_position(-0.364, -0.137, 1.1064453125)
    vehicle.values["global_position"] = global_position(47.3977434, 8.545592, 488.98)
    vehicle.values["home"] = home(47.3977425, 8.5455933, 489.599, (-0.467, -0.037, 0.4874267578125))
    assert placement.place(vehicle).height_m == pytest.approx(-0.618, abs=0.002)


def test_a_landed_vehicle_is_drawn_on_the_ground_although_its_altitude_estimate_has_drifted():
    vehicle = flying_vehicle()
    vehicle.values["status"] = status(landed="on_ground")
    vehicle.values["local_position"] = local_position(0.0, 0.0, 0.6)
    vehicle.values["global_position"] = global_position(LAT_DEG, LON_DEG, 487.4)
    place = Placement().place(vehicle)
    assert place.position_enu_m[2] == pytest.approx(place.ground_z_m + STANDING_HEIGHT_M)
    assert place.height_m == pytest.approx(-0.6)


def test_a_vehicle_landed_on_a_roof_is_drawn_on_the_roof():
    vehicle = flying_vehicle()
    vehicle.values["status"] = status(landed="on_ground")
    assert Placement().place(vehicle).position_enu_m[2] == pytest.approx(10.0)
