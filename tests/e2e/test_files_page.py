"""Files on the vehicle in the page: a folder is made, a file put, replaced, got and removed, each said before
it is done; and by the Python client."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import open_page, serious_violations
from tests.e2e.fast_station import Station

pytestmark = [pytest.mark.browser, pytest.mark.story]
SIZES = ((1280, 800), (1024, 768), (390, 844))


def pictures(page: Page, name: str) -> None:
    """Pictures for a person to look at, if a folder is given."""
    if (folder := os.environ.get("GCS_PICTURES")) is None:
        return
    for theme in ("light", "dark"):
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(400)
            page.screenshot(path=Path(folder) / f"{name}-{width}-{theme}.png")
        page.set_viewport_size({"width": 1280, "height": 800})
        page.keyboard.press("Shift+D")


def test_a_file_is_put_replaced_got_and_removed_in_the_page(browser: Browser, station: Station) -> None:
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.locator(".pill").wait_for()
        page.keyboard.press("Shift+B")
        panel = page.get_by_role("region", name="Files", exact=True)
        expect(panel.get_by_label("Folder", exact=True)).to_be_focused()
        expect(panel).to_contain_text("parameters.bson")
        panel.get_by_label("Name of a new folder").fill("notes")
        panel.get_by_role("button", name="Make", exact=True).click()
        expect(panel).to_contain_text("/notes was made.")
        panel.get_by_role("button", name="notes", exact=True).click()
        expect(panel).to_contain_text("This folder is empty.")

        def put(content: bytes) -> None:
            file = {"name": "extras.txt", "mimeType": "text/plain", "buffer": content}
            panel.get_by_label("File to write").set_input_files(files=[file])

        put(b"old")
        expect(panel).to_contain_text("Write /notes/extras.txt (3 B)")
        panel.get_by_role("button", name="Write now").click()
        expect(panel).to_contain_text("/notes/extras.txt was written; its checksum is right.")
        put(b"newer")
        expect(panel).to_contain_text("The old content cannot be recovered.")
        panel.get_by_role("button", name="Write now").click()
        expect(panel.get_by_role("listitem").filter(has_text="extras.txt")).to_contain_text("5 B")
        with page.expect_download() as download:
            panel.get_by_role("button", name="Get extras.txt").click()
        assert Path(download.value.path()).read_bytes() == b"newer"
        assert download.value.suggested_filename == "extras.txt"
        assert serious_violations(page) == []

        panel.get_by_role("button", name="Folder above").click()
        panel.get_by_role("button", name="Remove parameters.bson").click()
        expect(panel).to_contain_text("calibration and tuning")
        pictures(page, "files")
        panel.get_by_role("button", name="Keep as it is").click()

    files = station.drone.files
    assert files.get("/notes/extras.txt") == b"newer"
    files.remove("/notes/extras.txt")
    files.remove("/notes")
    assert "notes" not in [entry["name"] for entry in files.list("/")]
