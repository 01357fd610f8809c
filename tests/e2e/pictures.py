"""Takes pictures of the page while a vehicle is flying, in both themes."""

from __future__ import annotations

import base64
import contextlib
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page

from gcs_server.client import SyncVehicle
from tests.station import wait_until

MAX_BYTES = 100_000  # of a picture
QUALITIES = (85, 78, 70, 60, 50)  # of WebP, the best first
THEMES: tuple[Any, ...] = ("dark", "light")
DESKTOP_SIZE, TABLET_SIZE, PHONE_SIZE = (1440, 900), (1024, 768), (390, 844)
UNCHANGED_FOR_MS = 300
"""A picture is taken when the window has not changed for this long; without a GPU, drawing is slow."""
WAIT_FOR_ANIMATIONS = """() => Promise.all(document.getAnimations()
  .filter((a) => a.effect?.getComputedTiming().endTime < Infinity)
  .map((a) => a.finished.catch(() => null)))"""
"""Waits for the end of all finite animations."""
CLIENT_ID = "pictures"
"""Client id of the page and of the scripts: both act as one client, which has control of the vehicle."""


@dataclass
class PictureSetup:
    """Arguments of a function that takes pictures."""

    browser: Browser
    page: Page
    url: str
    drone: SyncVehicle
    simulator: subprocess.Popen[bytes]
    port: int
    folder: Path
    stack: contextlib.ExitStack


def save_picture(page: Page, path: Path) -> None:
    """Saves a picture of the window as WebP, at the highest quality within the size limit."""
    session = page.context.new_cdp_session(page)
    data = b""
    for quality in QUALITIES:
        capture = session.send("Page.captureScreenshot", {"format": "webp", "quality": quality})
        data = base64.b64decode(capture["data"])
        if len(data) <= MAX_BYTES:
            break
    path.write_bytes(data)
    session.detach()
    print(f"  {path.name}: {len(data) / 1000:.0f} kB", flush=True)


def wait_until_unchanged(page: Page, longest_s: float = 6.0) -> None:
    """Waits until the window no longer changes, but at most `longest_s`, because the picture of a flying
    vehicle always changes."""
    screenshots = [b""]

    def is_unchanged() -> bool:
        page.wait_for_timeout(UNCHANGED_FOR_MS)
        screenshots.append(page.screenshot(type="jpeg", quality=10))
        return screenshots[-1] == screenshots[-2]

    with contextlib.suppress(TimeoutError):
        wait_until(is_unchanged, "a still window", longest_s)


def save_in_both_themes(
    page: Page, folder: Path, name: str, before_picture: Callable[[], object] = lambda: None
) -> None:
    """Saves one state of the page in both themes; `before_picture` renews a setpoint or confirmation that
    would expire."""
    for theme in THEMES:
        page.emulate_media(color_scheme=theme)
        wait_until_unchanged(page, 3)
        before_picture()
        page.evaluate(WAIT_FOR_ANIMATIONS)
        save_picture(page, folder / f"{name}-{theme}.webp")
    page.emulate_media(color_scheme="dark")


def state_text(page: Page) -> str:
    """The vehicle's state as the page displays it."""
    return page.locator(".pill b").inner_text()


def wait_for_state_text(page: Page, *states: str) -> None:
    """Waits until the page displays one of these states."""
    wait_until(lambda: state_text(page) in states, " or ".join(states), 60)
