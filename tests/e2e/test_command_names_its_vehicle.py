"""A confirmation that is open while another vehicle is selected is closed with the reason."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import open_page
from tests.e2e.fast_station import FAST_OPTIONS
from tests.e2e.plan_page import open_plan_view
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

SECOND_VEHICLE_ARGUMENTS = ["--first-instance", "101", *FAST_OPTIONS]


def test_a_confirmation_commands_only_the_vehicle_that_it_names(browser: Browser) -> None:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=FAST_OPTIONS),
        running_vehicles(port, arguments=SECOND_VEHICLE_ARGUMENTS),
        SyncGcs(url, client="e2e") as gcs,
        open_page(browser, url, scene=False) as page,
    ):
        drones = [gcs.wait_for_vehicle(name, ready=True, timeout_s=120) for name in ("101", "102")]
        wait_until(lambda: drones[0].topic("home") is not None, "the home position")
        home = drones[0].topic("home")
        assert home is not None
        position = {key: home[key] for key in ("lat_deg", "lon_deg")}
        altitude = {"value_m": 8, "reference": "home"}
        plan = {
            "format": "offboard-gcs-plan",
            "version": 1,
            "planned_home": {**position, "alt_amsl_m": home["alt_amsl_m"]},
            "items": [{"kind": "takeoff", **position, "altitude": altitude}, {"kind": "return_home"}],
        }
        gcs.request("POST", "/plans", {"name": "Tower", "plan": plan})
        open_plan_view(page)
        page.get_by_role("button", name="Open", exact=True).click()
        page.get_by_text("Tower", exact=True).click()
        vehicle_buttons = page.locator("nav .chip")
        bar = page.get_by_label("Plan on the vehicle")
        for chip in (vehicle_buttons.nth(1), vehicle_buttons.nth(0)):  # both vehicles hold the plan
            chip.click()
            bar.get_by_role("button", name="Upload").click()
            expect(bar.get_by_role("button", name="Fly…")).to_be_visible(timeout=30_000)

        bar.get_by_role("button", name="Fly…").click()
        dialog = page.get_by_role("alertdialog")
        expect(dialog).to_contain_text("Fly the mission of Quad 101")
        page.get_by_role("slider").focus()
        page.keyboard.down("Space")
        vehicle_buttons.nth(1).click()
        expect(dialog).to_have_count(0)
        page.keyboard.up("Space")
        refusal = page.locator(".place").get_by_role("alert")
        expect(refusal).to_contain_text("Mission: Not sent")
        expect(refusal).to_contain_text("Another vehicle was selected")
        expect(refusal).to_contain_text("Quad 101")
        assert not any(drone.status()["armed"] for drone in drones)
        # A second look at the journal: no start has reached the server.
        assert not [e for e in gcs.request("GET", "/journal")["entries"] if "mission/start" in e["command"]]
