"""Two vehicles on one page: selection, a refused arming, a connection that is lost and restored."""

from __future__ import annotations

import os
import re
import signal

import pytest
from playwright.sync_api import Browser, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import confirm_by_slider, confirm_by_space_bar, open_page, violations_in_both_themes
from tests.e2e.fast_station import FAST_OPTIONS
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = pytest.mark.browser

SECOND_VEHICLE_ARGUMENTS = ["--first-instance", "101", *FAST_OPTIONS]


@pytest.mark.realtime
def test_two_vehicles_are_selected_and_commanded_separately_and_a_lost_connection_is_shown(
    browser: Browser,
) -> None:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=FAST_OPTIONS),
        running_vehicles(port, arguments=SECOND_VEHICLE_ARGUMENTS) as second_simulator,
        SyncGcs(url, client="e2e") as gcs,
        open_page(browser, url, scene=False) as page,
    ):
        drone_101 = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        drone_102 = gcs.wait_for_vehicle("102", ready=True, timeout_s=120)
        pill, vehicle_buttons = page.locator(".pill b"), page.locator("nav .chip")
        expect(vehicle_buttons).to_have_count(2)
        expect(vehicle_buttons.nth(1)).to_contain_text("simulated")

        # The refusal to arm on the ground is shown with its reason beside the button.
        drone_102.request("PUT", "/params/COM_ARM_MIS_REQ", {"value": 1})
        page.keyboard.press("2")
        expect(vehicle_buttons.nth(1)).to_have_attribute("aria-pressed", "true")
        page.get_by_role("button", name="Arm", exact=True).click()
        expect(page.get_by_role("alertdialog")).to_contain_text("Arm Quad 102")
        confirm_by_slider(page, page.get_by_role("button", name="Arm", exact=True).click)
        refusal = page.locator(".place").get_by_role("alert")
        expect(refusal).to_contain_text("Arm: The vehicle refused")
        expect(refusal).to_contain_text("Quad 102")
        expect(refusal).to_contain_text("Reason: Arming denied: Resolve system health failures first")
        assert violations_in_both_themes(page) == []
        assert not drone_102.status()["armed"]
        drone_102.request("PUT", "/params/COM_ARM_MIS_REQ", {"value": 0})
        gcs.wait_for_vehicle("102", ready=True, timeout_s=60)

        # The selected vehicle takes off; the other vehicle stays on the ground.
        page.keyboard.press("t")
        confirm_by_space_bar(page)
        wait_until(lambda: drone_102.status()["armed"], "the second vehicle's take-off")
        assert not drone_101.status()["armed"]
        vehicle_buttons.nth(0).click()
        expect(pill).to_have_text("Ready")
        page.keyboard.press("2")

        # In the vehicle list, text finds a vehicle and keys select it; one click puts all flying vehicles
        # into Hold.
        page.keyboard.press("1")
        page.keyboard.press("j")
        list_entries = page.get_by_role("list", name="Vehicles found").get_by_role("button")
        expect(list_entries).to_have_count(2)
        page.keyboard.type("102")
        expect(list_entries).to_have_count(1)
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Enter")
        expect(vehicle_buttons.nth(1)).to_have_attribute("aria-pressed", "true")
        page.get_by_role("button", name="Hold all flying (1)").click()
        status_text = page.get_by_label("Vehicle list").get_by_role("status")
        expect(status_text).to_have_text("The vehicle switched to Hold.")
        wait_until(lambda: drone_102.status()["mode"] == "hold", "Hold of all flying vehicles")
        assert violations_in_both_themes(page) == []
        page.keyboard.press("Escape")
        expect(list_entries).to_have_count(0)

        # The page shows a lost connection at once, and marks old values.
        os.killpg(second_simulator.pid, signal.SIGSTOP)
        try:
            expect(pill).to_have_text("Connection lost")
            expect(vehicle_buttons.nth(1)).to_contain_text("connection lost")
            expect(vehicle_buttons.nth(0)).not_to_contain_text("connection lost")
            expect(page.get_by_label("Values", exact=True)).to_contain_text(" old")
            assert violations_in_both_themes(page) == []
            # Hold is sent anyway; the answer says that the vehicle did not answer.
            page.keyboard.press("h")
            expect(refusal).to_contain_text("did not answer the request to switch to Hold", timeout=20_000)
            expect(refusal).to_contain_text("Check the link")
        finally:
            os.killpg(second_simulator.pid, signal.SIGCONT)
        expect(vehicle_buttons.nth(1)).not_to_contain_text("connection lost")
        expect(page.get_by_label("Messages", exact=True)).to_contain_text("Connection restored")
        # The vehicle has held since before; a Hold that is still under way would interrupt the landing.
        with page.expect_response(re.compile("/vehicles/102/hold$")) as hold:
            page.keyboard.press("h")
        assert hold.value.ok
        expect(pill).to_have_text("Holding")
        drone_102.land()
        drone_102.until_disarmed()


@pytest.mark.story
def test_a_batch_takes_off_what_it_can_and_names_what_it_leaves_out(browser: Browser) -> None:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=3, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
        SyncGcs(url, client="anna", client_id="anna") as anna,
        open_page(browser, url, scene=False) as page,
    ):
        drones = [gcs.wait_for_vehicle(each, ready=True, timeout_s=120) for each in ("101", "102", "103")]
        anna.vehicle("103").control.take()
        page.locator(".pill").wait_for()
        page.keyboard.press("j")
        panel = page.get_by_label("Vehicle list")
        panel.get_by_label("All shown").check()
        expect(panel.get_by_role("group", name="Command to 3 chosen")).to_be_visible()
        assert violations_in_both_themes(page) == []
        panel.get_by_role("button", name="Take off…").click()
        question = page.get_by_role("alertdialog")
        expect(question).to_contain_text("Take off: Quad 101, Quad 102")
        expect(question).to_contain_text("Left out: Quad 103: anna has control of this vehicle.")
        confirm_by_slider(page, panel.get_by_role("button", name="Take off…").click)
        for drone in drones[:2]:
            drone.until(lambda v: v["status"]["landed_state"] == "in_air", what="the take-off")
        assert not drones[2].status()["armed"]
        panel.get_by_label("Choose Quad 103").uncheck()
        panel.get_by_role("button", name="Hold 2").click()
        expect(panel.get_by_role("status")).to_contain_text("All 2 vehicles switched to Hold")
        panel.get_by_role("button", name="Land…").click()
        confirm_by_slider(page, panel.get_by_role("button", name="Land…").click)
        for drone in drones[:2]:
            drone.until(lambda v: v["status"]["mode"] == "land", what="the landing")
