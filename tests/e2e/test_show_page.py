"""A mission for several vehicles is loaded on the page, flown in a dry run and flown to its end, by mouse."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import confirm_by_space_bar, open_page
from tests.e2e.fast_station import FAST_OPTIONS, Station
from tests.e2e.plan_page import EXAMPLES, check_without_findings, open_plan_view, run_dry_run
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

VEHICLES = {"lead": "101", "left": "104"}
"""Vehicle of each role: not neighbours, because simulated vehicles start 3 m apart and the show needs 7 m."""


@pytest.fixture
def station() -> Iterator[Station]:
    """A server and four vehicles that are ready to arm."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=4, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drones = [gcs.wait_for_vehicle(each, ready=True, timeout_s=120) for each in VEHICLES.values()]
        yield Station(url, gcs, drones[0])


@pytest.mark.timeout(900)  # a dry run of two flights and the flight itself, on a busy machine
def test_a_two_vehicle_show_is_loaded_flown_in_a_dry_run_and_flown_to_its_end(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, scene=False) as page:
        view = open_plan_view(page)
        page.get_by_label("File to import").set_input_files(EXAMPLES / "two_vehicle_show.yaml")
        expect(view.get_by_label("Name of the plan")).to_have_value("Two-vehicle show")
        check_without_findings(view)
        for role, vehicle_id in VEHICLES.items():
            view.get_by_label(f"Vehicle of {role}").select_option(vehicle_id)

        dry_run_region = view.get_by_role("region", name="Dry run")
        dry_run_region.get_by_role("button", name="Conditions").click()
        dry_run_region.get_by_label("Flights with varied conditions").fill("2")
        dry_run_region.get_by_role("button", name="Conditions").click()
        run_dry_run(page, view, longest_s=400)
        for role in VEHICLES:
            expect(dry_run_region).to_contain_text(
                re.compile(rf"{role}, 2 simulated flights: 95 % within \d+\.\d m")
            )
        expect(dry_run_region).to_contain_text(
            re.compile(r"Smallest separation of lead and left in all flights: \d+\.\d m")
        )

        view.get_by_role("button", name=re.compile("fly…$", re.I)).click()  # "Save, check and fly…"
        expect(page.get_by_role("alertdialog")).to_contain_text("Fly “Two-vehicle show” with")
        confirm_by_space_bar(page)

        wait_for_mission_states(station, "flying", 180)
        assert all(mission["dry_run"] is not None for mission in missions(station)), (
            "a mission has no dry run, so no corridor"
        )
        assert [mission["role"] for mission in missions(station)] == list(VEHICLES)
        page.keyboard.press("w")
        card = page.get_by_role("region", name="Offboard mission")
        expect(card).to_contain_text("Two-vehicle show")
        expect(card.get_by_role("button", name="Skip step…")).to_have_count(0)
        wait_for_mission_states(station, "done", 400)
        expect(card.get_by_role("status").first).to_have_text("Done")
        expect(card).to_contain_text(re.compile(r"at most \d+\.\d m; 95 % within \d+\.\d m"))
    for vehicle_id in VEHICLES.values():
        assert not station.gcs.vehicle(vehicle_id).status()["armed"]


def missions(station: Station) -> list[dict[str, Any]]:
    """The mission of each vehicle, with its state."""
    vehicles = [station.gcs.vehicle(each) for each in VEHICLES.values()]
    return [each.request("GET", "/offboard_mission")["mission"] or {} for each in vehicles]


def wait_for_mission_states(station: Station, state: str, within_s: float) -> None:
    """Waits until the missions of both vehicles are in this state."""
    try:
        wait_until(
            lambda: [mission.get("state") for mission in missions(station)] == [state] * 2,
            state,
            within_s,
        )
    except TimeoutError:
        raise AssertionError(missions(station)) from None
