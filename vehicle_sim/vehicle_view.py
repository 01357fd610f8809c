"""One vehicle's row of the simulation as plain floats, read once a step however many ask.

Reading single elements of NumPy arrays is the main cost of a Python autopilot, so it is done only here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from vehicle_sim.frames import angles_of
from vehicle_sim.parameters import Parameters, ParameterValue, UnknownParameterError
from vehicle_sim.simulation import Simulation

Vector = tuple[float, float, float]
Number = TypeVar("Number", float, int)


class VehicleEstimate(NamedTuple):
    """What the estimator says now; NED, FRD, SI."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector
    q_ned_frd: tuple[float, float, float, float]
    rates_frd_rad_s: Vector
    roll_rad: float
    pitch_rad: float
    yaw_ned_rad: float
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    height_above_ground_m: float
    """By the range finder; NaN: not known."""
    valid_position: bool
    valid_velocity: bool
    valid_attitude: bool
    valid_altitude: bool


class _Known(dict[str, Number], Generic[Number]):
    """Parameters as one type, each converted once: a dictionary answers an autopilot's 70 questions a tick
    four times as fast as a method does."""

    def __init__(self, read: Callable[[str], Number]) -> None:
        super().__init__()
        self._read = read

    def __missing__(self, name: str) -> Number:
        value = self[name] = self._read(name)
        return value


class VehicleView:
    """Vehicle `row` of a simulation, for its autopilot and its telemetry."""

    def __init__(self, simulation: Simulation, row: int, boot_time_unix_s: float) -> None:
        self.simulation = simulation
        self.row = row
        self.parameters: Parameters = simulation.parameters[row]
        self.boot_time_unix_s = boot_time_unix_s
        self._estimate: VehicleEstimate | None = None
        self._floats = _Known[float](lambda name: float(self.parameters.get(name)))
        self._choices = _Known[int](lambda name: int(self.parameters.get(name)))
        self.parameter: Callable[[str], float] = self._floats.__getitem__
        """A parameter's value as a float."""
        self.choice: Callable[[str], int] = self._choices.__getitem__
        """An integer parameter's value."""
        self.parameter_changes = 0
        """Rises with each parameter change, so that values derived from parameters are computed again."""
        self.parameters.add_listener(self._forget)
        self._step = -1

    @property
    def time_s(self) -> float:
        """Since boot."""
        return self.simulation.time_s

    def time_boot_ms(self) -> int:
        """Since boot, whole milliseconds as PX4's messages carry it."""
        return int(self.simulation.time_s * 1000.0 + 1e-6)

    def time_boot_us(self) -> int:
        """Since boot, microseconds."""
        return int(self.simulation.time_s * 1e6 + 0.5)

    def time_unix_us(self) -> int:
        """UTC as the vehicle believes it."""
        return int((self.boot_time_unix_s + self.simulation.time_s) * 1e6)

    def _forget(self, _name: str, _value: ParameterValue) -> None:
        self.parameter_changes += 1
        self._floats.clear()
        self._choices.clear()

    def optional_choice(self, name: str, default: int) -> int:
        """An integer parameter that not every build has among its live ones."""
        try:
            return self.choice(name)
        except UnknownParameterError:
            return default

    @property
    def estimate(self) -> VehicleEstimate:
        """The estimate of this step."""
        step = self.simulation.steps
        if self._estimate is None or self._step != step:
            self._estimate, self._step = self._read(), step
        return self._estimate

    def _read(self) -> VehicleEstimate:
        rows, i = self.simulation.estimate_rows, self.row
        w, x, y, z = rows.q_ned_frd[i]
        north, east, down = rows.position_ned_m[i]
        vn, ve, vd = rows.velocity_ned_m_s[i]
        an, ae, ad = rows.acceleration_ned_m_s2[i]
        roll_rate, pitch_rate, yaw_rate = rows.rates_frd_rad_s[i]
        # In the order of the fields: naming them takes a third of the time again.
        return VehicleEstimate(
            (north, east, down), (vn, ve, vd), (an, ae, ad), (w, x, y, z),
            (roll_rate, pitch_rate, yaw_rate), *angles_of((w, x, y, z)),
            rows.lat_deg[i], rows.lon_deg[i], rows.alt_amsl_m[i], rows.height_above_ground_m[i],
            rows.valid_position[i], rows.valid_velocity[i], rows.valid_attitude[i], rows.valid_altitude[i],
        )  # fmt: skip

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude, longitude, altitude of the local origin; NaN until GPS set it."""
        estimate, i = self.simulation.estimate, self.row
        return (
            float(estimate.origin_lat_deg[i]),
            float(estimate.origin_lon_deg[i]),
            float(estimate.origin_alt_amsl_m[i]),
        )
