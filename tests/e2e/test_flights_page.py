"""The page adds a log, plots it, moves its cursor by a message, and deletes it."""

from __future__ import annotations

import json
import os
import re
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from gcs_server.client import SyncGcs
from missions.offboard.document import write as write_mission
from missions.plan import write
from tests.e2e.browser import open_page, serious_violations
from tests.e2e.keyboard.tab_order import check_tab_order
from tests.station import (
    free_port,
    is_up,
    running_process,
    running_server,
    running_vehicles,
    server_command,
    wait_until,
)
from tests.support.flown_log import flown_log
from tests.support.flown_mission import flown_mission, flown_offboard, square
from tests.support.offboard_missions import mission
from tests.unit.gcs_server.logbook.autotuned_ulog import autotuned_ulog
from tests.unit.gcs_server.logbook.generated_ulogs import ulog

pytestmark = pytest.mark.browser

PICTURES = os.environ.get("GCS_PICTURES")
"""Where screens are saved; unset: nowhere."""

PLOTTED = """
() => [...document.querySelectorAll('.uplot canvas')].map((canvas) => {
  const { width, height } = canvas;
  const pixels = new Uint32Array(canvas.getContext('2d').getImageData(0, 0, width, height).data.buffer);
  return new Set(pixels).size;
})
"""
"""Number of colours of each plot."""


@pytest.fixture
def server_url(tmp_path: Path) -> Iterator[str]:
    port = free_port(socket.SOCK_STREAM)
    command = server_command(port, [f"udpin://127.0.0.1:{free_port()}"], tmp_path / "data")
    with running_process([*command, "--no-scene"]):
        wait_until(lambda: is_up(f"http://127.0.0.1:{port}"), "the server's start")
        yield f"http://127.0.0.1:{port}"


def choose_field(page: Page, words: str, name: str) -> None:
    page.get_by_label("Search fields").fill(words)
    page.get_by_role("group", name="Fields of the log").get_by_role("button", name=name).first.click()


def test_a_log_is_added_plotted_and_deleted(browser: Browser, server_url: str, tmp_path: Path) -> None:
    (tmp_path / "flight.ulg").write_bytes(ulog(steps=300))
    (tmp_path / "letter.ulg").write_bytes(b"This is no log. " * 99)
    with open_page(browser, server_url, scene=False) as page:
        page.keyboard.press("Shift+E")
        flights = page.get_by_role("region", name="Flights", exact=True)
        expect(flights).to_contain_text("No flights yet")
        flights.get_by_label("Add a log").set_input_files(tmp_path / "flight.ulg")
        choose_field(page, "all_types float", "float_value")
        pane = page.get_by_role("region", name="Pane 1")
        expect(pane).to_contain_text("all_types float_value")
        wait_until(lambda: page.evaluate(PLOTTED)[0] > 10, "the plot")
        choose_field(page, "all_types double", "double_value")
        axis = pane.get_by_role("button", name="double_value: axis at the right")
        axis.click()
        expect(axis).to_have_attribute("aria-pressed", "true")
        page.get_by_role("button", name="Add a pane").click()
        choose_field(page, "all_types double", "double_value")
        expect(page.get_by_role("region", name="Pane 2")).to_contain_text("double_value")
        page.get_by_role("radio", name="Messages").click()
        page.get_by_role("button", name=re.compile("Low battery")).click()
        slider = page.get_by_role("slider", name="Time of the plots")
        expect(slider).to_have_attribute("aria-valuetext", re.compile(r"^6\.00 s"))
        expect(pane.locator("b").first).to_have_text(re.compile(r"^−0\.279"))  # sin(6.0)
        slider.focus()
        page.keyboard.press("ArrowRight")
        expect(slider).not_to_have_attribute("aria-valuetext", re.compile(r"^6\.00 s"))
        page.get_by_role("toolbar", name="Window of time").get_by_role("button", name="Zoom in").click()
        page.get_by_role("button", name="Whole flight").click()
        expect(page.get_by_role("button", name="Whole flight")).to_be_disabled()
        page.get_by_role("radio", name="Parameters").click()
        expect(page.get_by_role("group", name="Parameters of the log")).to_contain_text("MPC_XY_VEL_MAX = 5")
        assert serious_violations(page) == []

        page.keyboard.press("Escape")
        row = flights.get_by_role("listitem").filter(has_text="vehicle 7")
        row.get_by_role("button", name=re.compile("^Delete ")).click()
        row.get_by_role("button", name="Delete", exact=True).click()
        expect(row).to_have_count(0)


@pytest.mark.story
def test_a_part_of_a_flight_is_flown_again_with_a_change(
    browser: Browser, server_url: str, tmp_path: Path
) -> None:
    path, step_s = flown_log(tmp_path / "vehicle", (0.0, 3.0, 0.0))
    with open_page(browser, server_url, scene=False) as page:
        page.keyboard.press("Shift+E")
        page.get_by_label("Add a log").set_input_files(path)
        page.get_by_role("radio", name="What if").click()
        panel = page.get_by_role("group", name="What if")
        panel.get_by_label("Parameter", exact=True).fill("mpc_xy_p")
        panel.get_by_label("Value", exact=True).fill("0.4")
        panel.get_by_role("button", name="Add").click()
        expect(panel).to_contain_text("MPC_XY_P")
        fly = panel.get_by_role("button", name=re.compile("Fly again from"))
        fly.click()
        expect(panel.get_by_role("alert")).to_contain_text("not in the air")
        slider = page.get_by_role("slider", name="Time of the plots")
        slider.focus()
        for _ in range(100):
            if float(re.findall(r"from ([\d.]+)", fly.inner_text())[0]) >= step_s - 1.0:
                break
            page.keyboard.press("Shift+ArrowRight")
        fly.click()
        expect(panel.get_by_role("status")).to_contain_text("it stays within", timeout=30_000)
        expect(panel.get_by_role("alert")).to_have_count(0)
        expect(page.get_by_role("region", name="Pane 2")).to_contain_text("North, changed")
        wait_until(lambda: page.evaluate(PLOTTED)[1] > 10, "the tracks")
        assert serious_violations(page) == []


def test_tuning_says_how_the_loops_respond_and_shows_the_curves(
    browser: Browser, server_url: str, tmp_path: Path
) -> None:
    path, _ = flown_log(tmp_path / "vehicle", (0.0, 3.0, 0.0))
    with open_page(browser, server_url, scene=False) as page:
        page.keyboard.press("Shift+E")
        page.get_by_label("Add a log").set_input_files(path)
        page.get_by_role("radio", name="Tuning").click()
        panel = page.get_by_role("group", name="Tuning")
        loops = panel.get_by_role("list", name="Control loops").get_by_role("button")
        expect(loops).to_have_count(6, timeout=30_000)
        expect(loops.nth(0)).to_contain_text(re.compile(r"Roll rate.*Rises in \d+ ms"))
        expect(loops.nth(5)).to_contain_text("The log does not say enough.")
        expect(panel.get_by_role("img", name="Answer to a step over time")).to_be_visible()
        wait_until(lambda: min(page.evaluate(PLOTTED)[-4:]) > 10, "the curves")
        if PICTURES:
            page.screenshot(path=Path(PICTURES) / "tuning.png")
        check_tab_order(page, "Tab")
        loops.nth(5).click()
        expect(panel).to_contain_text("hardly moves")
        loops.nth(0).click()
        panel.get_by_role("button", name="Plot setpoint and measurement").click()
        expect(page.get_by_role("region", name="Pane 1")).to_contain_text("vehicle_rates_setpoint/roll")
        assert serious_violations(page) == []
        page.set_viewport_size({"width": 390, "height": 844})
        page.get_by_role("radio", name="Tuning").scroll_into_view_if_needed()
        expect(page.get_by_role("radio", name="Tuning")).to_be_in_viewport()
        width = "(element) => element.scrollWidth - element.clientWidth"
        assert panel.evaluate(width) == page.evaluate(f"({width})(document.documentElement)") == 0
        if PICTURES:
            page.screenshot(path=Path(PICTURES) / "tuning-phone.png")


def test_the_gains_of_autotune_go_into_the_proof_with_one_press(
    browser: Browser, server_url: str, tmp_path: Path
) -> None:
    path = tmp_path / "autotune.ulg"
    path.write_bytes(autotuned_ulog())
    with open_page(browser, server_url, scene=False) as page:
        page.keyboard.press("Shift+E")
        page.get_by_label("Add a log").set_input_files(path)
        page.get_by_role("radio", name="Tuning").click()
        panel = page.get_by_role("group", name="Tuning")
        expect(panel.get_by_role("row", name="MC_ROLLRATE_P")).to_contain_text(re.compile(r"0\.15\s*0\.12"))
        expect(panel.get_by_role("row")).to_have_count(16)
        panel.get_by_role("button", name="Take these gains into the proof").click()
        expect(panel.get_by_role("button", name=re.compile("^Remove MC_"))).to_have_count(15)
        assert serious_violations(page) == []
        if PICTURES:
            panel.get_by_text("Gains of autotune").scroll_into_view_if_needed()
            page.screenshot(path=Path(PICTURES) / "autotune-gains.png")
        page.set_viewport_size({"width": 390, "height": 844})
        panel.get_by_role("table").scroll_into_view_if_needed()
        assert panel.evaluate("(element) => element.scrollWidth - element.clientWidth") == 0
        if PICTURES:
            page.screenshot(path=Path(PICTURES) / "autotune-gains-phone.png")


def test_the_simulated_px4_flies_on_with_a_changed_failsafe_and_plan_item(
    browser: Browser, server_url: str, tmp_path: Path
) -> None:
    _, moment_s = flown_mission(tmp_path / "vehicle", square(), until_item=2, fly_on_s=25.0)
    (path,) = (tmp_path / "vehicle").rglob("*.ulg")
    body = {"name": "Square", "plan": json.loads(write(square()))}
    assert httpx.post(f"{server_url}/api/v1/plans", json=body).status_code == 201
    with open_page(browser, server_url, scene=False) as page:
        page.keyboard.press("Shift+E")
        page.get_by_label("Add a log").set_input_files(path)
        page.get_by_role("radio", name="What if").click()
        panel = page.get_by_role("group", name="What if")
        panel.get_by_role("radio", name="A failsafe").click()
        panel.get_by_label("Parameter", exact=True).fill("com_low_bat_act")
        panel.get_by_label("Value", exact=True).fill("3")
        panel.get_by_role("button", name="Add").click()
        panel.get_by_label("Battery at the moment").fill("6")
        panel.get_by_label("Duration").fill("40")
        fly = panel.get_by_role("button", name=re.compile("Fly again from"))
        slider = page.get_by_role("slider", name="Time of the plots")
        slider.focus()
        for _ in range(100):
            if float(re.findall(r"from ([\d.]+)", fly.inner_text())[0]) >= moment_s:
                break
            page.keyboard.press("Shift+ArrowRight")
        fly.click()
        expect(panel.get_by_role("alert")).to_contain_text("does not know the plan")
        panel.get_by_label("Flown plan").select_option(label="Square")
        fly.click()
        status = panel.get_by_role("status")
        expect(status).to_contain_text("it stays within", timeout=30_000)
        changed = status.locator("ul").last
        expect(changed).to_contain_text("Return")
        expect(changed).to_contain_text("attery")
        expect(panel.get_by_role("alert")).to_have_count(0)
        assert serious_violations(page) == []
        panel.get_by_role("radio", name="An item or step").click()
        expect(fly).to_be_disabled()
        panel.get_by_label("Item of the plan").fill("3")
        panel.get_by_label("Item north by").fill("15")
        panel.get_by_label("After it").select_option("Land")
        fly.click()
        expect(status.locator("ul").last).not_to_contain_text("attery", timeout=30_000)
        expect(page.get_by_role("region", name="Pane 2")).to_contain_text("North, changed")
        wait_until(lambda: page.evaluate(PLOTTED)[1] > 10, "the tracks")


@pytest.mark.story
def test_an_offboard_mission_flies_on_with_a_changed_step(
    browser: Browser, server_url: str, tmp_path: Path
) -> None:
    fly = "- {step: fly, speed_m_s: 4, points: [{offset_ned_m: [40, 0, -6]}, {offset_ned_m: [40, 20, -6]}]}\n"
    flown = mission("- {step: take_off, height_m: 6}\n" + fly)
    _, begin_s = flown_offboard(tmp_path / "vehicle", flown, for_s=35.0)
    (path,) = (tmp_path / "vehicle").rglob("*.ulg")
    body = {"name": "Out", "plan": json.loads(write_mission(flown))}
    assert httpx.post(f"{server_url}/api/v1/plans", json=body).status_code == 201
    with open_page(browser, server_url, scene=False, size=(1280, 800)) as page:
        page.keyboard.press("Shift+E")
        page.get_by_label("Add a log").set_input_files(path)
        page.get_by_role("radio", name="What if").click()
        panel = page.get_by_role("group", name="What if")
        panel.get_by_role("radio", name="An item or step").click()
        panel.get_by_label("Flown plan").select_option(label="Out")
        fly_again = panel.get_by_role("button", name=re.compile("Fly again from"))
        expect(fly_again).to_be_disabled()
        panel.get_by_label("Step", exact=True).fill("two")
        expect(panel.get_by_text("Its number in the mission.")).to_be_visible()
        panel.get_by_label("Step", exact=True).fill("2")
        panel.get_by_label("Point of the step").fill("2")
        panel.get_by_label("Step north by").fill("15")
        panel.get_by_label("Duration", exact=True).fill("15")
        slider = page.get_by_role("slider", name="Time of the plots")
        slider.focus()
        for _ in range(100):
            if float(re.findall(r"from ([\d.]+)", fly_again.inner_text())[0]) >= begin_s + 15.0:
                break
            page.keyboard.press("Shift+ArrowRight")
        fly_again.click()
        status = panel.get_by_role("status")
        expect(status).to_contain_text("it stays within", timeout=30_000)
        expect(status.locator("ul").last).to_contain_text("Step 2: Fly")
        expect(panel.get_by_role("alert")).to_have_count(0)
        assert serious_violations(page) == []
        if PICTURES:
            for width, height, theme in ((1280, 800, "dark"), (1280, 800, "light"), (390, 844, "light")):
                page.set_viewport_size({"width": width, "height": height})
                page.emulate_media(color_scheme=theme)
                panel.get_by_label("Step", exact=True).scroll_into_view_if_needed()
                page.screenshot(path=Path(PICTURES) / f"mission-step-{width}-{theme}.png")
                status.scroll_into_view_if_needed()
                page.screenshot(path=Path(PICTURES) / f"mission-step-result-{width}-{theme}.png")


@pytest.mark.story
def test_two_flights_are_laid_over_each_other_and_say_how_they_differ(
    browser: Browser, server_url: str, tmp_path: Path
) -> None:
    for name, wind in (("calm", (0.0, 0.0, 0.0)), ("windy", (0.0, 4.0, 0.0))):
        path, _ = flown_log(tmp_path / name, wind)
        path.rename(tmp_path / f"{name}.ulg")
    with open_page(browser, server_url, scene=False) as page:
        page.keyboard.press("Shift+E")
        flights = page.get_by_role("region", name="Flights", exact=True)
        for name in ("windy", "calm"):
            flights.get_by_label("Add a log").set_input_files(tmp_path / f"{name}.ulg")
            expect(flights.get_by_role("heading", name=f"{name}.ulg")).to_be_visible(timeout=30_000)
            flights.get_by_role("radio", name="Two flights").wait_for()
            if name == "windy":
                flights.get_by_role("button", name="Back to the list of flights").click()
        flights.get_by_role("radio", name="Two flights").click()
        second = flights.get_by_label("Second flight")
        second.select_option(index=1)
        expect(flights).to_contain_text("as root mean square", timeout=30_000)
        pane = page.get_by_role("region", name="Pane 1")
        expect(pane).to_contain_text("Distance of the flights")
        expect(page.get_by_role("region", name="Pane 2")).to_contain_text("second flight")
        wait_until(lambda: min(page.evaluate(PLOTTED)[:2]) > 10, "the plots")
        flights.get_by_role("radio", name="Best fit").click()
        expect(flights).to_contain_text("Times of the second flight are moved by")
        assert serious_violations(page) == []
        second.select_option(index=0)
        expect(flights).not_to_contain_text("as root mean square")


@pytest.mark.story
def test_gains_are_written_only_after_a_proof_of_exactly_these_values(
    browser: Browser, tmp_path: Path
) -> None:
    path, _ = flown_log(tmp_path / "flown", (0.0, 3.0, 0.0))
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        before = drone.param("MC_ROLLRATE_P")
        with open_page(browser, url, scene=False) as page:
            page.locator(".pill").wait_for()
            page.keyboard.press("Shift+E")
            page.get_by_label("Add a log").set_input_files(path)
            page.get_by_role("radio", name="Tuning").click()
            panel = page.get_by_role("group", name="Tuning")
            write = panel.get_by_role("button", name="Review and write…")

            def propose(value: str) -> None:
                panel.get_by_label("Gain", exact=True).fill("mc_rollrate_p")
                panel.get_by_label("Value", exact=True).fill(value)
                panel.get_by_role("button", name="Add").click()
                expect(write).to_be_disabled()
                panel.get_by_role("button", name=re.compile("^Prove for ")).click()

            propose("1.5")
            expect(panel).to_contain_text("Not passed", timeout=120_000)
            expect(panel).to_contain_text("drives motors to their limits")
            expect(write).to_be_disabled()
            if PICTURES:
                panel.get_by_text("Not passed").scroll_into_view_if_needed()
                page.screenshot(path=Path(PICTURES) / "proof-failed.png")
            propose("0.17")
            expect(panel).to_contain_text("100 of 100 flights are stable", timeout=120_000)
            check_tab_order(page, "Tab")
            assert serious_violations(page) == []
            write.click()
            review = panel.get_by_role("region", name="Review")
            review.get_by_role("button", name="Write 1 parameter").click()
            expect(panel).to_contain_text("1 of 1 written.")
            assert drone.param("MC_ROLLRATE_P") == pytest.approx(0.17)
            if PICTURES:
                page.screenshot(path=Path(PICTURES) / "proof-written.png")
            panel.get_by_role("button", name="Take back…").click()
            review.get_by_role("button", name="Write 1 parameter").click()
            expect(panel.get_by_role("button", name="Take back…")).to_have_count(0)
            assert drone.param("MC_ROLLRATE_P") == pytest.approx(before)
