"""Pictures of the plan view: a survey with findings, an offboard mission, its dry run."""

from __future__ import annotations

from playwright.sync_api import Locator, Page

from tests.e2e.browser import choose_menu_entry
from tests.e2e.pictures import DESKTOP_SIZE, PictureSetup, save_in_both_themes, wait_until_unchanged
from tests.e2e.plan_page import EXAMPLES, import_tower, run_dry_run

SURVEY_AREA = ((0.49, 0.32), (0.62, 0.28), (0.68, 0.5), (0.52, 0.58))
FENCE = ((0.46, 0.24), (0.66, 0.22), (0.66, 0.62), (0.56, 0.66), (0.46, 0.5))
"""Corners of the survey area and of the geofence, as fractions of the window."""


def open_plan_view(page: Page, zoom: str | None = None) -> Locator:
    """Opens the plan view over the map."""
    page.keyboard.press("w")
    view = page.get_by_role("region", name="Plan view")
    view.wait_for()
    page.get_by_role("toolbar", name="Map").wait_for()
    if zoom is not None:
        page.get_by_role("button", name=zoom).click()
    wait_until_unchanged(page, 2)
    return view


def close_plan_view(page: Page) -> None:
    """Closes the plan view and the large map, which the pictures of the other states do not show."""
    page.get_by_role("button", name="Close the plan view").click()
    page.keyboard.press("m")


def click_points(page: Page, points: tuple[tuple[float, float], ...]) -> None:
    """Clicks these points, given as fractions of the window, one after the other."""
    for x, y in points:
        page.mouse.click(DESKTOP_SIZE[0] * x, DESKTOP_SIZE[1] * y)
        wait_until_unchanged(page, 1)  # two quick clicks are a double click, which completes the area


def plan(setup: PictureSetup) -> None:
    """A waypoint plan: the form of a survey, a geofence that the survey leaves, a waypoint, the altitudes."""
    page = setup.page
    setup.drone.request("POST", "/params/refresh", {"wait": True})
    view = open_plan_view(page, "Zoom out")
    view.get_by_label("Name of the plan").fill("Field survey")
    add_button = view.get_by_role("button", name="Add item")
    choose_menu_entry(add_button, "Survey")
    click_points(page, SURVEY_AREA)
    view.get_by_label("Altitude", exact=True).fill("25")
    page.mouse.move(0, 0)
    wait_until_unchanged(page, 3)
    save_in_both_themes(page, setup.folder, "pattern")
    view.get_by_role("button", name="Insert survey").click()
    findings = view.get_by_role("region", name="Findings")
    findings.get_by_role("button", name="Add a take-off at the beginning").click()
    choose_menu_entry(add_button, "Return")
    choose_menu_entry(add_button, "Geofence: stay inside")
    click_points(page, FENCE)
    view.get_by_role("button", name="Add geofence").click()
    view.get_by_role("option", name="Waypoint").nth(2).click()
    page.mouse.move(0, 0)
    wait_until_unchanged(page, 3)
    save_in_both_themes(page, setup.folder, "plan")
    close_plan_view(page)


def mission(setup: PictureSetup) -> None:
    """An offboard mission: its steps as a tree, its path, a selected step."""
    page = setup.page
    view = open_plan_view(page)
    page.get_by_label("File to import").set_input_files(EXAMPLES / "tower_inspection.yaml")
    view.get_by_role("option", name="Up beside the tower").click()
    page.get_by_role("button", name="Zoom in").click()
    page.mouse.move(0, 0)
    wait_until_unchanged(page, 4)
    save_in_both_themes(page, setup.folder, "mission")
    close_plan_view(page)


def dry_run(setup: PictureSetup) -> None:
    """A Monte Carlo dry run of a mission: simulated vehicle, gimbal and corridor at one time."""
    page = setup.page
    setup.drone.request("PUT", "/params/MNT_DO_STAB", {"value": 2})  # the mission locks the yaw of the gimbal
    setup.drone.request("POST", "/params/refresh", {"wait": True})
    view = open_plan_view(page)
    import_tower(page, view)
    view.get_by_role("button", name="Conditions").click()
    for label, value in (("Wind", "4"), ("Wind from", "270"), ("Gusts", "1"), ("Flights with", "8")):
        view.get_by_label(label).first.fill(value)
    view.get_by_role("button", name="Conditions").click()
    page.get_by_role("button", name="Zoom in").click()
    time_slider = run_dry_run(page, view, longest_s=600)
    for key in ("PageUp", "PageUp", "ArrowRight", "ArrowRight"):
        time_slider.press(key)
    page.mouse.move(0, 0)
    wait_until_unchanged(page, 3)
    save_in_both_themes(page, setup.folder, "dry-run")
    close_plan_view(page)
