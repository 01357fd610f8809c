"""Which setpoints a vehicle can fly: types that it can fly now over its link, and combinations of axes that
PX4 can fly.

With other combinations PX4 descends level, or stops. Its position controller needs both north and east of a
quantity, or neither, and a value on every axis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

from gcs_server.errors import Refused
from gcs_server.ros2.versions import REMEDY as VERSION_REMEDY
from gcs_server.streamer.frames.resolve import KINDS_TO_RESOLVE, NON_LOCAL_KINDS
from gcs_server.streamer.transport.mavlink import MAVLINK_KINDS
from gcs_server.streamer.transport.ros2 import ROS2_KINDS, topics_of
from missions.setpoints import (
    KINDS,
    UNCONTROLLED,
    Acceleration,
    Estimate,
    Partial3,
    Position,
    Setpoint,
    Trajectory,
    Velocity,
    needs_of,
)

TYPES_BY_PROTOCOL: dict[str, frozenset[str]] = {
    "MAVLink": MAVLINK_KINDS | KINDS_TO_RESOLVE,
    "ROS 2": ROS2_KINDS | KINDS_TO_RESOLVE | NON_LOCAL_KINDS,
}
"""By link protocol: the setpoint types that its messages can carry, directly or after a conversion."""
WAIT_REMEDY = "Wait for GPS and the estimator (see the vehicle's messages), then try again."
_MISSING = {
    "position": "The vehicle has no fresh position estimate, which a {type} setpoint needs.",
    "velocity": "The vehicle has no fresh velocity estimate, which a {type} setpoint needs.",
    "heading": "The vehicle has no fresh attitude estimate, which a {type} setpoint needs.",
    "global_position": "The vehicle has no valid global position, which a {type} setpoint needs.",
    "home": "The vehicle has no home position yet, so an altitude above home is not defined.",
}


@dataclass(frozen=True, slots=True)
class Available:
    """Whether a type of setpoint can be flown now."""

    can: bool
    why_not: str | None
    """The missing estimate, home position or link; null if the type can be flown."""
    needs: tuple[str, ...]
    """Estimates that this type needs: position, velocity, heading, global_position, home."""


class EstimateSource(Protocol):
    """The interface to a vehicle's estimates: which are valid and fresh."""

    def has_position(self) -> bool: ...

    def has_velocity(self) -> bool: ...

    def has_attitude(self) -> bool: ...

    def origin(self) -> object | None: ...

    def home(self) -> object | None: ...


def why_not_carried(setpoint_type: str, protocol: str) -> str | None:
    """Why links with this protocol cannot carry a setpoint type; None if the links can carry it."""
    if setpoint_type in TYPES_BY_PROTOCOL.get(protocol, frozenset()):
        return None
    carried = ", ".join(sorted(TYPES_BY_PROTOCOL.get(protocol, frozenset()))) or "none"
    return (
        f"A {protocol} link carries no {setpoint_type} setpoints, because PX4 follows no {protocol} message "
        f"for them. This link carries {carried}."
    )


class Availability:
    """Checks the vehicle's link and estimates.

    Args:
        estimates: the vehicle's newest samples.
        protocol: protocol of the vehicle's links.
        unusable_topics: the vehicle's ROS 2 topics that the server cannot use, and why.
    """

    def __init__(
        self,
        estimates: EstimateSource,
        protocol: Callable[[], str],
        unusable_topics: Callable[[], Mapping[str, str]],
    ) -> None:
        self._protocol, self._unusable_topics = protocol, unusable_topics
        self._has_estimate: dict[str, Callable[[], bool]] = {
            "position": estimates.has_position,
            "velocity": estimates.has_velocity,
            "heading": estimates.has_attitude,
            "global_position": lambda: estimates.origin() is not None,
            "home": lambda: estimates.home() is not None,
        }

    def for_type(self, setpoint_type: str) -> Available:
        """Availability of a setpoint type."""
        needs = KINDS[setpoint_type].needs
        why_not = (
            why_not_carried(setpoint_type, self._protocol())
            or self._unusable({setpoint_type}, in_offboard=True)
            or self._missing(setpoint_type, needs)
        )
        return Available(why_not is None, why_not, needs)

    def require_estimates(self, setpoint_type: str, needs: tuple[Estimate, ...]) -> None:
        """Raises Refused if one of these estimates is missing."""
        why_not = self._missing(setpoint_type, needs)
        if why_not is not None:
            raise Refused(why_not, remedy=WAIT_REMEDY)

    def require_topics(self, setpoint_types: Iterable[str], *, in_offboard: bool) -> None:
        """Raises Refused if the vehicle has a topic of these types in an unknown version.

        Args:
            setpoint_types: setpoint types of the stream.
            in_offboard: whether the stream flies in Offboard, or else in a mode that is registered with PX4.
        """
        why_not = self._unusable(setpoint_types, in_offboard=in_offboard)
        if why_not is not None:
            raise Refused(why_not, remedy=VERSION_REMEDY)

    def _unusable(self, setpoint_types: Iterable[str], *, in_offboard: bool) -> str | None:
        unusable = self._unusable_topics()
        if not unusable:
            return None
        topics = (topic for each in setpoint_types for topic in topics_of(each, in_offboard=in_offboard))
        problem = next((unusable[topic] for topic in topics if topic in unusable), None)
        return None if problem is None else f"{problem}."

    def _missing(self, setpoint_type: str, needs: tuple[Estimate, ...]) -> str | None:
        missing = next((need for need in needs if not self._has_estimate[need]()), None)
        return None if missing is None else _MISSING[missing].format(type=setpoint_type)

    def all(self) -> dict[str, Available]:
        """Availability of every type."""
        return {setpoint_type: self.for_type(setpoint_type) for setpoint_type in KINDS}

    def require(self, setpoint: Setpoint, *, in_offboard: bool) -> None:
        """Raises Refused if the setpoint cannot be flown now; `in_offboard`: see `require_topics`."""
        why_not = why_not_carried(setpoint.type, self._protocol())
        if why_not is not None:
            raise Refused(why_not, remedy="This type needs a ROS 2 link: add ros2://DOMAIN.")
        self.require_topics([setpoint.type], in_offboard=in_offboard)
        self.require_estimates(setpoint.type, needs_of(setpoint))


_AXES = ("north", "east", "down")


def axes_problem(
    position: Partial3 = UNCONTROLLED,
    velocity: Partial3 = UNCONTROLLED,
    acceleration: Partial3 = UNCONTROLLED,
) -> str | None:
    """Why PX4 would not fly this combination of axes; None if PX4 would fly it."""
    named = {
        "position_ned_m": position,
        "velocity_ned_m_s": velocity,
        "acceleration_ned_m_s2": acceleration,
    }
    if all(value is None for vector in named.values() for value in vector):
        return (
            "Only yaw is controlled: PX4 refuses a setpoint without position, velocity or acceleration. "
            "Give the current position to turn on the spot."
        )
    for name, (north, east, _) in named.items():
        if (north is None) != (east is None):
            return f"{name}: north and east are needed together; PX4 does not fly one without the other."
    for axis, name in enumerate(_AXES):
        if all(vector[axis] is None for vector in named.values()):
            return (
                f"{name} is not controlled: PX4 stops instead of flying the rest. Give a position, a "
                "velocity or an acceleration on every axis (type trajectory mixes them)."
            )
    return None


def problem_of(setpoint: Setpoint) -> str | None:
    """Why PX4 would never fly this setpoint, in any state of the vehicle; None if PX4 can fly it."""
    if isinstance(setpoint, Position):
        return axes_problem(position=setpoint.position_ned_m)
    if isinstance(setpoint, Velocity):
        return axes_problem(velocity=setpoint.velocity_ned_m_s)
    if isinstance(setpoint, Acceleration):
        return axes_problem(acceleration=setpoint.acceleration_ned_m_s2)
    if isinstance(setpoint, Trajectory):
        return axes_problem(
            setpoint.position_ned_m, setpoint.velocity_ned_m_s, setpoint.acceleration_ned_m_s2
        )
    return None
