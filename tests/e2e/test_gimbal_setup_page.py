"""A gimbal set up by clicks, from factory settings to a turning axis, and a user's own program that turns
it."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from gcs_server.client import SyncGcs
from tests.clients.seed_program import gimbal_program, has_reached
from tests.e2e.browser import open_page, serious_violations
from tests.e2e.fast_station import FAST_OPTIONS, Station, take_off_to_hold
from tests.station import free_port, running_server, running_vehicles

pytestmark = [pytest.mark.browser, pytest.mark.story]

FACTORY_SETTINGS = ["--param", "MNT_MODE_IN=-1"]
"""The simulated vehicle boots with the gimbal on, as PX4 was recorded; this is PX4's own default."""


@pytest.fixture
def tcp_port() -> int:
    return free_port(socket.SOCK_STREAM)


@pytest.fixture
def station(tcp_port: int) -> Iterator[Station]:
    """A server and a vehicle with factory settings, in real time, with a port for a user's program."""
    port = free_port()
    arguments = ["--no-log", *FACTORY_SETTINGS]
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=arguments, tcp_port=tcp_port),
        SyncGcs(url, client="e2e") as gcs,
    ):
        yield Station(url, gcs, gcs.wait_for_vehicle("101", ready=True, timeout_s=120))


def set_up_by_clicks(page: Page) -> None:
    """From factory settings to a gimbal that moves, as a person does it."""
    page.locator(".pill").wait_for()
    page.get_by_role("navigation").get_by_role("button", name="Vehicle", exact=True).click()
    room = page.get_by_label("Vehicle set-up", exact=True)
    state = room.get_by_label("State", exact=True)
    expect(state).to_contain_text("Input: none")
    expect(state).to_contain_text("DISABLED → MAVlink gimbal protocol v2")
    state.get_by_role("button", name="Set MNT_MODE_IN to 4 and start the gimbal").click()
    expect(state).to_contain_text("Running. Input: MAVLink.")
    state.get_by_role("button", name="Set COM_PREARM_MODE to 2").click()
    expect(state.get_by_text("The servos move only while")).to_have_count(0)

    roll = room.get_by_label("Output of roll")
    expect(roll.locator("option[value=PWM_MAIN_FUNC1]")).to_be_disabled()
    roll.select_option("PWM_MAIN_FUNC7")
    room.get_by_label("Output of pitch").select_option("PWM_MAIN_FUNC8")
    room.get_by_label("Reverse pitch").check()
    room.get_by_label("Range of roll").fill("9000")
    room.get_by_role("button", name="Review 4 changes").click()
    review = room.get_by_label("Review", exact=True)
    expect(review).to_contain_text("MNT_RANGE_ROLL must be from 1 to 720 deg, not 9000")
    expect(review).to_contain_text("Gimbal Roll (420)")
    review.get_by_role("button", name="Discard").click()
    room.get_by_label("Range of roll").fill("90")
    room.get_by_role("button", name="Review 3 changes").click()
    review.get_by_role("button", name="Write 3 parameters").click()
    expect(room).to_contain_text("3 of 3 written.")
    expect(state).not_to_contain_text("No output drives")


def test_from_factory_settings_to_a_turning_gimbal_by_clicks_and_by_a_users_program(
    browser: Browser, station: Station, tcp_port: int, reference_data: Path, tmp_path: Path
) -> None:
    drone = station.drone
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        set_up_by_clicks(page)
        room = page.get_by_label("Vehicle set-up", exact=True)
        control = room.get_by_label("Control of the gimbal")
        expect(control).to_contain_text("Primary control: not controlled")
        expect(control.get_by_label("Roll", exact=True)).to_be_disabled()
        control.get_by_role("button", name="Take control").click()
        expect(control).to_contain_text("controlled by this server")
        control.get_by_label("Roll", exact=True).fill("30")
        expect(control).to_contain_text("MAIN 7: 1833 µs")
        control.get_by_label("Pitch", exact=True).fill("-20")
        expect(control).to_contain_text("MAIN 8: 1722 µs")
        expect(control).to_contain_text("MAIN 7: 1500 µs")
        control.get_by_role("button", name="Retract").click()
        expect(control).to_contain_text("MAIN 8: 1500 µs")
        assert serious_violations(page) == []
        control.get_by_role("button", name="Release").click()
        expect(control).to_contain_text("Primary control: not controlled")
        assert not drone.status()["armed"]

        program = gimbal_program(reference_data, tmp_path, tcp_port)
        if program is not None:
            result = subprocess.run(
                [sys.executable, "-W", "ignore", str(program)],
                capture_output=True,
                text=True,
                timeout=120,
                check=False,
            )
            assert result.returncode == 0, result.stdout + result.stderr
            samples = drone.request("GET", "/history?topics=gimbal&since_unix_s=0")["samples"]
            states = [sample["value"] for sample in samples]
            assert has_reached(states, roll_deg=45, pitch_deg=0)
            assert has_reached(states, roll_deg=0, pitch_deg=45)
            drone.until_disarmed(timeout_s=10)

        room.get_by_role("button", name="Undo the newest change…").click()
        review = room.get_by_label("Review", exact=True)
        expect(review).to_contain_text("Gimbal Roll (420)")
        review.get_by_role("button", name="Write 3 parameters").click()
        expect(room.get_by_label("State", exact=True)).to_contain_text("No output drives an axis")
        assert drone.param("PWM_MAIN_FUNC7") == 0


def test_the_set_up_is_refused_while_armed_and_follows_the_lines_of_the_console(
    browser: Browser,
) -> None:
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=[*FAST_OPTIONS, *FACTORY_SETTINGS]),
        SyncGcs(url, client="e2e") as gcs,
        open_page(browser, url, size=(390, 844), scene=False) as page,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        page.locator(".pill").wait_for()
        page.keyboard.press("Shift+V")
        state = page.get_by_label("Vehicle set-up", exact=True).get_by_label("State", exact=True)
        expect(state).to_contain_text("reports no gimbal")
        for line in ("gimbal start", "gimbal primary-control 1 1"):  # as in the document
            drone.shell(line)
        expect(state).to_contain_text("Input: none. It takes no commands")
        drone.shell("param set MNT_MODE_IN 4")
        drone.shell("gimbal stop")
        drone.shell("gimbal start")
        assert "Input: Mavlink" in drone.shell("gimbal status")
        expect(state).to_contain_text("Running. Input: MAVLink.")
        drone.shell("gimbal primary-control 1 1")
        control = page.get_by_label("Control of the gimbal")
        expect(control).to_contain_text("controlled by the vehicle")
        control.get_by_role("button", name="Take control").click()
        expect(control.get_by_label("Yaw", exact=True)).to_be_enabled()
        take_off_to_hold(drone)
        expect(control).to_contain_text("its motors may turn")
        expect(control.get_by_label("Yaw", exact=True)).to_be_disabled()
        expect(state.get_by_role("button", name="Start again")).to_be_disabled()
        control.get_by_label("Move it although").check()
        control.get_by_label("Yaw", exact=True).fill("40")
        expect(control).to_contain_text("+40.0°")
        drone.land_now()
        drone.until_disarmed()
