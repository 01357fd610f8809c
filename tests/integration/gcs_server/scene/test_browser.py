"""The 3D view in a browser: viser's page runs behind this server's port and connects to no other address."""

from __future__ import annotations

import json
import math
import time

import pytest

from tools.ensure_browser import installed_chromium

playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
BROWSER_FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]


def ground_distance_m(click) -> float:
    north_m = (click.lat_deg - 47.397742) * 111_177  # metres per degree of latitude
    return math.hypot(north_m, (click.lon_deg - 8.545594) * 75_400)  # of longitude, at this latitude


def send_and_wait(page, message) -> None:
    """Sends a message to the frame; returns when the frame has received it (messages keep their order)."""
    page.evaluate(
        "(message) => new Promise((resolve) => {"
        " frames[0].addEventListener('message', (event) => { if (event.data.isLast) resolve(); });"
        " for (const each of [message, { isLast: true }]) frames[0].postMessage(each, location.origin); })",
        message,
    )


def wait_for(page, condition) -> None:
    """Waits for a condition; `time.sleep` would stop Playwright's event loop."""
    end_s = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < end_s
        page.wait_for_timeout(50)


@pytest.mark.story
@pytest.mark.browser
def test_the_view_runs_in_a_frame_and_connects_only_to_this_server(scene_server):
    requested_urls: list[str] = []
    errors: list[str] = []
    with playwright.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=installed_chromium(), args=BROWSER_FLAGS)
        page = browser.new_page(viewport={"width": 372, "height": 250})
        page.on("request", lambda r: requested_urls.append(r.url))
        page.on("websocket", lambda w: requested_urls.append(w.url))
        page.on("pageerror", lambda e: errors.append(str(e)))
        page.route(
            scene_server.url.replace("/scene/", "/host"),
            lambda route: route.fulfill(
                content_type="text/html",
                body='<iframe src="/scene/?view=frame&theme=dark" style="width:350px;height:230px"></iframe>',
            ),
        )
        page.goto(scene_server.url.replace("/scene/", "/host"))
        frame = page.frame_locator("iframe")
        tag = frame.locator(".gcs-tags span", has_text="1 · 10.0 m above home")
        tag.wait_for(state="visible", timeout=15_000)
        assert "simulated" in tag.inner_text()
        # The chased vehicle and its tag are in the middle of the frame: 350 px wide, after a margin of 8 px.
        first_box = tag.bounding_box()
        assert abs(first_box["x"] + first_box["width"] / 2 - (8 + 175)) < 60
        # Panels cover the left half of the frame: the page sends the middle of the free area, and the vehicle
        # moves there.
        page.evaluate("frames[0].postMessage({ gcsMiddle: [0.25, -0.1] }, location.origin)")
        wait_for(page, lambda: tag.bounding_box()["x"] - first_box["x"] > 0.2 * 350)
        assert first_box["y"] - tag.bounding_box()["y"] == pytest.approx(23, abs=8)
        page.evaluate("frames[0].postMessage({ gcsMiddle: [0, 0] }, location.origin)")
        wait_for(page, lambda: abs(tag.bounding_box()["x"] - first_box["x"]) < 0.05 * 350)
        assert frame.locator(".mantine-Paper-root:visible").count() == 0
        canvas = page.frames[1].locator("canvas").first.bounding_box()
        ground_px = (canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] * 0.9)
        camera_position = "() => [...window.__viserMutable.camera.position]"
        position_before = page.frames[1].evaluate(camera_position)
        page.mouse.move(*ground_px)
        page.mouse.down()
        page.mouse.move(ground_px[0] + 60, ground_px[1] - 10, steps=6)
        page.mouse.up()
        # A drag turns the camera and is not a click.
        wait_for(page, lambda: math.dist(position_before, page.frames[1].evaluate(camera_position)) > 0.1)
        assert scene_server.clicks == []
        page.mouse.click(ground_px[0], canvas["y"] + 3)  # the sky
        page.mouse.click(*ground_px)
        wait_for(page, lambda: scene_server.clicks)
        (click,) = scene_server.clicks
        assert (click.view, click.vehicle) == ("frame", "1")
        assert click.alt_amsl_m == pytest.approx(488.0)
        assert 2.0 < ground_distance_m(click) < 60.0  # the vehicle hovers ten metres above home
        assert (click.view_x, click.view_y) == pytest.approx((0.5, 0.9), abs=0.01)
        # While a plan is edited, the page knows the origin of the view, and the page alone receives clicks.
        root = page.frames[1].locator("html")
        assert root.get_attribute("data-gcs-origin") == "47.397742000,8.545594000,488.000"
        page.evaluate(
            "() => addEventListener('message', (event) => { window.clicked = event.data.gcsClick; })"
        )
        send_and_wait(page, {"gcsEditing": True})
        page.mouse.click(*ground_px)
        wait_for(page, lambda: page.evaluate("window.clicked"))
        assert page.evaluate("window.clicked") == pytest.approx(
            [ground_px[0] - canvas["x"], ground_px[1] - canvas["y"]], abs=1
        )
        assert len(scene_server.clicks) == 1
        page.evaluate(
            "body => fetch('/scene/view/frame', "
            "{method: 'POST', body, headers: {'Content-Type': 'application/json'}})",
            json.dumps({"theme": "light"}),
        )
        frame.locator('html[data-gcs-theme="light"]').wait_for(state="attached", timeout=8_000)
        browser.close()
    own_address = f"127.0.0.1:{scene_server.port}/"
    network_urls = [u for u in requested_urls if not u.startswith(("data:", "blob:"))]
    foreign_urls = [u for u in network_urls if not u.split("://", 1)[1].startswith(own_address)]
    assert foreign_urls == []
    assert any(u.startswith("ws://") for u in requested_urls)
    assert errors == []
