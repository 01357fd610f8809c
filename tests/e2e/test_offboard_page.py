"""The offboard view as operators use it: by form, by gamepad, by handles in 3D."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import (
    bounding_box,
    confirm_by_slider,
    confirm_by_space_bar,
    first_number,
    open_page,
    scene_frame,
    tab_to,
    violations_in_both_themes,
)
from tests.e2e.fast_station import FAST_OPTIONS, Station
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = pytest.mark.browser

FAKE_GAMEPAD = """
window.testPad = { axes: [0, 0, 0, 0], pressed: false, connected: true };
const buttons = () => Array.from({ length: 17 }, (_, i) => {
  const pressed = i === 5 && window.testPad.pressed;
  return { pressed, touched: pressed, value: pressed ? 1 : 0 };
});
navigator.getGamepads = () => window.testPad.connected
  ? [{ index: 0, id: 'Test pad', connected: true, mapping: 'standard', timestamp: performance.now(),
       axes: window.testPad.axes, buttons: buttons() }]
  : [null];
"""
HANDLE_IN_VIEW = """
(axis) => {
  const { camera, nodeRefFromName } = window.__viserMutable;
  const node = nodeRefFromName['/world/gizmo_ground'];
  if (!camera || !node) return null;
  const apply = (m, [x, y, z, w]) =>
    [0, 1, 2, 3].map((r) => m[r] * x + m[r + 4] * y + m[r + 8] * z + m[r + 12] * w);
  const pixel = (at) => {
    const inCamera = apply(camera.matrixWorldInverse.elements, at);
    const [x, y, , w] = apply(camera.projectionMatrix.elements, inCamera);
    return [((x / w + 1) / 2) * innerWidth, ((1 - y / w) / 2) * innerHeight];
  };
  const m = node.matrixWorld.elements;
  const at = [...m.slice(12, 15), 1];
  const end = at.map((c, i) => (i < 3 ? c + 0.01 * m[axis * 4 + i] : 1));
  const [x, y] = pixel(at), [ex, ey] = pixel(end);
  const length = Math.hypot(ex - x, ey - y);
  return [x, y, (ex - x) / length, (ey - y) / length];
}
"""
"""Position of the handles in the 3D view [px], and the direction of one of their axes."""


HANDLES_AND_CAMERA = """
() => {
  const { camera, nodeRefFromName } = window.__viserMutable;
  const handles = nodeRefFromName['/world/gizmo_ground'];
  return [handles, camera].map((node) => [...node.matrixWorld.elements.slice(12, 15)]);
}
"""
"""Positions of the handles and of the camera."""
ARROW_LENGTH_PX = 90
"""Length of the handles' arrows in the window."""
PANEL_EDGES = """
() => [...document.querySelectorAll('main .panel, main .cameras, .dock')]
  .map((panel) => panel.getBoundingClientRect()).map((box) => [box.left, box.top, box.right, box.bottom])
"""


@pytest.fixture(scope="module")
def hovering_station() -> Iterator[Station]:
    """One station with a hovering vehicle; each test leaves the vehicle in Hold."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        drone.takeoff(10)
        yield Station(url, gcs, drone)


@pytest.fixture(autouse=True)
def hold_after_each_test(hovering_station: Station) -> Iterator[None]:
    """Puts the vehicle into Hold after each test."""
    yield
    hovering_station.drone.hold()


def pill(page: Page) -> Locator:
    return page.locator(".pill b")


def open_offboard_view(page: Page) -> Locator:
    """Opens the offboard view by its key when the page shows the vehicle."""
    expect(pill(page)).to_have_text(re.compile("Holding|Offboard"))
    page.keyboard.press("p")
    view = page.get_by_role("region", name="Offboard view")
    expect(view.get_by_text("If the stream stops")).to_be_visible()
    return view


def handles_are_beside_all_panels(page: Page, frame: Any) -> bool:
    """Whether the handles are fully visible in the 3D view and beside all panels."""
    box = page.get_by_title("3D view", exact=True).bounding_box()
    handle = frame.evaluate(HANDLE_IN_VIEW, 0)
    if box is None or handle is None:
        return False
    x, y = box["x"] + handle[0], box["y"] + handle[1]
    if not (box["x"] < x - ARROW_LENGTH_PX and x + ARROW_LENGTH_PX < box["x"] + box["width"]):
        return False
    return all(
        x + ARROW_LENGTH_PX < left
        or x - ARROW_LENGTH_PX > right
        or y + ARROW_LENGTH_PX < top
        or y - ARROW_LENGTH_PX > bottom
        for left, top, right, bottom in page.evaluate(PANEL_EDGES)
        if right > left
    )


def offboard_status(drone: Any) -> dict[str, Any]:
    return drone.request("GET", "/offboard")


def speed_m_s(drone: Any) -> float:
    north, east, _ = drone.topic("local_position")["velocity_ned_m_s"]
    return math.hypot(north, east)


@pytest.mark.story
def test_setpoints_of_two_types_are_flown_by_form(browser: Browser, hovering_station: Station) -> None:
    """Also checks the preview, the values after limits, and the reason why a type is unavailable."""
    drone = hovering_station.drone
    with open_page(browser, hovering_station.url, scene=False) as page:
        view = open_offboard_view(page)
        north = view.get_by_label("Position, North")
        north.fill("far")
        view.get_by_role("button", name="Start…").click()
        expect(view).to_contain_text("North: enter a number.")
        assert not offboard_status(drone)["streaming"]
        north.fill("5")
        view.get_by_label("Position, Up").fill("12")
        expect(view).to_contain_text(re.compile(r"Not sent: \d.* away, \d"))
        view.get_by_role("button", name="Start…").click()
        expect(page.get_by_role("alertdialog")).to_contain_text("starts a setpoint stream: Position N 5.0")
        confirm_by_slider(page, view.get_by_role("button", name="Start…").click)
        expect(pill(page)).to_have_text("Offboard")
        assert offboard_status(drone)["setpoint"]["position_ned_m"][0] == 5
        health = page.get_by_label("Stream health")
        wait_until(lambda: first_number(health.inner_text().partition("Rate")[2]) > 30, "30 Hz in the view")
        expect(health).to_contain_text("Position error")
        wait_until(lambda: drone.topic("local_position")["position_ned_m"][0] > 4, "the position reached")
        expect(page.get_by_label(re.compile("^North: target 5.0 m, actual"))).to_be_visible()

        view.get_by_text("Limits", exact=True).click()
        view.get_by_label("Maximum ground speed").fill("1")
        view.get_by_role("button", name="Set limits").click()
        expect(view.get_by_text("ground speed 1 m/s")).to_be_visible()
        view.get_by_role("combobox", name="Setpoint type").click()
        expect(page.get_by_role("option", name=re.compile("^Thrust and torque"))).to_contain_text("MAVLink")
        assert violations_in_both_themes(page) == []
        page.get_by_role("option", name=re.compile("^Velocity local")).click()
        view.get_by_label("Velocity, East").fill("4")
        view.get_by_role("button", name="Send").click()
        newest_entry = page.get_by_label("Sent setpoints", exact=True).get_by_role("listitem").first
        expect(newest_entry).to_contain_text(re.compile("Velocity.*4.0.*accepted after .* ms:"))
        wait_until(lambda: 0.6 < speed_m_s(drone) < 1.3, "the limited speed")
        tab_to(page, "Hold")
        page.keyboard.press("Enter")
        expect(pill(page)).to_have_text("Holding")
        drone.request("PUT", "/offboard/limits", {})


@pytest.mark.realtime
def test_a_gamepad_flies_only_while_its_button_is_pressed(
    browser: Browser, hovering_station: Station
) -> None:
    drone = hovering_station.drone
    with open_page(browser, hovering_station.url, scene=False, script=FAKE_GAMEPAD) as page:
        view = open_offboard_view(page)
        view.get_by_role("radio", name="Gamepad").click()
        expect(view.get_by_label("Gamepad", exact=True)).to_contain_text("Test pad")
        view.get_by_role("button", name="Start stream").click()
        confirm_by_space_bar(page)
        expect(pill(page)).to_have_text("Offboard")
        view.get_by_role("button", name="Start stick control").click()
        expect(view).to_contain_text("zero velocity is sent")

        page.evaluate("testPad.axes = [0, 0, 0, -1]")
        expect(view.get_by_label("Right stick: horizontal motion").locator(".lever")).to_have_attribute(
            "y2", "-38"
        )
        assert offboard_status(drone)["setpoint"]["velocity_frd_m_s"] == [0, 0, 0]
        page.evaluate("testPad.pressed = true")
        expect(view).to_contain_text("Sticks control the vehicle")
        wait_until(lambda: speed_m_s(drone) > 0.7, "the vehicle to move by the stick")
        assert violations_in_both_themes(page) == []
        page.evaluate("testPad.pressed = false")
        expect(view).to_contain_text("zero velocity is sent")
        wait_until(
            lambda: offboard_status(drone)["setpoint"].get("velocity_frd_m_s") == [0, 0, 0],
            "a setpoint of zero velocity",
            5,
        )
        wait_until(lambda: speed_m_s(drone) < 0.2, "the vehicle stopped")
        expect(page.get_by_label("Sent setpoints", exact=True)).to_contain_text("Gamepad · accepted")

        page.evaluate("testPad.pressed = true")
        expect(view).to_contain_text("Sticks control the vehicle")
        page.evaluate("testPad.connected = false")
        expect(view.get_by_role("alert")).to_contain_text("The gamepad was disconnected.")
        # Without renewal the vehicle holds its position, then switches to Hold.
        expect(pill(page)).to_have_text("Holding")
        wait_until(lambda: speed_m_s(drone) < 0.2, "the vehicle stopped")


@pytest.mark.story  # software renders the 3D view in which the test drags
def test_a_position_is_set_by_handles_in_3d(browser: Browser, hovering_station: Station) -> None:
    """The position is a preview until Send is pressed; keys move it in steps."""
    drone = hovering_station.drone
    with open_page(browser, hovering_station.url, size=(1280, 720)) as page:
        view = open_offboard_view(page)
        view.get_by_role("radio", name="Drag in 3D").click()
        frame = scene_frame(page)
        wait_until(lambda: frame.evaluate(HANDLE_IN_VIEW, 0) is not None, "the handles", 40)
        wait_until(lambda: math.dist(*frame.evaluate(HANDLES_AND_CAMERA)) > 4.4, "the camera 4.4 m away")
        handles_before_step, _ = frame.evaluate(HANDLES_AND_CAMERA)
        view.get_by_role("button", name="1 m north").click()
        wait_until(
            lambda: math.dist(frame.evaluate(HANDLES_AND_CAMERA)[0], handles_before_step) > 0.9,
            "the handles one step further",
        )
        wait_until(lambda: handles_are_beside_all_panels(page, frame), "the handles beside all panels")
        vehicle_before = drone.topic("local_position")["position_ned_m"]
        box = bounding_box(page.get_by_title("3D view", exact=True))

        def displayed_position() -> list[float]:
            return [first_number(text) for text in view.locator(".cell b").all_inner_texts()]

        displayed_before = displayed_position()
        # The axis across the view: along the line of sight one pixel is too long a distance.
        x, y, dx, dy = frame.evaluate(HANDLE_IN_VIEW, 1)
        handle = (box["x"] + x + 70 * dx, box["y"] + y + 70 * dy)
        page.mouse.move(*handle)
        page.mouse.down()
        page.mouse.move(handle[0] + 40 * dx, handle[1] + 40 * dy, steps=6)
        page.mouse.up()
        wait_until(
            lambda: math.dist(displayed_position()[:2], displayed_before[:2]) > 0.3, "the dragged position"
        )
        assert displayed_position()[2] == displayed_before[2]
        assert math.dist(drone.topic("local_position")["position_ned_m"], vehicle_before) < 1
        dragged_position = displayed_position()
        view.get_by_role("button", name="Start…").click()
        confirm_by_space_bar(page)
        expect(pill(page)).to_have_text("Offboard")
        setpoint = offboard_status(drone)["setpoint"]["position_ned_m"]
        assert setpoint[:2] == pytest.approx(dragged_position[:2], abs=0.1)
        page.keyboard.press("p")
        expect(view).to_be_hidden()
