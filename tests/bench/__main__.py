"""Prints the tables of measurements: `make bench`, or `python -m tests.bench NAME …` for some of them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

from . import (
    browser_cost,
    consumers,
    dry_run,
    faults,
    findings,
    fleet_page,
    flight_spread,
    futures,
    guard,
    large_log,
    latency,
    log_download,
    page,
    reference_flights,
    ros2_flights,
    ros2_setpoints,
    setpoints,
    simulator,
    slow_browser,
    slow_link,
    startup,
    stream,
    telemetry_bytes,
    trajectories,
    what_if,
)

SECTIONS: dict[str, tuple[str, Callable[[], Iterator[str]]]] = {
    "startup": ("Start-up, CPU", startup.table),
    "latency": ("Round trips and latency", latency.table),
    "setpoints": ("Setpoint to datagram", setpoints.table),
    "guard": ("A guarded link", guard.table),
    "stream": ("Offboard stream, lateness", stream.table),
    "ros2_stream": ("A stream over ROS 2 and over MAVLink", ros2_setpoints.table),
    "slow_link": ("A slow link under load", slow_link.table),
    "simulator": ("Simulated PX4", simulator.table),
    "flights": ("Reference flights, simulated PX4 / real PX4", reference_flights.table),
    "ros2": ("Flights from ROS 2 messages, simulated PX4 / real PX4", ros2_flights.table),
    "faults": ("Faults, simulated PX4 / real PX4", faults.table),
    "findings": ("Findings of simulated flights", findings.table),
    "large_log": ("A ULog of 100 MB with an hour", large_log.table),
    "log_download": ("Download of a log by FTP", log_download.table),
    "spread": ("Differences of repeated flights, simulated PX4 / real PX4", flight_spread.table),
    "dry_run": ("Dry runs", dry_run.table),
    "consumers": ("Server CPU compared with pymavlink and MAVProxy, same feed", consumers.table),
    "browser_cost": ("Server CPU for one open browser", browser_cost.table),
    "slow_browser": ("A browser that does not read", slow_browser.table),
    "telemetry": ("Telemetry of one vehicle", telemetry_bytes.table),
    "trajectories": ("Trajectories, this solver compared with libraries", trajectories.table),
    "futures": ("Futures of random commands beside their flights", futures.table),
    "what_if": ("Reruns of logged flights, and identified aircraft", what_if.table),
    "page": ("The page in a browser", page.table),
    "fleet_page": ("The page with a hundred vehicles", fleet_page.table),
}


def main(selected: list[str]) -> int:
    unknown = [name for name in selected if name not in SECTIONS]
    if unknown:
        print(f"no such section: {', '.join(unknown)}; there are {', '.join(SECTIONS)}", file=sys.stderr)
        return 2
    for name, (title, table) in SECTIONS.items():
        if not selected or name in selected:
            print(f"\n## {title}\n", flush=True)
            for row in table():
                print(row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
