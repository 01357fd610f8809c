"""A flight over an obstacle, commanded on the page: setpoints over ROS 2, lidar distances over MAVLink."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import confirm_by_slider, open_page, scene_frame
from tests.e2e.fast_station import Station
from tests.station import free_port, running_server, running_vehicles, wait_until

pytest.importorskip("cyclonedds")
pytestmark = [pytest.mark.browser, pytest.mark.story]

DOMAIN = 56
NAMESPACE = f"box_{os.getpid()}"
BOX_HEIGHT_M = 4.0
"""Height of the box in vehicle_sim/worlds/obstacle-box.yaml."""
SETPOINT_UP_M, GOAL_NORTH_M = 1.0, 10.0
"""Height of all setpoints, and distance of the last setpoint, relative to the start."""
ARM_AT_S, TO_GOAL_AT_S = 2.0, 8.0
"""Times after the start of the setpoints: arming at 2 s, the setpoint at the goal at 8 s."""
MIN_DISTANCE_M = 0.5
"""The brake's margin is 1 m; errors of the velocity estimate and a busy machine bring the vehicle nearer."""
COUNT_DRAWN_LIDARS = """
() => {
  const nodes = window.__viserMutable.nodeRefFromName;
  const found = Object.keys(nodes).filter((n) => n.endsWith('/measured_points') && nodes[n]?.visible);
  return found.length;
}
"""
"""Number of vehicles whose lidar points are drawn."""


@pytest.fixture
def station_at_box() -> Iterator[Station]:
    """A vehicle in front of the box, connected to the server over MAVLink and ROS 2."""
    port = free_port()
    ros2 = ["--ros2", str(DOMAIN), "--ros2-namespace", NAMESPACE]
    with (
        running_server([f"udpin://127.0.0.1:{port}", f"ros2://{DOMAIN}/{NAMESPACE}"]) as (url, _),
        running_vehicles(port, arguments=["--no-log", "--world", "obstacle-box", *ros2]),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        drone.until(lambda v: v["reach"]["setpoints"] == "ROS 2", what="setpoints over ROS 2 besides MAVLink")
        yield Station(url, gcs, drone)


class PositionRecorder:
    """Reads the vehicle's estimated position, and records its greatest altitude above the start."""

    def __init__(self, drone: Any) -> None:
        self._drone = drone
        self.highest_m = 0.0

    def north_up_m(self) -> tuple[float, float]:
        """Position north of and above the start [m]."""
        north, _, down = self._drone.topic("local_position")["position_ned_m"]
        self.highest_m = max(self.highest_m, -down)
        return north, -down

    def wait_until(
        self, condition: Callable[[float, float], bool], what: str, deadline_s: float = 60.0
    ) -> None:
        """Waits until `condition` is true for the position north and up [m]."""
        wait_until(lambda: condition(*self.north_up_m()), what, deadline_s)


class Schedule:
    """Waits for times counted from the start of the setpoints."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()

    def sleep_until(self, at_s: float) -> None:
        """Waits until this time; on a busy machine it may have passed."""
        time.sleep(max(0.0, self._began_s + at_s - time.monotonic()))


def send_position(page: Page, view: Locator, north_m: float, button: str) -> None:
    """Enters a position in the form and presses this button."""
    for field, value in (("North", north_m), ("East", 0.0), ("Up", SETPOINT_UP_M)):
        view.get_by_label(f"Position, {field}").fill(f"{value:g}")
    view.get_by_role("button", name=button).click()


def test_the_vehicle_takes_off_stops_at_the_box_and_with_avoidance_flies_over_the_box(
    browser: Browser, station_at_box: Station
) -> None:
    drone, recorder = station_at_box.drone, PositionRecorder(station_at_box.drone)
    with open_page(browser, station_at_box.url, size=(1280, 720)) as page:
        expect(page.locator(".pill b")).to_have_text("Ready")
        page.keyboard.press("p")
        view = page.get_by_role("region", name="Offboard view")
        expect(view.get_by_text("If the stream stops")).to_be_visible()
        send_position(page, view, 0.0, "Start…")
        confirm_by_slider(page, view.get_by_role("button", name="Start…").click)
        drone.until(lambda v: v["status"]["mode"] == "offboard", what="Offboard")
        schedule = Schedule()
        schedule.sleep_until(ARM_AT_S)
        assert recorder.north_up_m()[1] < 0.5 * SETPOINT_UP_M, "the vehicle took off by setpoints alone"
        arm = page.get_by_role("button", name="Arm", exact=True)
        arm.click()
        confirm_by_slider(page, arm.click)
        recorder.wait_until(lambda _, up_m: up_m > 0.7 * SETPOINT_UP_M, "the take-off to one metre")
        schedule.sleep_until(TO_GOAL_AT_S)
        north_m, up_m = recorder.north_up_m()
        assert north_m < 1.5
        assert up_m > 0.5 * SETPOINT_UP_M, "the vehicle did not hover at one metre before the goal was sent"

        send_position(page, view, GOAL_NORTH_M, "Send")
        page.keyboard.press("p")
        card = page.get_by_label("Offboard", exact=True)
        avoidance_box = card.get_by_label("Avoid obstacles")
        expect(avoidance_box).not_to_be_checked()
        recorder.wait_until(lambda north_m, _: north_m > 1.5, "the flight towards the box")
        wait_until(lambda: lidar_ahead_m(drone) < 1.5 and is_slow(drone), "the stop before the box")
        time.sleep(3)  # the brake keeps the vehicle at this distance
        assert lidar_ahead_m(drone) > MIN_DISTANCE_M, "the brake did not keep its distance from the box"
        assert recorder.highest_m < 2.0
        wait_until(lambda: scene_frame(page).evaluate(COUNT_DRAWN_LIDARS) == 1, "the drawn lidar points", 40)

        avoidance_box.check()
        recorder.wait_until(lambda north_m, _: north_m > GOAL_NORTH_M - 1.0, "the flight over the box", 90)
        assert recorder.highest_m > BOX_HEIGHT_M
        expect(avoidance_box).to_be_checked()
        land = page.get_by_role("button", name="Land", exact=True)
        land.click()
        confirm_by_slider(page, land.click)
        drone.until_disarmed()


def is_slow(drone: Any) -> bool:
    """Whether the vehicle is slower than 0.2 m/s."""
    return max(map(abs, drone.topic("local_position")["velocity_ned_m_s"][:2])) < 0.2


def lidar_ahead_m(drone: Any) -> float:
    """Distance that the lidar measures forward [m]; infinite without a measurement. The lidar has no GPS
    error, unlike the estimated position."""
    sensors = drone.topic("distance_sensors")["sensors"]
    measured = [sensor["distance_m"] for sensor in sensors if sensor["direction_frd"][0] > 0.9]
    return min((each for each in measured if each is not None), default=math.inf)
