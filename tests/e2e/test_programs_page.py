"""A program on a guarded link by clicks: seen flying, overruled by Hold, and let continue by a person."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import confirm_by_slider, open_page, violations_in_both_themes
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.station import free_port, running_process, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]
ROOT = Path(__file__).resolve().parents[2]


def test_a_program_is_seen_overruled_and_let_continue(browser: Browser, station: Station) -> None:
    drone, port = station.drone, free_port()
    url = f"udpin://127.0.0.1:{port}?guard=free&client=survey"
    station.gcs.request("POST", "/links", {"url": url, "name": "guard"})
    take_off_to_hold(drone)
    drone.control.release()
    command = [sys.executable, "-m", "tests.support.streaming_program", str(port), "101"]
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        card = page.get_by_role("region", name="survey")
        expect(card).to_contain_text("No program")
        with running_process(command, cwd=ROOT):
            expect(card).to_contain_text("Flies", timeout=20_000)
            expect(card).to_contain_text("Setpoint: velocity at")
            page.get_by_role("button", name="Hold", exact=True).first.click()
            expect(card).to_contain_text("Overruled", timeout=20_000)
            assert violations_in_both_themes(page) == []
            wait_until(lambda: drone.status()["mode"] == "hold", "Hold")
            page.wait_for_timeout(6_000)  # the program asks again
            assert drone.status()["mode"] == "hold"
            card.get_by_text("Refused:").click()
            expect(card).to_contain_text("wait until a person lets it continue")
            let_continue = card.get_by_role("button", name="Let it continue")
            let_continue.click()
            confirm_by_slider(page, let_continue.click)
            expect(card).to_contain_text("Flies", timeout=20_000)
            drone.hold()
