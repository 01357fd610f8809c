"""The panel of ROS 2 topics in a browser: a server process, and a vehicle that this test process simulates
over real DDS."""

from __future__ import annotations

import uuid
from collections.abc import Iterator

import pytest

pytest.importorskip("cyclonedds")

from playwright.sync_api import Browser, expect

from gcs_server.ros2.dds import open_domain
from tests import station
from tests.e2e.browser import REPOSITORY, chromium, open_page, violations_in_both_themes
from tests.support.dds_publisher import TYPES, Publisher
from tests.support.dds_vehicle import VEHICLE_ATTITUDE, AcknowledgingVehicle, PeriodicThread
from tools import build_page

pytestmark = [pytest.mark.browser, pytest.mark.story]

DOMAIN = 57
SETPOINT = "/fmu/in/trajectory_setpoint"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium; builds the page first if its sources are newer."""
    build_page.build(REPOSITORY)
    with chromium() as running_browser:
        yield running_browser


def test_topics_are_shown_with_rate_and_fields_while_the_panel_is_open(browser: Browser) -> None:
    # a repeated test does not see the vehicle of the attempt before, which lives until it is collected
    namespace = f"panel_{uuid.uuid4().hex[:8]}"
    domain, vehicle_thread = open_domain(DOMAIN, None), PeriodicThread()
    vehicle = AcknowledgingVehicle(DOMAIN, namespace, 1)
    vehicle_thread.callbacks.append(vehicle.step)
    try:
        with (
            station.running_server([f"ros2://{DOMAIN}/{namespace}"]) as (url, _),
            open_page(browser, url, scene=False) as page,
        ):
            navigation = page.get_by_role("navigation", name="Views")
            expect(navigation.get_by_role("button", name="Topics")).to_be_visible()
            page.keyboard.press("x")  # opens the panel
            panel = page.get_by_role("region", name="ROS 2 topics")
            panel.get_by_label("Search topics").fill("attitude")
            row = panel.get_by_role("button", name=f"/{namespace}{VEHICLE_ATTITUDE}")
            expect(row).to_contain_text("Hz")
            expect(row).to_contain_text("px4_msgs/msg/VehicleAttitude")
            row.click()
            expect(panel.get_by_role("definition")).not_to_have_count(0)
            expect(panel.get_by_text("timestamp_sample")).to_be_visible()
            expect(panel.get_by_text("1 publisher, 1 subscriber")).to_be_visible()
            expect(panel.get_by_text("confirmed by PX4")).to_be_visible()
            program = Publisher(DOMAIN, f"{namespace}_other")
            program.send(SETPOINT, TYPES["TrajectorySetpoint"].encode({}), "TrajectorySetpoint")
            causes = panel.get_by_role("group", name="Why topics are empty or setpoints do nothing")
            expect(causes).to_contain_text(
                f"A program publishes /{namespace}_other{SETPOINT}, but no vehicle"
            )
            expect(causes).to_contain_text(f"Vehicles in this domain: /{namespace}.")
            assert violations_in_both_themes(page) == []
            page.keyboard.press("Escape")
            expect(panel).to_have_count(0)
    finally:
        vehicle_thread.close()
    assert domain  # this reference has kept the domain open
