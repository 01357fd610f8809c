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

LAT, LON = 47.397742, 8.545594
NORTH_100_M = LAT + 100.0 / 111177.0


def test_the_first_home_is_the_origin():
    placed = Placement().place(flying_vehicle())
    assert placed.position_enu_m == pytest.approx((0.0, 0.0, 10.0), abs=1e-6)
    assert placed.ground_z_m == 0.0
    assert placed.home_enu_m == (0.0, 0.0, 0.0)


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
    second.values["global_position"] = global_position(NORTH_100_M, LON, 493.0)
    second.values["home"] = home(NORTH_100_M, LON, 483.0, (0.0, 0.0, 0.0))
    placed = placement.place(second)
    assert placed.position_enu_m == pytest.approx((0.0, 100.0, 5.0), abs=0.1)
    assert placed.ground_z_m == pytest.approx(-5.0)
    assert placed.local_origin_enu_m == pytest.approx((0.0, 100.0, -5.0), abs=0.1)


def test_a_global_position_alone_places_a_vehicle():
    placement = Placement()
    placement.place(flying_vehicle("1"))
    placed = placement.place(
        FakeVehicle("2", values={"global_position": global_position(NORTH_100_M, LON, 490.0)})
    )
    assert placed.position_enu_m == pytest.approx((0.0, 100.0, 2.0), abs=0.1)
    assert placed.position_known
    assert placed.local_origin_enu_m is None


def test_a_local_position_alone_places_a_vehicle():
    placed = Placement().place(FakeVehicle(values={"local_position": local_position(3.0, 4.0, -5.0)}))
    assert placed.position_enu_m == (4.0, 3.0, 5.0)
    assert placed.position_known


def test_a_vehicle_without_a_position_is_drawn_at_the_origin():
    placed = Placement().place(FakeVehicle())
    assert placed.position_enu_m == (0.0, 0.0, 0.0)
    assert not placed.position_known


def test_a_difference_between_local_and_global_position_does_not_move_the_frame():
    placement, vehicle = Placement(), flying_vehicle()
    first = placement.place(vehicle).local_origin_enu_m
    vehicle.values["global_position"] = global_position(LAT + 1e-5, LON, 498.5)  # 1 m farther north
    assert placement.place(vehicle).local_origin_enu_m == first


def test_an_estimator_reset_moves_the_local_origin_and_not_the_vehicle():
    placement, vehicle = Placement(), flying_vehicle()
    before = placement.place(vehicle).position_enu_m
    vehicle.values["local_position"] = local_position(500.0, 0.0, -10.0)
    vehicle.values["home"] = home(LAT, LON, 488.0, None)
    assert placement.place(vehicle).position_enu_m == pytest.approx(before, abs=1e-6)


@pytest.mark.parametrize("invalid", [global_position(math.nan, LON, 0.0), global_position(0.0, 0.0, 0.0)])
def test_an_invalid_position_is_not_used(invalid):
    vehicle = FakeVehicle(values={"global_position": invalid})
    assert not Placement().place(vehicle).position_known


def test_after_a_reset_of_the_scene_the_next_vehicle_sets_the_origin():
    placement = Placement()
    placement.place(flying_vehicle())
    placement.reset()
    elsewhere = FakeVehicle("2", values={"home": home(10.0, 20.0, 5.0)})
    assert placement.place(elsewhere).home_enu_m == (0.0, 0.0, 0.0)


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
    vehicle.values["global_position"] = global_position(LAT, LON, 487.4)
    placed = Placement().place(vehicle)
    assert placed.position_enu_m[2] == pytest.approx(placed.ground_z_m + STANDING_HEIGHT_M)
    assert placed.height_m == pytest.approx(-0.6)


def test_a_vehicle_landed_on_a_roof_is_drawn_on_the_roof():
    vehicle = flying_vehicle()
    vehicle.values["status"] = status(landed="on_ground")
    assert Placement().place(vehicle).position_enu_m[2] == pytest.approx(10.0)
