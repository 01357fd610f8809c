"""Offboard missions as PX4 flight modes over ROS 2; server and simulator are real processes, in real time."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import expect

pytest.importorskip("cyclonedds")

from tests import station
from tests.e2e.browser import REPOSITORY, chromium, confirm_by_space_bar, open_page, violations_in_both_themes
from tests.e2e.mission_modes import (
    MISSION,
    MODE_NAME,
    TAKE_OFF_MISSION,
    VehicleWithMissionModes,
    vehicle_with_mission_modes,
)
from tests.e2e.plan_page import open_plan_view
from tools import build_page


@pytest.fixture
def vehicle() -> Iterator[VehicleWithMissionModes]:
    with vehicle_with_mission_modes() as mission_vehicle:
        yield mission_vehicle


@pytest.mark.story
def test_a_registered_mission_is_listed_by_another_station_and_started_by_both_stations(
    vehicle: VehicleWithMissionModes,
) -> None:
    mode = vehicle.register_and_take_off()
    assert MODE_NAME in vehicle.other_station.mode_names()
    vehicle.other_station.select_mode(mode)
    station.wait_until(lambda: vehicle.status["mode"] == mode, "the mode", 5.0)
    assert vehicle.status["mode_label"] == MODE_NAME
    for start_request in (None, {"mode": mode}):  # None: the other station has started the mission
        if start_request is not None:
            vehicle.call("mode", start_request)
        vehicle.wait_for_mission_state("flying")
        vehicle.wait_for_mission_state("done")
        station.wait_until(lambda: vehicle.status["mode"] == "hold", "Hold", 5.0)
    assert vehicle.north_m() == pytest.approx(16.0, abs=2.0)
    assert vehicle.modes()["modes"][0]["state"] == "registered"
    assert vehicle.call("mission_modes/unregister", {"name": MODE_NAME})["modes"] == []
    station.wait_until(
        lambda: MODE_NAME not in vehicle.other_station.mode_names(), "the removal of the mission", 10.0
    )


@pytest.mark.realtime
def test_a_mission_selected_on_the_ground_takes_off_when_armed_lands_and_switches_to_hold(
    vehicle: VehicleWithMissionModes,
) -> None:
    station.wait_until(vehicle.is_ready, "readiness", 60.0)
    body = {"mission": TAKE_OFF_MISSION, "name": MODE_NAME}
    (mode,) = vehicle.call("mission_modes/register", body)["modes"]
    assert (mode["state"], mode["takes_off"]) == ("registered", True)
    vehicle.other_station.select_mode(mode["mode"])
    station.wait_until(lambda: vehicle.status["mode"] == mode["mode"], "the mode", 5.0)
    assert (vehicle.status["armed"], vehicle.mission_state()) == (False, None)
    start_north_m = vehicle.north_m()
    vehicle.arm()
    vehicle.wait_for_mission_state("taking_off")
    mission = vehicle.get("/vehicles/1/offboard_mission")["mission"]
    assert (mission["mode"], mission["executor_in_charge"]) == (mode["mode"], True)
    vehicle.wait_for_mission_state("flying")
    vehicle.wait_for_mission_state("landing")
    assert vehicle.north_m() == pytest.approx(start_north_m + 6.0, abs=1.5)
    vehicle.wait_for_mission_state("done")
    station.wait_until(lambda: vehicle.status["mode"] == "hold", "Hold", 5.0)
    assert vehicle.status["armed"] is False
    assert vehicle.modes()["modes"][0]["state"] == "registered"


@pytest.mark.story
@pytest.mark.browser
def test_in_the_plan_view_a_mission_is_registered_started_and_removed(
    vehicle: VehicleWithMissionModes,
) -> None:
    build_page.build(REPOSITORY)
    vehicle.take_off()
    file = {"name": "line.json", "mimeType": "application/json", "buffer": json.dumps(MISSION).encode()}
    with chromium() as browser, open_page(browser, vehicle.url, scene=False) as page:
        view = open_plan_view(page)
        page.get_by_label("File to import").set_input_files(file)  # type: ignore[arg-type]
        expect(view.get_by_label("Name of the plan")).to_have_value("Line")
        view.get_by_text("Mission as a PX4 flight mode", exact=True).click()
        modes_group = view.get_by_role("group", name="Mission as a PX4 flight mode")
        modes_group.get_by_label("Name of the flight mode").fill(MODE_NAME)
        deferral_field = modes_group.get_by_label("Defer failsafes")
        register_button = modes_group.get_by_role("button", name=re.compile("register", re.I))
        deferral_field.fill("500")
        expect(register_button).to_be_disabled()
        expect(modes_group).to_contain_text("from 0 (never) to 120")
        deferral_field.fill("20")
        register_button.click()
        expect(modes_group).to_contain_text("The mission starts when this mode is selected in flight")
        assert MODE_NAME in vehicle.other_station.mode_names()
        assert vehicle.modes()["modes"][0]["defer_failsafes_s"] == 20
        assert violations_in_both_themes(page) == []
        modes_group.get_by_role("button", name=f"Start {MODE_NAME}…").click()
        confirm_by_space_bar(page)
        expect(page.locator(".pill b")).to_have_text(MODE_NAME)
        expect(modes_group).to_contain_text("Selected")
        expect(modes_group.get_by_role("button", name=f"Remove {MODE_NAME}")).to_have_count(0)
        vehicle.wait_for_mission_state("done")
        modes_group.get_by_role("button", name=f"Remove {MODE_NAME}").click()
        expect(modes_group.get_by_role("listitem")).to_have_count(0)
