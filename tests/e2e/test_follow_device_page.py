"""The page follows this device by the browser's position: by clicks, until the positions stop."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from gcs_server.client import SyncVehicle
from missions.geodesy import distance_m
from tests.e2e.browser import confirm_by_slider, open_page, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

METRES_PER_DEGREE = 111_195
PICTURES = os.environ.get("FOLLOW_PICTURES")
"""Where the screens are saved, to look at them; unset: nowhere."""
ALWAYS_NEW = """
() => {
  const { geolocation } = navigator;
  const ask = geolocation.getCurrentPosition.bind(geolocation);
  geolocation.getCurrentPosition = (found, ...rest) =>
    ask(({ coords }) => found({ coords, timestamp: Date.now() }), ...rest);
}
"""
"""A device locates itself anew; the emulated position keeps the time at which the test has set it."""


def picture(page: Page, name: str) -> None:
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / f"{name}.png")


def carry_device(
    page: Page, drone: SyncVehicle, north_m: float, accuracy_m: float = 5.0
) -> tuple[float, float]:
    """Puts the device 30 m east and some metres north of home; returns its latitude and longitude."""
    home = drone.topic("home")
    assert home is not None
    lon_scale = METRES_PER_DEGREE * math.cos(math.radians(home["lat_deg"]))
    at = (home["lat_deg"] + north_m / METRES_PER_DEGREE, home["lon_deg"] + 30 / lon_scale)
    page.context.set_geolocation({"latitude": at[0], "longitude": at[1], "accuracy": accuracy_m})
    return at


def away_m(drone: SyncVehicle, at: tuple[float, float]) -> float:
    position = drone.topic("global_position")
    assert position is not None
    return distance_m(position["lat_deg"], position["lon_deg"], *at)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_vehicle_follows_this_device_until_its_positions_stop(
    browser: Browser, station: Station, theme: str
) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    with open_page(browser, station.url, theme=theme, size=(1280, 800), scene=False) as page:
        page.locator(".pill").wait_for()
        page.evaluate(ALWAYS_NEW)
        page.keyboard.press("b")
        panel = page.get_by_label("Guide", exact=True)
        panel.get_by_role("radio", name="Follow", exact=True).click()
        whom = panel.get_by_label("Whom", exact=True)
        whom.select_option(label="This device")
        expect(panel).to_contain_text("The browser does not give this page the position of this device")
        page.context.grant_permissions(["geolocation"])
        at = carry_device(page, drone, 0.0, accuracy_m=60)
        expect(panel).to_contain_text("accurate to 60 m: following needs 20 m")
        at = carry_device(page, drone, 0.0)
        expect(panel).to_contain_text(
            re.compile(r"stays 15 m west of it at \d+\.\d m above home, not above you")
        )
        panel.get_by_label("Nose", exact=True).select_option(label="Towards this device")
        panel.get_by_label("Altitude above home", exact=True).fill("3")
        expect(panel).to_contain_text("From 5 to 500 m")
        panel.get_by_label("Altitude above home", exact=True).fill("9")
        assert serious_violations(page) == []
        picture(page, f"{theme}-1-draft")
        panel.get_by_role("button", name="Follow this device…").click()
        expect(page.get_by_role("alertdialog")).to_contain_text("It holds if no position comes for 4 s")
        picture(page, f"{theme}-2-confirmation")
        confirm_by_slider(page)
        wait_until(lambda: abs(away_m(drone, at) - 15) < 2, "15 m from the device", 30)
        expect(panel).to_contain_text(re.compile(r"Follows this device: 1[3-7]\.\d m away"))
        for north_m in range(2, 14, 2):  # walks north
            at = carry_device(page, drone, north_m)
            page.wait_for_timeout(1000)
        wait_until(lambda: abs(away_m(drone, at) - 15) < 2, "15 m from the device", 30)
        picture(page, f"{theme}-3-following")
        assert serious_violations(page) == []
        page.context.clear_permissions()
        drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")
        expect(panel).to_contain_text("Following has ended")
        assert abs(away_m(drone, at) - 15) < 3


def test_hold_ends_following_and_so_does_closing_the_page(browser: Browser, station: Station) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    drone.request("POST", "/control/release", {})
    for ends_by_hold in (True, False):
        with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
            page.locator(".pill").wait_for()
            page.evaluate(ALWAYS_NEW)
            page.context.grant_permissions(["geolocation"])
            at = carry_device(page, drone, 0.0)
            page.keyboard.press("b")
            panel = page.get_by_label("Guide", exact=True)
            panel.get_by_role("radio", name="Follow", exact=True).click()
            panel.get_by_label("Whom", exact=True).select_option(label="This device")
            panel.get_by_role("button", name="Follow this device…").click()
            confirm_by_slider(page)
            drone.until(lambda v: v["status"]["mode"] == "offboard", what="Offboard")
            wait_until(lambda at=at: abs(away_m(drone, at) - 15) < 2, "15 m from the device", 40)
            if ends_by_hold:
                page.get_by_role("button", name="Hold", exact=True).first.click()
                drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")
                for north_m in (2, 4, 6):  # the device moves on, the vehicle does not
                    carry_device(page, drone, north_m)
                    page.wait_for_timeout(1500)
                    assert drone.status()["mode"] == "hold"
                expect(panel).to_contain_text("Following has ended: the vehicle is in Hold.")
        if not ends_by_hold:
            drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold without the page")
