"""One vehicle of the simulation, as its autopilot and telemetry read it: estimate, parameters and clocks.

Reading single elements of NumPy arrays is slow in Python, so the estimates are converted to plain numbers all
at once (`Simulation.estimates`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from vehicle_sim.parameters import Parameters, ParameterValue, UnknownParameterError
from vehicle_sim.simulation import Simulation
from vehicle_sim.state import Vector, VehicleEstimate

__all__ = ["Vector", "VehicleEstimate", "VehicleView"]

Number = TypeVar("Number", float, int)


class _ParameterCache(dict[str, Number], Generic[Number]):
    """Parameters converted to one type. An autopilot reads 70 parameters per step, and a dictionary returns a
    stored value four times as fast as a method."""

    def __init__(self, read: Callable[[str], Number]) -> None:
        super().__init__()
        self._read = read

    def __missing__(self, name: str) -> Number:
        value = self[name] = self._read(name)
        return value


class VehicleView:
    """The vehicle in one row of a simulation."""

    def __init__(self, simulation: Simulation, row: int, boot_time_unix_s: float) -> None:
        self.simulation = simulation
        self.row = row
        self.parameters: Parameters = simulation.parameters[row]
        self.px4 = self.parameters.px4
        """The version of PX4 that the vehicle simulates."""
        self.boot_time_unix_s = boot_time_unix_s
        self._floats = _ParameterCache[float](lambda name: float(self.parameters.get(name)))
        self._choices = _ParameterCache[int](lambda name: int(self.parameters.get(name)))
        self.parameter: Callable[[str], float] = self._floats.__getitem__
        """A parameter's value as a float."""
        self.choice: Callable[[str], int] = self._choices.__getitem__
        """An integer parameter's value, such as the number of a choice."""
        self.parameter_changes = 0
        """Increases with each parameter change, so that values derived from parameters are computed again."""
        self.parameters.add_listener(self._clear_caches)

    @property
    def time_s(self) -> float:
        """Simulated time since boot."""
        return self.simulation.time_s

    def time_boot_ms(self) -> int:
        """Time since boot in whole milliseconds, as in PX4's messages."""
        return int(self.simulation.time_s * 1000.0 + 1e-6)

    def time_boot_us(self) -> int:
        """Time since boot in microseconds."""
        return int(self.simulation.time_s * 1e6 + 0.5)

    def time_unix_us(self) -> int:
        """The vehicle's clock: UTC in microseconds since 1970."""
        return int((self.boot_time_unix_s + self.simulation.time_s) * 1e6)

    def _clear_caches(self, _name: str, _value: ParameterValue) -> None:
        self.parameter_changes += 1
        self._floats.clear()
        self._choices.clear()

    def optional_choice(self, name: str, default: int) -> int:
        """An integer parameter, or `default` if the vehicle has no such parameter."""
        try:
            return self.choice(name)
        except UnknownParameterError:
            return default

    @property
    def estimate(self) -> VehicleEstimate:
        """The vehicle's estimate after the last step."""
        return self.simulation.estimates[self.row]

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude, longitude [deg] and altitude AMSL [m] of the local origin; NaN before the first good GPS
        fix."""
        estimate, i = self.simulation.estimate, self.row
        return (
            float(estimate.origin_lat_deg[i]),
            float(estimate.origin_lon_deg[i]),
            float(estimate.origin_alt_amsl_m[i]),
        )
