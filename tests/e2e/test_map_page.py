"""Clicks on the map and in the 3D view: the vehicle flies to a clicked position, or the camera looks at it.
The 3D view does not reload."""

from __future__ import annotations

import base64
import json
import math
import os
import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, Route, expect

from gcs_server.client import SyncVehicle
from tests.e2e.browser import bounding_box, confirm_by_slider, open_page, scene_frame, serious_violations
from tests.e2e.fast_station import Station
from tests.e2e.map_files import png, vector_tile, write_mbtiles, write_pmtiles
from tests.station import wait_until
from tests.support.archive_server import VECTOR_TILES, ArchiveServer, archive
from tests.support.tile_server import TileServer
from tests.support.wmts import description, layer, matrix_set

pytestmark = [pytest.mark.browser, pytest.mark.story]

PICTURES = os.environ.get("MAP_PICTURES")
"""Where some screens are saved, to look at them; unset: nowhere."""
MEAN_COLOUR = """
async (screenshot) => {
  const image = new Image();
  image.src = `data:image/png;base64,${screenshot}`;
  await image.decode();
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [1, 1];
  const ctx = canvas.getContext('2d');
  ctx.drawImage(image, 0, 0, 1, 1);
  return [...ctx.getImageData(0, 0, 1, 1).data].slice(0, 3);
}
"""
CENTRE_OF_FREE_AREA = """
() => {
  const box = (name) => document.querySelector(name)?.getBoundingClientRect();
  const stage = box('main'), inset = box('section.inset'), cards = box('aside');
  const messages = box('.messages-space'), bar = box('.place .dock');
  const left = inset ? inset.right : stage.left;
  return [(left + cards.left) / 2, (messages.bottom + bar.top) / 2];
}
"""
"""The centre of the area without panels, where the large map shows a followed vehicle."""


def open_large_map(page: Page, *, beside_scene: bool = False) -> None:
    """Opens the large map, which is the default without a 3D view and follows the vehicle."""
    if beside_scene:
        page.get_by_title("3D view", exact=True).wait_for()
        page.keyboard.press("m")
    page.get_by_role("toolbar", name="Map").wait_for()
    expect(page.locator(".bar")).to_have_text("10 m")


def open_menu_at(page: Page, east_px: int, north_px: int) -> Locator:
    """Opens the menu at a position relative to the vehicle."""
    x, y = page.evaluate(CENTRE_OF_FREE_AREA)
    page.mouse.click(x + east_px, y - north_px)
    menu = page.get_by_role("dialog")
    menu.wait_for()
    return menu


def menu_position(menu: Locator) -> tuple[float, float]:
    """Latitude and longitude [deg] in the menu."""
    found = re.search(r"(-?\d+\.\d+), (-?\d+\.\d+)", menu.locator(".where").inner_text())
    assert found is not None
    return float(found[1]), float(found[2])


def newest_value(drone: SyncVehicle, topic: str) -> dict[str, Any]:
    """The newest value of a topic that this vehicle has sent."""
    value = drone.topic(topic)
    assert value is not None
    return value


def distance_m(drone: SyncVehicle, lat_lon_deg: tuple[float, float]) -> float:
    position = newest_value(drone, "global_position")
    north_m = math.radians(position["lat_deg"] - lat_lon_deg[0]) * 6_371_000
    east_m = (
        math.radians(position["lon_deg"] - lat_lon_deg[1])
        * 6_371_000
        * math.cos(math.radians(lat_lon_deg[0]))
    )
    return math.hypot(north_m, east_m)


def test_the_vehicle_flies_to_a_position_on_the_map_or_in_3d(browser: Browser, station: Station) -> None:
    drone = station.drone
    drone.takeoff(8)
    with open_page(browser, station.url, scene=False) as page:
        open_large_map(page)
        menu = open_menu_at(page, 120, 80)
        expect(menu).to_contain_text(re.compile(r"1[78]\.\d m north-east of the vehicle"))
        expect(menu).to_contain_text(re.compile(r"about \d+ s"))
        goal_deg = menu_position(menu)
        altitude = menu.get_by_label("Flight altitude above home", exact=True)
        altitude.fill("10")
        altitude.press("Tab")
        check_refusal_in_the_menu(page, menu)
        menu.get_by_role("button", name="Go here").click()
        expect(page.get_by_role("alertdialog")).to_contain_text("at 10.0 m above home")
        confirm_by_slider(page)
        expect(menu).to_be_hidden()
        wait_until(lambda: distance_m(drone, goal_deg) < 1.5, "the vehicle at the clicked position", 30)
        wait_until(
            lambda: abs(newest_value(drone, "global_position")["alt_home_m"] - 10) < 1, "the entered altitude"
        )

        menu = open_menu_at(page, -80, -64)
        expect(menu).to_contain_text("Look here: Take control of the gimbal first, on the gimbal card")
        roi_deg = menu_position(menu)
        menu.get_by_role("button", name="Set ROI").click()
        expect(menu).to_be_hidden()
        roi = drone.request("GET", "/gimbal")["roi"]
        assert (roi["lat_deg"], roi["lon_deg"]) == pytest.approx(roi_deg, abs=1e-6)
        home_amsl_m = newest_value(drone, "home")["alt_amsl_m"]
        assert roi["alt_amsl_m"] == pytest.approx(home_amsl_m, abs=0.1)
        wait_until(lambda: newest_value(drone, "gimbal")["pitch_rad"] < -0.4, "the camera pointing down")
        expect(page.get_by_label("Gimbal", exact=True)).to_contain_text("Points at")

        check_menu_by_keyboard(page)
        assert serious_violations(page) == []
        page.keyboard.press("Escape")

    with open_page(browser, station.url) as page:
        open_large_map(page, beside_scene=True)
        scene_frame(page).evaluate("() => { window.notReloaded = true }")
        page.get_by_title("Show the 3D view large (M)").click()
        page.get_by_title("Show the map large (M)").click()
        page.keyboard.press("m")
        expect(page.get_by_title("Show the map large (M)")).to_be_visible()
        assert scene_frame(page).evaluate("() => window.notReloaded") is True
        check_click_in_3d(page)

    drone.land()
    drone.until_disarmed()
    with open_page(browser, station.url, scene=False) as page:
        open_large_map(page)
        menu = open_menu_at(page, 60, 60)
        expect(menu).to_contain_text("The vehicle is on the ground: take off first.")
        expect(menu.get_by_role("button", name="Go here")).to_have_attribute("aria-disabled", "true")


def check_refusal_in_the_menu(page: Page, menu: Locator) -> None:
    """Checks that the menu shows the vehicle's refusal, and that the button can be pressed again."""
    problem = {
        "code": "rejected",
        "title": "The vehicle refused",
        "status": 409,
        "detail": "Too windy.",
        "remedy": "Wait.",
    }

    def refuse(route: Route) -> None:
        route.fulfill(status=409, content_type="application/problem+json", body=json.dumps(problem))

    page.route("**/goto", refuse)
    menu.get_by_role("button", name="Go here").click()
    confirm_by_slider(page)
    expect(menu.get_by_role("alert")).to_contain_text("Go here: The vehicle refused")
    expect(menu.get_by_role("alert")).to_contain_text("Too windy.")
    expect(menu.get_by_role("alert")).to_contain_text("Wait.")
    page.unroute("**/goto", refuse)


def check_menu_by_keyboard(page: Page) -> None:
    """Opens the menu by Tab to the map, arrow keys and Enter; checks that the menu has the focus."""
    page.get_by_role("application").focus()
    for _ in range(3):
        page.keyboard.press("Shift+ArrowRight")
    expect(page.locator(".cross")).to_contain_text(" E")
    page.keyboard.press("Enter")
    menu = page.get_by_role("dialog")
    expect(menu).to_contain_text("east of the vehicle")
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement.closest('[role=dialog]') !== null")


def check_click_in_3d(page: Page) -> None:
    """Clicks on the ground in 3D; checks that the menu opens at the pointer."""
    page.mouse.click(520, 700)
    menu = page.get_by_role("dialog")
    expect(menu).to_contain_text("of home")
    expect(menu).to_contain_text("Ground at this position:")
    box = bounding_box(menu)
    assert box["x"] == pytest.approx(540, abs=30)
    page.keyboard.press("Escape")
    expect(menu).to_be_hidden()


def mean_colour(page: Page) -> tuple[float, float, float]:
    """Red, green, blue of a part of the map."""
    screenshot = page.screenshot(clip={"x": 700, "y": 600, "width": 40, "height": 40})
    r, g, b = page.evaluate(MEAN_COLOUR, base64.b64encode(screenshot).decode())
    return r, g, b


@pytest.mark.parametrize("file_type", ["pmtiles", "mbtiles"])
def test_a_map_file_of_the_operator_is_shown(browser: Browser, station: Station, file_type: str) -> None:
    folder = Path(station.gcs.request("GET", "/maps")["folder"])
    write_map_file, attribution = (
        (write_pmtiles, "© Red Survey") if file_type == "pmtiles" else (write_mbtiles, "Green Maps")
    )
    write_map_file(folder / f"field.{file_type}", png((255, 0, 0)))
    with open_page(browser, station.url, theme="light", scene=False) as page:
        open_large_map(page)
        expect(page.get_by_role("toolbar", name="Map")).to_contain_text(attribution)

        def is_red() -> bool:
            r, g, b = mean_colour(page)
            return r - max(g, b) > 60

        wait_until(is_red, "the tiles of the operator's file")


def test_a_source_is_chosen_and_saved_by_clicks(browser: Browser, station: Station) -> None:
    """The page itself asks nobody but the server: `open_page` checks it."""
    source = TileServer(png((0, 0, 255)))
    try:
        with (
            open_page(browser, station.url, theme="light", scene=False) as page,
            open_page(browser, station.url, theme="light", scene=False) as other_browser,
        ):
            open_large_map(other_browser)
            open_large_map(page)
            page.get_by_role("button", name="Choose map").click()
            panel = page.get_by_role("region", name="Map source")
            expect(panel).to_contain_text("nothing is asked for on the internet")
            panel.get_by_role("button", name="Add a source").click()
            panel.get_by_label("Name").fill("Field server")
            panel.get_by_label("Address of a tile").fill(source.url.replace("{z}", "{level}"))
            panel.get_by_label("allow saving").check()
            panel.get_by_role("button", name="Add and show").click()
            expect(panel.get_by_role("alert")).to_contain_text("{level}")
            assert source.asked == []
            panel.get_by_label("Address of a tile").fill(source.url)
            panel.get_by_role("button", name="Add and show").click()
            expect(panel).to_contain_text("and so tells it which area is viewed")
            wait_until(lambda: mean_colour(page)[2] - mean_colour(page)[0] > 60, "the tiles of the source")
            wait_until(
                lambda: mean_colour(other_browser)[2] - mean_colour(other_browser)[0] > 60, "the same there"
            )
            panel.get_by_label("Name").fill("Our field")
            panel.get_by_role("button", name="How large?").click()
            expect(panel).to_contain_text("tiles, about")
            panel.get_by_role("button", name="Save", exact=True).click()
            expect(panel).to_contain_text("shown without internet")
            assert serious_violations(page) == []
            source.close()
            panel.get_by_label("Grid only").check()
            expect(panel).to_contain_text("and the map file")
            wait_until(lambda: mean_colour(page)[2] - mean_colour(page)[0] > 60, "the saved tiles")
    finally:
        source.close()


def test_a_layer_of_a_service_is_chosen_by_its_capabilities(browser: Browser, station: Station) -> None:
    picture, source = png((0, 160, 0)), TileServer()
    base = source.url.partition("/{z}")[0]
    template = f"{base}/{{Style}}/{{TileMatrixSet}}/{{TileMatrix}}/{{TileRow}}/{{TileCol}}.png"
    capabilities = description(
        matrix_set(), layer("roads"), layer("land", title="Land use", template=template)
    )
    answers = {"/WMTSCapabilities.xml": capabilities, "/sign-in.xml": b"<html>Sign in</html>"}
    source.answer = lambda path: answers.get(path, picture)
    try:
        with open_page(browser, station.url, theme="light", scene=False) as page:
            open_large_map(page)
            page.get_by_role("button", name="Choose map").click()
            panel = page.get_by_role("region", name="Map source")
            panel.get_by_role("button", name="Add a source").click()
            address = panel.get_by_label("Address of a tile")
            address.fill(f"{base}/sign-in.xml")
            panel.get_by_role("button", name="Read its layers").click()
            expect(panel.get_by_role("alert")).to_contain_text("a web page")
            address.fill(f"{base}/WMTSCapabilities.xml")
            panel.get_by_role("button", name="Read its layers").click()
            expect(panel.get_by_label("Layer")).to_contain_text("Land use")
            expect(panel).to_contain_text("One more layer is not in Web Mercator, or has no images.")
            expect(panel.get_by_label("Name")).to_have_value("Land use")
            expect(panel.get_by_label("Attribution")).to_have_value("Office of Maps")
            assert serious_violations(page) == []
            if PICTURES:
                page.screenshot(path=Path(PICTURES) / "wmts.png")
            panel.get_by_role("button", name="Add and show").click()
            expect(panel).to_contain_text("and so tells it which area is viewed")

            def is_green() -> bool:
                r, g, b = mean_colour(page)
                return g - max(r, b) > 60

            wait_until(is_green, "the tiles of the layer")
            expect(page.get_by_role("toolbar", name="Map")).to_contain_text("Office of Maps")
    finally:
        source.close()


@pytest.mark.parametrize("kind", ["raster", "vector"])
def test_a_pmtiles_file_at_an_address_is_drawn(browser: Browser, station: Station, kind: str) -> None:
    """Its own attribution is shown, also when the source is gone; then its kept tiles stay."""
    if kind == "raster":
        file = archive({0: png((255, 0, 0))}, zooms=(0, 0))
    else:
        metadata = {"attribution": "© Us", "vector_layers": [{"id": "land"}]}
        file = archive(
            {0: vector_tile("land")}, zooms=(0, 0), kind=VECTOR_TILES, packed=True, metadata=metadata
        )
    source = ArchiveServer(file)
    try:
        with open_page(browser, station.url, theme="light", scene=False) as page:
            open_large_map(page)
            before = mean_colour(page)

            def is_drawn() -> bool:
                return math.dist(mean_colour(page), before) > (60 if kind == "raster" else 4)

            page.get_by_role("button", name="Choose map").click()
            panel = page.get_by_role("region", name="Map source")
            panel.get_by_role("button", name="Add a source").click()
            panel.get_by_label("Name").fill(f"World {kind}")
            panel.get_by_label("Address of a tile").fill(source.url)
            panel.get_by_label("allow saving").check()
            panel.get_by_role("button", name="Add and show").click()
            expect(panel).to_contain_text("and so tells it which area is viewed")
            expect(page.get_by_role("toolbar", name="Map")).to_contain_text("© Us")
            wait_until(is_drawn, "the tiles of the archive")
            assert source.asked
            if PICTURES:
                page.screenshot(path=Path(PICTURES) / f"pmtiles-{kind}.png")
            if kind == "vector":
                panel.get_by_role("button", name="How large?").click()
                panel.get_by_role("button", name="Save", exact=True).click()
                expect(panel.get_by_role("alert")).to_contain_text("vector tiles")
            source.close()
            page.reload()
            open_large_map(page)
            wait_until(is_drawn, "its kept tiles")
    finally:
        source.close()
