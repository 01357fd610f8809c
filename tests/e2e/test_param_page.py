"""Parameters in the page: a file with faults is reviewed, written, undone; favourites; two vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import open_page, serious_violations
from tests.e2e.fast_station import FAST_OPTIONS, Station
from tests.station import free_port, running_server, running_vehicles

pytestmark = [pytest.mark.browser, pytest.mark.story]

FILE = """\
# Stack: PX4 Pro
# Version: 1.16.0
7\t1\tMNT_RATE_YAW\t40\t9
7\t1\tMNT_RATE_PITCH\t30\t9
7\t1\tMNT_MODE_OUT\t2\t6
7\t1\tMAV_SYS_ID\t7\t6
7\t1\tNO_SUCH\t1\t6
7\t1\tMNT_DO_STAB\t1.5\t6
broken
"""


@pytest.fixture
def station() -> Iterator[Station]:
    """A server and two vehicles, whose parameters differ in one value."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=2, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        gcs.wait_for_vehicle("102", ready=True, timeout_s=120)
        yield Station(url, gcs, drone)


def test_a_file_is_reviewed_written_and_undone(browser: Browser, station: Station, tmp_path: Path) -> None:
    drone = station.drone
    path = tmp_path / "other.params"
    path.write_text(FILE)
    with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
        page.locator(".pill").wait_for()
        page.keyboard.press("i")
        panel = page.get_by_label("Parameters", exact=True)
        expect(panel.get_by_label("Parameters found").locator("li").nth(5)).to_be_visible()
        panel.get_by_label("File of parameters").set_input_files(path)
        review = panel.get_by_label("Review", exact=True)
        for words in (
            "The file is of version 1.16.0; the vehicle has 1.17.0.",
            "The file is of vehicle 7; this is vehicle 101.",
            "The vehicle has no parameter of this name.",
            "'1.5' is not a whole number, but its type is one.",
            "Not vehicle, component, name, value and type: 'broken'.",
            "line 9",
            "1 value is the same.",
        ):
            expect(review).to_contain_text(words)
        assert serious_violations(page) == []
        expect(review.get_by_label("Write MAV_SYS_ID")).not_to_be_checked()
        review.get_by_label("Write MNT_MODE_OUT").uncheck()
        review.get_by_role("button", name="Write 1 parameter").click()
        expect(panel).to_contain_text("1 of 1 written.")
        assert (drone.param("MNT_RATE_YAW"), drone.param("MNT_MODE_OUT")) == (40, 0)

        panel.get_by_label("Compare with").select_option("102")
        expect(review).to_contain_text("MNT_RATE_YAW")
        review.get_by_role("button", name="Discard").click()
        panel.get_by_role("button", name="Undo…").click()
        review.get_by_role("button", name="Write 1 parameter").click()
        expect(panel).to_contain_text("1 of 1 written.")
        assert drone.param("MNT_RATE_YAW") == 30

        panel.get_by_label("Search parameters").fill("MNT_MODE_IN")
        panel.get_by_role("button", name="MNT_MODE_IN").click()
        expect(panel).to_contain_text("Who commands the gimbal")
        panel.get_by_label("Favourite", exact=True).check()
        panel.get_by_label("Search parameters").fill("")
        panel.get_by_label("Favourites").check()
        expect(panel.get_by_label("Parameters found").locator("li")).to_have_count(1)
        with page.expect_download() as download:
            panel.get_by_role("button", name="Save file").click()
        assert "101\t1\tMNT_MODE_IN\t4\t6" in Path(download.value.path()).read_text()
        assert len(drone.params.review(file=drone.params.file())) == 913
