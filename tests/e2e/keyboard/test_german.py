"""The whole page in German: no English word, no text without room."""

from __future__ import annotations

from collections import Counter

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import open_page
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.german import choose_german, clipped_texts, english_texts, german
from tests.e2e.keyboard.tab_order import close_all, views_and_panels

pytestmark = [pytest.mark.browser, pytest.mark.story]

SIZES = [(1280, 800), (1024, 768), (390, 844)]


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_every_view_and_panel_is_german_and_has_room_for_it(
    browser: Browser, flying_station: Station, size: tuple[int, int]
) -> None:
    clipped_in_english: dict[str, Counter[str]] = {}
    with open_page(browser, flying_station.url, scene=False, size=size) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        for name, open_view in views_and_panels(page):
            open_view()
            page.wait_for_timeout(200)
            clipped_in_english[name] = Counter(clipped_texts(page))
            if not name.startswith("view"):
                close_all(page)
        choose_german(page)
        expect(page.locator(".pill b")).to_have_text(german("Holding"))
        found: dict[str, list[str]] = {}
        for name, open_view in views_and_panels(page, german):
            open_view()
            page.wait_for_timeout(200)
            more_clipped = Counter(clipped_texts(page)) - clipped_in_english[name]
            if texts := [*english_texts(page), *(f"no room: {one}" for one in more_clipped)]:
                found[name] = texts
            if not name.startswith("view"):
                close_all(page)
    assert found == {}


def test_the_page_opens_in_the_chosen_language(browser: Browser, flying_station: Station) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        choose_german(page)
        expect(page.locator(".pill b")).to_have_text(german("Holding"))
