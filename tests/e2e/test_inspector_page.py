"""MAVLink inspector and console in the page while the vehicle flies: rates, fields, a plot, a message."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import open_page, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

COLOURS_OF_PLOT = """
() => {
  const canvas = document.querySelector('.uplot canvas');
  const { width, height } = canvas;
  return new Set(new Uint32Array(canvas.getContext('2d').getImageData(0, 0, width, height).data.buffer)).size;
}
"""


def picture(page: Page, name: str) -> None:
    """A picture for a person to look at, if a folder is given."""
    if (folder := os.environ.get("GCS_PICTURES")) is not None:
        page.screenshot(path=Path(folder) / f"{name}.png")


def test_messages_are_inspected_plotted_and_sent_in_flight_beside_the_console(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.locator(".pill").wait_for()
        take_off_to_hold(station.drone)
        page.keyboard.press("Shift+X")
        panel = page.get_by_role("region", name="MAVLink", exact=True)
        search = panel.get_by_label("Search messages")
        expect(search).to_be_focused()
        expect(panel).to_contain_text("HEARTBEAT")
        search.fill("attitude rollspeed")
        row = panel.get_by_role("button", name=re.compile("^ATTITUDE "))
        expect(row).to_contain_text(re.compile(r"\d+ Hz"))
        row.click()
        panel.get_by_role("button", name="Plot roll", exact=True).click()
        panel.get_by_role("button", name="Plot pitch", exact=True).click()
        wait_until(lambda: page.evaluate(COLOURS_OF_PLOT) > 10, "the plot")
        assert serious_violations(page) == []
        picture(page, "inspector-1280")

        panel.get_by_text("Send a message").click()
        name = panel.get_by_label("Message", exact=True)
        send = panel.get_by_role("button", name="Send …")
        name.fill("MANUAL_CONTROL")  # has a command of its own
        expect(send).to_be_disabled()
        name.fill("COMMAND_LONG")
        panel.get_by_label(re.compile("^command ")).fill("512")  # MAV_CMD_REQUEST_MESSAGE
        panel.get_by_label(re.compile("^param1 ")).fill("148")
        expect(send).to_be_disabled()
        panel.get_by_label("Send while").check()
        send.click()
        confirm = panel.get_by_role("group", name="Confirm the message")
        expect(confirm).to_contain_text('"command":512')
        assert serious_violations(page) == []
        picture(page, "inspector-send-1280")
        confirm.get_by_role("button", name="Send now").click()
        expect(panel).to_contain_text("MAV_RESULT_ACCEPTED")

        page.keyboard.press("Escape")
        expect(panel).to_have_count(0)
        page.keyboard.press("s")
        console = page.get_by_label("Console", exact=True)
        console.get_by_label("Line to send").fill("ver hw")
        console.get_by_label("Send while").check()
        console.get_by_role("button", name="Send", exact=True).click()
        expect(console.get_by_role("log")).to_contain_text("ver hw")
        page.keyboard.press("Escape")

        page.set_viewport_size({"width": 390, "height": 844})
        page.keyboard.press("Shift+X")
        expect(panel).to_contain_text("ATTITUDE")
        box = panel.bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390
        assert serious_violations(page) == []
        picture(page, "inspector-390")
        panel.get_by_label("Messages received").focus()
        page.keyboard.press("Shift+D")
        page.set_viewport_size({"width": 1024, "height": 768})
        picture(page, "inspector-1024-other-theme")
        station.drone.land_now()
        station.drone.until_disarmed()
