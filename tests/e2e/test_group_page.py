"""The page flies two vehicles as a group: it selects and starts them, renews their setpoints while it is
visible, and puts them into Hold."""

from __future__ import annotations

import re
import time
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from gcs_server.client import SyncGcs, setpoints
from tests.e2e.browser import (
    REPOSITORY,
    chromium,
    confirm_by_slider,
    confirm_by_space_bar,
    first_number,
    open_page,
    tab_to,
    violations_in_both_themes,
)
from tests.e2e.fast_station import FAST_OPTIONS, move_aside
from tests.station import free_port, running_server, running_vehicles, wait_until
from tools import build_page

pytestmark = [pytest.mark.browser, pytest.mark.story]

VEHICLE_IDS: tuple[str, ...] = ("101", "102")
SET_VISIBILITY = """
(state) => {
  Object.defineProperty(document, 'visibilityState', { configurable: true, get: () => state });
  document.dispatchEvent(new Event('visibilitychange'));
}
"""


def positions_ned_m(drones: list[Any]) -> list[list[float]]:
    return [drone.topic("local_position")["position_ned_m"] for drone in drones]


def modes(drones: list[Any]) -> set[str]:
    return {drone.status()["mode"] for drone in drones}


def open_group_form(page: Page) -> Any:
    """Opens the group form of the offboard view."""
    expect(page.locator(".pill b")).to_have_text("Holding")
    page.keyboard.press("p")
    view = page.get_by_role("region", name="Offboard view")
    view.get_by_role("radio", name="Group", exact=True).click()
    return view


def test_two_vehicles_are_flown_together_and_put_into_hold() -> None:
    build_page.build(REPOSITORY)
    port = free_port()
    with (
        chromium() as browser,
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=2, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
        open_page(browser, url, scene=False, size=(1280, 720)) as page,
    ):
        drones = [gcs.wait_for_vehicle(v, ready=True, timeout_s=120) for v in VEHICLE_IDS]
        for drone in drones:
            drone.takeoff(8)
        for drone in drones:
            drone.until(lambda v: v["status"]["mode"] == "hold", what="the end of the take-off")
        move_aside(drones[1], 8.0)
        view = open_group_form(page)

        # The form shows missing input; beside the button it shows the server's refusal, with the vehicles'
        # names.
        view.get_by_role("button", name="Start group…").click()
        expect(view).to_contain_text("Choose two vehicles or more.")
        for vehicle_id in VEHICLE_IDS:
            view.get_by_role("checkbox", name=re.compile(f"^Quad {vehicle_id}")).check()
        expect(view).to_contain_text(re.compile(r"Closest pair now: 101 and 102, \d"))
        view.get_by_label("Move, North").fill("6")
        view.get_by_label("Minimum separation").fill("60")
        view.get_by_role("button", name="Start group…").click()
        expect(page.get_by_role("alertdialog")).to_contain_text("Start group: Quad 101 and Quad 102")
        expect(page.get_by_role("alertdialog")).to_contain_text("all move 6.0 m north together")
        confirm_by_slider(page, view.get_by_role("button", name="Start group…").click)
        refusal = view.get_by_role("alert")
        expect(refusal).to_contain_text("Quad 101 and Quad 102")
        expect(refusal).to_contain_text(re.compile("[Vv]ehicles? 10[12]"))
        assert violations_in_both_themes(page) == []
        assert modes(drones) == {"hold"}

        # The group flies, and the page renews its setpoints while the page is visible.
        start_ned_m = positions_ned_m(drones)
        view.get_by_label("Minimum separation").fill("1")
        view.get_by_label("Valid for, seconds").fill("4")
        tab_to(page, "Start group…")
        page.keyboard.press("Enter")
        confirm_by_space_bar(page)
        group_card = view.get_by_role("region", name=re.compile("^Group"))
        expect(group_card).to_contain_text("Flying")
        expect(group_card).to_contain_text("from you")
        expect(refusal).to_be_hidden()
        began_s = time.monotonic()
        expect(view.get_by_label("Move, North")).to_have_value("0")  # pressing Send again moves nothing

        def moved_north(north_m: float) -> bool:
            return all(
                position[0] - start_position[0] > north_m
                for position, start_position in zip(positions_ned_m(drones), start_ned_m, strict=True)
            )

        wait_until(lambda: moved_north(5.5), "both vehicles almost six metres further north", 30)
        expect(group_card).to_contain_text("This page renews the setpoints while it is visible")
        assert first_number(group_card.locator(".figures b").first.inner_text()) > 1
        wait_until(lambda: time.monotonic() - began_s > 10, "the end of the first validity")
        group = gcs.request("GET", "/groups")["groups"][-1]
        assert (group["state"], group["findings"]) == ("flying", [])

        # The page sends another offset from the current positions, then commands Hold by one key.
        view.get_by_label("Move, North").fill("3")
        view.get_by_label("Valid for, seconds").fill("30")
        view.get_by_role("button", name="Send to group").click()
        wait_until(lambda: moved_north(8.4), "both vehicles almost nine metres further north", 30)
        expect(page.get_by_label("Sent setpoints", exact=True).get_by_role("listitem").first).to_contain_text(
            "Group · accepted"
        )
        assert violations_in_both_themes(page) == []
        tab_to(page, "Hold group")
        page.keyboard.press("Enter")
        wait_until(lambda: modes(drones) == {"hold"}, "Hold")
        expect(group_card).to_contain_text("commanded Hold.")
        expect(view.get_by_role("button", name="Hold group")).to_have_count(0)

        # After the end the page shows the reason once, and no button for Hold or Send.
        expect(group_card).to_contain_text("Ended")
        expect(view.get_by_role("button", name="Send to group")).to_have_count(0)

        # While the page is hidden it does not renew, so the setpoints expire and the group switches to Hold.
        view.get_by_label("Valid for, seconds").fill("3")
        view.get_by_role("button", name="Start group…").click()
        confirm_by_space_bar(page)
        expect(group_card).to_contain_text("Flying")
        page.evaluate(SET_VISIBILITY, "hidden")
        wait_until(lambda: modes(drones) == {"hold"}, "Hold after the setpoints expired")
        page.evaluate(SET_VISIBILITY, "visible")
        expect(group_card).to_contain_text("The setpoints expired.")

        # The page also shows the group of another client, identified by its id and not by name, and can
        # command Hold.
        for drone in drones:
            drone.control.release()
        with SyncGcs(url, client="pair", client_id="pair") as other:
            velocity_setpoints = dict.fromkeys(VEHICLE_IDS, setpoints.velocity_ned(0.5, 0, 0))
            with other.group(velocity_setpoints, minimum_separation_m=1, valid_for_s=60):
                other_group = view.get_by_role("region", name="Group 3")
                expect(other_group).to_contain_text("from pair")
                expect(other_group).to_contain_text("Flying")
                view.get_by_role("radio", name="Form", exact=True).click()
                page.keyboard.press("p")
                offboard_card = page.get_by_label("Offboard", exact=True)
                expect(offboard_card).to_contain_text("In group 3, controlled by pair.")
                offboard_card.get_by_role("button", name="Show the group").click()
                view.get_by_role("button", name="Hold group").click()
                wait_until(lambda: modes(drones) == {"hold"}, "Hold by a client without control")
