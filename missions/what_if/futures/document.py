"""What the futures of a command are (`flight.py`), as clients read them; without the simulation, which takes
long to import."""

from __future__ import annotations

from dataclasses import dataclass

from missions.frames import Vector3

FLIGHTS = 100
HORIZON_S = 20.0
MAX_HORIZON_S = 60.0
SHARE = 0.95
"""Part of the flights that are inside the corridor from their begin to their end."""


@dataclass(frozen=True, slots=True)
class FuturesSpread:
    """Standard deviations of what is not known; the position's is the vehicle's own estimate of its error."""

    wind_m_s: float = 1.0
    """Steady wind on each horizontal axis, about the wind that is known or that the tilt of a slow vehicle
    shows."""
    unknown_wind_m_s: float = 2.5
    """The same if nothing is known of the wind."""
    gusts_m_s: float = 1.0
    """Gusts: the standard deviation of a flight is drawn evenly from 0 to this."""
    mass: float = 0.03
    """Mass, as a part of it; inertia grows with it."""
    thrust: float = 0.05
    """Thrust at full signal, as a part of it: batteries and propellers."""
    inertia: float = 0.1
    """Inertia of each axis, as a part of it, besides that of the mass."""
    lag: float = 0.15
    """Time constant of the motors, as a part of it."""
    velocity_m_s: float = 0.25
    """Error of the velocity estimate on each axis."""
    unsettled_m_s2: float = 0.4
    """Acceleration on each axis that the velocity controller's integral has besides that against drag and
    weight."""
    battery: float = 0.05
    """Capacity of the battery, as a part of it."""


@dataclass(frozen=True, slots=True)
class FuturesQuantiles:
    """A value over all flights that have it."""

    p5: float
    p50: float
    p95: float


@dataclass(frozen=True, slots=True)
class FuturesCorridor:
    """A tube around the mean of all flights that 95 of 100 flights do not leave at any time; all lists are
    equally long."""

    t_s: list[float]
    """Time since the state of the vehicle from which the flights begin [s]."""
    position_ned_m: list[Vector3]
    """Mean true position, from `origin` [m]."""
    horizontal_m: list[float]
    """Horizontal radius [m]."""
    vertical_m: list[float]
    """Half of the height [m]."""


@dataclass(frozen=True, slots=True)
class NearestThing:
    """The smallest distance of all flights from one kind of thing."""

    name: str
    """Geofence, the obstacle's name or the vehicle's id."""
    distance_m: float
    """Smallest distance of any flight [m]; negative: that far beyond the geofence."""
    t_s: float
    """When it is smallest, since the begin [s]."""
    position_ned_m: Vector3
    """Where the vehicle is then, from `origin` [m]."""
    touched: int
    """Number of flights that touch it: they leave the geofence, or come nearer than 0.5 m to the obstacle or
    2 m to the vehicle."""


@dataclass(frozen=True, slots=True)
class Futures:
    """Many flights of one command from a vehicle's present state."""

    flights: int
    seed: int
    horizon_s: float
    """How far the flights reach [s]."""
    command: str
    """The command, in words."""
    corridor: FuturesCorridor
    target_ned_m: Vector3 | None
    """Where the command leads, from `origin` [m]; null: it has no fixed target."""
    arrived: int
    """Number of flights that come within 1 m of the target in this time."""
    arrival_s: FuturesQuantiles | None
    """When those do [s]; null: none does, or there is no target."""
    landed: int
    """Number of flights that are on the ground at the end."""
    touched_ground: int
    """Number of flights that touch the ground without a command to land."""
    lost_control: int
    """Number of flights that tilt by more than 80°."""
    battery_start_share: float | None
    """Charge at the begin, 0 to 1; null: not known."""
    battery_end_share: FuturesQuantiles | None
    """Charge at the end, 0 to 1; null: not known, or the battery's drain is not."""
    fence: NearestThing | None
    """The geofence; null: none is known."""
    obstacle: NearestThing | None
    """The nearest known obstacle; null: none is known."""
    vehicle: NearestThing | None
    """The other vehicle that comes nearest, as far as its flight is known; null: there is none."""
    spread: FuturesSpread
    """How the flights differ."""
    assumed: list[str]
    """What was assumed of the vehicle and its command, as sentences."""

    @property
    def clear(self) -> bool:
        """Whether no flight touches anything."""
        things = (self.fence, self.obstacle, self.vehicle)
        return not any(each is not None and each.touched for each in things) and not (
            self.touched_ground or self.lost_control
        )
