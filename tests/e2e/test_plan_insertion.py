"""The plan view inserts a stored mission and a trajectory file; the server has no vehicle."""

from __future__ import annotations

import io
import json

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import choose_menu_entry, open_page, violations_in_both_themes
from tests.e2e.plan_page import entries_of
from tests.station import free_port, running_server

pytestmark = [pytest.mark.browser, pytest.mark.story]

HOME = {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 480}
MAST_POINTS = [{"offset_ned_m": [20, 0, -12]}, {"offset_ned_m": [20, 30, -12]}]
MAST_MISSION = {
    "format": "offboard-gcs-mission",
    "name": "Mast",
    "home": HOME,
    "steps": [{"step": "take_off", "height_m": 8}, {"step": "fly", "name": "Around", "points": MAST_POINTS}],
}
FIELD_MISSION = {
    **MAST_MISSION,
    "name": "Field",
    "home": {**HOME, "lat_deg": 47.401},
    "steps": [{"step": "take_off", "height_m": 8}, {"step": "land"}],
}


def test_a_stored_mission_and_a_trajectory_file_are_inserted(browser: Browser) -> None:
    table_file = io.BytesIO()
    np.save(table_file, np.array([[0, 0, 0, -10], [20, 20, 0, -10]], dtype=float))
    with (
        running_server([f"udpin://127.0.0.1:{free_port()}"]) as (url, _),
        open_page(browser, url, scene=False, size=(1280, 800)) as page,
    ):
        httpx.post(f"{url}/api/v1/plans", json={"name": "Mast", "plan": MAST_MISSION}).raise_for_status()
        page.get_by_role("toolbar", name="Map").wait_for()
        page.keyboard.press("w")
        view = page.get_by_role("region", name="Plan view")
        field_file = {"name": "field.json", "mimeType": "", "buffer": json.dumps(FIELD_MISSION).encode()}
        page.get_by_label("File to import").set_input_files(field_file)  # type: ignore[arg-type]
        entries = entries_of(view)
        expect(entries).to_have_count(3)  # home, take-off, landing

        choose_menu_entry(view.get_by_role("button", name="Add step"), "Insert a stored mission…")
        insertion = view.get_by_role("region", name="Insert a stored mission")
        insertion.get_by_role("button", name="Mast").click()
        expect(insertion.get_by_role("alert")).to_contain_text("'Mast' has positions relative to its start")
        assert violations_in_both_themes(page) == []
        insertion.get_by_role("button", name="Keep the planned positions").click()
        expect(entries.filter(has_text="Mast:")).to_contain_text("Around")
        expect(entries.nth(2)).to_have_attribute("aria-selected", "true")
        expect(view.get_by_role("status").first).to_contain_text("Take-off of 'Mast' is left out.")
        page.keyboard.press("Control+z")
        expect(entries).to_have_count(3)

        choose_menu_entry(view.get_by_role("button", name="Add step"), "Trajectory from a table")
        file_input = page.get_by_label("Choose a CSV or NumPy file")
        damaged_file = {"name": "line.npy", "mimeType": "", "buffer": b"\x93NUMPY"}
        file_input.set_input_files(damaged_file)  # type: ignore[arg-type]
        expect(view.get_by_role("alert")).to_contain_text("“line.npy” was not imported.")
        file_input.set_input_files({**damaged_file, "buffer": table_file.getvalue()})  # type: ignore[arg-type]
        expect(view.get_by_text("“line.npy”: 2 rows, 20.0 s, without yaw.")).to_be_visible()
        expect(entries.filter(has_text="line.csv")).to_have_count(1)
