"""The vehicle's console in the page: the lines of a gimbal set-up, and a line while the vehicle is armed."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import open_page, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold

pytestmark = [pytest.mark.browser, pytest.mark.story]


def test_lines_are_sent_and_recalled_and_while_armed_only_if_chosen(
    browser: Browser, station: Station
) -> None:
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.locator(".pill").wait_for()
        page.keyboard.press("s")
        panel = page.get_by_label("Console", exact=True)
        line, output = panel.get_by_label("Line to send"), panel.get_by_role("log")
        expect(line).to_be_focused()
        for text in ("gimbal start", "gimbal primary-control 1 1", "gimbal status"):
            line.fill(text)
            line.press("Enter")
            expect(line).to_have_value("")
        expect(output).to_contain_text("Primary control:   1/1")
        line.press("ArrowUp")
        line.press("ArrowUp")
        expect(line).to_have_value("gimbal primary-control 1 1")
        assert serious_violations(page) == []
        take_off_to_hold(station.drone)
        send = panel.get_by_role("button", name="Send", exact=True)
        expect(send).to_be_disabled()
        line.fill("ver hw")
        panel.get_by_label("Send while").check()
        send.click()
        expect(output).to_contain_text("ver hw")
        station.drone.land_now()
        station.drone.until_disarmed()
        expect(panel.get_by_label("Send while")).to_have_count(0)
