"""Lateness of the offboard stream's setpoints, measured between server and vehicle."""

from __future__ import annotations

import contextlib
import math
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass

from playwright.sync_api import sync_playwright

from gcs_server.client import ApiError, SyncGcs, SyncVehicle
from tests.station import free_port, running_process, running_server, running_vehicles
from tools.ensure_browser import installed_chromium

from .page import CHROMIUM_FLAGS
from .process import load_average, quantiles_ms
from .relay import Relay

RATE_HZ = 50.0
WINDOW_S = 12.0
MAVSDK_RATE_HZ = 20.0
LOAD_S = "120"
"""Duration of the other processes; longer than a measurement, which ends them."""


def lateness_s(arrivals_s: list[float], rate_hz: float) -> tuple[list[float], int]:
    """Lateness of each arrival [s] on a schedule with a fixed period, and the number of skipped deadlines.

    Each arrival is late for the first deadline after that of the previous arrival; deadlines that passed in
    between are skipped, as the stream skips them. No arrival is early, so the schedule begins at the earliest
    phase. Outliers are ignored: the earliest phase is at most a quarter of a period before the shortest part
    of the period that contains half of all arrivals.
    """
    period_s = 1.0 / rate_hz
    phases = sorted(arrival % period_s for arrival in arrivals_s)
    two_periods_s, half = [*phases, *(phase + period_s for phase in phases)], len(phases) // 2
    dense_s = phases[min(range(len(phases)), key=lambda i: two_periods_s[i + half] - two_periods_s[i])]
    before_s = ((dense_s - phase) % period_s for phase in phases)
    start_s = dense_s - max(before for before in before_s if before < period_s / 4)
    late: list[float] = []
    skipped, last_slot = 0, None
    for arrival in arrivals_s:
        slot = math.floor((arrival - start_s) / period_s + 1e-6)
        due = slot if last_slot is None else last_slot + 1
        late.append(arrival - start_s - due * period_s)
        skipped += slot - due
        last_slot = slot
    return late, skipped


@dataclass(frozen=True, slots=True)
class Load:
    """The load while the streams run."""

    title: str
    streams: int = 1
    other_vehicles: int = 0
    """Number of vehicles on a second link; each sends 100 messages per second."""
    watchers: int = 0
    """WebSocket clients that read all telemetry."""
    page: bool = False
    """Whether one Chromium shows the page's 3D view."""
    mavsdk: bool = False
    """Whether MAVSDK also streams, to another vehicle."""
    futures: bool = False
    """Whether a client asks for the futures of a setpoint, one after another."""


LOADS = (
    Load("idle"),
    Load("futures of a setpoint, one after another", futures=True),
    Load("5,000 msg/s from 50 other vehicles", other_vehicles=50),
    Load("ten streams, 5,000 msg/s from 50 others, ten WebSocket clients", 10, 50, 10),
    Load("the same and one Chromium with the 3D view", 10, 50, 10, page=True, mavsdk=True),
)


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Arrival times of setpoints in the window."""

    streams: list[list[float]]
    mission: list[float]
    """Arrivals of an offboard mission that another vehicle flies at the same time."""
    mavsdk: list[float]
    """Arrivals of MAVSDK's streamer; empty if it does not stream."""
    futures_s: list[float]
    """Time of each answer with futures [s]."""


MISSION_VEHICLE = 101
MISSION = {
    "name": "bench",
    "actions": {"control_lost": "continue"},
    "steps": [
        {"step": "take_off", "height_m": 5},
        {
            "step": "figure_eight",
            "center": {"offset_ned_m": [0, 0, -5]},
            "length_m": 60,
            "width_m": 30,
            "rounds": 20,
            "heading": "along_path",
        },
        {"step": "land"},
    ],
}


def measure(load: Load) -> Arrivals:
    """Measures all streams and the mission under this load."""
    feed_port, link_port = free_port(), free_port()
    links = [f"udpin://127.0.0.1:{link_port}", f"udpin://127.0.0.1:{feed_port}"]
    with contextlib.ExitStack() as stack:
        relay = stack.enter_context(Relay(link_port))
        url, _ = stack.enter_context(running_server(links))
        stack.enter_context(running_vehicles(relay.vehicle_port, instances=load.streams + 1))
        if load.other_vehicles:
            command = [
                sys.executable,
                "-m",
                "tests.bench.feed",
                str(feed_port),
                str(load.other_vehicles),
                LOAD_S,
            ]
            stack.enter_context(running_process(command))
        if load.watchers:
            command = [sys.executable, "-m", "tests.bench.watchers", url, str(load.watchers), LOAD_S]
            stack.enter_context(running_process(command))
        gcs = stack.enter_context(SyncGcs(url, client="bench"))
        mission_vehicle = gcs.wait_for_vehicle(str(MISSION_VEHICLE), ready=True)
        mission_vehicle.offboard_mission.start(MISSION)
        mission_vehicle.until(lambda v: v["status"]["mode"] == "offboard", what="the mission's path")
        for number in range(1, load.streams + 1):
            drone = gcs.wait_for_vehicle(str(MISSION_VEHICLE + number), ready=True)
            if load.futures:
                drone.arm()
                drone.takeoff(5.0)
                drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")
            stack.enter_context(
                drone.offboard(position_ned_m=(0.0, 0.0, -5.0), rate_hz=RATE_HZ, valid_for_s=300)
            )
        if load.page:
            stack.enter_context(browser_showing_scene(url))
        mavsdk_relay = stack.enter_context(mavsdk_streaming()) if load.mavsdk else None
        time.sleep(1)
        for each in filter(None, (relay, mavsdk_relay)):
            each.setpoints.clear()
        futures_s: list[float] = []
        if load.futures:
            futures_s = flying_futures_s(gcs.vehicle(str(MISSION_VEHICLE + 1)), WINDOW_S)
        else:
            time.sleep(WINDOW_S)
        arrivals = relay.arrivals_s()
        mission = arrivals.pop(MISSION_VEHICLE, [])
        mavsdk = [] if mavsdk_relay is None else _longest_stream_s(mavsdk_relay)
        return Arrivals(list(arrivals.values()), mission, mavsdk, futures_s)


def flying_futures_s(drone: SyncVehicle, duration_s: float) -> list[float]:
    """Asks for futures one after another; the time of each answer [s]."""
    end_s, times_s = time.monotonic() + duration_s, list[float]()
    while (begin_s := time.monotonic()) < end_s:
        drone.futures(setpoint={"type": "position", "position_ned_m": [20, 0, -8]}, horizon_s=20)
        times_s.append(time.monotonic() - begin_s)
    return times_s


@contextlib.contextmanager
def browser_showing_scene(url: str) -> Generator[None]:
    """Opens the 3D view in a real browser."""
    executable = installed_chromium()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=str(executable) if executable else None, args=list(CHROMIUM_FLAGS)
        )
        try:
            page = browser.new_page()
            page.goto(f"{url}/scene/?view=bench&mode=free")
            time.sleep(5)
            yield
        finally:
            browser.close()


@contextlib.contextmanager
def mavsdk_streaming() -> Generator[Relay]:
    """Runs MAVSDK's streamer (20 Hz, fixed) and a vehicle with a relay between them."""
    port = free_port()
    with Relay(port) as relay, running_vehicles(relay.vehicle_port):
        command = [sys.executable, "-W", "ignore", "-m", "tests.bench.mavsdk_streamer", str(port)]
        with running_process(command, stdout=subprocess.PIPE) as streamer:
            assert streamer.stdout is not None
            streamer.stdout.readline()  # it streams
            yield relay


def _longest_stream_s(relay: Relay) -> list[float]:
    return max(relay.arrivals_s().values(), key=len, default=[])


def mavsdk_idle_s() -> list[float]:
    """Arrivals of MAVSDK's stream without any other load."""
    with mavsdk_streaming() as relay:
        time.sleep(1)
        relay.setpoints.clear()
        time.sleep(WINDOW_S)
        return _longest_stream_s(relay)


def row(title: str, streams: list[list[float]], rate_hz: float) -> str:
    """One row of Markdown."""
    late: list[float] = []
    skipped = 0
    for arrivals in streams:
        stream_late, stream_skipped = lateness_s(arrivals, rate_hz)
        late += stream_late
        skipped += stream_skipped
    return f"| {title} | {load_average()} | {len(late)} | {skipped} | {quantiles_ms(late)} |"


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| when | load average | setpoints | skipped | lateness ms: p50 / p99 / max |"
    yield "|---|---|---|---|---|"
    for load in LOADS:
        try:
            arrivals = measure(load)
        except ApiError as error:  # the machine is too slow for this load
            yield f"| {load.title} | {load_average()} | – | – | not measured: {str(error).splitlines()[0]} |"
            continue
        yield row(load.title, arrivals.streams, RATE_HZ)
        yield row("an offboard mission in flight at the same time", [arrivals.mission], RATE_HZ)
        if arrivals.futures_s:
            count, times_ms = len(arrivals.futures_s), quantiles_ms(arrivals.futures_s)
            yield f"| … each answer with futures | – | {count} | – | {times_ms} |"
        if load.mavsdk:
            yield row("MAVSDK's streamer at its 20 Hz, at the same time", [arrivals.mavsdk], MAVSDK_RATE_HZ)
    yield row("MAVSDK's streamer, idle", [mavsdk_idle_s()], MAVSDK_RATE_HZ)
