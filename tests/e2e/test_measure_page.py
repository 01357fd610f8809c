"""Distances are measured on the map by clicks and keys, in Fly and in the plan view; nothing is sent."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import open_page, serious_violations
from tests.e2e.fast_station import Station

pytestmark = [pytest.mark.browser]


def click_points(page: Page, *points: tuple[int, int]) -> None:
    for x, y in points:
        page.mouse.click(x, y)


@pytest.mark.story
def test_a_distance_and_an_area_are_measured_in_fly_and_plan_and_nothing_is_sent(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        sent: list[str] = []
        page.on("request", lambda request: sent.append(request.url) if request.method == "POST" else None)
        expect(page.locator(".bar")).to_have_text("10 m")  # the map is drawn
        page.get_by_role("toolbar", name="Map").get_by_role("button", name="Measure").click()
        panel = page.get_by_role("region", name="Measure")
        expect(panel).to_contain_text("each click adds a point")
        click_points(page, (700, 250), (800, 250), (800, 350))
        legs = panel.get_by_role("group", name="Legs")
        expect(legs).to_contain_text(re.compile(r"1 → 2.*\d m, 090°"))
        expect(legs).to_contain_text(re.compile(r"2 → 3.*\d m, 180°"))
        expect(panel.get_by_role("status")).to_contain_text("Distance")
        page.mouse.click(700, 250)  # the first point closes the area
        expect(panel.get_by_role("status")).to_contain_text(re.compile(r"Perimeter.*Area\d+(\.\d)? (m²|ha)"))
        assert serious_violations(page) == []
        expect(page.get_by_role("dialog")).to_have_count(0)
        page.keyboard.press("Escape")
        expect(panel).to_have_count(0)
        page.mouse.click(760, 300)
        expect(page.get_by_role("dialog")).to_be_visible()  # a click is again a place for commands
        page.keyboard.press("Escape")

        page.keyboard.press("w")
        view = page.get_by_role("region", name="Plan view")
        view.wait_for()
        page.keyboard.press("d")
        expect(panel).to_be_visible()
        click_points(page, (700, 250), (760, 300))
        expect(legs).to_contain_text("1 → 2")
        page.keyboard.press("d")
        expect(panel).to_have_count(0)
        expect(view.get_by_role("listbox", name="Items").get_by_role("option")).to_have_count(1)  # home
        assert [url for url in sent if "/vehicles/" in url] == []
