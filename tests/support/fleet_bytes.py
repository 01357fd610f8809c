"""Digests of all bytes that the vehicles of a fleet send. All vehicles arm and take off; the vehicles with an
even instance number then lose GPS."""

from __future__ import annotations

import hashlib

from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import frame_v2
from vehicle_sim.simulation import row_east

ARM_AT_FRACTION = 0.6
"""When the vehicles are armed, as a fraction of the simulated time. EKF2 is ready six seconds after boot: in
a simulation of less than 10 s the vehicles cannot be armed."""
GPS_LOSS_AT_FRACTION = 0.8
"""When the even instances lose GPS, as a fraction of the simulated time."""
TICK_S = 0.02
ARM, TAKEOFF = 400, 22
"""MAV_CMD_COMPONENT_ARM_DISARM and MAV_CMD_NAV_TAKEOFF."""


def digests(first: int, count: int, seconds: float, seed: int = 11) -> dict[int, str]:
    """Flies instances `first` to `first + count - 1`; returns for each instance a digest of all bytes on both
    links."""
    sim = SimulatedFleet(count, first_instance=first, seed=seed, start_ned_m=row_east(count, first))
    hashes = {first + row: hashlib.sha256() for row in range(count)}
    target_amsl_m = sim.simulation.origin.alt_amsl_m + 10.0
    steps = round(seconds / TICK_S)
    for step in range(steps):
        for row in range(count):
            if step == round(ARM_AT_FRACTION * steps):
                _command(sim, row, ARM, 1.0)
                _command(sim, row, TAKEOFF, *[float("nan")] * 6, target_amsl_m)
            if step == round(GPS_LOSS_AT_FRACTION * steps) and (first + row) % 2 == 0:
                sim.set_parameter(row, "SIM_GPS_USED", 3)
        sim.step(TICK_S)
        for row in range(count):
            for link in ("gcs", "api"):
                hashes[first + row].update(sim.drain(row, link))
    return {instance: digest.hexdigest() for instance, digest in hashes.items()}


def _command(sim: SimulatedFleet, row: int, command_id: int, *parameters: float) -> None:
    values = {f"param{n + 1}": value for n, value in enumerate(parameters)}
    target = {"target_system": sim.nodes[row].system_id, "target_component": 1}
    layout, payload = pack("COMMAND_LONG", command=command_id, **target, **values)
    sequence_number, station_ids = command_id & 0xFF, (255, 190)
    sim.feed(row, "gcs", frame_v2(layout, payload, sequence_number, *station_ids))
