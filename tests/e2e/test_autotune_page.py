"""Autotune by clicks: what prevents it, gains that are only logged, its confirmation, progress and end."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import confirm_by_slider, open_page, serious_violations
from tests.e2e.fast_station import take_off_to_hold
from tests.e2e.keyboard.tab_order import check_tab_order
from tests.station import free_port, running_server, running_vehicles
from tests.support.autotune_relay import autotune_relay

pytestmark = [pytest.mark.browser, pytest.mark.story]

PICTURES = os.environ.get("GCS_PICTURES")
"""Where screens are saved; unset: nowhere."""


def picture(page: Page, name: str) -> None:
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / f"autotune-{name}.png")


def test_a_vehicle_tunes_itself_once_and_is_ended_by_one_press(browser: Browser) -> None:
    port = free_port()
    with (
        autotune_relay(port, 101) as autotune,
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(autotune.port, arguments=["--no-log", "--param", "MC_AT_EN=1"]),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        with open_page(browser, url, size=(1280, 800), scene=False) as page:
            page.locator(".pill").wait_for()
            page.keyboard.press("Shift+V")
            room = page.get_by_role("region", name="Vehicle set-up")
            room.get_by_role("radio", name="Autotune").click()
            start = room.get_by_role("button", name="Start autotune…")
            expect(room).to_contain_text("is not flying. Take off first.")
            expect(start).to_be_disabled()
            expect(room).to_contain_text("writes the gains itself once it is disarmed")
            room.get_by_role("button", name="Only log them: set MC_AT_APPLY to 0…").click()
            room.get_by_role("button", name="Write 1 parameter").click()
            expect(room).to_contain_text("The gains are only in the log")
            expect(room.get_by_role("button", name="Take back…")).to_be_visible()
            assert drone.param("MC_AT_APPLY") == 0
            take_off_to_hold(drone, 10)
            expect(start).to_be_enabled()
            picture(page, "ready")
            check_tab_order(page, "Tab")
            start.click()
            dialog = page.get_by_role("alertdialog")
            expect(dialog).to_contain_text("Shakes itself about roll, pitch and yaw for 40 to 70 s, in Hold.")
            picture(page, "confirm")
            confirm_by_slider(page, start.click)
            status = room.get_by_role("region", name="Autotune").get_by_role("status")
            expect(status).to_contain_text("moves about its roll axis. 20 %")
            expect(room).to_contain_text("Hold alone does not end it")
            assert serious_violations(page) == []
            picture(page, "runs")
            room.get_by_role("button", name="End autotune").click()
            expect(room.get_by_role("alert")).to_contain_text("Interrupted by “End autotune”", timeout=15_000)
            expect(start).to_be_enabled()
            assert (autotune.starts, (drone.topic("status") or {})["mode"]) == (1, "hold")
            picture(page, "ended")
            start.click()
            confirm_by_slider(page, start.click)
            expect(status).to_contain_text("moves about its yaw axis", timeout=20_000)
            page.reload()
            page.locator(".pill").wait_for()
            if not room.is_visible():
                page.keyboard.press("Shift+V")
            room.get_by_role("radio", name="Autotune").click()
            expect(status).to_contain_text("prove them under Tuning", timeout=20_000)
            assert autotune.starts == 2
            assert serious_violations(page) == []
            page.set_viewport_size({"width": 390, "height": 844})
            start.scroll_into_view_if_needed()
            assert room.evaluate("(element) => element.scrollWidth - element.clientWidth") == 0
            picture(page, "phone")
        if PICTURES:
            with open_page(browser, url, size=(1280, 800), scene=False, theme="light") as page:
                page.locator(".pill").wait_for()
                page.keyboard.press("Shift+V")
                page.get_by_role("radio", name="Autotune").click()
                expect(page.get_by_role("button", name="Start autotune…")).to_be_enabled()
                picture(page, "light")
