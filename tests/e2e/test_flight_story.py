"""After a flight, by clicks: its log from the vehicle, a finding and its plot, the moment in 3D, what if, and
the parameter that came of it, written and taken back."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import open_page, scene_frame, serious_violations
from tests.e2e.fast_station import Station, take_off_to_hold
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story, pytest.mark.timeout(600)]

WEAK_MOTOR = """\
name: Motor 2 is weak
events:
  - {when: armed, motor: {number: 2, thrust: 0.6}}
"""
FOLDER = os.environ.get("GCS_PICTURES")
"""Where each screen is saved; unset: nowhere."""
PLOTTED = """
() => [...document.querySelectorAll('.uplot canvas')].map((canvas) => {
  const { width, height } = canvas;
  return new Set(new Uint32Array(canvas.getContext('2d').getImageData(0, 0, width, height).data.buffer)).size;
})
"""
"""Number of colours of each plot."""


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    """A server and one vehicle with a weak motor, which logs its flights, in real time: its log and the
    server's recording become one flight by their clocks."""
    script = tmp_path / "weak-motor.yaml"
    script.write_text(WEAK_MOTOR)
    port = free_port()
    options = ["--script", str(script), "--data-dir", str(tmp_path / "vehicle")]
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, arguments=options),
        SyncGcs(url, client="e2e") as gcs,
    ):
        yield Station(url, gcs, gcs.wait_for_vehicle("101", ready=True, timeout_s=120))


def picture(page: Page, name: str) -> None:
    """Checks the screen for accessibility, and saves it if somebody wants to look at it."""
    assert serious_violations(page) == [], name
    if FOLDER:
        page.screenshot(path=Path(FOLDER) / f"{name}.png")


def fly(station: Station) -> None:
    """A flight with two legs."""
    drone = station.drone
    take_off_to_hold(drone)
    north, east, down = drone.position_ned_m()
    for target in ((north + 8, east, down), (north + 8, east + 8, down)):
        with drone.offboard(position_ned_m=target, valid_for_s=120):
            drone.until(
                lambda v: (v["offboard"]["health"]["position_error_m"] or 9.0) < 0.5, what="the place"
            )
    drone.land()
    drone.until_disarmed()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_from_the_landing_to_a_parameter_that_is_written_and_taken_back(
    browser: Browser, station: Station, theme: str
) -> None:
    drone = station.drone
    fly(station)
    before = drone.param("MPC_XY_P")
    with open_page(browser, station.url, theme=theme, size=(1280, 800)) as page:
        page.locator(".pill").wait_for()
        page.keyboard.press("Shift+E")
        flights = page.get_by_role("region", name="Flights", exact=True)
        logs = flights.get_by_role("region", name=re.compile("^Logs on "))
        logs.get_by_role("button", name="List logs").click()
        newest = (
            logs.get_by_role("list", name="Logs on the vehicle, newest first").get_by_role("listitem").first
        )
        newest.get_by_role("button", name="Download").click()
        newest.get_by_role("button", name="Open").wait_for(timeout=60_000)
        picture(page, f"{theme}-1-flights")
        newest.get_by_role("button", name="Open").click()
        expect(page.get_by_role("button", name="Whole flight")).to_be_visible(timeout=60_000)

        page.get_by_role("radio", name=re.compile("^Findings")).click()
        found = page.get_by_role("group", name="Findings of the log")
        found.get_by_role("button", name=re.compile("otor")).first.click()
        wait_until(lambda: max(page.evaluate(PLOTTED), default=0) > 10, "the plot of the evidence")
        picture(page, f"{theme}-2-finding")

        slider = page.get_by_role("slider", name="Time of the plots")
        slider.focus()
        page.keyboard.press("Shift+ArrowRight")
        scene_frame(page)
        page.wait_for_timeout(3000)  # software draws the view
        picture(page, f"{theme}-3-in-3d")

        page.get_by_role("radio", name="What if").click()
        panel = page.get_by_role("group", name="What if")
        panel.get_by_label("Parameter", exact=True).fill("MPC_XY_P")
        panel.get_by_label("Value", exact=True).fill("0.6")
        panel.get_by_role("button", name="Add").click()
        panel.get_by_role("button", name=re.compile("Fly again from")).click()
        expect(panel.get_by_role("status").first).to_contain_text("it stays within", timeout=60_000)
        picture(page, f"{theme}-4-what-if")

        panel.get_by_role("button", name="Review and write…").click()
        review = panel.get_by_role("region", name="Review")
        expect(review).to_contain_text("MPC_XY_P")
        picture(page, f"{theme}-5-review")
        review.get_by_role("button", name="Write 1 parameter").click()
        expect(panel).to_contain_text("1 of 1 written.")
        assert drone.param("MPC_XY_P") == pytest.approx(0.6)
        panel.get_by_role("button", name="Take back…").click()
        review.get_by_role("button", name="Write 1 parameter").click()
        expect(panel.get_by_role("button", name="Take back…")).to_have_count(0)
        assert drone.param("MPC_XY_P") == pytest.approx(before)
        picture(page, f"{theme}-6-taken-back")
