"""A flown plan in the flight room: beside its plan and dry run, and its parameters beside the vehicle's."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import open_page, serious_violations
from tests.e2e.fast_station import Station
from tests.e2e.line_mission import plan_at
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]
SIZES = ((1280, 800), (1024, 768), (390, 844))


def pictures(page: Page, name: str) -> None:
    """Pictures for a person to look at, if a folder is given."""
    if (folder := os.environ.get("GCS_PICTURES")) is None:
        return
    for theme in ("dark", "light"):
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(600)
            page.screenshot(path=Path(folder) / f"{name}-{width}-{theme}.png")
        page.set_viewport_size({"width": 1280, "height": 800})
        page.keyboard.press("Shift+D")


def test_a_flight_is_beside_its_plan_and_its_parameters_are_written_as_reviewed(
    browser: Browser, station: Station
) -> None:
    drone = station.drone
    drone.params.read()
    plan = plan_at(drone)
    drone.mission.upload({**plan, "items": [*plan["items"][:3], plan["items"][-1]]})
    drone.mission.start(0, despite=["plan_not_known"])
    drone.until(lambda v: v["status"]["armed"], what="the start")
    drone.until_disarmed(timeout_s=200)
    drone.set_param("MPC_XY_CRUISE", 4.5)
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.locator(".pill").wait_for()
        wait_until(
            lambda: station.gcs.request("GET", "/flights")["flights"], "the flight in the list of flights"
        )
        page.keyboard.press("Shift+E")
        room = page.get_by_role("region", name="Flights", exact=True)
        room.get_by_role("button", name="Open", exact=False).first.click()
        page.get_by_role("radio", name="Plan").click()
        group = page.get_by_role("group", name="Beside the plan")
        expect(group).to_contain_text("At most")
        expect(group).to_contain_text("No corridor was monitored")
        assert serious_violations(page) == []
        pictures(page, "beside-plan")
        page.get_by_role("radio", name="Parameters").click()
        group = page.get_by_role("group", name="Parameters of the log")
        group.get_by_label("Compare the flight’s parameters with").select_option(f"vehicle {drone.id}")
        review = group.get_by_role("region", name="Review")
        expect(review).to_contain_text("MPC_XY_CRUISE")
        assert serious_violations(page) == []
        pictures(page, "flight-parameters")
        review.get_by_role("button", name=re.compile(r"^Write \d+ parameter")).click()
        wait_until(lambda: drone.param("MPC_XY_CRUISE") == 5, "the value of the flight")
