"""The whole page in German: no English word, no text without room."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import REPOSITORY, open_page
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.german import choose_german, clipped_texts, english_texts, german
from tests.e2e.keyboard.german_walk import english_after_each_press, refuse_commands_in_german
from tests.e2e.keyboard.tab_order import close_all, views_and_panels
from tests.support.flown_log import flown_log

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


PLANS = [
    REPOSITORY / "tests/data/plans/survey_gimbal_fence.plan",
    REPOSITORY / "tests/data/plans/structure.plan",
    REPOSITORY / "tests/data/plans/corridor.plan",
    REPOSITORY / "missions/examples/tower_inspection.yaml",
    REPOSITORY / "missions/examples/two_vehicle_show.yaml",
]
OWN_WORD = re.compile(r"(?:(?:name|meeting|mission): |^  (?=\w+:$))([^,:}\n]+)", re.MULTILINE)
"""Names of steps, meetings, lists and roles in a mission."""


@pytest.mark.timeout(900)
def test_everything_that_a_press_shows_is_german(
    browser: Browser, flying_station: Station, tmp_path: Path
) -> None:
    log, _ = flown_log(tmp_path, (0.0, 3.0, 0.0))
    with open_page(browser, flying_station.url, scene=False, size=(1280, 800)) as page:
        refuse_commands_in_german(page)
        found: dict[str, list[str]] = {}
        pressed = [german("Reload"), "English"]
        own_words = {word for plan in PLANS for word in OWN_WORD.findall(plan.read_text("utf-8"))}
        for name, open_view in rooms(page, log):
            choose_german(page)  # every room begins with a page in which nothing is open
            expect(page.locator(".pill b")).to_have_text(german("Holding"))
            open_view()
            found |= english_after_each_press(page, name, pressed, own_words)
    assert found == {}


def rooms(page: Page, log: Path) -> list[tuple[str, Callable[[], None]]]:
    """Every view and panel, a plan of each kind, and a log."""

    def plan_opener(path: Path) -> Callable[[], None]:
        def open_plan() -> None:
            page.keyboard.press("w")
            page.get_by_label(german("File to import")).set_input_files(path)
            page.wait_for_timeout(1000)

        return open_plan

    def open_log() -> None:
        page.keyboard.press("Shift+E")
        page.get_by_label(german("Add a log")).set_input_files(log)
        page.get_by_role("radio", name=german("What if")).wait_for()

    return [
        *views_and_panels(page, german),
        *((path.name, plan_opener(path)) for path in PLANS),
        ("log", open_log),
    ]
