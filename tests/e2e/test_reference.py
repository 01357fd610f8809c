"""The API reference at /docs in a browser shows each call, and sends no requests to other sites."""

from __future__ import annotations

import httpx
import pytest

from tests.e2e.browser import PageMonitor, chromium
from tests.station import running_server

pytestmark = [pytest.mark.browser, pytest.mark.story]


def test_the_reference_shows_every_call_and_loads_nothing_from_other_sites() -> None:
    with running_server([]) as (url, _), chromium() as browser:
        paths = httpx.get(f"{url}/api/v1/openapi.json", timeout=30.0).json()["paths"]
        page = browser.new_page()
        monitor = PageMonitor(page, url)
        page.goto(f"{url}/docs")
        page.locator("details").first.wait_for()
        assert page.locator("details").count() == sum(len(methods) for methods in paths.values())
        assert f"curl -sS -X POST {url}/api/v1/vehicles/1/takeoff" in page.locator("main").text_content()
        assert "motors stop, vehicle 1 falls" in page.locator("main").text_content()
        page.get_by_label("Find").fill("takeoff")
        assert page.locator("details:visible").count() == 1
        page.locator("details:visible summary").click()
        assert page.get_by_text("Altitude above home to climb to [m], 1 to 120.").is_visible()
        page.set_viewport_size({"width": 360, "height": 740})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (
            "a narrow page scrolls horizontally"
        )
        monitor.check()
