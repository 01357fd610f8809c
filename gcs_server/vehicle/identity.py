"""Who a vehicle is, and whether we may command it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Identity:
    """What does not change in flight, as far as it is known yet."""

    system_id: int
    component_id: int
    autopilot: int
    """MAV_AUTOPILOT: 12 is PX4, 3 ArduPilot."""
    vehicle_type: int
    """MAV_TYPE: 2 is a quadrotor."""
    uid: str | None
    """Hexadecimal, from AUTOPILOT_VERSION (uid2, else uid); None until it came or where there is none."""
    simulated: bool
    replayed: bool
    firmware: str | None
    """`1.16.0` or None."""
    capabilities: int | None
    """MAV_PROTOCOL_CAPABILITY."""
    warnings: tuple[str, ...] = ()
    """What the operator should know about this identity, as sentences."""
