"""The confirmation of a go-to shows simulated flights from the vehicle's present state: their corridor on the
map, and what they come near to. It never waits for them."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import confirm_by_slider, open_page, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

PICTURES = os.environ.get("FUTURES_PICTURES")
"""Where some screens are saved, to look at them; unset: nowhere."""


def ask_to_go(page: Page) -> None:
    page.get_by_role("toolbar", name="Map").wait_for()
    page.mouse.click(760, 300)
    page.get_by_role("button", name="Go here").click()
    page.get_by_role("alertdialog").wait_for()


def picture(page: Page, name: str) -> None:
    if PICTURES is not None:
        page.screenshot(path=Path(PICTURES) / f"{name}.png")


def ask_to_climb(page: Page) -> None:
    page.locator(".pill").wait_for()
    if page.get_by_label("Guide", exact=True).count() == 0:
        page.keyboard.press("b")
    panel = page.get_by_label("Guide", exact=True)
    panel.get_by_role("radio", name="Altitude", exact=True).click()
    panel.get_by_label("Altitude above home", exact=True).fill("30")
    panel.get_by_role("button", name="Change altitude…").click()
    page.get_by_role("alertdialog").wait_for()


@pytest.mark.parametrize(
    ("theme", "size", "ask", "limits"),
    [
        ("dark", (1280, 800), ask_to_go, {"distance_max_m": 5}),
        ("light", (390, 844), ask_to_climb, {"height_max_m": 15}),
    ],
)
def test_a_command_shows_where_it_leads_and_what_it_comes_near_to(
    browser: Browser,
    station: Station,
    theme: str,
    size: tuple[int, int],
    ask: Callable[[Page], None],
    limits: dict[str, float],
) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    drone.futures(mode="hold")  # the first ones wait until their process has started
    with open_page(browser, station.url, size=size, theme=theme, scene=False) as page:
        ask(page)
        flights = page.get_by_role("group", name="Simulated flights")
        expect(flights).to_contain_text(re.compile(r"100 simulated flights: there in \d+ to \d+ s"))
        picture(page, f"clear-{theme}")
        slider = page.get_by_role("alertdialog").locator(".knob").bounding_box()
        page.keyboard.press("Escape")
        drone.set_offboard_limits(**limits)
        ask(page)
        expect(flights).to_contain_text(re.compile(r"Leaves the geofence in \d+ of 100 simulated flights"))
        picture(page, f"fence-{theme}")
        assert page.get_by_role("alertdialog").locator(".knob").bounding_box() == slider
        assert serious_violations(page) == []


def test_a_confirmation_does_not_wait_and_its_end_ends_the_flights(
    browser: Browser, station: Station
) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        asked, failed = [], []
        page.on("requestfailed", lambda request: failed.append(request.url))

        def never_answer(route: object) -> None:
            asked.append(route)

        page.route("**/futures", never_answer)
        ask_to_go(page)
        expect(page.get_by_role("group", name="Simulated flights")).to_contain_text("Flies it in simulation")
        confirm_by_slider(page)
        wait_until(lambda: (target := drone.topic("target_local")) and target["position_ned_m"], 20)
        expect(page.get_by_role("alertdialog")).to_have_count(0)
        wait_until(lambda: any(url.endswith("/futures") for url in failed), 5)
        assert len(asked) == 1
