"""One vehicle's row of the simulation as plain floats, read once a step however many ask.

Reading single elements of NumPy arrays is the main cost of a Python autopilot, so it is done only here.
"""

from __future__ import annotations

from typing import NamedTuple

from vehicle_sim.frames import angles_of
from vehicle_sim.parameters import Parameters, ParameterValue, UnknownParameterError
from vehicle_sim.simulation import Simulation

Vector = tuple[float, float, float]


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


class VehicleView:
    """Vehicle `row` of a simulation, for its autopilot and its telemetry."""

    def __init__(self, simulation: Simulation, row: int, boot_time_unix_s: float) -> None:
        self.simulation = simulation
        self.row = row
        self.parameters: Parameters = simulation.parameters[row]
        self.boot_time_unix_s = boot_time_unix_s
        self._estimate: VehicleEstimate | None = None
        self._floats: dict[str, float] = {}
        self._choices: dict[str, int] = {}
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

    def parameter(self, name: str) -> float:
        """A parameter's value as a float."""
        value = self._floats.get(name)
        if value is None:
            value = self._floats[name] = float(self.parameters.get(name))
        return value

    def choice(self, name: str) -> int:
        """An integer parameter's value."""
        value = self._choices.get(name)
        if value is None:
            value = self._choices[name] = int(self.parameters.get(name))
        return value

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
        if self._estimate is None or self._step != self.simulation.steps:
            self._estimate = self._read()
            self._step = self.simulation.steps
        return self._estimate

    def _read(self) -> VehicleEstimate:
        rows, i = self.simulation.estimate_rows, self.row
        w, x, y, z = rows.q_ned_frd[i]
        roll, pitch, yaw = angles_of((w, x, y, z))
        north, east, down = rows.position_ned_m[i]
        vn, ve, vd = rows.velocity_ned_m_s[i]
        an, ae, ad = rows.acceleration_ned_m_s2[i]
        roll_rate, pitch_rate, yaw_rate = rows.rates_frd_rad_s[i]
        return VehicleEstimate(
            position_ned_m=(north, east, down),
            velocity_ned_m_s=(vn, ve, vd),
            acceleration_ned_m_s2=(an, ae, ad),
            q_ned_frd=(w, x, y, z),
            rates_frd_rad_s=(roll_rate, pitch_rate, yaw_rate),
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_ned_rad=yaw,
            lat_deg=rows.lat_deg[i],
            lon_deg=rows.lon_deg[i],
            alt_amsl_m=rows.alt_amsl_m[i],
            height_above_ground_m=rows.height_above_ground_m[i],
            valid_position=rows.valid_position[i],
            valid_velocity=rows.valid_velocity[i],
            valid_attitude=rows.valid_attitude[i],
            valid_altitude=rows.valid_altitude[i],
        )

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude, longitude, altitude of the local origin; NaN until GPS set it."""
        estimate, i = self.simulation.estimate, self.row
        return (
            float(estimate.origin_lat_deg[i]),
            float(estimate.origin_lon_deg[i]),
            float(estimate.origin_alt_amsl_m[i]),
        )
