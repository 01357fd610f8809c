"""The mission on a vehicle in the Fly view: drawn, paused, resumed, skipped and restarted by clicks."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import confirm_by_slider, open_page, serious_violations
from tests.e2e.fast_station import FAST_OPTIONS, Station
from tests.e2e.line_mission import current_item, is_read, plan_at, start_mission
from tests.e2e.plan_page import entries_of, open_plan_view
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]


def test_a_mission_is_paused_resumed_skipped_and_restarted_in_fly(browser: Browser, station: Station) -> None:
    drone = station.drone
    plan = station.gcs.plans().create("Line", plan_at(drone))
    drone.mission.upload(plan_id=plan["id"])
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.get_by_role("toolbar", name="Map").wait_for()
        card = page.get_by_label("Mission", exact=True)
        expect(card).to_have_count(0)
        start_mission(drone)
        expect(card).to_contain_text("Line")
        expect(card).to_contain_text("to the last item")
        expect(card).to_contain_text(re.compile(r"\d\d:\d\d remaining"))
        wait_until(lambda: current_item(drone) == 1, "the first waypoint", 60)
        expect(card).to_contain_text("Item 2 of 6 · Waypoint")
        assert serious_violations(page) == []

        card.get_by_role("button", name="Pause").click()
        drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")
        expect(card.get_by_role("status").first).to_have_text(re.compile("Paused"))
        card.get_by_role("button", name="Resume at item 2…").click()
        confirm_by_slider(page)
        drone.until(lambda v: v["status"]["mode"] == "mission", what="Mission")

        card.get_by_label("Item to skip to").select_option("4 · Waypoint")
        skip = card.get_by_role("button", name="Skip to…")
        skip.click()
        expect(page.get_by_role("alertdialog")).to_contain_text("It leaves out items 2 to 3.")
        confirm_by_slider(page, skip.click)
        wait_until(lambda: current_item(drone) == 3, "item 4", 20)
        expect(card).to_contain_text("Item 4 of 6 · Waypoint")

        card.get_by_role("button", name="Restart…").click()
        expect(page.get_by_role("alertdialog")).to_contain_text("flies the whole mission again")
        confirm_by_slider(page)
        wait_until(lambda: current_item(drone) in (0, 1), "the first item", 20)
        drone.until(lambda v: v["status"]["mode"] == "mission", what="Mission")

        view = open_plan_view(page)
        page.get_by_role("toolbar", name="Plan").get_by_role("button", name="Open", exact=True).click()
        page.get_by_label("Plans", exact=True).get_by_role("button", name=re.compile("^Line")).first.click()
        on_vehicle = view.get_by_label("Plan on the vehicle")
        expect(on_vehicle).to_contain_text("It is being flown: item")
        expect(on_vehicle.get_by_role("button", name=re.compile("Resume|Fly"))).to_have_count(0)
        expect(entries_of(view).filter(has_text="flying now")).to_have_count(1)


def test_a_plan_that_came_from_elsewhere_is_read_and_its_items_are_named(browser: Browser) -> None:
    port = free_port()
    link = [f"udpin://127.0.0.1:{port}"]
    with running_vehicles(port, arguments=FAST_OPTIONS):
        with running_server(link) as (url, _), SyncGcs(url, client="e2e") as gcs:
            drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
            drone.mission.upload(plan_at(drone))
        with running_server(link) as (url, _), SyncGcs(url, client="e2e") as gcs:
            drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
            assert drone.mission.state()["holds"]["state"] == "not_known"
            with open_page(browser, url, size=(1280, 800), scene=False) as page:
                page.get_by_role("toolbar", name="Map").wait_for()
                wait_until(lambda: is_read(drone), "the reading of the plan", 20)
                start_mission(drone)
                card = page.get_by_label("Mission", exact=True)
                expect(card).to_contain_text("the server does not monitor this flight")
                options = card.get_by_label("Item to skip to").locator("option")
                expect(options).to_have_count(6)
                expect(options.nth(4)).to_have_text("5 · Waypoint")
