"""Surveys and tower inspections in the plan view, from drawing to flight: by mouse, by keyboard and with
files."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import (
    choose_menu_entry,
    confirm_by_space_bar,
    open_page,
    press_key,
    tab_to,
    violations_in_both_themes,
)
from tests.e2e.fast_station import Station
from tests.e2e.plan_page import (
    check_without_findings,
    entries_of,
    home_of,
    import_tower,
    open_plan_view,
    run_dry_run,
    save_as_other_client,
    start_plan,
    undo_and_redo_everything,
    upload_plan,
    window_position_on_map,
)
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story, pytest.mark.timeout(600)]

SURVEY_AREA = ((0.5, 0.3), (0.64, 0.3), (0.64, 0.5), (0.5, 0.5))
"""Corners of the survey area, as fractions of the map."""
TOWER_NED_M = (10, 20, -2)
WAYPOINTS_AROUND_TOWER = ((0.52, 0.5), (0.6, 0.44), (0.56, 0.36))
"""Positions of waypoints, as fractions of the map."""
DROP_FILE = """
(text) => {
  const data = new DataTransfer();
  data.items.add(new File([text], 'dropped.plan'));
  const options = { dataTransfer: data, bubbles: true, cancelable: true };
  for (const type of ['dragover', 'drop']) document.body.dispatchEvent(new DragEvent(type, options));
}
"""
MAP_LABEL = (
    "Map from above. Arrows move the crosshair, Enter opens the menu for its position, plus and minus zoom."
)


def test_a_survey_is_drawn_corrected_dry_run_and_flown(browser: Browser, station: Station) -> None:
    with open_page(browser, station.url, scene=False) as page:
        view = open_plan_view(page)
        choose_menu_entry(view.get_by_role("button", name="Add item"), "Survey")
        for point in SURVEY_AREA:
            page.mouse.click(*window_position_on_map(page, point))
        expect(view.get_by_text("4 corners")).to_be_visible()
        view.get_by_label("Altitude", exact=True).fill("15")
        expect(view.get_by_role("group", name="Figures of the pattern")).to_contain_text("cm/px")
        view.get_by_role("button", name="Insert survey").click()
        survey = entries_of(view).filter(has_text="Survey")
        expect(survey).to_contain_text("15.0 m above home")

        findings = view.get_by_role("region", name="Findings")
        expect(findings).to_contain_text("The plan has no take-off")
        findings.get_by_role("button", name="Add a take-off at the beginning").click()
        expect(findings).not_to_contain_text("The plan has no take-off")
        undo_and_redo_everything(page, view)

        time_slider = run_dry_run(page, view)
        press_key(time_slider, "End")
        expect(time_slider).to_have_attribute(
            "aria-valuetext", re.compile(r"^0\d:\d\d, \d+\.\d m above the start$")
        )
        page.get_by_role("radiogroup", name="Shown over time").get_by_role("radio", name="Speed").click()
        expect(time_slider).to_have_attribute("aria-valuetext", re.compile(r"m/s$"))
        press_key(time_slider, "Home")
        expect(time_slider).to_have_attribute("aria-valuetext", re.compile(r"^00:00"))

        start_plan(page, upload_plan(view), station)
        page.keyboard.press("h")
        wait_until(lambda: station.drone.status()["mode"] == "hold", "the mode Hold", 60)
        survey.click()
        view.get_by_role("button", name=re.compile(r"^Fly from item \d+…$")).click()
        expect(page.get_by_role("alertdialog")).to_contain_text("Fly the mission of Quad 101 from item")
        page.keyboard.press("Escape")


def test_a_survey_in_the_plan_is_turned_saved_reopened_and_taken_apart(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, scene=False, size=(1280, 800)) as page:
        view = open_plan_view(page)
        choose_menu_entry(view.get_by_role("button", name="Add item"), "Survey")
        for point in SURVEY_AREA:
            page.mouse.click(*window_position_on_map(page, point))
        view.get_by_label("Heading of the lines").fill("0")
        figures = view.get_by_role("group", name="Figures of the pattern")
        expect(figures).to_contain_text("Line heading 0°")
        view.get_by_role("button", name="Insert survey").click()
        survey = entries_of(view).filter(has_text="Survey")
        before = survey.inner_text()

        card = page.get_by_role("group", name="Selection")
        card.get_by_role("button", name="Edit survey…").click()
        view.get_by_label("Heading of the lines").fill("30")
        expect(figures).to_contain_text("Line heading 30°")
        view.get_by_label("Side overlap").fill("90")
        expect(figures).not_to_contain_text(before)
        view.get_by_role("button", name="Done").click()
        expect(survey).not_to_have_text(before)
        turned = survey.inner_text()
        page.keyboard.press("Control+z")
        expect(survey).not_to_have_text(turned)
        page.keyboard.press("Control+y")
        expect(survey).to_have_text(re.compile(re.escape(turned.splitlines()[-1])))

        page.get_by_label("Name of the plan").fill("Turned survey")
        page.get_by_role("button", name="Save", exact=True).click()
        expect(view.get_by_text("version 1", exact=True)).to_be_visible()
        page.reload()
        view = open_plan_view(page)
        page.get_by_role("button", name="Open", exact=True).click()
        view.get_by_role("button", name=re.compile("^Turned survey")).first.click()
        survey = entries_of(view).filter(has_text="Survey")
        survey.click()
        card.get_by_role("button", name="Edit survey…").click()
        expect(view.get_by_label("Heading of the lines")).to_have_value("30")
        expect(view.get_by_label("Side overlap")).to_have_value("90")
        view.get_by_role("button", name="Take apart").click()
        expect(entries_of(view).filter(has_text="Waypoint").nth(3)).to_be_visible()
        expect(survey).to_have_count(0)
        page.keyboard.press("Control+z")
        expect(survey).to_have_count(1)


PASTE = """
(text) => {
  const clipboardData = new DataTransfer();
  clipboardData.setData('text/plain', text);
  const options = { clipboardData, bubbles: true, cancelable: true };
  document.body.dispatchEvent(new ClipboardEvent('paste', options));
}
"""


def test_items_are_duplicated_reversed_and_raised_and_coordinates_pasted(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, scene=False, size=(1280, 800)) as page:
        view = open_plan_view(page)
        waypoints = entries_of(view).filter(has_text="Waypoint")
        home = station.drone.topic("home")
        assert home is not None
        lat, lon = home["lat_deg"], home["lon_deg"]
        for north_deg in (0.0001, 0.0002):
            page.evaluate(PASTE, f"{lat + north_deg:.7f}, {lon:.7f}")
        expect(waypoints).to_have_count(2)
        page.evaluate(PASTE, "147.39, 8.54")
        expect(view.get_by_text("147.39 is no latitude")).to_be_visible()
        expect(waypoints).to_have_count(2)

        waypoints.first.click()
        waypoints.last.click(modifiers=["Shift"])
        card = page.get_by_role("group", name="Selection")
        card.get_by_label("Shift altitudes by").fill("12")
        card.get_by_role("button", name="Shift", exact=True).click()
        expect(waypoints.first).to_contain_text("42.0 m above home")
        expect(waypoints.last).to_contain_text("42.0 m above home")
        page.keyboard.press("Escape")
        waypoints.last.click()
        page.keyboard.press("Control+d")
        expect(waypoints).to_have_count(3)
        waypoints.first.click()
        waypoints.last.click(modifiers=["Shift"])
        card.get_by_role("button", name="Reverse").click()
        waypoints.first.click()
        expect(card.get_by_label("Latitude")).to_have_value(f"{lat + 0.0002:.7f}")
        waypoints.last.click()
        expect(card.get_by_label("Latitude")).to_have_value(f"{lat + 0.0001:.7f}")


def test_a_tower_inspection_is_imported_edited_dry_run_and_started(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, scene=False, size=(1280, 800)) as page:
        view = open_plan_view(page)
        import_tower(page, view)
        steps, findings = entries_of(view), check_without_findings(view)
        steps.filter(has_text="Around the tower").click()
        card = page.get_by_role("group", name="Selection")
        card.get_by_label("Edit", exact=True).select_option(label="point 3c")
        card.get_by_label("Altitude above start").fill("200")
        expect(findings).to_contain_text("above home")
        page.get_by_role("button", name="Undo", exact=True).click()
        expect(card.get_by_label("Altitude above start")).to_have_value("18")
        expect(findings).to_contain_text("no findings")

        time_slider = run_dry_run(page, view)
        press_key(time_slider, "PageUp")
        expect(time_slider).to_have_attribute("aria-valuetext", re.compile(r"^00:10"))
        view.get_by_role("button", name=re.compile("fly…$", re.I)).click()  # "Save and fly…"
        expect(page.get_by_role("alertdialog")).to_contain_text(
            "If the server fails or loses the connection to the vehicle:"
        )
        confirm_by_space_bar(page)

        def mission_state() -> str | None:
            mission = station.drone.request("GET", "/offboard_mission")["mission"]
            return None if mission is None else mission["state"]

        wait_until(lambda: mission_state() == "flying", "the mission's flight", 60)
        page.keyboard.press("h")
        wait_until(lambda: station.drone.status()["mode"] == "hold", "the mode Hold", 60)


def test_a_tower_inspection_is_drawn_by_clicks_and_flown_with_the_gimbal_at_the_tower(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, scene=False, size=(1280, 800)) as page:
        view = open_plan_view(page)
        steps, add_button = entries_of(view), view.get_by_role("button", name="Add step")
        card = page.get_by_role("group", name="Selection")
        choose_menu_entry(page.get_by_role("button", name="New", exact=True), "Offboard mission")
        for point in WAYPOINTS_AROUND_TOWER:
            page.mouse.click(*window_position_on_map(page, point))
        page.keyboard.press("Escape")
        expect(steps.filter(has_text="3 points")).to_have_count(1)
        steps.filter(has_text="Take off").click()
        choose_menu_entry(add_button, "Gimbal")
        card.get_by_label("Gimbal mode").select_option(label="look at a point")
        for label, value in zip(("north", "east"), TOWER_NED_M, strict=False):
            card.get_by_label(f"Look at: {label}").fill(f"{value}")
        card.get_by_label("Altitude above start").fill(f"{-TOWER_NED_M[2]}")
        steps.filter(has_text="3 points").click()
        card.get_by_label("Heading").select_option(label="towards a point")
        card.get_by_label("Photo every").fill("6")
        check_without_findings(view)
        press_key(run_dry_run(page, view), "End")
        view.get_by_role("button", name=re.compile("fly…$", re.I)).click()  # "Save and fly…"
        confirm_by_space_bar(page)
        start_ned_m = station.drone.position_ned_m()

        def looks_at_the_tower(min_distance_m: float) -> bool:
            gimbal = station.drone.topic("gimbal")
            north, east, down = (
                now - then for now, then in zip(station.drone.position_ned_m(), start_ned_m, strict=True)
            )
            to_north, to_east, to_down = TOWER_NED_M[0] - north, TOWER_NED_M[1] - east, TOWER_NED_M[2] - down
            pitch, yaw = -math.atan2(to_down, math.hypot(to_north, to_east)), math.atan2(to_east, to_north)
            errors = (gimbal["pitch_rad"] - pitch, math.remainder(gimbal["yaw_ned_rad"] - yaw, math.tau))
            return down < -8 and math.hypot(north, east) >= min_distance_m and max(map(abs, errors)) < 0.15

        for distance_m in (0, 8):
            wait_until(
                lambda m=distance_m: looks_at_the_tower(m), f"the tower in view, {distance_m} m away", 60
            )
        page.keyboard.press("h")
        wait_until(lambda: station.drone.status()["mode"] == "hold", "the mode Hold", 60)


def test_a_plan_is_created_and_flown_by_keyboard_only(browser: Browser, station: Station) -> None:
    home_of(station)
    with open_page(browser, station.url, scene=False) as page:
        view = open_plan_view(page)
        steps, keyboard = entries_of(view), page.keyboard
        tab_to(page, MAP_LABEL)
        for keys in (("ArrowUp",) * 4, ("ArrowRight",) * 4):
            for key in keys:
                keyboard.press(key)
            keyboard.press("Enter")
        expect(steps.filter(has_text="Waypoint")).to_have_count(2)
        keyboard.press("Escape")
        for typed_letters, title in (("take", "Take off"), ("ret", "Return")):
            tab_to(page, "Add item")
            keyboard.press("Enter")
            expect(page.get_by_role("menuitem").first).to_be_focused()
            keyboard.type(typed_letters)
            expect(page.get_by_role("menuitem", name=title, exact=True)).to_be_focused()
            keyboard.press("Enter")
            expect(steps.filter(has_text=title)).to_have_count(1)
        keyboard.press("Control+z")
        expect(steps.filter(has_text="Return")).to_have_count(0)
        keyboard.press("Control+Shift+z")
        expect(steps.filter(has_text="Return")).to_have_count(1)
        expect(view.get_by_role("region", name="Findings")).not_to_contain_text("Error:")

        tab_to(page, "Dry run")
        keyboard.press("Enter")
        expect(view.get_by_role("region", name="Dry run")).to_contain_text("Dry run: ", timeout=240_000)
        tab_to(page, "Time in the dry run")
        keyboard.press("PageUp")
        keyboard.press("ArrowRight")
        time_slider = page.get_by_role("slider", name="Time in the dry run")
        expect(time_slider).to_have_attribute("aria-valuetext", re.compile(r"^00:11"))

        tab_to(page, "Save and upload")
        keyboard.press("Enter")
        upload_region = view.get_by_role("region", name="Plan on the vehicle")
        expect(upload_region).to_contain_text("This plan is on Quad 101.")
        tab_to(page, "Fly…")
        keyboard.press("Enter")
        confirm_by_space_bar(page)
        wait_until(lambda: station.drone.status()["mode"] == "mission", "the mode Mission", 60)
        keyboard.press("h")
        wait_until(lambda: station.drone.status()["mode"] == "hold", "the mode Hold", 60)


def test_a_survey_is_made_and_dry_run_by_keyboard_only(browser: Browser, station: Station) -> None:
    home = home_of(station)
    with open_page(browser, station.url, scene=False, size=(1024, 768)) as page:
        view = open_plan_view(page)
        keyboard = page.keyboard
        tab_to(page, "Add item")
        keyboard.press("Enter")
        expect(page.get_by_role("menuitem").first).to_be_focused()
        keyboard.type("surv")
        expect(page.get_by_role("menuitem", name="Survey", exact=True)).to_be_focused()
        keyboard.press("Enter")
        expect(view.get_by_label("Pattern", exact=True)).to_be_focused()
        figures = view.get_by_role("group", name="Figures of the pattern")
        expect(figures).to_contain_text("Add 3 more corners")
        tab_to(page, "Add rectangle")
        keyboard.press("Enter")
        expect(figures).to_contain_text("cm/px")
        type_into(page, "Latitude", f"{home['lat_deg'] + 0.0002:.7f}")
        type_into(page, "Altitude", "15")
        type_into(page, "Side overlap", "96")
        expect(view.get_by_text("Enter a number from 0 to 95.")).to_be_visible()
        type_into(page, "Side overlap", "50")
        type_into(page, "Heading of the lines", "90")
        expect(figures).to_contain_text("90°")
        assert violations_in_both_themes(page) == []
        tab_to(page, "Insert survey")
        keyboard.press("Enter")
        expect(entries_of(view).filter(has_text="Survey")).to_contain_text("15.0 m above home")
        findings = view.get_by_role("region", name="Findings")
        tab_to(page, "Add a take-off at the beginning")
        keyboard.press("Enter")
        expect(findings).not_to_contain_text("The plan has no take-off")
        expect(findings).not_to_contain_text("Error:")
        tab_to(page, "Dry run")
        keyboard.press("Enter")
        expect(view.get_by_role("region", name="Dry run")).to_contain_text("Dry run: ", timeout=240_000)


def type_into(page: Page, label: str, text: str) -> None:
    """Replaces the text of a field by keyboard."""
    tab_to(page, label)
    page.keyboard.press("Control+a")
    page.keyboard.type(text)


def test_a_plan_is_exported_dropped_as_a_file_dragged_by_touch_and_restored_to_an_older_version(
    browser: Browser, station: Station
) -> None:
    home = home_of(station)
    position = {"lat_deg": home["lat_deg"], "lon_deg": home["lon_deg"]}
    altitude = {"value_m": 20, "reference": "home"}
    items = [{"kind": kind, **position, "altitude": altitude} for kind in ("takeoff", "waypoint", "land")]
    plan = {"planned_home": home, "items": items}
    with open_page(browser, station.url, scene=False) as page:
        view = open_plan_view(page)
        stored_plan = station.gcs.request("POST", "/plans", {"name": "Tower", "plan": plan})
        path = f"/plans/{stored_plan['id']}"
        page.get_by_role("button", name="Open", exact=True).click()
        view.get_by_role("button", name=re.compile("^Tower Waypoint plan · 3 items")).click()
        with page.expect_download() as download:
            choose_menu_entry(page.get_by_role("button", name="Export"), "QGroundControl .plan")
        exported_plan = Path(download.value.path()).read_text(encoding="utf-8")
        assert [item["command"] for item in json.loads(exported_plan)["mission"]["items"]] == [22, 16, 21]

        page.evaluate(DROP_FILE, exported_plan)
        expect(view.get_by_label("Name of the plan")).to_have_value("dropped")
        expect(entries_of(view).filter(has_text="Waypoint")).to_have_count(1)
        page.evaluate(DROP_FILE, "{")
        expect(view.get_by_role("alert")).to_contain_text("“dropped.plan” was not imported.")
        expect(entries_of(view).filter(has_text="Waypoint")).to_have_count(1)
        drag_by_touch(page)

        save_as_other_client(station, path, 1, {**plan, "items": items[:1]})
        page.get_by_role("button", name="Open", exact=True).click()
        view.get_by_role("button", name="Versions of Tower").click()
        view.get_by_role("button", name=re.compile(r"^Version 1 3 items")).click()
        expect(view).to_contain_text("Version 1 of 2, saved by e2e.")
        view.get_by_role("button", name="Restore this version").click()
        expect(view).to_contain_text("Saved as version 3.")
    assert len(station.gcs.request("GET", path)["plan"]["items"]) == 3


def drag_by_touch(page: Page) -> None:
    """Drags a waypoint by touch."""
    view = page.get_by_role("region", name="Plan view")
    x, y = window_position_on_map(page, (0.4, 0.35))
    choose_menu_entry(view.get_by_role("button", name="Add item"), "Waypoint")
    page.mouse.click(x, y)
    latitude = page.get_by_role("group", name="Selection").get_by_label("Latitude")
    page.keyboard.press("Escape")
    latitude_before = latitude.input_value()
    session = page.context.new_cdp_session(page)
    for kind, moved_px in (("touchStart", 0), ("touchMove", -20), ("touchMove", -60), ("touchEnd", None)):
        points = [] if moved_px is None else [{"x": x, "y": y + moved_px}]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    expect(latitude).not_to_have_value(latitude_before)
    session.detach()
