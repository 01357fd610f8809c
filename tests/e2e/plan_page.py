"""Actions in the plan view that several tests use."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from playwright.sync_api import Locator, Page, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import REPOSITORY, bounding_box, confirm_by_space_bar
from tests.e2e.fast_station import Station
from tests.station import wait_until

EXAMPLES: Path = REPOSITORY / "missions" / "examples"
TOWER_MISSION = """
format: offboard-gcs-mission
version: 1
name: Tower inspection
steps:
  - {step: take_off, height_m: 6}
  - {step: gimbal, name: Look at the tower top, track: look_at, place: {offset_ned_m: [20, 0, -10]}}
  - step: fly
    name: Around the tower
    curve: smooth
    speed_m_s: 5
    points:
      - {offset_ned_m: [2, -14, -12]}
      - {offset_ned_m: [22, -17, -16]}
      - {offset_ned_m: [38, 2, -18]}
      - {offset_ned_m: [20, 17, -15]}
    look_at: {offset_ned_m: [20, 0, -10]}
    photo_every_m: 6
  - {step: fly, name: Back, points: [{offset_ned_m: [0, 0, -6]}], speed_m_s: 5}
  - {step: land}
"""
"""A mission with less than a minute of flight."""
CLICK_POSITIONS = ((0.35, 0.55), (0.45, 0.4), (0.55, 0.5))
"""Positions to click, as fractions of the map."""


def open_plan_view(page: Page) -> Locator:
    """Opens the plan view and waits until its map accepts clicks."""
    page.get_by_role("toolbar", name="Map").wait_for()
    expect(page.locator(".bar")).to_have_text("10 m")
    page.keyboard.press("w")
    view = page.get_by_role("region", name="Plan view")
    view.wait_for()
    page.get_by_role("toolbar", name="Map").wait_for()
    return view


def entries_of(view: Locator) -> Locator:
    """The entries of the list of items (waypoint plan) or steps (offboard mission)."""
    return view.get_by_role("listbox", name=re.compile("^(Items|Steps)$")).get_by_role("option")


def window_position_on_map(page: Page, fraction: tuple[float, float]) -> tuple[float, float]:
    """Position in the window [px] of a point that is given as fractions of the map."""
    box = bounding_box(page.get_by_role("application"))
    return box["x"] + fraction[0] * box["width"], box["y"] + fraction[1] * box["height"]


def undo_and_redo_everything(page: Page, view: Locator) -> None:
    """Undoes and redoes all edits; checks that the list is then the same as before."""
    steps = entries_of(view)
    undo, redo = (page.get_by_role("button", name=name, exact=True) for name in ("Undo", "Redo"))
    texts_before = steps.all_inner_texts()
    edit_count = 0
    while undo.is_enabled():
        page.keyboard.press("Control+z")
        edit_count += 1
    expect(redo).to_be_enabled()
    expect(steps.filter(has_text="Waypoint")).to_have_count(0)
    for _ in range(edit_count):
        page.keyboard.press("Control+Shift+z")
    expect(redo).to_be_disabled()
    assert steps.all_inner_texts() == texts_before


def import_tower(page: Page, view: Locator) -> None:
    """Imports the tower inspection from a file into the editor."""
    file = {"name": "tower.yaml", "mimeType": "application/yaml", "buffer": TOWER_MISSION.encode()}
    page.get_by_label("File to import").set_input_files(file)  # type: ignore[arg-type]
    expect(view.get_by_label("Name of the plan")).to_have_value("Tower inspection")


def check_without_findings(view: Locator) -> Locator:
    """Reads the vehicle's parameters and waits until the check has no findings; returns the region of
    findings."""
    findings = view.get_by_role("region", name="Findings")
    findings.get_by_role("button", name="Read the parameters").click()
    expect(findings).to_contain_text("no findings")
    return findings


def run_dry_run(page: Page, view: Locator, longest_s: float = 240) -> Locator:
    """Runs a dry run of the plan; returns the time slider of its result."""
    dry_run_region = view.get_by_role("region", name="Dry run")
    dry_run_region.get_by_role("button", name="Dry run", exact=True).click()
    expect(dry_run_region).to_contain_text("Dry run: ", timeout=longest_s * 1000)
    return page.get_by_role("slider", name="Time in the dry run")


def upload_plan(view: Locator) -> Locator:
    """Uploads the plan to the vehicle; returns the region that shows the plan on the vehicle."""
    upload_region = view.get_by_role("region", name="Plan on the vehicle")
    upload_region.get_by_role("button", name=re.compile("upload", re.I)).click()
    expect(upload_region).to_contain_text("This plan is on Quad 101.")
    return upload_region


def start_plan(page: Page, upload_region: Locator, station: Station) -> None:
    """Starts the uploaded plan and confirms the start."""
    upload_region.get_by_role("button", name="Fly…").click()
    confirm_by_space_bar(page)
    wait_until(lambda: station.drone.status()["mode"] == "mission", "the mode Mission", 60)
    expect(upload_region).to_contain_text("is flying its mission")


def home_of(station: Station) -> dict[str, float]:
    """The vehicle's home, with only the fields that a plan's home has."""
    wait_until(lambda: station.drone.topic("home") is not None, "the vehicle's home")
    topic = station.drone.topic("home")
    assert topic is not None
    return {name: topic[name] for name in ("lat_deg", "lon_deg", "alt_amsl_m")}


def save_as_other_client(station: Station, path: str, base_version: int, plan: dict[str, Any]) -> None:
    """Saves the next version of a plan as the client "anna"."""
    body = {"name": "Tower", "plan": plan, "base_version": base_version}
    with SyncGcs(station.url, client="anna", client_id="anna") as anna:
        anna.request("PUT", path, body)
