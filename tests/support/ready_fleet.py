"""Simulated vehicles that stand in a row and are ready to arm."""

from __future__ import annotations

import numpy as np

from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.fleet import SimulatedFleet

READY_WITHIN_S = 40.0


def row_of_ready_vehicles(count: int, apart_m: float) -> SimulatedFleet:
    """Vehicles 1, 2, …, each `apart_m` east of the previous one; the bytes of their start are discarded.

    Raises:
        AssertionError: a vehicle cannot be armed in time.
    """
    positions_ned_m = np.zeros((count, 3))
    positions_ned_m[:, 1] = apart_m * np.arange(count)
    sim = SimulatedFleet(count, links=(("gcs", "gcs"),), seed=3, start_ned_m=positions_ned_m)
    while not all(autopilot.commander.report.armable(NavState.TAKEOFF) for autopilot in sim.autopilots):
        assert sim.time_s < READY_WITHIN_S
        sim.step(0.5)
    for row in range(count):
        sim.drain(row, "gcs")
    return sim
