"""How late the offboard stream's setpoints leave, seen on the wire between server and vehicle."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Iterator

from gcs_server.client import SyncGcs
from tests.station import free_port, running, server, vehicle

from .process import quantiles_ms
from .relay import Relay

RATE_HZ = 50.0
WINDOW_S = 12.0


def lateness_s(arrivals_s: list[float], rate_hz: float) -> tuple[list[float], int]:
    """How late each arrival is on the absolute schedule, and how many of its deadlines were left out.

    An arrival serves the first deadline after the one before; those that passed meanwhile are left out, as
    the stream does it. Nothing comes early, so the schedule is where the phases begin: those of half of all
    arrivals lie close together (on the shortest arc of a period), a few come up to a quarter before them.
    """
    period_s = 1.0 / rate_hz
    phases = sorted(arrival % period_s for arrival in arrivals_s)
    around, half = [*phases, *(phase + period_s for phase in phases)], len(phases) // 2
    dense_s = phases[min(range(len(phases)), key=lambda i: around[i + half] - around[i])]
    before_s = ((dense_s - phase) % period_s for phase in phases)
    start_s = dense_s - max(before for before in before_s if before < period_s / 4)
    late: list[float] = []
    left_out, served = 0, None
    for arrival in arrivals_s:
        slot = math.floor((arrival - start_s) / period_s + 1e-6)
        due = slot if served is None else served + 1
        late.append(arrival - start_s - due * period_s)
        left_out += slot - due
        served = slot
    return late, left_out


def measure(other_vehicles: int) -> tuple[list[float], int]:
    """`lateness_s` over the window while `other_vehicles` × 100 msg/s arrive on a second link."""
    feed_port, link_port = free_port(), free_port()
    links = [f"udpin://127.0.0.1:{link_port}", f"udpin://127.0.0.1:{feed_port}"]
    with contextlib.ExitStack() as running_now:
        relay = running_now.enter_context(Relay(link_port))
        url, _ = running_now.enter_context(server(links))
        running_now.enter_context(vehicle(relay.vehicle_port))
        if other_vehicles:
            command = [sys.executable, "-m", "tests.bench.feed", str(feed_port), str(other_vehicles), "60"]
            running_now.enter_context(running(command))
        gcs = running_now.enter_context(SyncGcs(url, client="bench"))
        drone = gcs.wait_for_vehicle("101", ready=True)
        with drone.offboard(position_ned_m=(0.0, 0.0, -5.0), rate_hz=RATE_HZ, valid_for_s=60):
            time.sleep(1)
            relay.setpoints.clear()
            time.sleep(WINDOW_S)
            arrivals = [arrival for arrival, _ in relay.setpoints]
    return lateness_s(arrivals, RATE_HZ)


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| load | setpoints | left out | lateness ms: p50 / p99 / max |"
    yield "|---|---|---|---|"
    for other_vehicles, words in ((0, "idle"), (50, "5,000 msg/s from 50 other vehicles")):
        late, missed = measure(other_vehicles)
        yield f"| {words} | {len(late)} | {missed} | {quantiles_ms(late)} |"
