"""The page as operators use it: real Chromium, real server, a vehicle simulated at three times real time."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Request, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import (
    READ_CANVAS,
    bounding_box,
    confirm_by_slider,
    confirm_by_space_bar,
    first_number,
    open_page,
    scene_frame,
    shown_value,
    tab_to,
    violations_in_both_themes,
)
from tests.e2e.fast_station import FAST_OPTIONS, Station
from tests.station import (
    end_process,
    free_port,
    is_up,
    running_process,
    running_server,
    running_vehicles,
    server_command,
    wait_until,
)

pytestmark = pytest.mark.browser

FLIGHT_MS = 90_000
LONGER_THAN_ANY_KEY_HOLD_MS = 2_000


@pytest.fixture(scope="module")
def module_station() -> Iterator[Station]:
    """One server and one vehicle for all flights; each test leaves the vehicle on the ground."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        # The returned vehicle hovers above home until the page commands Land.
        running_vehicles(port, arguments=[*FAST_OPTIONS, "--param", "RTL_LAND_DELAY=-1"]),
        SyncGcs(url, client="e2e") as gcs,
    ):
        yield Station(url, gcs, gcs.vehicle("101"))


@pytest.fixture
def landed_station(module_station: Station) -> Iterator[Station]:
    """The station with its vehicle ready on the ground, before and after each test."""
    drone = module_station.gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
    yield module_station
    if drone.status()["armed"]:
        drone.land()
        drone.until_disarmed()


def pill(page: Page) -> Any:
    """The display of the vehicle's state, in the middle of the top bar."""
    return page.locator(".pill b")


@pytest.mark.story
def test_a_vehicle_is_flown_by_mouse(browser: Browser, landed_station: Station) -> None:
    drone = landed_station.drone
    with open_page(browser, landed_station.url, scene=False) as page:
        instrument, offboard_card = (
            page.get_by_label("Attitude and heading"),
            page.get_by_label("Offboard", exact=True),
        )
        expect(pill(page)).to_have_text("Ready")

        page.get_by_role("button", name="Take off", exact=True).click()
        altitude = page.get_by_label("Above home")
        altitude.fill("999")
        expect(page.get_by_role("alertdialog")).to_contain_text("from 1 to 120 m above home")
        confirm_by_slider(page)
        assert not drone.status()["armed"]
        altitude.fill("6")
        altitude.press("Tab")
        expect(page.get_by_role("alertdialog")).to_contain_text("Arms, climbs to 6.0 m above home")
        confirm_by_slider(page)
        expect(pill(page)).to_have_text(re.compile("Taking off|Holding"))
        wait_until(lambda: shown_value(instrument, "Above home") > 3, "the climb on the page")
        expect(pill(page)).to_have_text("Holding", timeout=FLIGHT_MS)
        wait_until(lambda: abs(shown_value(instrument, "Above home") - 6) < 1, "the requested altitude")

        start_button = offboard_card.get_by_role("button", name="Start")
        start_button.click()
        confirm_by_slider(page, start_button.click)
        expect(pill(page)).to_have_text("Offboard")
        target_up = offboard_card.locator(".cell", has_text="Up").locator("b")
        target_up_m = first_number(target_up.inner_text())
        offboard_card.get_by_role("button", name="1 m up").click()
        expect(target_up).to_contain_text(f"{target_up_m + 1:.1f}")
        wait_until(
            lambda: first_number(offboard_card.locator(".figures").inner_text()) > 30, "30 Hz on the page"
        )
        expect(offboard_card).to_contain_text(re.compile(r"Valid [0-9.]+\s?s left"))
        stream = drone.request("GET", "/offboard")
        assert stream["streaming"]
        assert -stream["setpoint"]["position_ned_m"][2] == pytest.approx(target_up_m + 1, abs=0.1)
        assert violations_in_both_themes(page) == []
        wait_until(lambda: shown_value(instrument, "Above home") > 6.6, "the climb to the moved target")

        offboard_card.get_by_role("button", name="Hold", exact=True).click()
        expect(pill(page)).to_have_text("Holding")
        expect(offboard_card).to_contain_text("no stream")
        assert not drone.request("GET", "/offboard")["streaming"]

        point_the_gimbal(page, drone)

        page.get_by_role("button", name="Return", exact=True).click()
        expect(page.get_by_role("alertdialog")).to_contain_text(
            re.compile(r"m above home \(lower near home\), flies \d")
        )
        confirm_by_slider(page)
        expect(pill(page)).to_have_text("Returning")
        assert drone.status()["mode"] == "rtl"

        land_button = page.get_by_role("button", name="Land", exact=True)
        land_button.click()
        confirm_by_slider(page, land_button.click)
        expect(pill(page)).to_have_text("Landing")
        drone.until_disarmed()
        expect(page.get_by_role("button", name="Arm", exact=True)).to_be_visible()


def point_the_gimbal(page: Page, drone: Any) -> None:
    """Takes control of the gimbal, points it by pad and buttons, and releases it; checks its angles by
    telemetry."""
    gimbal_card = page.get_by_label("Gimbal", exact=True)
    gimbal_card.get_by_role("button", name="Take").click()
    pad = gimbal_card.get_by_role("slider", name="Gimbal pad")
    box = bounding_box(pad)
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.55, box["y"] + box["height"] * 0.7, steps=5)
    page.mouse.up()

    def pitch_rad() -> float:
        return float(drone.topic("gimbal")["pitch_rad"])

    wait_until(lambda: -1.2 < pitch_rad() < -0.3, "the gimbal at the angles where the pad was released")
    gimbal_card.get_by_role("button", name="Down", exact=True).click()
    # PX4's servo outputs reach half of MNT_RANGE_PITCH to each side
    wait_until(lambda: pitch_rad() < -0.78, "the gimbal at its lowest angle")
    expect(gimbal_card).to_contain_text("−45.0°")
    tilt_button = bounding_box(gimbal_card.get_by_role("button", name="Tilt up"))
    page.mouse.move(tilt_button["x"] + 8, tilt_button["y"] + 8)
    page.mouse.down()
    wait_until(lambda: pitch_rad() > -0.7, "the gimbal turning while the arrow is held")

    def is_stop_request(request: Request) -> bool:
        body = request.post_data_json if request.url.endswith("/gimbal/rates") else None
        return body is not None and (body["pitch_rate_deg_s"], body["yaw_rate_deg_s"]) == (0, 0)

    with page.expect_request(is_stop_request):
        page.mouse.up()
    gimbal_card.get_by_role("button", name="Release").click()
    expect(gimbal_card.get_by_role("button", name="Take")).to_be_visible()


def test_a_vehicle_is_flown_by_keyboard_and_a_refusal_is_shown_beside_its_button(
    browser: Browser, landed_station: Station
) -> None:
    drone = landed_station.drone
    with open_page(browser, landed_station.url, scene=False) as page:
        expect(pill(page)).to_have_text("Ready")
        page.keyboard.press("t")
        confirm_by_space_bar(page)
        expect(pill(page)).to_have_text(re.compile("Taking off|Holding"))
        wait_until(lambda: drone.topic("global_position")["alt_home_m"] > 2, "the climb")
        page.keyboard.press("h")
        expect(pill(page)).to_have_text("Holding")
        assert drone.status()["mode"] == "hold"

        page.keyboard.press("Shift+K")
        confirmation = page.get_by_role("alertdialog")
        confirmation.get_by_role("button", name="Cancel").focus()
        page.keyboard.down("Space")
        page.wait_for_timeout(LONGER_THAN_ANY_KEY_HOLD_MS)
        page.keyboard.up("Space")
        expect(confirmation).to_be_hidden()
        assert drone.status()["armed"]

        page.keyboard.press("o")
        confirm_by_space_bar(page)
        expect(pill(page)).to_have_text("Offboard")
        up_m = -drone.request("GET", "/offboard")["setpoint"]["position_ned_m"][2]
        tab_to(page, "1 m up")
        page.keyboard.press("Enter")
        wait_until(
            lambda: -drone.request("GET", "/offboard")["setpoint"]["position_ned_m"][2] > up_m + 0.9,
            "the target moved by keys",
            5,
        )
        page.keyboard.press("h")
        expect(pill(page)).to_have_text("Holding")
        tab_to(page, "Take gimbal control")
        page.keyboard.press("Enter")
        expect(page.get_by_label("Gimbal", exact=True).get_by_role("button", name="Release")).to_be_visible()
        tab_to(page, "Tilt down")
        page.keyboard.down("Enter")
        wait_until(lambda: drone.topic("gimbal")["pitch_rad"] < -0.1, "the gimbal moved by a key")
        page.keyboard.up("Enter")
        tab_to(page, "Release gimbal control")
        page.keyboard.press("Enter")

        page.keyboard.press("Shift+A")
        confirm_by_space_bar(page)
        refusal = page.locator(".place").get_by_role("alert")
        expect(refusal).to_contain_text("Disarm: The vehicle refused")
        expect(refusal).to_contain_text("Disarming denied: not landed")
        assert drone.status()["armed"]
        assert violations_in_both_themes(page) == []
        page.keyboard.press("Escape")
        expect(refusal).to_be_hidden()

        page.keyboard.press("r")
        confirm_by_space_bar(page)
        expect(pill(page)).to_have_text("Returning")
        page.keyboard.press("l")
        confirm_by_space_bar(page)
        expect(pill(page)).to_have_text("Landing")
        drone.until_disarmed()


@pytest.mark.story
def test_the_3d_view_shows_the_vehicle_and_loads_nothing_from_other_sites(
    browser: Browser, landed_station: Station
) -> None:
    with open_page(browser, landed_station.url) as page:
        expect(pill(page)).to_have_text("Ready")
        frame = scene_frame(page)
        frame.locator("canvas[data-engine]").wait_for()

        def is_drawn() -> bool:
            found = frame.evaluate(READ_CANVAS)
            # A cleared canvas is transparent and of one colour; the shaded vehicle has hundreds of colours.
            return found["colours"] > 200 and found["drawn"] > 0.01

        wait_until(is_drawn, "a drawn vehicle in the 3D view")
        expect(frame.locator(".gcs-tags")).to_contain_text("simulated")
        page.get_by_role("radio", name="Top", exact=True).click()
        page.keyboard.press("m")
        wait_until(is_drawn, "a drawn vehicle in the small 3D view")


@pytest.mark.story
def test_the_page_has_no_serious_accessibility_violations(browser: Browser, landed_station: Station) -> None:
    with open_page(browser, landed_station.url, scene=False) as page:
        expect(pill(page)).to_have_text("Ready")
        page.keyboard.press("t")
        page.get_by_role("alertdialog").wait_for()
        assert violations_in_both_themes(page) == []
        page.keyboard.press("Escape")
        page.keyboard.press("?")
        page.get_by_role("button", name="Battery").click()
        assert violations_in_both_themes(page) == []
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")
        page.keyboard.press("n")
        page.keyboard.press("v")
        assert violations_in_both_themes(page) == []


@pytest.mark.story
def test_the_displayed_values_are_selected_by_mouse_and_keyboard_and_stored(
    browser: Browser, landed_station: Station
) -> None:
    with open_page(browser, landed_station.url, scene=False) as page:
        values = page.get_by_label("Values", exact=True)
        labels = values.locator(".grid .name")
        default_labels = [
            "Vertical speed",
            "From home",
            "Flight time",
            "Heading",
            "Local north",
            "Local east",
        ]
        expect(labels).to_have_text(default_labels)
        values.get_by_role("button", name="Choose the values").click()
        page.get_by_label("Find a value to add").fill("motor 1")
        values.get_by_role("button", name="Add Motor 1").click()
        page.get_by_label("Find a value to add").fill("")
        values.get_by_role("button", name="Remove Heading").click()
        speed_handle = values.get_by_role("button", name="Vertical speed: drag")
        speed_handle.focus()
        page.keyboard.press("ArrowDown")
        expect(speed_handle).to_be_focused()
        motor_handle = bounding_box(values.get_by_role("button", name="Motor 1: drag"))
        distance_handle = bounding_box(values.get_by_role("button", name="From home: drag"))
        page.mouse.move(motor_handle["x"] + 9, motor_handle["y"] + 9)
        page.mouse.down()
        page.mouse.move(distance_handle["x"] + 9, distance_handle["y"] + 9, steps=12)
        page.mouse.up()
        values.get_by_role("button", name="Done").click()
        selected_labels = [
            "Motor 1",
            "From home",
            "Vertical speed",
            "Flight time",
            "Local north",
            "Local east",
        ]
        expect(labels).to_have_text(selected_labels)
        # The page was not subscribed to this topic before.
        wait_until(lambda: shown_value(values, "Motor 1") >= 900, "the first motor's value")

        page.reload()
        expect(labels).to_have_text(selected_labels)
        page.keyboard.press("v")
        values.get_by_role("button", name="Reset").click()
        page.keyboard.press("Escape")
        expect(labels).to_have_text(default_labels)


@pytest.mark.realtime
def test_the_page_shows_the_end_of_a_killed_server_and_reconnects_to_the_next(
    browser: Browser, tmp_path: Path
) -> None:
    port, http_port = free_port(), free_port()
    url = f"http://127.0.0.1:{http_port}"
    command = server_command(http_port, [f"udpin://127.0.0.1:{port}"], tmp_path)
    context = browser.new_context()
    page = context.new_page()
    with running_vehicles(port, arguments=FAST_OPTIONS):
        with running_process(command) as first_server:
            wait_until(lambda: is_up(url), "the first server")
            page.goto(url)
            vehicle_button = page.get_by_role("button", name="Quad 101")
            vehicle_button.wait_for()
            page.get_by_role("radio", name="Top", exact=True).click()
            end_process(first_server, signal.SIGKILL)
            notice = page.get_by_role("alert").filter(has_text="No connection to the server")
            notice.wait_for()
            expect(notice).to_contain_text("The values shown are old")
            expect(vehicle_button).to_contain_text("no connection to the server")
            status = page.locator(".pill").filter(has_text="No connection to the server")
            for width in (1000, 1150, 1280, 1440, 1600):
                page.set_viewport_size({"width": width, "height": 800})
                end = bounding_box(status)
                gps = bounding_box(page.get_by_role("button", name=re.compile("GPS")))
                assert end["x"] + end["width"] <= gps["x"], f"the status covers GPS at {width} px"
            page.set_viewport_size({"width": 1280, "height": 720})
        with (
            page.expect_request(
                lambda r: "/scene/view/" in r.url and r.method == "POST", timeout=60_000
            ) as request,
            running_process(command),
        ):
            wait_until(lambda: is_up(url), "the second server")
            notice.wait_for(state="hidden")
            expect(page.get_by_text("Connected again")).to_be_visible()
            expect(vehicle_button).not_to_contain_text("no connection to the server")
            assert request.value.post_data_json["mode"] == "top"
    context.close()
