"""The plan view in a browser: a plan is drawn by clicks, corrected, undone, saved and opened again."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e.browser import (
    bounding_box,
    choose_menu_entry,
    confirm_by_space_bar,
    open_page,
    scene_frame,
    violations_in_both_themes,
)
from tests.e2e.fast_station import Station
from tests.e2e.plan_page import (
    CLICK_POSITIONS,
    EXAMPLES,
    check_without_findings,
    entries_of,
    home_of,
    open_plan_view,
    save_as_other_client,
    start_plan,
    upload_plan,
    window_position_on_map,
)
from tests.station import wait_until

pytestmark = pytest.mark.browser

WINDOW_POSITION_OF_POINT = """
(enu) => {
  const viser = window.__viserMutable, world = viser?.nodeRefFromName['/world'];
  if (!viser?.camera || !world) return null;
  const row = (m, r, [x, y, z, w]) => m[r] * x + m[r + 4] * y + m[r + 8] * z + m[r + 12] * w;
  const transform = (matrix, point) => [0, 1, 2, 3].map((r) => row(matrix, r, point));
  const matrices = [world.matrixWorld, viser.camera.matrixWorldInverse, viser.camera.projectionMatrix];
  const at = matrices.reduce((point, matrix) => transform(matrix.elements, point), [...enu, 1]);
  return [(at[0] / at[3] + 1) / 2 * innerWidth, (1 - at[1] / at[3]) / 2 * innerHeight];
}
"""
"""Position of a point of viser's world inside the iframe [px]; null while the view is not ready."""


@pytest.mark.story
def test_a_plan_is_drawn_corrected_undone_saved_and_opened_again(browser: Browser, station: Station) -> None:
    with open_page(browser, station.url, scene=False) as page:
        view = open_plan_view(page)
        steps = entries_of(view)
        waypoints = steps.filter(has_text="Waypoint")
        for count, point in enumerate(CLICK_POSITIONS, 1):
            page.mouse.click(*window_position_on_map(page, point))
            expect(waypoints).to_have_count(count)
        page.keyboard.press("Escape")
        expect(view.get_by_text("Click the map to add waypoints.")).to_be_hidden()

        drag_waypoint_and_undo(page, view)

        card = page.get_by_role("group", name="Selection")
        waypoints.nth(1).click()
        card.get_by_label("Altitude", exact=True).fill("45,5")
        expect(waypoints.nth(1)).to_contain_text("45.5 m above home")
        page.get_by_role("button", name="Undo").click()
        expect(waypoints.nth(1)).to_contain_text("30.0 m above home")
        page.get_by_role("button", name="Redo").click()
        expect(waypoints.nth(1)).to_contain_text("45.5 m above home")

        findings = view.get_by_role("region", name="Findings")
        expect(findings).to_contain_text("The plan has no take-off")
        findings.get_by_role("button", name="Add a take-off at the beginning").click()
        expect(steps.nth(1)).to_contain_text("Take off")
        expect(findings).not_to_contain_text("The plan has no take-off")
        assert violations_in_both_themes(page) == []

        view.get_by_label("Name of the plan").fill("Tower")
        page.get_by_role("button", name="Save", exact=True).click()
        expect(view).to_contain_text("Saved as version 1.")
        page.reload()
        view = open_plan_view(page)
        expect(view).to_contain_text("version 1")
        expect(waypoints).to_have_count(3)
        expect(waypoints.nth(1)).to_contain_text("45.5 m above home")

        check_conflict_with_other_client(page, view, station)


def test_a_plan_is_uploaded_and_flown_and_interrupted_by_the_hold_key(
    browser: Browser, station: Station
) -> None:
    home = home_of(station)
    start_position = {"lat_deg": home["lat_deg"], "lon_deg": home["lon_deg"]}
    far_position = {
        **start_position,
        "lat_deg": home["lat_deg"] + 0.0135,
    }  # 1500 m: the vehicle is still on its way when the page is checked
    altitude = {"value_m": 20, "reference": "home"}
    items = [
        {"kind": "takeoff", **start_position, "altitude": altitude},
        {"kind": "waypoint", **far_position, "altitude": altitude},
        {"kind": "return_home"},
    ]
    station.gcs.request("POST", "/plans", {"name": "Far", "plan": {"planned_home": home, "items": items}})
    with open_page(browser, station.url, scene=False) as page:
        view = open_plan_view(page)
        page.get_by_role("button", name="Open", exact=True).click()
        view.get_by_role("button", name=re.compile("^Far Waypoint plan · 3 items")).click()
        expect(view.get_by_role("option", name="3 Return")).to_be_visible()
        fly_and_hold(page, view, station)


@pytest.mark.story
def test_an_offboard_mission_is_opened_edited_checked_and_undone(browser: Browser, station: Station) -> None:
    with open_page(browser, station.url, scene=False, size=(1280, 800)) as page:
        view = open_plan_view(page)
        page.get_by_label("File to import").set_input_files(EXAMPLES / "tower_inspection.yaml")
        steps = entries_of(view)
        expect(view).to_contain_text("Offboard mission")
        expect(steps.filter(has_text="Down around the mast")).to_contain_text("Helix")
        expect(steps.filter(has_text="round: Orbit").first).to_contain_text("radius 12 m")
        findings = check_without_findings(view)

        steps.filter(has_text="Down around the mast").click()
        altitude_gain = page.get_by_role("group", name="Selection").get_by_label("Altitude gain")
        altitude_gain.fill("-40")
        expect(findings).to_contain_text("step 8:")
        expect(findings).to_contain_text("above home")
        findings.get_by_role("button", name="Show").first.click()
        page.get_by_role("button", name="Undo").click()
        expect(altitude_gain).to_have_value("-18")
        expect(findings).to_contain_text("no findings")

        steps.filter(has_text="Is the photo sharp").click()
        page.keyboard.press("Delete")
        expect(steps.filter(has_text="Is the photo sharp")).to_have_count(0)
        page.keyboard.press("Control+z")
        expect(steps.filter(has_text="Is the photo sharp")).to_have_count(1)
        assert violations_in_both_themes(page) == []
        page.get_by_role("button", name="Save", exact=True).click()
        expect(view).to_contain_text("Saved as version 1.")
    (stored,) = [
        plan for plan in station.gcs.request("GET", "/plans")["plans"] if plan["kind"] == "offboard_mission"
    ]
    assert (stored["name"], stored["item_count"]) == ("Tower inspection", 16)


@pytest.mark.realtime
def test_an_offboard_mission_is_flown_paused_and_aborted_by_clicks(
    browser: Browser, station: Station
) -> None:
    steps = [{"step": "take_off", "height_m": 4}, {"step": "hold", "duration_s": 600, "name": "Look around"}]
    plan = {"format": "offboard-gcs-mission", "version": 1, "name": "Hop", "steps": steps}
    station.gcs.request("POST", "/plans", {"name": "Hop", "plan": plan})

    def is_mission_in_state(state: str) -> bool:
        mission = station.drone.request("GET", "/offboard_mission")["mission"]
        return mission is not None and mission["state"] == state

    with open_page(browser, station.url, scene=False) as page:
        view = open_plan_view(page)
        page.get_by_role("button", name="Open", exact=True).click()
        view.get_by_role("button", name=re.compile("^Hop Offboard mission · 2 steps")).click()
        start_region = view.get_by_role("region", name="Fly this mission")
        expect(start_region).to_contain_text("The check found no errors for Quad 101.")
        start_region.get_by_role("button", name="Fly…").click()
        expect(
            page.get_by_text("If the server fails or loses the connection to the vehicle:")
        ).to_be_visible()
        confirm_by_space_bar(page)
        wait_until(lambda: is_mission_in_state("flying"), "the mission's flight", 60)
        expect(start_region).to_contain_text("Abort it first")
        page.keyboard.press("w")
        card = page.get_by_role("region", name="Offboard mission")
        expect(card).to_contain_text("Look around")
        card.get_by_role("button", name="Pause").click()
        expect(card.get_by_role("status")).to_have_text("Paused")
        assert violations_in_both_themes(page) == []
        card.get_by_role("button", name="Abort…").click()
        confirm_by_space_bar(page)
        expect(card.get_by_role("status")).to_have_text("Aborted")
        page.reload()
        expect(card.get_by_role("table", name="Flown compared with planned")).to_contain_text("Battery used")
        expect(card.get_by_role("img", name="Distance from the planned path over time")).to_be_visible()
        assert violations_in_both_themes(page) == []
        wait_until(lambda: station.drone.status()["mode"] == "hold", "the mode Hold", 60)
        card.get_by_role("button", name="Close").click()
        expect(card).to_be_hidden()


@pytest.mark.story
def test_a_plan_is_edited_in_3d_and_a_click_while_editing_opens_no_command_menu(
    browser: Browser, station: Station
) -> None:
    home = home_of(station)
    offsets = {"waypoint": (3e-4, 1e-4), "land": (3e-4, 5e-4)}
    items = [
        {
            "kind": kind,
            "lat_deg": home["lat_deg"] + north,
            "lon_deg": home["lon_deg"] + east,
            "altitude": {"value_m": 15, "reference": "home"},
        }
        for kind, (north, east) in {"takeoff": (0, 0), **offsets}.items()
    ]
    station.gcs.request("POST", "/plans", {"name": "Hill", "plan": {"planned_home": home, "items": items}})
    with open_page(browser, station.url) as page:
        page.get_by_title("3D view", exact=True).wait_for()
        page.keyboard.press("w")
        view = page.get_by_role("region", name="Plan view")
        page.get_by_role("button", name="Open", exact=True).click()
        view.get_by_role("button", name=re.compile("^Hill Waypoint plan")).click()
        page.keyboard.press("m")
        page.get_by_role("radio", name="Free").click()
        page.get_by_role("button", name="Show plan").click()
        x, y = window_position(page, (7.5, 33.4, 15.0))
        menu = page.get_by_role("dialog", name="At this position: Quad 101")

        page.mouse.click(x, y)
        waypoint = entries_of(view).filter(has_text="Waypoint")
        expect(waypoint).to_have_attribute("aria-selected", "true")
        latitude = page.get_by_role("group", name="Selection").get_by_label("Latitude")
        latitude_before = latitude.input_value()
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 30, y + 20, steps=4)
        page.mouse.up()
        expect(latitude).not_to_have_value(latitude_before)
        expect(waypoint).to_contain_text("15.0 m above home")
        page.keyboard.press("Control+z")
        expect(latitude).to_have_value(latitude_before)

        page.mouse.click(x, y + 60)
        expect(waypoint).to_have_attribute("aria-selected", "false")
        expect(menu).to_be_hidden()
        page.get_by_role("button", name="Close the plan view").click()
        expect(view).to_be_hidden()
        page.mouse.click(x, y + 60)
        expect(menu).to_contain_text("Go here")


def window_position(page: Page, enu_m: tuple[float, float, float]) -> tuple[float, float]:
    """Window position [px] of a point of the 3D view's world (east, north, up), when the camera is at
    rest."""
    frame, position_px = scene_frame(page), (0.0, 0.0)

    def is_at_rest() -> bool:
        nonlocal position_px
        previous_px, position_px = position_px, frame.evaluate(WINDOW_POSITION_OF_POINT, enu_m)
        page.wait_for_timeout(300)
        return position_px is not None and previous_px == position_px

    wait_until(is_at_rest, "the camera of the 3D view", 60)
    box = bounding_box(page.get_by_title("3D view", exact=True))
    return box["x"] + position_px[0], box["y"] + position_px[1]


def fly_and_hold(page: Page, view: Locator, station: Station) -> None:
    """Uploads the plan, starts it after confirmation, and commands Hold by the key H."""
    start_plan(page, upload_plan(view), station)
    page.keyboard.press("w")
    card = page.get_by_role("region", name="Mission", exact=True)
    expect(card).to_contain_text("of 3")
    expect(card).to_contain_text("the straight lines of the plan")
    page.keyboard.press("h")
    wait_until(lambda: station.drone.status()["mode"] == "hold", "the mode Hold", 60)
    expect(card.get_by_role("status")).to_have_text("Paused: not in Mission mode")
    page.reload()
    expect(card.get_by_role("status")).to_have_text("Paused: not in Mission mode")
    expect(card).to_contain_text("The vehicle has left Mission mode")


def drag_waypoint_and_undo(page: Page, view: Locator) -> None:
    """Drags a waypoint by mouse, and restores its position by Undo."""
    card = page.get_by_role("group", name="Selection")
    view.get_by_role("option", name="Waypoint").nth(1).click()
    latitude = card.get_by_label("Latitude")
    latitude_before = latitude.input_value()
    x, y = window_position_on_map(page, CLICK_POSITIONS[1])
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 15, y - 30, steps=4)
    page.mouse.up()
    expect(latitude).not_to_have_value(latitude_before)
    page.keyboard.press("Control+z")
    expect(latitude).to_have_value(latitude_before)


def check_conflict_with_other_client(page: Page, view: Locator, station: Station) -> None:
    """Checks that the page shows a conflict and overwrites nothing after another client saved the plan."""
    plans = station.gcs.request("GET", "/plans")["plans"]
    assert [(plan["name"], plan["version"]) for plan in plans] == [("Tower", 1)]
    path = f"/plans/{plans[0]['id']}"
    stored = station.gcs.request("GET", path)
    save_as_other_client(station, path, 1, {**stored["plan"], "items": []})
    expect(view).to_contain_text("anna saved version 2 of this plan.")
    page.get_by_role("group", name="Selection").wait_for()
    view.get_by_role("option", name="Waypoint").first.click()
    page.keyboard.press("Delete")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(view.get_by_role("alert")).to_contain_text(re.compile("version 2, saved by anna"))
    view.get_by_role("button", name="Save my version as a new plan").click()
    expect(view).to_contain_text("Saved as version 1.")
    assert len(station.gcs.request("GET", path)["plan"]["items"]) == 0
    assert len(station.gcs.request("GET", "/plans")["plans"]) == 2


@pytest.mark.story
def test_an_obstacle_is_drawn_raised_into_the_path_and_shown(browser: Browser, station: Station) -> None:
    with open_page(browser, station.url, scene=False) as page:
        view = open_plan_view(page)
        for point in ((0.35, 0.5), (0.65, 0.5)):
            page.mouse.click(*window_position_on_map(page, point))
            page.wait_for_timeout(400)  # two quick clicks are a double click
        page.keyboard.press("Escape")
        choose_menu_entry(view.get_by_role("button", name="Add item"), "Obstacle")
        for point in ((0.48, 0.45), (0.53, 0.45), (0.53, 0.55), (0.48, 0.55)):
            page.mouse.click(*window_position_on_map(page, point))
            page.wait_for_timeout(400)
        view.get_by_role("button", name="Add obstacle").click()
        obstacle = entries_of(view).filter(has_text="obstacle, top")
        expect(obstacle).to_contain_text("Obstacle 1")

        card = page.get_by_role("group", name="Selection")
        card.get_by_label("Name", exact=True).fill("Barn")
        findings = view.get_by_role("region", name="Findings")
        expect(findings).not_to_contain_text("Barn")
        card.get_by_label("Top", exact=True).fill("40")
        expect(obstacle).to_contain_text("top 40.0 m above home")
        expect(findings).to_contain_text("passes through Barn")
        assert violations_in_both_themes(page) == []
        finding = findings.get_by_role("listitem").filter(has_text="passes through Barn")
        finding.get_by_role("button", name="Show").click()
        expect(entries_of(view).filter(has_text="Waypoint").nth(1)).to_have_attribute("aria-selected", "true")

        obstacle.click()
        page.keyboard.press("Delete")
        expect(obstacle).to_have_count(0)
        expect(findings).not_to_contain_text("Barn")
        page.keyboard.press("Control+z")
        expect(findings).to_contain_text("passes through Barn")
