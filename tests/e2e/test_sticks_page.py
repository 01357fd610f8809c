"""Flying by stick in a browser: the gamepad's page in the settings, a flight, an unplugged gamepad."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import open_page, violations_in_both_themes
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.station import wait_until

pytestmark = pytest.mark.browser

FAKE_GAMEPAD = """
window.testPad = { axes: [0, 0, 0, 0], pressed: [], connected: true };
navigator.getGamepads = () => [window.testPad.connected
  ? { index: 0, id: 'Test pad', connected: true, mapping: 'standard', timestamp: performance.now(),
      axes: window.testPad.axes, buttons: Array.from({ length: 6 }, (_, i) => {
        const pressed = window.testPad.pressed.includes(i);
        return { pressed, touched: pressed, value: pressed ? 1 : 0 };
      }) }
  : null];
"""


def speed_m_s(drone: Any) -> float:
    north, east, _ = drone.topic("local_position")["velocity_ned_m_s"]
    return math.hypot(north, east)


def map_the_gamepad(page: Page) -> None:
    """Chooses axes and a button in the settings, and sees them live."""
    page.keyboard.press("Shift+U")
    page.get_by_role("radio", name="Gamepad").click()
    expect(page.get_by_role("combobox", name="Gamepad", exact=True)).to_contain_text("Test pad")
    throttle = page.get_by_role("group", name="Throttle, up")
    expect(throttle.get_by_role("combobox")).to_have_value("1")
    page.get_by_role("radio", name="Mode 1").click()
    expect(throttle.get_by_role("combobox")).to_have_value("3")
    page.get_by_role("radio", name="Mode 2").click()
    page.evaluate("testPad.axes = [0, -1, 0, 0]")
    expect(throttle.get_by_role("img", name="+100 %")).to_be_visible()
    page.evaluate("testPad.axes = [0, 0, 0, 0]")
    page.get_by_label("Dead zone").fill("70")
    expect(page.get_by_label("Dead zone")).to_have_attribute("aria-invalid", "true")
    page.get_by_label("Dead zone").fill("10")
    page.get_by_label("Button 2").select_option("stop")
    assert violations_in_both_themes(page) == []
    page.keyboard.press("Shift+U")


@pytest.mark.realtime
def test_a_gamepad_flies_in_position_and_unplugged_the_vehicle_holds(
    browser: Browser, station: Station
) -> None:
    drone = station.drone
    for name, value in (
        ("COM_RC_LOSS_T", 5),
        ("COM_RCL_EXCEPT", 2),
    ):  # the page may be slow on a busy machine
        drone.set_param(name, value)
    take_off_to_hold(drone)
    with open_page(browser, station.url, scene=False, script=FAKE_GAMEPAD) as page:
        map_the_gamepad(page)
        stored = station.gcs.request("GET", "/settings")["settings"]["gamepad"]
        assert (stored["dead_zone"], stored["buttons"][-1]) == (0.1, {"button": 2, "action": "stop"})
        card = page.get_by_role("region", name="Sticks")
        expect(card).to_contain_text("In Hold it stays there")
        assert (
            violations_in_both_themes(page) == []
        )  # not in flight: it stops the page for longer than sticks are valid
        card.get_by_role("button", name=re.compile("^Fly .* by stick")).click()
        expect(card).to_contain_text("The sticks fly the vehicle")
        page.evaluate("testPad.axes = [0, 0, 0, -1]")  # PX4 leaves Hold when a stick is moved
        wait_until(lambda: drone.status()["mode"] == "position", "Position mode by the stick")
        wait_until(lambda: speed_m_s(drone) > 0.7, "the vehicle to move by the stick")
        assert drone.request("GET", "/manual_control")["phase"] == "flying"
        page.evaluate("testPad.connected = false")
        expect(card.get_by_role("alert")).to_contain_text("The gamepad was disconnected.")
        wait_until(lambda: drone.status()["mode"] == "hold", "Hold without the gamepad")
        page.evaluate("testPad.connected = true")
        page.evaluate("testPad.axes = [0, 0, 0, 0]")
        card.get_by_role("button", name="Fly on").click()
        expect(card).to_contain_text("The sticks fly the vehicle")
        page.evaluate("testPad.pressed = [2]")
        expect(card).to_contain_text("Off")
        wait_until(lambda: drone.request("GET", "/manual_control")["by"] is None, "the end of the stream")
        assert drone.status()["mode"] == "hold"
