"""Bytes per second of the page's telemetry socket: one vehicle, disarmed on the ground and in flight."""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from collections.abc import Iterator

import httpx
from playwright.sync_api import Page, WebSocket, sync_playwright

from tests.station import free_port, is_up, running_process, running_vehicles, server_command, wait_until
from tools.ensure_browser import installed_chromium

WARM_UP_S = 10.0
WINDOW_S = 20.0


class SocketBytes:
    """Received bytes of a page's telemetry socket, by topic and in total."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._bytes: Counter[str] = Counter()
        page.on("websocket", self._on_socket_opened)

    def over_window(self) -> Counter[str]:
        """Bytes per second during a window from now on."""
        self._bytes.clear()
        self._page.wait_for_timeout(WINDOW_S * 1000)
        return Counter({topic: round(count / WINDOW_S) for topic, count in self._bytes.items()})

    def _on_socket_opened(self, socket: WebSocket) -> None:
        if "/telemetry" in socket.url:
            socket.on("framereceived", self._on_frame_received)

    def _on_frame_received(self, payload: str | bytes) -> None:
        for sample in json.loads(payload).get("samples", ()):
            self._bytes[sample["topic"]] += len(json.dumps(sample, separators=(",", ":")))
        self._bytes["total"] += len(payload)


def _take_off(api: httpx.Client) -> None:
    (only_vehicle,) = api.get("/vehicles").raise_for_status().json()
    path = f"/vehicles/{only_vehicle['id']}"
    wait_until(lambda: api.post(f"{path}/arm").is_success, "arming", 60)
    api.post(f"{path}/takeoff", json={"alt_home_m": 10}).raise_for_status()


def _measure(page: Page, url: str, api: httpx.Client) -> tuple[Counter[str], Counter[str]]:
    """Bytes per second, disarmed and in flight."""
    socket_bytes = SocketBytes(page)
    page.goto(url)
    page.wait_for_timeout(WARM_UP_S * 1000)
    disarmed = socket_bytes.over_window()
    _take_off(api)
    page.wait_for_timeout(WARM_UP_S * 1000)
    return disarmed, socket_bytes.over_window()


def table() -> Iterator[str]:
    """Rows of Markdown: bytes per second, by topic and in total."""
    udp_port, http_port = free_port(), free_port()
    url = f"http://127.0.0.1:{http_port}"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as data, sync_playwright() as playwright:
        command = server_command(http_port, [f"udpin://127.0.0.1:{udp_port}"], data)
        with (
            running_process([*command, "--no-scene"]),
            running_vehicles(udp_port),
            httpx.Client(base_url=f"{url}/api/v1", timeout=30) as api,
        ):
            wait_until(lambda: is_up(url), "the server's start")
            wait_until(lambda: api.get("/vehicles").raise_for_status().json(), "the vehicle")
            browser = playwright.chromium.launch(executable_path=installed_chromium(), args=["--no-sandbox"])
            disarmed, in_flight = _measure(browser.new_page(), url, api)
            browser.close()
    yield f"Bytes a second of the page's telemetry socket, one vehicle, over {WINDOW_S:.0f} s each.\n"
    yield "| topic | disarmed | in flight |"
    yield "|---|---|---|"
    for topic, _ in in_flight.most_common():
        yield f"| {topic} | {disarmed[topic]} | {in_flight[topic]} |"
