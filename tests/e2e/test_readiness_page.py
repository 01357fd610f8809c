"""The page shows the reasons against arming: in the status, after a refusal and by keyboard; it updates them
without input."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.e2e.browser import (
    REPOSITORY,
    chromium,
    hold_space,
    open_page,
    press,
    serious_violations,
    violations_in_both_themes,
)
from tests.e2e.fast_station import Station
from tools import build_page

pytestmark = [pytest.mark.browser, pytest.mark.story]


def test_the_reasons_against_arming_and_against_each_mode_are_shown(station: Station) -> None:
    build_page.build(REPOSITORY)
    drone = station.drone
    with chromium() as browser, open_page(browser, station.url, scene=False) as page:
        page.locator(".pill").get_by_role("button").click()
        panel = page.get_by_role("region", name="Readiness")
        expect(panel).to_contain_text("Ready to arm in Hold")
        expect(panel).to_contain_text("Descriptions by the vehicle.")
        row = {name: panel.get_by_role("row", name=name) for name in ("Offboard", "Hold", "Position slow")}
        expect(row["Offboard"]).to_contain_text("No offboard setpoints received.")
        expect(row["Position slow"]).to_contain_text("No manual control input.")
        expect(row["Hold"].get_by_text("yes")).to_have_count(2)
        expect(panel.get_by_role("listitem").filter(has_text="No offboard setpoints")).to_contain_text(
            "Start an offboard stream"
        )
        assert violations_in_both_themes(page) == []
        page.set_viewport_size({"width": 1280, "height": 720})
        hold = page.get_by_role("button", name="Hold", exact=True).bounding_box()
        box = panel.bounding_box()
        assert hold is not None
        assert box is not None
        assert box["y"] + box["height"] <= hold["y"], "Hold is never covered"
        page.keyboard.press("Escape")
        expect(panel).to_have_count(0)

        drone.set_mode("position")
        page.keyboard.press("y")
        expect(panel).to_contain_text("Cannot arm in Position")
        page.keyboard.press("y")
        page.keyboard.press("Shift+A")
        hold_space(page)
        refusal = page.get_by_role("alert").filter(has_text="Arm")
        refusal.get_by_role("button", name="Show what blocks each mode").click()
        expect(panel).to_contain_text("Cannot arm in Position")
        expect(panel).to_contain_text("The vehicle is in Position and cannot be armed in it. Choose Hold.")
        press(panel.get_by_role("button", name="Switch to Hold"), "Enter")
        expect(panel).to_contain_text("Ready to arm in Hold")  # updated without any input

        start = {"setpoint": {"type": "position", "position_ned_m": [0, 0, -2]}}
        drone.request("POST", "/offboard/start", start)
        expect(panel).to_contain_text("Ready to arm in Offboard")
        drone.request("POST", "/offboard/stop")
        expect(panel).to_contain_text("Ready to arm in Hold")

        page.keyboard.press("Escape")
        page.keyboard.press("i")
        params = page.get_by_role("region", name="Parameters")
        expect(params.get_by_role("status")).to_contain_text("929")
        params.get_by_label("Search parameters").fill("xy_cruise")
        line = params.get_by_role("button", name="MPC_XY_CRUISE")
        expect(line).to_contain_text("m/s")
        line.click()
        value = params.get_by_label("New value of MPC_XY_CRUISE")
        value.fill("99")
        value.press("Enter")
        expect(params.get_by_role("alert")).to_contain_text("Outside the documented range: 3 to 20 m/s")
        expect(line).to_contain_text("5 m/s")
        value.fill("4")
        value.press("Enter")
        expect(line).to_contain_text("4 m/s")
        params.get_by_label("Search parameters").fill("")
        params.get_by_label("Only non-default").check()
        expect(params.get_by_role("button", name="MPC_XY_CRUISE")).to_have_count(1)
        assert serious_violations(page) == []
        assert drone.param("MPC_XY_CRUISE") == 4.0
        page.get_by_role("button", name="Fly", exact=True).click()
        expect(params).to_have_count(0)
