"""The page shows the reasons against arming by a click on the status, by a key and after a refusal, updates
them without input, and edits parameters."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.e2e.browser import (
    REPOSITORY,
    chromium,
    confirm_by_space_bar,
    open_page,
    press_key,
    serious_violations,
    violations_in_both_themes,
)
from tests.e2e.fast_station import Station
from tools import build_page

pytestmark = [pytest.mark.browser, pytest.mark.story]


def test_reasons_against_arming_and_each_mode_are_shown_and_parameters_are_edited(station: Station) -> None:
    build_page.build(REPOSITORY)
    drone = station.drone
    with chromium() as browser, open_page(browser, station.url, scene=False) as page:
        page.locator(".pill").get_by_role("button").first.click()
        panel = page.get_by_role("region", name="Readiness")
        expect(panel).to_contain_text("Ready to arm in Hold")
        expect(panel).to_contain_text("Descriptions by the vehicle.")
        rows = {name: panel.get_by_role("row", name=name) for name in ("Offboard", "Hold", "Position slow")}
        expect(rows["Offboard"]).to_contain_text("No offboard setpoints received.")
        expect(rows["Position slow"]).to_contain_text("No manual control input.")
        expect(rows["Hold"].get_by_text("yes")).to_have_count(2)
        expect(panel.get_by_role("listitem").filter(has_text="No offboard setpoints")).to_contain_text(
            "Start an offboard stream"
        )
        assert violations_in_both_themes(page) == []
        page.set_viewport_size({"width": 1280, "height": 720})
        hold_box = page.get_by_role("button", name="Hold", exact=True).bounding_box()
        panel_box = panel.bounding_box()
        assert hold_box is not None
        assert panel_box is not None
        assert panel_box["y"] + panel_box["height"] <= hold_box["y"], "the panel covers the Hold button"
        page.keyboard.press("Escape")
        expect(panel).to_have_count(0)

        drone.set_mode("position")
        page.keyboard.press("y")
        expect(panel).to_contain_text("Cannot arm in Position")
        page.keyboard.press("y")
        page.keyboard.press("Shift+A")
        confirm_by_space_bar(page)
        refusal = page.get_by_role("alert").filter(has_text="Arm")
        refusal.get_by_role("button", name="Show what blocks each mode").click()
        expect(panel).to_contain_text("Cannot arm in Position")
        expect(panel).to_contain_text("The vehicle is in Position and cannot be armed in it. Choose Hold.")
        press_key(panel.get_by_role("button", name="Switch to Hold"), "Enter")
        expect(panel).to_contain_text("Ready to arm in Hold")  # updated without any input

        start_request = {"setpoint": {"type": "position", "position_ned_m": [0, 0, -2]}}
        drone.request("POST", "/offboard/start", start_request)
        expect(panel).to_contain_text("Ready to arm in Offboard")
        drone.request("POST", "/offboard/stop")
        expect(panel).to_contain_text("Ready to arm in Hold")

        page.keyboard.press("Escape")
        page.keyboard.press("i")
        parameters = page.get_by_role("region", name="Parameters")
        expect(parameters.get_by_role("status")).to_contain_text("913")
        parameters.get_by_label("Search parameters").fill("xy_cruise")
        parameter_row = parameters.get_by_role("button", name="MPC_XY_CRUISE")
        expect(parameter_row).to_contain_text("m/s")
        parameter_row.click()
        value_field = parameters.get_by_label("New value of MPC_XY_CRUISE")
        value_field.fill("99")
        value_field.press("Enter")
        expect(parameters.get_by_role("alert")).to_contain_text("Outside the documented range: 3 to 20 m/s")
        expect(parameter_row).to_contain_text("5 m/s")
        value_field.fill("4")
        value_field.press("Enter")
        expect(parameter_row).to_contain_text("4 m/s")
        parameters.get_by_label("Search parameters").fill("")
        parameters.get_by_label("Only non-default").check()
        expect(parameters.get_by_role("button", name="MPC_XY_CRUISE")).to_have_count(1)
        assert serious_violations(page) == []
        assert drone.param("MPC_XY_CRUISE") == 4.0
        page.get_by_role("button", name="Fly", exact=True).click()
        expect(parameters).to_have_count(0)
