"""One survey is drawn, divided over three vehicles and flown by them together, by clicks."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import choose_menu_entry, confirm_by_space_bar, open_page, serious_violations
from tests.e2e.fast_station import Station
from tests.e2e.plan_page import check_without_findings, open_plan_view, run_dry_run, window_position_on_map
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = [pytest.mark.browser]

IDS = ("101", "104", "107")
"""Not neighbours, because simulated vehicles start 3 m apart, and 7 m are needed."""
PARTS = [f"part {number}" for number in (1, 2, 3)]
MINIMUM_M = 5.0
AREA = ((0.42, 0.2), (0.78, 0.2), (0.78, 0.6), (0.42, 0.6))
"""Corners of the survey, as fractions of the map."""


@pytest.fixture
def station() -> Iterator[Station]:
    """A server and seven vehicles, three of which are ready to arm; in real time: in a faster simulation
    positions are older, and the guard keeps vehicles further apart than the plan does."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=7, arguments=["--no-log"]),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drones = [gcs.wait_for_vehicle(each, ready=True, timeout_s=120) for each in IDS]
        yield Station(url, gcs, drones[0])


def divide_by_clicks(page: Page) -> Locator:
    """Draws a survey, divides it over the three vehicles, and returns the plan view with the mission."""
    view = open_plan_view(page)
    choose_menu_entry(view.get_by_role("button", name="Add item"), "Survey")
    for corner in AREA:
        page.mouse.click(*window_position_on_map(page, corner))
    view.get_by_label("Altitude", exact=True).fill("15")
    expect(view.get_by_role("group", name="Figures of the pattern")).to_contain_text("cm/px")
    view.get_by_role("button", name="Insert survey").click()
    card = page.get_by_role("group", name="Selection")
    card.get_by_role("button", name="Divide over several vehicles…").click()
    form = view.get_by_role("form", name="Divide the survey")
    form.get_by_label(f"Quad {IDS[0]}").check()
    expect(form.get_by_role("alert")).to_contain_text("at least two vehicles")
    expect(form.get_by_role("button", name="Divide", exact=True)).to_be_disabled()
    for vehicle in IDS[1:]:
        form.get_by_label(f"Quad {vehicle}").check()
    assert serious_violations(page) == []
    form.get_by_role("button", name="Divide", exact=True).click()
    expect(view).to_contain_text("Divided over 3 vehicles")
    return view


@pytest.mark.story
def test_a_drawn_survey_is_divided_over_the_chosen_vehicles_with_times_and_the_smallest_distance(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, scene=False) as page:
        view = divide_by_clicks(page)
        bar = view.get_by_role("region", name="Fly this mission with several vehicles")
        chosen = {bar.get_by_label(f"Vehicle of {part}").input_value() for part in PARTS}
        assert chosen == set(IDS)
        expect(bar).to_contain_text(re.compile(r"part 1 · (\d+ min )?\d+ s · \d+ m · \d+ photos"))
        expect(bar).to_contain_text(re.compile(r"Smallest planned distance: \d+\.\d m, part \d and part \d"))
        expect(bar.get_by_role("button", name="Save, check and fly…")).to_be_enabled()
        assert serious_violations(page) == []
        page.get_by_role("button", name="Undo", exact=True).click()
        expect(view.get_by_role("listbox", name="Items")).to_contain_text("Survey")


@pytest.mark.story
@pytest.mark.timeout(1200)  # a dry run and a flight of three vehicles, on a busy machine
def test_three_vehicles_share_a_survey_in_dry_run_and_in_flight_and_stay_apart(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, scene=False) as page:
        view = divide_by_clicks(page)
        check_without_findings(view)
        dry_run_region = view.get_by_role("region", name="Dry run")
        run_dry_run(page, view, longest_s=400)
        expect(dry_run_region).to_contain_text(re.compile(r"part 1 and part 2 stay at least \d+\.\d m apart"))
        view.get_by_role("button", name=re.compile("fly…$", re.I)).click()
        expect(page.get_by_role("alertdialog")).to_contain_text("(part 3)")
        confirm_by_space_bar(page)
        wait_until(lambda: started(station), "the start", 180)
        distances_m: list[float] = []

        def landed() -> bool:
            distances_m.append(smallest_distance_m(station))
            return states(station) == ["done"] * 3

        wait_until(landed, "the end of the mission", 900)
    assert min(distances_m) >= MINIMUM_M
    assert len(distances_m) > 50
    (group,) = [each for each in station.gcs.request("GET", "/groups")["groups"] if each["mission"]]
    assert group["findings"] == []
    for vehicle in IDS:
        assert not station.gcs.vehicle(vehicle).status()["armed"]


def started(station: Station) -> bool:
    """Whether all vehicles are on their way; each may be waiting for the others at its first lines."""
    return all(state in {"flying", "waiting"} for state in states(station))


def states(station: Station) -> list[Any]:
    """State of each vehicle's mission. Raises AssertionError if one has ended otherwise than as planned."""
    missions = [
        station.gcs.vehicle(each).request("GET", "/offboard_mission")["mission"] or {} for each in IDS
    ]
    reasons = [
        mission["reason"] for mission in missions if mission.get("reason") and mission["state"] != "done"
    ]
    assert not reasons, reasons
    return [mission.get("state") for mission in missions]


def smallest_distance_m(station: Station) -> float:
    """Distance of the two nearest vehicles by their global positions [m]."""
    places: list[tuple[float, float, float]] = []
    for vehicle in IDS:
        position = station.gcs.vehicle(vehicle).topic("global_position")
        assert position is not None
        east_m = math.radians(position["lon_deg"]) * 6_371_000.0 * math.cos(math.radians(position["lat_deg"]))
        places.append((math.radians(position["lat_deg"]) * 6_371_000.0, east_m, position["alt_amsl_m"]))
    return min(math.dist(a, b) for a, b in itertools.combinations(places, 2))
