"""What the simulated PX4 costs: share of a core in real time with all streams, and its fastest factor."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator

from tests.station import free_port, vehicle

from .process import cpu_share

WINDOW_S = 8.0

_HEADLESS = """
import sys, time
from vehicle_sim.simulation import Simulation
count, steps = int(sys.argv[1]), int(sys.argv[2])
simulation = Simulation(count)
for _ in range(200):
    simulation.step()
began = time.perf_counter()
for _ in range(steps):
    simulation.step()
print((time.perf_counter() - began) / steps)
"""


def real_time_share(vehicles: int) -> float:
    """CPU share (1 = one core) of the simulator process in real time, streaming to a port nobody reads."""
    with vehicle(free_port(), instances=vehicles) as process:
        time.sleep(4)
        return cpu_share(process.pid, WINDOW_S)


def step_cost_s(vehicles: int) -> float:
    """Seconds a 4 ms step of physics and control takes for so many vehicles."""
    steps = 2000 if vehicles <= 10 else 500
    command = [sys.executable, "-c", _HEADLESS, str(vehicles), str(steps)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def table() -> Iterator[str]:
    """Rows of Markdown."""
    yield "| vehicles | physics and control, µs a step | fastest factor | CPU in real time, streaming |"
    yield "|---|---|---|---|"
    for vehicles in (1, 10, 100):
        cost = step_cost_s(vehicles)
        share = f"{real_time_share(vehicles):.1%}" if vehicles <= 10 else "–"
        yield f"| {vehicles} | {cost * 1e6:.0f} | {0.004 / cost:.1f} | {share} |"
