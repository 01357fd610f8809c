"""The present state of a vehicle, from which futures begin, and how the flights differ from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Quaternion, Vector3
from missions.what_if.futures.document import FuturesSpread

Values = NDArray[np.float64]
MAX_SIGMA = 2.5
"""Deviations are limited to so many standard deviations."""
GRAVITY_M_S2 = 9.80665
SLOW_M_S = 1.0
"""A slower vehicle leans against the wind only."""


@dataclass(frozen=True, slots=True)
class Start:
    """What is known of the vehicle; NED, SI units."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    q_ned_frd: Quaternion
    rates_frd_rad_s: Vector3
    ground_down_m: float
    """Position down of the ground below it, taken as level."""
    position_error_m: float
    """One sigma of the horizontal position estimate."""
    height_error_m: float
    """One sigma of the vertical position estimate."""
    wind_ne_m_s: tuple[float, float] | None
    """Estimated wind; None: it is taken from the tilt of a slow vehicle."""
    in_hold: bool
    """Whether Hold is active: a go-to then continues its trajectory."""
    hold_target_ned_m: Vector3 | None
    """Where Hold flies to or stays; None: another mode, or not known."""
    battery_share: float | None
    """Charge, 0 to 1; None: not known."""
    parameters: dict[str, float]
    """Of the vehicle, with its body (SIH_*); what is missing has PX4's default."""
    px4: str
    """Release of PX4 to simulate: `1.17`."""


@dataclass(frozen=True, slots=True)
class OtherVehicle:
    """The predicted flight of another vehicle."""

    vehicle: str
    t_s: Values
    """(K,) since the begin of the futures, increasing."""
    position_ned_m: Values
    """(K, 3) in the local frame of the futures."""


@dataclass(frozen=True, slots=True)
class Delay:
    """Time from the state to the moment at which the vehicle has the command; drawn evenly [s]."""

    shortest_s: float
    longest_s: float


@dataclass(frozen=True, slots=True)
class Deviations:
    """What differs between N flights; the first one has none."""

    wind_ne_m_s: Values
    """(N, 2) steady wind."""
    gusts_m_s: Values
    """(N,) standard deviation of the gusts."""
    mass: Values
    """(N,) factors; so are the next ones."""
    thrust: Values
    inertia: Values
    """(N, 3)."""
    lag: Values
    battery: Values
    settled: Values
    """(N,) part of the drag by the vehicle's own speed that the velocity controller's integral has taken up,
    0 to 1."""
    unsettled_m_s2: Values
    """(N, 3) what else that integral has: it follows the wind and the last manoeuvre late."""
    keeps_speed: Values
    """(N,) of a trajectory that continues, the part of the cruise speed with which it may turn, 0 to 1."""
    delay_s: Values
    """(N,)."""

    @classmethod
    def draw(
        cls, start: Start, delay: Delay, spread: FuturesSpread, count: int, seed: int, drag_per_s: float
    ) -> Deviations:
        """The deviations of `count` flights; equal seeds give equal ones.

        Args:
            start: the vehicle's state.
            delay: of the command.
            spread: how conditions vary.
            count: number of flights.
            seed: their seed.
            drag_per_s: drag of the body per speed, divided by its mass.
        """
        generator = np.random.default_rng([seed, 7])
        z = np.clip(generator.standard_normal((count, 12)), -MAX_SIGMA, MAX_SIGMA)
        even = generator.uniform(size=(count, 4))
        z[0], even[0] = 0.0, (0.0, 0.5, 0.5, 0.5)
        wind, sigma_m_s = _wind(start, spread, drag_per_s)
        return cls(
            wind_ne_m_s=wind + sigma_m_s * z[:, :2],
            gusts_m_s=spread.gusts_m_s * even[:, 0],
            mass=1.0 + spread.mass * z[:, 2],
            thrust=1.0 + spread.thrust * z[:, 3],
            inertia=1.0 + spread.inertia * z[:, 4:7],
            lag=1.0 + spread.lag * z[:, 7],
            battery=1.0 + spread.battery * z[:, 8],
            settled=even[:, 1],
            unsettled_m_s2=spread.unsettled_m_s2 * z[:, 9:12],
            keeps_speed=even[:, 3] ** 2,
            delay_s=delay.shortest_s + (delay.longest_s - delay.shortest_s) * even[:, 2],
        )


def _wind(start: Start, spread: FuturesSpread, drag_per_s: float) -> tuple[Values, float]:
    """The wind north and east, and the standard deviation of each."""
    if start.wind_ne_m_s is not None:
        return np.array(start.wind_ne_m_s), spread.wind_m_s
    vn, ve, _ = start.velocity_ned_m_s
    if math.hypot(vn, ve) > SLOW_M_S or drag_per_s <= 0.0:
        return np.zeros(2), spread.unknown_wind_m_s
    return np.array([vn, ve]) - _leaning_m_s2(start.q_ned_frd) / drag_per_s, spread.wind_m_s


def _leaning_m_s2(q_ned_frd: Quaternion) -> Values:
    """(2,) horizontal acceleration by the thrust of a vehicle whose thrust carries its weight [m/s²]."""
    w, x, y, z = q_ned_frd
    down = 1.0 - 2.0 * (x * x + y * y)
    axis = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x)])
    return -GRAVITY_M_S2 * axis / max(down, 0.5)
