"""The page on a phone, by touch: what stops a vehicle is in reach, and nothing covers it."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e.browser import bounding_box, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.e2e.line_mission import plan_at, start_mission
from tests.e2e.touch import HEIGHT_PX, WIDTH_PX, phone, slide_by_touch

pytestmark = [pytest.mark.browser, pytest.mark.story]

TOUCH_PX = 44
"""Smallest side of a control that a thumb hits."""
TITLES = """() => {
  const [pill, title] = [document.querySelector('.pill'), document.querySelector('.pill b')];
  title.textContent = 'Connection lost';
  const [outer, inner] = [pill.getBoundingClientRect(), title.getBoundingClientRect()];
  return [inner.right <= outer.right, inner.bottom <= outer.bottom, title.scrollWidth <= title.clientWidth];
}"""
"""Whether the longest state of a vehicle is whole inside its pill."""


def assert_in_reach(page: Page, control: Locator) -> None:
    """The control is whole on the screen, large enough, and nothing lies over its middle."""
    box = bounding_box(control)
    assert box["x"] >= 0, box
    assert box["x"] + box["width"] <= WIDTH_PX, box
    assert box["y"] + box["height"] <= HEIGHT_PX, box
    assert min(box["width"], box["height"]) >= TOUCH_PX, box
    middle = [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]
    is_hit = "(element, [x, y]) => element.contains(document.elementFromPoint(x, y))"
    assert control.evaluate(is_hit, middle), f"{control} is covered"


def actions_of(page: Page) -> list[Locator]:
    """Hold, Land and Stop motors."""
    bar = page.get_by_role("toolbar", name="Actions")
    return [bar.get_by_role("button", name=name, exact=True) for name in ("Hold", "Land", "Stop motors")]


def test_hold_land_and_stop_motors_are_in_reach_while_a_mission_is_flown(
    browser: Browser, station: Station
) -> None:
    drone = station.drone
    drone.mission.upload(plan_id=station.gcs.plans().create("Line", plan_at(drone))["id"])
    with phone(browser, station) as page:
        start_mission(drone)
        card = page.get_by_label("Mission", exact=True)
        expect(card).to_contain_text("Waypoint")
        for control in (*actions_of(page), card.get_by_role("button", name="Pause")):
            assert_in_reach(page, control)
        assert page.evaluate(TITLES) == [True, True, True]
        assert serious_violations(page) == []
        card.get_by_role("button", name="Pause").tap()
        drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")
        card.get_by_role("button", name="Resume at item").tap()
        slide_by_touch(page)
        drone.until(lambda v: v["status"]["mode"] == "mission", what="Mission")
        actions_of(page)[0].tap()
        drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")
        page.get_by_role("button", name="Hide instruments").tap()
        expect(card).to_be_hidden()
        for name in ("Plan", "Offboard"):
            page.get_by_role("navigation", name="Views").get_by_role("button", name=name).tap()
            page.get_by_label(f"{name} view").first.wait_for()
            for control in actions_of(page):
                assert_in_reach(page, control)
        page.get_by_role("navigation", name="Views").get_by_role("button", name="Files").tap()
        files = page.get_by_role("region", name="Files")
        expect(files).to_be_visible()
        expect(page.get_by_label("Offboard view")).to_have_count(0)
        for control in actions_of(page):
            assert_in_reach(page, control)
        page.get_by_role("navigation", name="Views").get_by_role("button", name="Plan").tap()
        expect(files).to_have_count(0)
        actions_of(page)[1].tap()
        slide_by_touch(page)
        drone.until(lambda v: v["status"]["mode"] == "land", what="the landing")


def test_the_page_of_another_client_has_land_now_and_it_lands(browser: Browser, station: Station) -> None:
    drone = station.drone
    take_off_to_hold(drone)
    drone.control.take()
    with phone(browser, station, client_id="0123abcd-phone") as page:
        bar = page.get_by_role("toolbar", name="Actions")
        land_now = bar.get_by_role("button", name="Land now")
        expect(bar.get_by_role("button", name="Land", exact=True)).to_have_count(0)
        assert_in_reach(page, land_now)
        land_now.tap()
        slide_by_touch(page)
        drone.until(lambda v: v["status"]["mode"] == "land", what="the landing")
