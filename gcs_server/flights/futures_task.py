"""What the process that flies futures (`futures_worker.py`) is asked; without the simulation, which takes
long to import."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.streamer.values.snapshot import Snapshot
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.setpoints import Setpoint
from missions.what_if.futures.commands import ModeCommand
from missions.what_if.futures.start import Delay, OtherVehicle, Start

SOLVED, PROBLEM = b"+", b"-"
"""First byte of an answer: a result, or a problem in words."""


@dataclass(frozen=True, slots=True)
class Stream:
    """A setpoint as the stream would take it now."""

    setpoint: Setpoint
    snapshot: Snapshot
    """The vehicle's state and limits, without scans."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What is around the vehicle."""

    home: LocalOrigin
    """Fence and obstacles are relative to it."""
    home_ned_m: Vector3
    zones: bytes
    """Geofence of the vehicle, as JSON."""
    radius_m: float
    """Largest distance from home; 0: no limit."""
    height_m: float
    """Largest altitude above home; 0: no limit."""
    obstacles: bytes
    """Obstacles of plans, as JSON."""
    others: tuple[OtherVehicle, ...]


@dataclass(frozen=True, slots=True)
class FuturesTask:
    """All that a process needs to fly futures."""

    vehicle: str
    start: Start
    origin: LocalOrigin | None
    """Global position of the local frame; None: unknown."""
    mode: ModeCommand | None
    """None: `stream`."""
    stream: Stream | None
    delay: Delay
    surroundings: Surroundings
    state_unix_s: float
    text: str
    battery_known: bool
    flights: int
    horizon_s: float
    seed: int
    assumed: tuple[str, ...]
