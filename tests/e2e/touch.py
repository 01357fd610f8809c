"""The page in a phone's browser, which has only touch."""

from __future__ import annotations

import contextlib
from collections.abc import Generator

from playwright.sync_api import Browser, Page

from tests.e2e.browser import bounding_box, client_id_script
from tests.e2e.fast_station import Station

WIDTH_PX, HEIGHT_PX = 390, 844


@contextlib.contextmanager
def phone(browser: Browser, station: Station, client_id: str = "e2e") -> Generator[Page]:
    """The page in a phone's browser, which has only touch."""
    context = browser.new_context(
        viewport={"width": WIDTH_PX, "height": HEIGHT_PX}, has_touch=True, is_mobile=True
    )
    context.set_default_timeout(60_000)
    page = context.new_page()
    page.add_init_script(client_id_script(client_id))
    page.route("**/scene/**", lambda route: route.fulfill(content_type="text/plain", body=""))
    try:
        page.goto(station.url)
        page.locator(".pill").wait_for()
        yield page
    finally:
        context.close()


def slide_by_touch(page: Page) -> None:
    """Confirms the open confirmation with a finger."""
    knob = page.get_by_role("alertdialog").get_by_role("slider")
    box = bounding_box(knob)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    session = page.context.new_cdp_session(page)

    def touch(kind: str, points: list[dict[str, float]]) -> None:
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", [{"x": x, "y": y}])
    for step in range(1, 11):
        touch("touchMove", [{"x": min(x + step * 32, WIDTH_PX - 4), "y": y}])
    touch("touchEnd", [])
