"""What this vehicle, on this link, can be flown by now, and why not by the rest: said before it is tried."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from gcs_server.errors import Refused
from gcs_server.streamer.frames.resolve import RESOLVED_KINDS
from gcs_server.streamer.transport.mavlink import MAVLINK_CARRIES
from missions.setpoints import KINDS, Estimate, Setpoint, needs_of

CARRIED_BY: dict[str, frozenset[str]] = {
    "MAVLink": MAVLINK_CARRIES | RESOLVED_KINDS,
}
"""By a link's protocol: kinds that its messages carry, or that are turned into such."""
WAIT = "Wait for GPS and the estimator (see the vehicle's messages), then try again."
_MISSING = {
    "position": "The vehicle has no fresh position estimate, which a {type} setpoint needs.",
    "velocity": "The vehicle has no fresh velocity estimate, which a {type} setpoint needs.",
    "heading": "The vehicle has no fresh attitude estimate, which a {type} setpoint needs.",
    "global_position": "The vehicle does not know where on the earth it is, which a {type} setpoint needs.",
    "home": "The vehicle has no home position yet, so that a height above home means nothing.",
}


@dataclass(frozen=True, slots=True)
class Available:
    """Whether a type of setpoint can be flown now."""

    can: bool
    why_not: str | None
    """Which estimate, home or link is missing; None where it can be flown."""
    needs: tuple[str, ...]
    """Of the vehicle's estimates: position, velocity, heading, global_position, home."""


class EstimateSource(Protocol):
    """Says which of a vehicle's estimates are valid and fresh."""

    def has_position(self) -> bool: ...

    def has_velocity(self) -> bool: ...

    def has_heading(self) -> bool: ...

    def origin(self) -> object | None: ...

    def home(self) -> object | None: ...


def carried(setpoint_type: str, protocol: str) -> str | None:
    """Why links of a protocol do not carry a type; None where they do."""
    if setpoint_type in CARRIED_BY.get(protocol, frozenset()):
        return None
    others = ", ".join(sorted(CARRIED_BY.get(protocol, frozenset()))) or "none"
    return (
        f"A {protocol} link carries no {setpoint_type} setpoints: there is no message for them that PX4 "
        f"follows. It carries {others}."
    )


class Availability:
    """Asks the vehicle's link and estimator.

    Args:
        estimates: the vehicle's newest samples.
        protocol: what the vehicle's links speak.
    """

    def __init__(self, estimates: EstimateSource, protocol: Callable[[], str]) -> None:
        self._protocol = protocol
        self._has: dict[str, Callable[[], bool]] = {
            "position": estimates.has_position,
            "velocity": estimates.has_velocity,
            "heading": estimates.has_heading,
            "global_position": lambda: estimates.origin() is not None,
            "home": lambda: estimates.home() is not None,
        }

    def of(self, setpoint_type: str, needs: tuple[Estimate, ...] | None = None) -> Available:
        """For one type, or one setpoint's needs."""
        needs = KINDS[setpoint_type].needs if needs is None else needs
        why_not = carried(setpoint_type, self._protocol()) or self._missing(setpoint_type, needs)
        return Available(why_not is None, why_not, needs)

    def require_estimates(self, setpoint_type: str, needs: tuple[Estimate, ...]) -> None:
        """Raises Refused where the vehicle lacks one of these."""
        why_not = self._missing(setpoint_type, needs)
        if why_not is not None:
            raise Refused(why_not, remedy=WAIT)

    def _missing(self, setpoint_type: str, needs: tuple[Estimate, ...]) -> str | None:
        missing = next((need for need in needs if not self._has[need]()), None)
        return None if missing is None else _MISSING[missing].format(type=setpoint_type)

    def all(self) -> dict[str, Available]:
        """For every type."""
        return {setpoint_type: self.of(setpoint_type) for setpoint_type in KINDS}

    def require(self, setpoint: Setpoint) -> None:
        """Raises Refused where the setpoint cannot be flown now."""
        unable = carried(setpoint.type, self._protocol())
        if unable is not None:
            raise Refused(unable, remedy="A ROS 2 link would be needed.")
        available = self.of(setpoint.type, needs_of(setpoint))
        if available.why_not is not None:
            raise Refused(available.why_not, remedy=WAIT)
