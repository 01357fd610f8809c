"""CPU time of the server for one open browser, compared with another version of the project in the same run.

`python -m tests.bench.browser_cost [ROUNDS [OTHER_TREE]]`: OTHER_TREE is a checkout with its own `.venv`.
Both servers get the same moving feed at the same time, and their CPU time is read over the same
windows, so that the machine's other load affects both equally.
"""

from __future__ import annotations

import contextlib
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from tests.station import free_port, is_up, running_process, server_command, wait_until

from .process import load_average, tree_cpu_s
from .slow_browser import VEHICLES, open_scene, open_telemetry

WARM_UP_S = 3.0
WINDOW_S = 6.0
ROUNDS = 5
FEED_S = 3600.0
"""Longer than any measurement, which ends the feed."""

CONNECTIONS: dict[str, tuple[Callable[[str], ClientConnection], ...]] = {
    "nothing": (),
    "telemetry of all at 20 Hz": (open_telemetry,),
    "the 3D view": (open_scene,),
    "telemetry and the 3D view": (open_telemetry, open_scene),
}
"""Open connections of the browser, by case; each case is measured once per round."""


@dataclass(frozen=True, slots=True)
class RunningServer:
    """A server of one version of the project."""

    name: str
    url: str
    pid: int


def _start_server(
    stack: contextlib.ExitStack, name: str, python: str, tree: Path | None, port: int
) -> RunningServer:
    data = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
    http_port = free_port(socket.SOCK_STREAM)
    _, *arguments = server_command(http_port, [f"udpin://127.0.0.1:{port}"], data)
    process = stack.enter_context(running_process([python, *arguments], cwd=tree))
    url = f"http://127.0.0.1:{http_port}"
    wait_until(lambda: is_up(url), f"the start of the server {name}", 60)
    return RunningServer(name, url, process.pid)


@dataclass(frozen=True, slots=True)
class Usage:
    """CPU time and messages of one server in one window."""

    share: float
    """CPU share of one core, including the server's child processes."""
    scene_messages_per_s: float
    """Messages of the 3D view per second: a server with too little CPU time sends fewer."""


def _count_messages(connection: ClientConnection, received: Counter[str], name: str) -> None:
    with contextlib.suppress(ConnectionClosed):
        for _ in connection:
            received[name] += 1


def _measure_usage(servers: Sequence[RunningServer], case: str) -> dict[str, Usage]:
    """Usage over one window, by the name of the version."""
    received: Counter[str] = Counter()
    with contextlib.ExitStack() as stack:
        for server in servers:
            for connect in CONNECTIONS[case]:
                connection = connect(server.url)
                stack.callback(connection.socket.close)
                name = server.name if connect is open_scene else "telemetry"
                threading.Thread(
                    target=_count_messages, args=(connection, received, name), daemon=True
                ).start()
        time.sleep(WARM_UP_S)
        received.clear()
        cpu_before_s = [tree_cpu_s(server.pid) for server in servers]
        began_s = time.monotonic()
        time.sleep(WINDOW_S)
        cpu_after_s = [tree_cpu_s(server.pid) for server in servers]
        elapsed_s = time.monotonic() - began_s
        scene_messages = Counter(received)
    return {
        server.name: Usage((after_s - before_s) / elapsed_s, scene_messages[server.name] / elapsed_s)
        for server, before_s, after_s in zip(servers, cpu_before_s, cpu_after_s, strict=True)
    }


def measure(rounds: int, other_tree: Path | None) -> Iterator[dict[str, dict[str, Usage]]]:
    """Yields for each round the usage of each version, by case and version."""
    trees = {"now": (sys.executable, None)}
    if other_tree is not None:
        trees = {"before": (str(other_tree / ".venv/bin/python"), other_tree), **trees}
    ports = [free_port() for _ in trees]
    feed = ["-m", "tests.bench.feed", ",".join(map(str, ports)), str(VEHICLES), str(FEED_S), "moving"]
    with contextlib.ExitStack() as stack:
        servers = [
            _start_server(stack, name, python, tree, port)
            for (name, (python, tree)), port in zip(trees.items(), ports, strict=True)
        ]
        feed_process = stack.enter_context(running_process([sys.executable, *feed], stdout=subprocess.PIPE))
        assert feed_process.stdout is not None
        feed_process.stdout.readline()  # the feed is encoded and starts
        for _ in range(rounds):
            yield {case: _measure_usage(servers, case) for case in CONNECTIONS}


def table(rounds: int = ROUNDS, other_tree: Path | None = None) -> Iterator[str]:
    """Rows of Markdown: medians over the rounds of the CPU share that the browser adds, in percent of one
    core."""
    added: dict[str, dict[str, list[float]]] = {}
    scene_messages: dict[str, dict[str, list[float]]] = {}
    for usages in measure(rounds, other_tree):
        for case, usage_by_version in usages.items():
            for name, usage in usage_by_version.items():
                added_share = usage.share - (usages["nothing"][name].share if case != "nothing" else 0.0)
                added.setdefault(case, {}).setdefault(name, []).append(added_share * 100)
                scene_messages.setdefault(case, {}).setdefault(name, []).append(usage.scene_messages_per_s)
    yield f"{VEHICLES} × 100 msg/s, moving; {rounds} rounds of {WINDOW_S:.0f} s, load {load_average()}.\n"
    yield "| open connections | before | now | ratio: median (range) | 3D view, messages/s: before, now |"
    yield "|---|---|---|---|---|"
    for case, added_by_version in added.items():
        now, before = added_by_version["now"], added_by_version.get("before")
        message_rates = [f"{statistics.median(rates):.0f}" for rates in scene_messages[case].values()]
        cells = ["–", f"{statistics.median(now):.1f}", "–", ", ".join(message_rates)]
        if before is not None:
            ratios = [n / b for n, b in zip(now, before, strict=True)]
            cells[0] = f"{statistics.median(before):.1f}"
            cells[2] = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
        yield f"| {case} | {' | '.join(cells)} |"


if __name__ == "__main__":
    rounds_wanted = int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS
    for row in table(rounds_wanted, Path(sys.argv[2]) if len(sys.argv) > 2 else None):
        print(row, flush=True)
