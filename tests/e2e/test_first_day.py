"""A first day, by clicks: choose a map, draw a survey, turn it, dry run, fly, hold, resume, land, compare."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import choose_menu_entry, confirm_by_slider, open_page, serious_violations
from tests.e2e.fast_station import Station
from tests.e2e.line_mission import current_item
from tests.e2e.map_files import png
from tests.e2e.plan_page import (
    check_without_findings,
    entries_of,
    open_plan_view,
    run_dry_run,
    upload_plan,
    window_position_on_map,
)
from tests.station import wait_until
from tests.support.tile_server import TileServer

pytestmark = [pytest.mark.browser, pytest.mark.story, pytest.mark.timeout(900)]

AREA = ((0.46, 0.25), (0.62, 0.25), (0.62, 0.45), (0.46, 0.45))
"""Corners of the survey, as fractions of the map."""
FOLDER = os.environ.get("FIRST_DAY_PICTURES")
"""Where each screen is saved; unset: nowhere."""


def picture(page: Page, name: str) -> None:
    """Checks the screen for accessibility, and saves it if somebody wants to look at it."""
    assert serious_violations(page) == [], name
    if FOLDER:
        page.screenshot(path=Path(FOLDER) / f"{name}.png")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_from_the_first_visit_to_the_comparison_of_the_flight(
    browser: Browser, station: Station, theme: str
) -> None:
    drone, tiles = station.drone, TileServer(png((150, 170, 140)))
    with open_page(browser, station.url, theme=theme, size=(1280, 800), scene=False) as page:
        page.get_by_role("button", name="Choose map").click()
        sources = page.get_by_role("region", name="Map source")
        sources.get_by_role("button", name="Add a source").wait_for()  # the panel has begun to fade in
        picture(page, f"{theme}-1-map-sources")
        sources.get_by_role("button", name="Add a source").click()
        sources.get_by_label("Name").fill("Field server")
        sources.get_by_label("Address of a tile").fill(tiles.url)
        sources.get_by_role("button", name="Add and show").click()
        expect(sources).to_contain_text("and so tells it which area is viewed")
        wait_until(lambda: bool(tiles.asked), "a tile of the source")
        sources.get_by_role("button", name="Close").click()

        view = open_plan_view(page)
        choose_menu_entry(view.get_by_role("button", name="Add item"), "Survey")
        for corner in AREA:
            page.mouse.click(*window_position_on_map(page, corner))
        view.get_by_label("Altitude", exact=True).fill("12")
        view.get_by_label("Heading of the lines").fill("0")
        figures = view.get_by_role("group", name="Figures of the pattern")
        expect(figures).to_contain_text("Line heading 0°")
        expect(figures.locator(".stale")).to_have_count(0)  # pale while new lines are being made
        picture(page, f"{theme}-2-survey")
        view.get_by_role("button", name="Insert survey").click()
        survey = entries_of(view).filter(has_text="Survey")
        before = survey.inner_text()
        page.get_by_role("group", name="Selection").get_by_role("button", name="Edit survey…").click()
        view.get_by_label("Heading of the lines").fill("60")
        expect(figures).to_contain_text("Line heading 60°")
        view.get_by_role("button", name="Done").click()
        expect(survey).not_to_have_text(before)
        findings = view.get_by_role("region", name="Findings")
        findings.get_by_role("button", name="Add a take-off at the beginning").click()
        check_without_findings(view)
        page.get_by_label("Name of the plan").fill(f"First day {theme}")
        run_dry_run(page, view)
        picture(page, f"{theme}-3-dry-run")

        on_vehicle = upload_plan(view)
        picture(page, f"{theme}-4-on-the-vehicle")
        on_vehicle.get_by_role("button", name="Fly…").click()
        picture(page, f"{theme}-5-confirmation")
        confirm_by_slider(page)
        drone.until(lambda v: v["status"]["mode"] == "mission", what="Mission")
        page.keyboard.press("w")
        card = page.get_by_label("Mission", exact=True)
        wait_until(lambda: (current_item(drone) or 0) >= 2, "the survey", 120)
        expect(card).to_contain_text(re.compile(r"Item \d+ of \d+"))
        picture(page, f"{theme}-6-in-flight")

        page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Hold").click()
        drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")
        expect(card).to_contain_text("Paused")
        picture(page, f"{theme}-7-paused")
        card.get_by_role("button", name=re.compile(r"^Resume at item \d+…$")).click()
        confirm_by_slider(page)
        drone.until(lambda v: v["status"]["mode"] == "mission", what="Mission")
        page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Land", exact=True).click()
        picture(page, f"{theme}-8-land")
        confirm_by_slider(page)
        drone.until_disarmed()
        expect(card.get_by_role("table", name="Flown compared with planned")).to_be_visible()
        picture(page, f"{theme}-9-compared")
    tiles.close()
