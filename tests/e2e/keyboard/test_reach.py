"""Tab reaches each control of each view; screen readers do not announce changing numbers."""

from __future__ import annotations

import os
import re
import signal

import pytest
from playwright.sync_api import Browser, expect

from gcs_server.client.errors import Refused
from tests.e2e.browser import open_page, violations
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.tab_order import check_tab_order, close_all, views_and_panels
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

LISTEN_MS = 2_500
RECORD_ANNOUNCEMENTS = """
(wait_ms) => new Promise((done) => {
  const announced = [];
  const liveRegions = ['status', 'alert', 'log', 'timer'].map((role) => `[role="${role}"]`)
    .concat('[aria-live="polite"]', '[aria-live="assertive"]').join();
  const watcher = new MutationObserver((changes) => {
    for (const change of changes) {
      const node = change.target.nodeType === 3 ? change.target.parentElement : change.target;
      const region = node?.closest(liveRegions);
      if (!region || node.closest('[aria-live="off"]') || node.closest('[aria-hidden="true"]')) continue;
      if (region.getAttribute('aria-relevant') === 'additions' && change.type === 'characterData') continue;
      announced.push(region.outerHTML.slice(0, 160));
    }
  });
  watcher.observe(document.body, { subtree: true, childList: true, characterData: true });
  setTimeout(() => { watcher.disconnect(); done([...new Set(announced)]); }, wait_ms);
})
"""


def test_every_control_of_every_view_is_reached_by_tab_and_has_a_name(
    browser: Browser, flying_station: Station
) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        for name, open_view in views_and_panels(page):
            open_view()
            page.wait_for_timeout(50)
            try:
                check_tab_order(page, "Shift+Tab" if name == "fly" else "Tab")
            except AssertionError as error:
                raise AssertionError(f"in {name}: {error}") from error
            if not name.startswith("view"):
                close_all(page)


@pytest.mark.parametrize("size", [(1280, 800), (1024, 768), (390, 844)])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_on_any_screen(
    browser: Browser, flying_station: Station, size: tuple[int, int], theme: str
) -> None:
    found: dict[str, list[str]] = {}
    with open_page(browser, flying_station.url, scene=False, size=size, theme=theme) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        for name, open_view in views_and_panels(page):
            open_view()
            page.wait_for_timeout(200)
            if texts := violations(page):
                found[name] = texts
            if not name.startswith("view"):
                close_all(page)
    assert found == {}


def test_screen_readers_do_not_announce_changing_numbers(
    browser: Browser, flying_station: Station, vehicles_pid: int
) -> None:
    drone = flying_station.drone
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        start_request: dict[str, object] = {
            "setpoint": {"type": "position", "position_ned_m": [0, 0, -6]},
            "valid_for_s": 60,
        }

        def is_started() -> bool:
            try:
                drone.request("POST", "/offboard/start", start_request)
            except Refused:  # on a busy machine the position may be too old for a moment
                return False
            return True

        wait_until(is_started, "the start of the stream", 60)
        expect(page.locator(".pill b")).to_have_text("Offboard")
        for open_view in (lambda: None, lambda: page.keyboard.press("p"), lambda: page.keyboard.press("y")):
            open_view()
            page.wait_for_timeout(500)
            assert page.evaluate(RECORD_ANNOUNCEMENTS, LISTEN_MS) == []
        drone.hold()
        os.killpg(vehicles_pid, signal.SIGSTOP)
        try:
            expect(page.locator(".pill b")).to_have_text("Connection lost")
            expect(page.get_by_role("button", name=re.compile("^Quad 101"))).to_contain_text(
                "connection lost"
            )
            page.wait_for_timeout(500)
            assert page.evaluate(RECORD_ANNOUNCEMENTS, LISTEN_MS) == []
        finally:
            os.killpg(vehicles_pid, signal.SIGCONT)
        expect(page.locator(".pill b")).not_to_have_text("Connection lost")
