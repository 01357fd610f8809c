"""The ground from the first visit: a source of heights is chosen, and the ground of an area is saved from a
local tile server and shown: shaded on the map, below a plan, and as terrain in 3D."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import open_page, scene_frame, serious_violations
from tests.e2e.fast_station import Station
from tests.e2e.plan_page import home_of
from tests.station import wait_until
from tests.support.terrarium_tiles import tile_at
from tests.support.tile_server import TileServer

pytestmark = [pytest.mark.browser, pytest.mark.story]

FOLDER = os.environ.get("GROUND_PICTURES")
"""Where each screen is saved; unset: nowhere."""
PART_OF_MAP = {"x": 530, "y": 480, "width": 300, "height": 200}


def colours(page: Page) -> int:
    """Number of colours in a part of the map without vehicle and panels."""
    image = Image.open(io.BytesIO(page.screenshot(clip=PART_OF_MAP))).convert("RGB")  # type: ignore[arg-type]
    return len(np.unique(np.asarray(image).reshape(-1, 3), axis=0))


def picture(page: Page, name: str) -> None:
    """Checks the screen for accessibility, and saves it if somebody wants to look at it."""
    assert serious_violations(page) == [], name
    if FOLDER:
        page.screenshot(path=Path(FOLDER) / f"{name}.png")


def hills(home: dict[str, float]):
    """Rolling ground that passes two metres below home's altitude at home."""

    def elevation(lat_deg: np.ndarray, lon_deg: np.ndarray) -> np.ndarray:
        north_m = (lat_deg - home["lat_deg"]) * 111_200
        east_m = (lon_deg - home["lon_deg"]) * 75_300
        waves_m = 25 * np.sin(north_m / 130) + 20 * np.sin(east_m / 90)
        return home["alt_amsl_m"] - 2 + waves_m + 60 * (1 - np.exp(-(north_m**2 + east_m**2) / 4e6))

    return elevation


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_ground_of_an_area_is_saved_and_shown(browser: Browser, station: Station, theme: str) -> None:
    home = home_of(station)
    ground = hills(home)
    source = TileServer(lambda path: tile_at(ground, *(int(part) for part in path[1:-4].split("/"))))
    try:
        with open_page(browser, station.url, theme=theme, size=(1280, 800), scene=False) as page:
            page.get_by_role("toolbar", name="Map").wait_for()
            page.get_by_role("button", name="Choose map").click()
            panel = page.get_by_role("region", name="Map source")
            panel.get_by_role("radio", name="Ground").click()
            expect(panel).to_contain_text("level at home")
            expect(panel).to_contain_text("nothing is asked for on the internet")
            panel.get_by_role("button", name="Add a source").click()
            panel.get_by_label("Name").fill("Hills")
            panel.get_by_label("Address of a tile").fill(source.url)
            panel.get_by_label("allow saving").check()
            panel.get_by_role("button", name="Add and choose").click()
            expect(panel).to_contain_text("When you save an area, the server asks 127.0.0.1")
            for _ in range(4):
                page.get_by_role("button", name="Zoom out").click()
                page.wait_for_timeout(200)
            panel.get_by_label("Detail").select_option(label="A height each 6 m (zoom 14)")
            picture(page, f"{theme}-1-source")
            assert source.asked == []
            level = colours(page)
            panel.get_by_role("button", name="How large?").click()
            expect(panel).to_contain_text("tiles, about")
            panel.get_by_role("button", name="Save", exact=True).click()
            expect(panel).to_contain_text("Saved as an elevation file")
            expect(panel).to_contain_text("known from one elevation file")
            wait_until(lambda: colours(page) > level + 20, "the shades of the hills")
            picture(page, f"{theme}-2-shaded")
            panel.get_by_label("Shade hills").uncheck()
            wait_until(lambda: colours(page) <= level + 5, "the level map")
            panel.get_by_label("Shade hills").check()
        check_profile(station, home)
        with open_page(browser, station.url, theme=theme, size=(1280, 800)) as page:
            page.get_by_title("3D view", exact=True).wait_for()
            scene = scene_frame(page)
            expect(scene.locator(".gcs-tags em")).to_contain_text("terrain · lines 100 m", timeout=60_000)
            picture(page, f"{theme}-3-terrain")
            page.mouse.click(520, 640)
            menu = page.get_by_role("dialog")
            expect(menu).to_contain_text("Ground at this position:")
            page.keyboard.press("Escape")
    finally:
        source.close()


def check_profile(station: Station, home: dict[str, float]) -> None:
    """Checks that the ground below a plan is that of the saved area."""
    altitude = {"value_m": 100, "reference": "home"}
    items = [
        {"kind": "waypoint", "lat_deg": home["lat_deg"] + d, "lon_deg": home["lon_deg"], "altitude": altitude}
        for d in (0.001, 0.003)
    ]
    check = station.gcs.request("POST", "/plans/check", {"plan": {"planned_home": home, "items": items}})
    heights_m = [height_m for _, height_m in check["ground"] if height_m is not None]
    assert min(heights_m) < -1.0 < 15.0 < max(heights_m)
