"""The stage by hand: a place on map or in 3D sends vehicle and camera there; nothing is loaded anew."""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, Route, expect

from gcs_server.client import SyncVehicle
from tests.e2e.browser import REPOSITORY, chromium, opened, scene, serious_violations, slide
from tests.e2e.fast_station import Station
from tests.e2e.map_files import png, write_mbtiles, write_pmtiles
from tests.station import wait_until
from tools import build_page

pytestmark = pytest.mark.browser

MEAN_COLOUR = """
async (shot) => {
  const image = new Image();
  image.src = `data:image/png;base64,${shot}`;
  await image.decode();
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [1, 1];
  const ctx = canvas.getContext('2d');
  ctx.drawImage(image, 0, 0, 1, 1);
  return [...ctx.getImageData(0, 0, 1, 1).data].slice(0, 3);
}
"""
FREE = """
() => {
  const box = (name) => document.querySelector(name)?.getBoundingClientRect();
  const stage = box('main'), small = box('section.inset'), cards = box('aside');
  const news = box('.news'), bar = box('.place .dock');
  const left = small ? small.right : stage.left;
  return [(left + cards.left) / 2, (news.bottom + bar.top) / 2];
}
"""
"""The middle of what panels leave free: there a followed vehicle is on the large map."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One Chromium for all of them; the page is built first if it is older than its sources."""
    build_page.build(REPOSITORY)
    with chromium() as one:
        yield one


def large_map(page: Page, *, beside_scene: bool = False) -> None:
    """The map fills the stage, as it does by itself where there is no 3D view, and follows the vehicle."""
    if beside_scene:
        page.get_by_title("3D view", exact=True).wait_for()
        page.keyboard.press("m")
    page.get_by_role("toolbar", name="Map").wait_for()
    expect(page.locator(".bar")).to_have_text("10 m")


def menu_at(page: Page, east_px: int, north_px: int) -> Locator:
    """The menu of a place beside the vehicle."""
    x, y = page.evaluate(FREE)
    page.mouse.click(x + east_px, y - north_px)
    menu = page.get_by_role("dialog")
    menu.wait_for()
    return menu


def place_of(menu: Locator) -> tuple[float, float]:
    """Latitude and longitude [deg] as the menu says them."""
    found = re.search(r"(-?\d+\.\d+), (-?\d+\.\d+)", menu.locator(".where").inner_text())
    assert found is not None
    return float(found[1]), float(found[2])


def told(drone: SyncVehicle, topic: str) -> dict[str, Any]:
    """A topic's newest value, which this vehicle has reported."""
    value = drone.topic(topic)
    assert value is not None
    return value


def metres_from(drone: SyncVehicle, place: tuple[float, float]) -> float:
    here = told(drone, "global_position")
    north = math.radians(here["lat_deg"] - place[0]) * 6_371_000
    east = math.radians(here["lon_deg"] - place[1]) * 6_371_000 * math.cos(math.radians(place[0]))
    return math.hypot(north, east)


@pytest.mark.realtime  # clicks into 3D, drawn in software
def test_a_place_on_the_map_or_in_3d(browser: Browser, station: Station) -> None:
    drone = station.drone
    drone.takeoff(8)
    with opened(browser, station.url, scene=False) as page:
        large_map(page)
        menu = menu_at(page, 120, 80)
        expect(menu).to_contain_text(re.compile(r"1[78]\.\d m north-east of the vehicle"))
        expect(menu).to_contain_text(re.compile(r"about \d+ s"))
        goal = place_of(menu)
        height = menu.get_by_label("Flight altitude above home", exact=True)
        height.fill("10")
        height.press("Tab")
        refused_where_it_was_pressed(page, menu)
        menu.get_by_role("button", name="Go here").click()
        expect(page.get_by_role("alertdialog")).to_contain_text("to 10.0 m above home")
        slide(page)
        expect(menu).to_be_hidden()
        wait_until(lambda: metres_from(drone, goal) < 1.5, "the vehicle where the map was clicked", 30)
        wait_until(lambda: abs(told(drone, "global_position")["alt_home_m"] - 10) < 1, "the height asked")

        menu = menu_at(page, -80, -64)
        expect(menu).to_contain_text("Look here: Take control of the gimbal first")
        aim = place_of(menu)
        menu.get_by_role("button", name="Set ROI").click()
        expect(menu).to_be_hidden()
        roi = drone.request("GET", "/gimbal")["roi"]
        assert (roi["lat_deg"], roi["lon_deg"]) == pytest.approx(aim, abs=1e-6)
        home = told(drone, "home")["alt_amsl_m"]
        assert roi["alt_amsl_m"] == pytest.approx(home, abs=0.1)
        wait_until(lambda: told(drone, "gimbal")["pitch_rad"] < -0.4, "the camera down to the place")
        expect(page.get_by_label("Gimbal", exact=True)).to_contain_text("Points at")

        by_keys_alone(page)
        assert serious_violations(page) == []
        page.keyboard.press("Escape")

    with opened(browser, station.url) as page:
        large_map(page, beside_scene=True)
        scene(page).evaluate("() => { window.kept = true }")
        page.get_by_title("Show the 3D view large (M)").click()
        page.get_by_title("Show the map large (M)").click()
        page.keyboard.press("m")
        expect(page.get_by_title("Show the map large (M)")).to_be_visible()
        assert scene(page).evaluate("() => window.kept") is True
        in_3d(page)

    drone.land()
    drone.until_disarmed()
    with opened(browser, station.url, scene=False) as page:
        large_map(page)
        menu = menu_at(page, 60, 60)
        expect(menu).to_contain_text("The vehicle is on the ground: take off first.")
        expect(menu.get_by_role("button", name="Go here")).to_have_attribute("aria-disabled", "true")


def refused_where_it_was_pressed(page: Page, menu: Locator) -> None:
    """What the vehicle answers stands in the menu; a second try is open."""
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
    slide(page)
    expect(menu.get_by_role("alert")).to_contain_text("Go here: The vehicle refused")
    expect(menu.get_by_role("alert")).to_contain_text("Too windy.")
    expect(menu.get_by_role("alert")).to_contain_text("Wait.")
    page.unroute("**/goto", refuse)


def by_keys_alone(page: Page) -> None:
    """Tab to the map, arrows, Enter: the same menu, with its keyboard focus inside."""
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


def in_3d(page: Page) -> None:
    """A click on the ground in 3D opens the menu at the pointer."""
    page.mouse.click(520, 700)
    menu = page.get_by_role("dialog")
    expect(menu).to_contain_text("of home")
    expect(menu).to_contain_text("Ground there:")
    box = menu.bounding_box()
    assert box is not None
    assert box["x"] == pytest.approx(540, abs=30)
    page.keyboard.press("Escape")
    expect(menu).to_be_hidden()


@pytest.mark.parametrize("kind", ["pmtiles", pytest.param("mbtiles", marks=pytest.mark.realtime)])
def test_a_map_file_of_the_operators_own(browser: Browser, station: Station, kind: str) -> None:
    folder = Path(station.gcs.request("GET", "/maps")["folder"])
    write, made = (write_pmtiles, "© Red Survey") if kind == "pmtiles" else (write_mbtiles, "Green Maps")
    write(folder / f"field.{kind}", png((255, 0, 0)))
    with opened(browser, station.url, theme="light", scene=False) as page:
        large_map(page)
        expect(page.get_by_role("toolbar", name="Map")).to_contain_text(made)

        def red() -> bool:
            shot = page.screenshot(clip={"x": 700, "y": 600, "width": 40, "height": 40})
            r, g, b = page.evaluate(MEAN_COLOUR, base64.b64encode(shot).decode())
            return r - max(g, b) > 60

        wait_until(red, "the operator's own tiles")
