"""What this vehicle, on this link, can be flown by now, and why not by the rest: said before it is tried."""

from __future__ import annotations

from collections.abc import Callable

from gcs_server.errors import Refused
from gcs_server.streamer.encoders import MAVLINK_CARRIES
from gcs_server.streamer.observe import Observer
from gcs_server.streamer.status import Available
from missions.setpoints import KINDS, Acceleration, Follow, PositionGlobal, Setpoint, Trajectory, Velocity

CARRIED_BY: dict[str, frozenset[str]] = {
    "MAVLink": MAVLINK_CARRIES | {"position_body", "path", "follow"},
}
"""By a link's protocol: types that its messages carry, or that are turned into such."""
NEEDS: dict[str, tuple[str, ...]] = {
    "position": ("position", "velocity"),
    "position_global": ("position", "velocity", "global_position"),
    "position_body": ("position", "velocity", "heading"),
    "velocity": ("velocity",),
    "velocity_body": ("velocity", "heading"),
    "acceleration": ("velocity",),
    "trajectory": ("position", "velocity"),
    "attitude": ("heading",),
    "rates": ("heading",),
    "thrust_torque": (),
    "actuators": (),
    "path": ("position", "velocity"),
    "follow": ("position", "velocity", "global_position"),
}
"""Estimates that PX4 asks for (position for a position, velocity for velocity and acceleration, else none but
its attitude), and those that the server itself needs to turn an order into a message."""
WAIT = "Wait for GPS and the estimator (see the vehicle's messages), then try again."
_MISSING = {
    "position": "The vehicle has no fresh position estimate, which a {type} setpoint needs.",
    "velocity": "The vehicle has no fresh velocity estimate, which a {type} setpoint needs.",
    "heading": "The vehicle has no fresh attitude estimate, which a {type} setpoint needs.",
    "global_position": "The vehicle does not know where on the earth it is, which a {type} setpoint needs.",
    "home": "The vehicle has no home position yet, so that a height above home means nothing.",
}


def needs_of(setpoint: Setpoint) -> tuple[str, ...]:
    """The estimates that one setpoint needs; a trajectory those of the fields that it has."""
    if isinstance(setpoint, Trajectory) and all(axis is None for axis in setpoint.position_ned_m):
        return NEEDS[Velocity.type if any(setpoint.velocity_ned_m_s) else Acceleration.type]
    if isinstance(setpoint, PositionGlobal) and setpoint.alt_home_m is not None:
        return (*NEEDS[setpoint.type], "home")
    if isinstance(setpoint, Follow) and setpoint.yaw == "keep":
        return (*NEEDS[setpoint.type], "heading")
    return NEEDS[setpoint.type]


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
        observer: the vehicle's newest samples.
        protocol: what the vehicle's links speak.
    """

    def __init__(self, observer: Observer, protocol: Callable[[], str]) -> None:
        self._protocol = protocol
        self._has: dict[str, Callable[[], bool]] = {
            "position": observer.has_position,
            "velocity": observer.has_velocity,
            "heading": observer.has_heading,
            "global_position": lambda: observer.origin() is not None,
            "home": lambda: observer.home() is not None,
        }

    def of(self, setpoint_type: str, needs: tuple[str, ...] | None = None) -> Available:
        """For one type, or one setpoint's needs."""
        needs = NEEDS[setpoint_type] if needs is None else needs
        why_not = carried(setpoint_type, self._protocol())
        if why_not is None:
            missing = next((need for need in needs if not self._has[need]()), None)
            why_not = None if missing is None else _MISSING[missing].format(type=setpoint_type)
        return Available(why_not is None, why_not, needs)

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
