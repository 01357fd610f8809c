"""The page in a real Chromium with ten vehicles in flight: loaded bytes, CPU time, heap, frames.

Without a graphics card, WebGL is rendered by the processor in Chromium's GPU process. So that process is
measured separately, and the page is measured again without the 3D view.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import httpx
from playwright.sync_api import Browser, CDPSession, Page, sync_playwright

from tests.station import free_port, is_up, running_process, running_vehicles, server_command, wait_until
from tools.ensure_browser import installed_chromium

from .process import cpu_share, load_average, quantiles_ms

VEHICLES = 10
WARM_UP_S = 15.0
FRAMES_WINDOW_S = 15.0
SCENE_WINDOW_S = 180.0
MAP_WINDOW_S = 60.0
CHROMIUM_FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PARTS: tuple[str, ...] = ("page", "answers of the API", "map", "3D view")
"""`page` is what it needs to show the vehicle: document, scripts, styles, font."""
NOTE_WHEN_SHOWN = """(() => {
  const parts = ['.top button.chip', '.top .pill', 'section[aria-label="Map"]'];
  const isShown = part => (document.querySelector(part)?.getClientRects().length ?? 0) > 0;
  const look = () => {
    const state = document.querySelector('.top .pill')?.textContent ?? 'No vehicle state';
    if (parts.every(isShown) && !state.includes('No vehicle state')) window.shownAt_ms = Date.now();
    else requestAnimationFrame(look);
  };
  if (window === top) requestAnimationFrame(look);
})()"""
"""Notes when the page shows the vehicle, its state and the frame of the map."""
SETTLED_S = 12.0
"""Time for map and 3D view to load after the page is shown."""

_FRAMES = """ms => new Promise(done => {
  const intervals = [];
  let last = performance.now();
  const end = last + ms;
  const frame = now => {
    intervals.push(now - last);
    last = now;
    if (now < end) requestAnimationFrame(frame); else done(intervals.slice(1));
  };
  requestAnimationFrame(frame);
})"""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One run of the page."""

    title: str
    page_share: float
    """CPU share of the page's main thread, including its frames, of one core."""
    script_share: float
    renderer_share: float
    gpu_share: float
    server_share: float
    heap_start_mb: float
    heap_end_mb: float
    """Both heap sizes are measured after a garbage collection."""
    frames_s: list[float]
    load: str


@contextmanager
def flying_vehicles(*, scene: bool) -> Generator[tuple[str, int]]:
    """Ten simulated vehicles hovering at ten metres; yields the page's address and the server's process
    id."""
    udp_port, http_port = free_port(), free_port()
    url = f"http://127.0.0.1:{http_port}"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as data:
        command = server_command(http_port, [f"udpin://127.0.0.1:{udp_port}"], data)
        with (
            running_process([*command, *(() if scene else ("--no-scene",))]) as process,
            running_vehicles(udp_port, instances=VEHICLES),
            httpx.Client(base_url=f"{url}/api/v1", timeout=30) as api,
        ):
            wait_until(lambda: is_up(url), "the server's start")
            wait_until(lambda: len(_vehicle_ids(api)) == VEHICLES, f"{VEHICLES} vehicles")
            for vehicle_id in _vehicle_ids(api):
                path = f"/vehicles/{vehicle_id}"
                wait_until(lambda path=path: api.post(f"{path}/arm").is_success, f"arming {vehicle_id}", 60)
                api.post(f"{path}/takeoff", json={"alt_home_m": 10}).raise_for_status()
            yield url, process.pid


def _vehicle_ids(api: httpx.Client) -> list[str]:
    return [v["id"] for v in api.get("/vehicles").raise_for_status().json()]


class SentBytes:
    """Bytes of a page's HTTP responses as they were sent: compressed, with their headers, without what the
    browser had in its cache. WebSockets do not count."""

    def __init__(self, page: Page) -> None:
        self._urls: dict[str, str] = {}
        self._unix_offset_s = 0.0
        self._finished: list[tuple[float, str, int]] = []
        """Time of the end [s since 1970], URL and size of each response."""
        cdp = page.context.new_cdp_session(page)
        cdp.send("Network.enable")
        cdp.on("Network.requestWillBeSent", self._on_request)
        cdp.on("Network.loadingFinished", self._on_end)

    def _on_request(self, event: dict[str, Any]) -> None:
        self._urls[event["requestId"]] = event["request"]["url"]
        self._unix_offset_s = event["wallTime"] - event["timestamp"]

    def _on_end(self, event: dict[str, Any]) -> None:
        url = self._urls.get(event["requestId"], "")
        if url.startswith("http"):  # otherwise data within a document
            unix_s = event["timestamp"] + self._unix_offset_s
            self._finished.append((unix_s, url, int(event["encodedDataLength"])))

    def by_part(self, until_unix_s: float = math.inf) -> dict[str, int]:
        """Bytes of the responses that ended until a time, by part of the page."""
        sizes = dict.fromkeys(PARTS, 0)
        for unix_s, url, size in self._finished:
            if unix_s <= until_unix_s:
                sizes[_part_of_page(urlsplit(url).path)] += size
        return sizes


def _part_of_page(path: str) -> str:
    """The part of the page that a file belongs to."""
    if path.startswith("/api/"):
        return "answers of the API"
    if path.startswith("/scene/"):
        return "3D view"
    return "map" if any(name in path for name in ("map-engine", "maplibre", "/views-")) else "page"


@dataclass(frozen=True, slots=True)
class Load:
    """Bytes that one load of the page receives, by part."""

    until_shown: dict[str, int]
    in_all: dict[str, int]


def measured_loads(browser: Browser, url: str, loads: int = 2) -> list[Load]:
    """Loads the page and reloads it in the same browser."""
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    page = context.new_page()
    page.add_init_script(NOTE_WHEN_SHOWN)
    measured: list[Load] = []
    for load in range(loads):
        sent = SentBytes(page)
        page.goto(url) if load == 0 else page.reload()
        shown_unix_s = page.wait_for_function("() => window.shownAt_ms").json_value() / 1000
        page.locator("section[aria-label=Map] canvas").first.wait_for(state="visible", timeout=60_000)
        page.wait_for_timeout(SETTLED_S * 1000)
        measured.append(Load(sent.by_part(shown_unix_s), sent.by_part()))
    context.close()
    return measured


def _load_rows(loads: list[Load]) -> Iterator[str]:
    columns = (
        "until vehicle, top bar and frame of the map are shown",
        "with map and 3D view",
        "after a reload",
    )
    yield f"| kB as sent | {' | '.join(columns)} |"
    yield "|---|---|---|---|"
    first, reload = loads[0], loads[-1]
    measured = (first.until_shown, first.in_all, reload.in_all)
    for part in PARTS:
        yield f"| {part} | {' | '.join(f'{sizes[part] / 1000:.1f}' for sizes in measured)} |"
    yield f"| **all** | {' | '.join(f'**{sum(sizes.values()) / 1000:.1f}**' for sizes in measured)} |"


def _metrics(cdp: CDPSession) -> dict[str, float]:
    return {m["name"]: m["value"] for m in cdp.send("Performance.getMetrics")["metrics"]}


def _processes_s(browser: CDPSession) -> dict[str, float]:
    """CPU time by kind of process [s]."""
    cpu_s: dict[str, float] = {}
    for process in browser.send("SystemInfo.getProcessInfo")["processInfo"]:
        cpu_s[process["type"]] = cpu_s.get(process["type"], 0.0) + process["cpuTime"]
    return cpu_s


def _heap_mb(cdp: CDPSession) -> float:
    for _ in range(2):
        cdp.send("HeapProfiler.collectGarbage")
    return _metrics(cdp)["JSHeapUsedSize"] / 1e6


def _measure(title: str, browser: Browser, page: Page, server_pid: int, window_s: float) -> Measurement:
    cdp, browser_cdp = page.context.new_cdp_session(page), browser.new_browser_cdp_session()
    cdp.send("Performance.enable", {"timeDomain": "threadTicks"})  # CPU time, not elapsed time
    page.wait_for_timeout(WARM_UP_S * 1000)
    heap_start_mb = _heap_mb(cdp)
    before, cpu_before_s, began_s = _metrics(cdp), _processes_s(browser_cdp), time.monotonic()
    # No CDP request during the window: its response would be part of the measured CPU time.
    server_share = cpu_share(server_pid, window_s)
    after, cpu_after_s = _metrics(cdp), _processes_s(browser_cdp)
    elapsed_s, load = time.monotonic() - began_s, load_average()
    heap_end_mb = _heap_mb(cdp)
    frames_ms: list[float] = page.evaluate(_FRAMES, FRAMES_WINDOW_S * 1000)

    def share(name: str) -> float:
        return (after[name] - before[name]) / elapsed_s

    def process_share(kind: str) -> float:
        return (cpu_after_s.get(kind, 0.0) - cpu_before_s.get(kind, 0.0)) / elapsed_s

    return Measurement(
        title,
        share("TaskDuration"),
        share("ScriptDuration"),
        process_share("renderer"),
        process_share("GPU"),
        server_share,
        heap_start_mb,
        heap_end_mb,
        [ms / 1000 for ms in frames_ms],
        load,
    )


def _row(measured: Measurement) -> str:
    grown_mb = measured.heap_end_mb - measured.heap_start_mb
    cells = (
        measured.title,
        measured.load,
        f"{measured.page_share:.0%} ({measured.script_share:.0%})",
        f"{measured.renderer_share:.0%}",
        f"{measured.gpu_share:.0%}",
        f"{measured.server_share:.1%}",
        f"{measured.heap_start_mb:.1f} → {measured.heap_end_mb:.1f} ({grown_mb:+.1f})",
        quantiles_ms(measured.frames_s),
    )
    return f"| {' | '.join(cells)} |"


def _open_page(browser: Browser, url: str) -> Page:
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.goto(url)
    page.locator("canvas").first.wait_for(state="visible", timeout=30_000)
    page.wait_for_timeout(5000)
    return page


def table() -> Iterator[str]:
    """Rows of Markdown."""
    loads: list[Load] = []
    rows: list[Measurement] = []
    with sync_playwright() as playwright:
        for scene, title, window_s in (
            (True, "3D and map", SCENE_WINDOW_S),
            (False, "map only", MAP_WINDOW_S),
        ):
            print(f"page: {title}, {window_s:.0f} s", file=sys.stderr, flush=True)
            browser = playwright.chromium.launch(
                executable_path=installed_chromium(), args=list(CHROMIUM_FLAGS)
            )
            with flying_vehicles(scene=scene) as (url, server_pid):
                loads = loads or measured_loads(browser, url)
                page = _open_page(browser, url)
                rows.append(_measure(f"{title}, {window_s:.0f} s", browser, page, server_pid, window_s))
                browser.close()
    yield from _load_rows(loads)
    yield f"\n{VEHICLES} vehicles hovering, 1440 × 900; shares of one core.\n"
    yield (
        "| shown | load average | page's main thread (script) | renderer processes "
        "| GPU process (software WebGL) | server | heap after GC, MB | frame interval ms: p50 / p99 / max |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    yield from map(_row, rows)
