"""Guided actions by clicks, by key and on a phone's size: each shows its effect before, its progress and its
end; a refused one says why."""

from __future__ import annotations

import math
import re

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e.browser import confirm_by_slider, open_page, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

PHONE = (390, 844)


def open_guide(page: Page, command: str) -> Locator:
    """Opens the form with its key, and chooses a command."""
    page.locator(".pill").wait_for()
    page.keyboard.press("b")
    panel = page.get_by_label("Guide", exact=True)
    panel.get_by_role("radio", name=command, exact=True).click()
    return panel


def test_an_orbit_from_the_map_is_drawn_flown_and_ended(browser: Browser, station: Station) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.get_by_role("toolbar", name="Map").wait_for()
        page.mouse.click(760, 300)
        page.get_by_role("dialog").get_by_role("button", name="Orbit here…").click()
        panel = page.get_by_label("Guide", exact=True)
        expect(panel).to_contain_text(
            re.compile(r"Centre\s*47\.\d{6}, 8\.\d{6}")
        )  # not the vehicle's position
        panel.get_by_label("Radius", exact=True).fill("4")
        expect(panel).to_contain_text("At 4 m the vehicle flies at most 2.8 m/s")
        expect(panel.get_by_role("button", name="Orbit…")).to_have_attribute("aria-disabled", "true")
        panel.get_by_label("Radius", exact=True).fill("15")
        panel.get_by_role("radio", name="Counter-clockwise").click()
        expect(panel).to_contain_text("a circle of 15 m radius")
        assert serious_violations(page) == []
        panel.get_by_role("button", name="Orbit…").click()
        expect(page.get_by_role("alertdialog")).to_contain_text("circles counter-clockwise at 3 m/s")
        confirm_by_slider(page)
        expect(panel).to_contain_text("Orbit of 15 m, counter-clockwise", timeout=20_000)
        circle = drone.topic("orbit")
        assert circle is not None
        assert (circle["radius_m"], circle["clockwise"]) == (15, False)
        page.keyboard.press("h")
        expect(panel).to_contain_text("The orbit has ended: the vehicle is in Hold")


def test_altitude_by_key_and_a_refused_home(browser: Browser, station: Station) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        panel = open_guide(page, "Altitude")
        panel.get_by_label("Altitude above home", exact=True).fill("18")
        expect(panel).to_contain_text("to 18.0 m above home")
        panel.get_by_role("button", name="Change altitude…").click()
        confirm_by_slider(page)
        expect(panel).to_contain_text("Reached 18.0 m above home", timeout=30_000)
        drone.rtl()
        panel.get_by_role("radio", name="Home", exact=True).click()
        expect(panel).to_contain_text("refers to the present home: Hold first")


def test_the_nose_is_turned_to_a_place_on_the_map(browser: Browser, station: Station) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.get_by_role("toolbar", name="Map").wait_for()
        page.mouse.click(760, 300)
        page.get_by_role("dialog").get_by_role("button", name="Turn nose here…").click()
        panel = page.get_by_label("Guide", exact=True)
        expect(panel).to_contain_text("once: it does not follow it")
        asked_deg = float(panel.get_by_label("Heading", exact=True).input_value())
        assert serious_violations(page) == []
        panel.get_by_role("button", name="Turn…").click()
        confirm_by_slider(page)
        expect(panel).to_contain_text("Turned to", timeout=30_000)
        position = drone.topic("global_position")
        assert position is not None
        assert abs(math.remainder(position["heading_deg"] - asked_deg, 360.0)) < 12


def test_home_is_set_on_a_phone_and_the_mode_menu_holds(browser: Browser, station: Station) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    before = drone.topic("home")
    assert before is not None
    drone.goto(before["lat_deg"] + 2e-4, before["lon_deg"], alt_home_m=10)
    drone.until(
        lambda v: v["topics"]["global_position"]["value"]["lat_deg"] - before["lat_deg"] > 1.8e-4,
        what="the position",
    )
    with open_page(browser, station.url, size=PHONE, scene=False) as page:
        panel = open_guide(page, "Home")
        expect(panel).to_contain_text("Return flies here and lands here")
        panel.get_by_role("button", name="Set home…").click()
        confirm_by_slider(page)
        expect(panel).to_contain_text("Home is set.", timeout=20_000)
        wait_until(
            lambda: math.isclose(drone.topic("home")["lat_deg"] - before["lat_deg"], 2e-4, abs_tol=4e-5),  # type: ignore[index]
            "the new home",
        )
        panel.get_by_role("button", name="Close").click()
        page.get_by_role("button", name="Modes", exact=True).click()
        menu = page.get_by_label("Modes", exact=True).last
        expect(menu).to_contain_text("No RC transmitter or joystick")
        drone.set_mode("land")
        menu.get_by_role("button", name=re.compile("^Hold ")).click()  # without a confirmation
        drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")
