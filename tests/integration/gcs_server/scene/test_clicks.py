"""A click in the 3D view becomes a position on the ground, or nothing if there is no ground."""

from __future__ import annotations

import asyncio

import httpx
import msgspec
import pytest

from gcs_server.clock import SystemClock
from gcs_server.errors import Refused
from gcs_server.scene.clicks import REACH_M, ground_point
from gcs_server.scene.tracks import Tracks
from tests.integration.gcs_server.scene.scene_server import CLICK_NORTH, open_stream, wait_until
from tests.support.viser_camera import CAMERA_MESSAGE
from tests.unit.gcs_server.scene.scene_fakes import FakeFleet, FakeVehicle, flying_vehicle

METRES_PER_DEGREE = 111177.0


def test_a_ray_intersects_the_level_ground():
    assert ground_point((1.0, 2.0, 12.0), (0.0, 2.0, -1.0), 2.0) == (1.0, 22.0, 2.0)


@pytest.mark.parametrize(
    ("eye_z_m", "ray"),
    [
        (10.0, (0.0, 1.0, 0.1)),  # towards the sky
        (10.0, (1.0, 0.0, 0.0)),  # parallel to the ground
        (-1.0, (0.0, 0.0, -1.0)),  # from below the ground
        (10.0, (1.0, 0.0, -9.0 / REACH_M)),  # farther than a click can reach
    ],
)
def test_a_ray_that_does_not_reach_the_ground_gives_none(eye_z_m, ray):
    assert ground_point((0.0, 0.0, eye_z_m), ray, 0.0) is None


def test_the_ground_is_at_the_altitude_of_the_selected_vehicles_home():
    tracks = Tracks(FakeFleet([flying_vehicle("1"), flying_vehicle("2")]), None, SystemClock())
    tracks.update(1000.0, 0.03)
    vehicle, lat_deg, lon_deg, alt_amsl_m = tracks.ground_position("2", (0.0, 0.0, 10.0), (0.0, 1.0, -0.1))
    assert vehicle == "2"
    assert (lat_deg, lon_deg) == pytest.approx((47.397742 + 100.0 / METRES_PER_DEGREE, 8.545594), abs=1e-6)
    assert alt_amsl_m == pytest.approx(488.0)
    assert tracks.ground_position("9", (0.0, 0.0, 10.0), (0.0, 0.0, -1.0))[0] == "1"  # no vehicle 9


def test_without_a_global_position_a_click_is_refused():
    with pytest.raises(Refused, match="no vehicle yet"):
        Tracks(FakeFleet(), None, SystemClock()).ground_position(None, (0.0, 0.0, 10.0), (0.0, 0.0, -1.0))
    tracks = Tracks(FakeFleet([FakeVehicle()]), None, SystemClock())
    tracks.update(1000.0, 0.03)
    with pytest.raises(Refused, match="reported its position"):
        tracks.ground_position(None, (0.0, 0.0, 10.0), (0.0, 0.0, -1.0))


def test_a_click_is_published_with_the_token_of_its_view(scene_server):
    async def send_clicks():
        async with open_stream(scene_server, "?view=clicked&vehicle=2") as stream:
            await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            await wait_until(lambda: scene_server.scene.viewers == 1)
            async with httpx.AsyncClient() as client:
                response = await client.post(scene_server.url + "view/clicked/click", json=CLICK_NORTH)
                click_on_sky = {**CLICK_NORTH, "ray_enu": [0, 1, 1]}
                sky_response = await client.post(scene_server.url + "view/clicked/click", json=click_on_sky)
        return response.json(), sky_response.json()

    scene_server.clicks.clear()
    assert asyncio.run(send_clicks()) == ({"ground": True}, {"ground": False})
    (result,) = scene_server.clicks
    assert (result.view, result.vehicle, result.view_x, result.view_y) == ("clicked", "2", 0.5, 0.6)
    assert result.lat_deg == pytest.approx(47.397742 + 10.0 / METRES_PER_DEGREE, abs=1e-7)


@pytest.mark.parametrize(
    ("change", "field"),
    [({"ray_enu": [0, 1]}, "ray_enu"), ({"view_x": 2}, "view_x"), ({"eye_enu_m": [0, 0, 1e9]}, "eye_enu_m")],
)
def test_the_error_about_an_invalid_click_names_its_field(scene_server, change, field):
    response = httpx.post(scene_server.url + "view/clicked/click", json={**CLICK_NORTH, **change})
    assert response.status_code == 422
    assert field in response.text


def test_a_click_of_a_foreign_page_is_refused(scene_server):
    headers = {"Origin": "http://elsewhere.example"}
    response = httpx.post(scene_server.url + "view/clicked/click", json=CLICK_NORTH, headers=headers)
    assert response.status_code == 409
