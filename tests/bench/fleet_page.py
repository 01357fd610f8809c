"""The page with a hundred simulated vehicles: CPU time of list, selection, Hold for all and the 3D
view; memory over five minutes."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
from playwright.sync_api import CDPSession, Page, sync_playwright

from tests.station import free_port, running_server, running_vehicles, wait_until
from tools.ensure_browser import installed_chromium

from .page import CHROMIUM_FLAGS
from .process import cpu_share, load_average

VEHICLES = 100
ALT_HOME_M = 10.0
SETTLE_S, WINDOW_S = 5.0, 15.0
LONG_S = 300.0
"""Time over which memory may not grow."""
PARALLEL_TAKEOFFS = 8
"""Number of vehicles that are armed and take off at the same time."""


@contextlib.contextmanager
def flying_vehicles(count: int) -> Generator[tuple[str, int]]:
    """Flies this many vehicles; yields the page's address and the server's process id."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, process),
        running_vehicles(port, instances=count, arguments=["--no-log"]),
        httpx.Client(base_url=f"{url}/api/v1", timeout=60) as api,
    ):
        wait_until(lambda: len(_vehicles(api)) == count, f"{count} vehicles", 120)

        def take_off(vehicle_id: str) -> None:
            path = f"/vehicles/{vehicle_id}"
            wait_until(lambda: api.post(f"{path}/arm").is_success, f"arming {vehicle_id}", 120)
            api.post(f"{path}/takeoff", json={"alt_home_m": ALT_HOME_M}).raise_for_status()

        with ThreadPoolExecutor(PARALLEL_TAKEOFFS) as pool:
            list(pool.map(take_off, [v["id"] for v in _vehicles(api)]))
        yield url, process.pid


def _vehicles(api: httpx.Client) -> list[dict[str, Any]]:
    return api.get("/vehicles").raise_for_status().json()


class CpuMeter:
    """CPU share of the page's main thread and of the server over a window.

    Args:
        page: the measured page.
        server_pid: the server's process.
    """

    def __init__(self, page: Page, server_pid: int) -> None:
        self._cdp: CDPSession = page.context.new_cdp_session(page)
        self._cdp.send("Performance.enable", {"timeDomain": "threadTicks"})
        self._server_pid = server_pid

    def row(self, title: str, window_s: float = WINDOW_S) -> str:
        """A row of the table for the currently displayed view."""
        time.sleep(SETTLE_S)
        before, began_s = self._metrics(), time.monotonic()
        server_share = cpu_share(self._server_pid, window_s)
        after, elapsed_s = self._metrics(), time.monotonic() - began_s
        main_thread, script = (
            (after[name] - before[name]) / elapsed_s for name in ("TaskDuration", "ScriptDuration")
        )
        return f"| {title} | {load_average()} | {main_thread:.0%} | {script:.0%} | {server_share:.0%} |"

    def heap_mb(self) -> float:
        """The page's objects in memory after a garbage collection [MB]."""
        self._cdp.send("HeapProfiler.collectGarbage")
        return self._metrics()["JSHeapUsedSize"] / 1e6

    def _metrics(self) -> dict[str, float]:
        return {m["name"]: m["value"] for m in self._cdp.send("Performance.getMetrics")["metrics"]}


def _elapsed_ms(page: Page, action: Callable[[], None], condition: str) -> float:
    """Time from an action until a condition (JavaScript) is true in the page [ms]."""
    began_s = time.monotonic()
    action()
    page.wait_for_function(condition, timeout=60_000, polling=20)
    return (time.monotonic() - began_s) * 1000


def table(count: int = VEHICLES) -> Iterator[str]:
    """Rows of Markdown, as they are measured."""
    yield f"{count} vehicles at {ALT_HOME_M:.0f} m, 1280 × 800; shares of one core.\n"
    yield "| shown | load average | page's main thread | of that, script | server |"
    yield "|---|---|---|---|---|"
    with sync_playwright() as playwright, flying_vehicles(count) as (url, server_pid):
        browser = playwright.chromium.launch(executable_path=installed_chromium(), args=list(CHROMIUM_FLAGS))
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url)
        page.locator("canvas").first.wait_for(state="visible", timeout=60_000)
        print(f"page: {count} vehicles", file=sys.stderr, flush=True)
        cpu_meter = CpuMeter(page, server_pid)
        yield cpu_meter.row("3D and map")
        is_listed = f"document.querySelectorAll('section[aria-label=\"Vehicle list\"] li').length === {count}"
        opened_ms = _elapsed_ms(page, lambda: page.keyboard.press("j"), f"() => {is_listed}")
        yield cpu_meter.row("with the list")
        heap_mb = [cpu_meter.heap_mb()]
        yield cpu_meter.row(f"the same over {LONG_S / 60:.0f} min", LONG_S)
        heap_mb.append(cpu_meter.heap_mb())
        last_vehicle = page.get_by_role("list", name="Vehicles found").get_by_role("button").last
        selected_row = "document.querySelector('.row[aria-pressed=true]')"
        is_last_selected = f"() => {selected_row} === document.querySelector('li:last-child .row')"
        selected_ms = _elapsed_ms(page, last_vehicle.click, is_last_selected)
        hold_button = page.get_by_role("button", name="Hold all flying")
        with httpx.Client(base_url=f"{url}/api/v1", timeout=60) as api:
            began_s = time.monotonic()
            hold_button.click()
            wait_until(lambda: all(v["status"]["mode"] == "hold" for v in _vehicles(api)), "Hold", 120)
            hold_ms = (time.monotonic() - began_s) * 1000
        browser.close()
    yield f"\nList shown after {opened_ms:.0f} ms, another vehicle selected after {selected_ms:.0f} ms."
    yield f"Heap after GC: {heap_mb[0]:.1f} MB, {LONG_S / 60:.0f} min later {heap_mb[1]:.1f} MB."
    yield f"Hold all: the last vehicle showed Hold after {hold_ms:.0f} ms."
