"""The ULog of a simulated flight with a step, for what is done with logs of flights."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.parameters import Parameters
from vehicle_sim.storage.files import VehicleFiles

SET_MODE, OFFBOARD = 176, 6


def flown_log(
    folder: Path, wind_ned_m_s: tuple[float, float, float], parameters: Mapping[str, float] | None = None
) -> tuple[Path, float]:
    """A vehicle takes off, hovers in wind, and steps 8 m north by offboard setpoints.

    Args:
        folder: the vehicle's files.
        wind_ned_m_s: steady wind from the hover on.
        parameters: with other values than PX4's.

    Returns:
        The log, and the time of the step [s since the log's start].
    """
    station = Station(log=True, files=[VehicleFiles(folder)], stores=[Parameters(parameters)])
    station.take_off_and_hover(6.0)
    station.sim.simulation.set_wind(np.array(wind_ned_m_s))
    north_m = 0.0

    def send() -> None:
        station.send(
            "SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1, coordinate_frame=1,
            type_mask=0b100111111000, x=north_m, z=-6.0,
        )  # fmt: skip

    station.run(1.0, send)
    station.command(SET_MODE, 1, OFFBOARD)
    station.run(9.0, send)
    logger = station.sim.loggers[0]
    north_m, step_s = 8.0, station.now_s - logger.started_at_us / 1e6
    station.run(8.0, send)
    assert logger.path is not None
    return folder / logger.path, step_s
