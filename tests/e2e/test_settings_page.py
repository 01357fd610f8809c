"""A person's settings by clicks: the same in two browsers, right at the first paint, saved to a file and
opened; wrong files are refused with the field's name and change nothing."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import confirm_by_slider, open_page, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold

pytestmark = [pytest.mark.browser]

IS_DARK = "() => document.documentElement.dataset.theme === 'dark'"


def open_settings(page: Page, name: str) -> None:
    page.keyboard.press("Shift+U")
    field = page.get_by_label("Your name, as others see it")
    field.fill(name)
    field.press("Enter")
    expect(page.get_by_text(f"The settings of {name} apply")).to_be_visible()


def choose_file(page: Page, path: Path) -> None:
    page.get_by_label("File of settings").set_input_files(path)


def test_settings_follow_a_person_into_another_browser_and_a_file(
    browser: Browser, station: Station, tmp_path: Path
) -> None:
    size = (1280, 800)
    with (
        open_page(browser, station.url, size=size, scene=False, theme="light") as page,
        open_page(browser, station.url, size=size, scene=False, theme="light", client_id="other") as other,
    ):
        for each in (page, other):
            open_settings(each, "Vera")
        page.get_by_role("radio", name="Dark", exact=True).click()
        other.wait_for_function(IS_DARK)
        page.get_by_label("Take-off", exact=True).fill("500")
        expect(page.get_by_text("Enter a number from 1 to 120")).to_be_visible()
        page.get_by_label("Take-off", exact=True).fill("21")
        expect(other.get_by_label("Take-off", exact=True)).to_have_value("21")
        assert serious_violations(page) == []

        with page.expect_download() as download:
            page.get_by_role("button", name="Save to a file").click()
        saved = tmp_path / "settings.json"
        download.value.save_as(saved)
        content = json.loads(saved.read_text())
        assert content["settings"] == {"theme": "dark", "default_altitudes": {"takeoff_m": 21}}

        wrong = tmp_path / "wrong.json"
        content["settings"]["default_altitudes"]["takeoff_m"] = 900
        wrong.write_text(json.dumps(content))
        choose_file(page, wrong)
        alert = page.get_by_role("alert").filter(has_text="Nothing has changed.")
        expect(alert).to_contain_text("settings.default_altitudes.takeoff_m")
        wrong.write_text(json.dumps({**content, "version": 99}))
        choose_file(page, wrong)
        expect(alert).to_contain_text("newer version of this server")

        page.get_by_role("radio", name="System", exact=True).click()
        other.wait_for_function(f"() => !({IS_DARK})()")
        choose_file(page, saved)
        expect(page.get_by_text("The settings of settings.json apply.")).to_be_visible()
        other.wait_for_function(IS_DARK)
        other.reload()
        assert other.evaluate(IS_DARK)
        other.get_by_role("button", name="Settings", exact=True).click()
        expect(other.get_by_label("Take-off", exact=True)).to_have_value("21")


@pytest.mark.story
def test_an_altitude_given_in_feet_is_flown_in_metres(browser: Browser, station: Station) -> None:
    """Field, bounds, confirmation and instruments are in feet; the vehicle flies the metres."""
    take_off_to_hold(station.drone)
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        open_settings(page, "Will")
        units = page.get_by_role("radiogroup", name="Units", exact=True)
        units.get_by_role("radio", name="Imperial").click()
        page.get_by_role("button", name="Close the settings").click()
        expect(page.get_by_role("region", name="Attitude and heading")).to_contain_text("ft")
        expect(page.locator(".bar")).to_have_text(re.compile(r"\d+ ft"))  # the map's scale
        page.mouse.click(760, 300)
        menu = page.get_by_role("dialog")
        field = menu.get_by_label("Flight altitude above home", exact=True)
        field.fill("4000")
        expect(menu).to_contain_text("to 3280.83 ft.")
        field.fill("60")
        menu.get_by_role("button", name="Go here").click()
        expect(page.get_by_role("alertdialog")).to_contain_text("at 60.0 ft above home")
        confirm_by_slider(page)

        def altitude_m(state: dict[str, Any]) -> float:
            return state["topics"]["global_position"]["value"]["alt_home_m"]

        station.drone.until(lambda v: abs(altitude_m(v) - 60 * 0.3048) < 0.5, what="60 ft above home")
