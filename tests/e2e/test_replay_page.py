"""The page lists a recording of a real PX4, replays it, seeks in it, and shows its values."""

from __future__ import annotations

import bisect
import math
import re
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from gcs_server.replay.records import Batch, Cursor, message_id, open_log, read_batch
from tests.e2e.browser import first_number, open_page, serious_violations, shown_value
from tests.station import (
    free_port,
    is_up,
    running_process,
    running_server,
    running_vehicles,
    server_command,
    wait_until,
)
from vehicle_sim.mavlink import generated_dialect as mavlink

pytestmark = pytest.mark.browser

RECORDING = "flight-takeoff-reposition-orbit-gimbal-rtl.tlog.gz"
MODE_LABELS = {(4, 2): "Take off", (4, 3): "Hold", (3, 1): "Orbit", (4, 5): "Return", (4, 6): "Land"}
"""Labels on the page by main mode and sub mode."""
DECODED_IDS = {30, 33, 285, 436}
"""ATTITUDE, GLOBAL_POSITION_INT, GIMBAL_DEVICE_ATTITUDE_STATUS, CURRENT_MODE."""


@pytest.fixture
def server_url(reference_data: Path, tmp_path: Path) -> Iterator[str]:
    """A server whose data folder has one recording and one invalid file."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    shutil.copy(reference_data / "px4" / "tlogs" / RECORDING, folder)
    (folder / "letter.tlog").write_bytes(b"This is no telemetry log. " * 40)
    port = free_port(socket.SOCK_STREAM)
    command = server_command(port, [f"udpin://127.0.0.1:{free_port()}"], tmp_path)
    with running_process([*command, "--no-scene"]):
        wait_until(lambda: is_up(f"http://127.0.0.1:{port}"), "the server's start")
        yield f"http://127.0.0.1:{port}"


class DecodedLog:
    """The compared messages of a log, decoded by pymavlink."""

    def __init__(self, path: Path) -> None:
        decoder: Any = mavlink.MAVLink(None)
        self._recorded: dict[str, tuple[list[int], list[Any]]] = {}
        self.begin_us = self.end_us = 0
        with open_log(path) as file:
            batch = Batch([], Cursor(), at_end=False, bytes_skipped=0)
            while not batch.at_end:
                batch = read_batch(file, batch.after)
                self.begin_us = self.begin_us or batch.records[0].time_us
                self.end_us = batch.records[-1].time_us
                for record in batch.records:
                    if record.raw[5] == 1 and message_id(record.key) in DECODED_IDS:  # of system id 1
                        message = decoder.decode(bytearray(record.raw))
                        times, messages = self._recorded.setdefault(message.get_type(), ([], []))
                        times.append(record.time_us)
                        messages.append(message)

    def newest(self, name: str, time_us: int) -> Any:
        """The newest message with this name at a time."""
        times, messages = self._recorded[name]
        return messages[bisect.bisect_right(times, time_us) - 1]

    def first_time_us(self, mode: tuple[int, int]) -> int:
        """Time of the first message in a mode [us]."""
        times, messages = self._recorded["CURRENT_MODE"]
        return next(t for t, m in zip(times, messages, strict=True) if _mode(m) == mode)


def _mode(message: Any) -> tuple[int, int]:
    return message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24 & 0xFF


def seek(page: Page, log_us: int) -> None:
    """Sets the replay's position through the API, which is exact to a microsecond, and pauses the replay."""
    status = page.evaluate(
        """async (positionUnixS) => {
          const { replays } = await (await fetch('/api/v1/replays')).json();
          return (await fetch(`/api/v1/replays/${encodeURIComponent(replays[0].name)}`, { method: 'POST',
            headers: { 'Content-Type': 'application/json' },
            body: JSON.stringify({ position_unix_s: positionUnixS, playing: false }) })).status;
        }""",
        log_us / 1e6,
    )
    assert status == 200


def wrapped_deg(degrees: float) -> float:
    return (degrees + 180) % 360 - 180


def compare_instruments(page: Page, log: DecodedLog, time_us: int) -> None:
    """Compares the page's instruments with the log at the same time."""
    mode = log.newest("CURRENT_MODE", time_us)
    position = log.newest("GLOBAL_POSITION_INT", time_us)
    attitude = log.newest("ATTITUDE", time_us)
    gimbal = log.newest("GIMBAL_DEVICE_ATTITUDE_STATUS", time_us)
    expect(page.locator(".pill .who")).to_contain_text(MODE_LABELS[_mode(mode)])
    values = page.get_by_role("complementary", name="Instruments")
    altitude = values.locator(".value", has=page.get_by_text("Above home", exact=True)).locator(".text")
    expect(altitude).to_have_text(
        re.compile(rf"^{position.relative_alt / 1000:.1f}".replace("-", "−") + r"\s*m")
    )
    assert abs(wrapped_deg(shown_value(values, "Heading") - math.degrees(attitude.yaw))) <= 1.0
    w, x, y, z = gimbal.q
    pitch_deg = math.degrees(math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))))
    card = page.get_by_role("region", name="Gimbal")
    shown_pitch = card.get_by_text("Pitch", exact=True).locator("xpath=following-sibling::*[1]").inner_text()
    assert abs(first_number(shown_pitch) - pitch_deg) <= 0.1
    slider_value = page.get_by_role("slider", name="Time in the recording").get_attribute("aria-valuenow")
    assert slider_value is not None
    assert int(slider_value) > 0


@pytest.mark.story
def test_a_replay_shows_the_values_of_the_log(
    browser: Browser, reference_data: Path, server_url: str
) -> None:
    log = DecodedLog(reference_data / "px4" / "tlogs" / RECORDING)
    with open_page(browser, server_url, scene=False) as page:
        page.get_by_role("button", name="Flights", exact=True).click()
        flights = page.get_by_role("region", name="Flights", exact=True)
        invalid_file = flights.get_by_role("listitem").filter(has_text="letter.tlog")
        expect(invalid_file).to_contain_text("not a telemetry log")
        expect(invalid_file.get_by_role("button", name="Replay")).to_be_disabled()
        assert serious_violations(page) == []
        flights.get_by_role("listitem").filter(has_text="vehicle 1").get_by_role(
            "button", name="Replay"
        ).click()
        replay_bar = page.get_by_role("region", name="Replay")
        expect(replay_bar.get_by_role("button", name="Pause")).to_be_visible()
        expect(page.get_by_role("toolbar", name="Actions")).to_have_count(0)
        expect(page.get_by_role("button", name=re.compile("Quad 1"))).to_contain_text("replayed")
        page.keyboard.press("Space")
        expect(replay_bar.get_by_role("button", name="Play", exact=True)).to_be_visible()

        slider = page.get_by_role("slider", name="Time in the recording")
        orbit_us, rtl_us = log.first_time_us((3, 1)), log.first_time_us((4, 5))
        for time_us in (orbit_us + 9_000_000, rtl_us + 4_000_000, orbit_us - 3_000_000):  # forward and back
            seek(page, time_us)
            replay_s = (time_us - log.begin_us) / 1e6
            expect(slider).to_have_attribute(
                "aria-valuenow", re.compile(rf"^({int(replay_s)}|{int(replay_s) + 1})$")
            )
            compare_instruments(page, log, time_us)
        assert serious_violations(page) == []

        # by keyboard: to the end, to the start, and five seconds forward; then Play at 16 times the speed
        slider.focus()
        page.keyboard.press("End")
        duration_text = slider.get_attribute("aria-valuemax")
        assert duration_text is not None
        expect(slider).to_have_attribute("aria-valuenow", duration_text)
        assert abs(int(duration_text) - (log.end_us - log.begin_us) / 1e6) <= 0.5
        expect(page.locator(".pill .who")).to_contain_text(
            MODE_LABELS[_mode(log.newest("CURRENT_MODE", log.end_us))]
        )
        page.keyboard.press("Home")
        expect(slider).to_have_attribute("aria-valuenow", "0")
        page.keyboard.press("ArrowRight")
        expect(slider).to_have_attribute("aria-valuenow", "5")
        replay_bar.get_by_label("Speed").select_option("16 ×")
        page.get_by_role("button", name="Play", exact=True).click()
        expect(slider).to_have_attribute("aria-valuenow", re.compile(r"^([3-9]\d|1\d\d)$"))
        expect(page.locator(".pill .who")).to_contain_text(re.compile("Hold|Orbit|Take off|Return|Land"))
        replay_bar.get_by_role("button", name="Close the replay").click()
        expect(replay_bar).to_have_count(0)
        expect(page.get_by_text("No vehicle connected yet")).to_be_visible()


@pytest.mark.story
def test_a_log_of_the_vehicle_is_listed_downloaded_and_saved(browser: Browser) -> None:
    link_port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{link_port}"]) as (url, _),
        running_vehicles(link_port),
        open_page(browser, url, scene=False) as page,
    ):
        page.get_by_role("button", name="Flights", exact=True).click()
        logs = page.get_by_role("region", name="Logs on")
        logs.get_by_role("button", name="List logs").click()
        logs.get_by_role("button", name="Download").click()
        save = logs.get_by_role("link", name=re.compile(r"^Save .*\.ulg$"))
        expect(save).to_be_visible(timeout=30_000)
        assert serious_violations(page) == []
        logs.get_by_role("button", name="Open").click()
        expect(page.get_by_role("group", name="Fields of the log")).to_contain_text("vehicle_attitude")
        page.get_by_role("button", name="Back to the list of flights").click()
        with page.expect_download() as download:
            save.click()
        assert download.value.path().read_bytes()[:7] == b"ULog\x01\x12\x35"
