"""The pytest plugin: `pytest --gcs` flies scenario files as tests, and gives tests a simulated vehicle.

    async def test_the_vehicle_climbs(vehicle, flight):
        await vehicle.takeoff(8)
        await vehicle.until(lambda v: v["status"]["mode"] == "hold")
        flight.must_hold("reaches", position_ned_m=[0, 0, -8])

Each test has a ground station of its own, on simulated time. `@pytest.mark.gcs(wind_ned_m_s=(0, 6, 0))` sets
its conditions. Nothing of the simulator is imported without `--gcs`.
"""

from __future__ import annotations

from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """The plugin's options."""
    group = parser.getgroup("gcs", "flights as tests")
    group.addoption("--gcs", action="store_true", help="fly scenario files, and give tests vehicles")
    group.addoption(
        "--gcs-out", type=Path, metavar="FOLDER", help="write the report of the scenario files to this folder"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Adds the fixtures and the scenario files, if they are asked for."""
    config.addinivalue_line(
        "markers", "gcs(vehicles, px4, seed, wind_ned_m_s, gusts_m_s, faults, parameters, world, speed): "
        "conditions of the simulated flight of a test"
    )  # fmt: skip
    if config.getoption("--gcs"):
        from gcs_server.scenarios import pytest_files, pytest_fixtures

        config.pluginmanager.register(pytest_fixtures, "gcs-fixtures")
        config.pluginmanager.register(pytest_files.ScenarioFiles(config.getoption("--gcs-out")), "gcs-files")
