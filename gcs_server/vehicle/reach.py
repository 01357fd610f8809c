"""Protocols over which a vehicle is connected, the protocol of each kind of data, and the features that the
links do not carry.

ROS 2 carries what PX4 bridges by default: telemetry, commands and setpoints. The features in
`NEEDS_MAVLINK` are MAVLink protocols without ROS 2 topics. Only this module decides what a vehicle's links
carry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

from gcs_server.errors import Refused
from gcs_server.vehicle.endpoint import MAVLINK, NO_DATA_AFTER_S, ROS2, Endpoint, protocol_in_use

Feature = Literal[
    "parameters",
    "mission_transfer",
    "files",
    "gimbal",
    "camera",
    "arming_report",
    "shell",
    "manual_control",
    "raw_messages",
]
"""A feature that only MAVLink carries."""
NEEDS_MAVLINK: Final[dict[Feature, str]] = {
    "parameters": "parameters",
    "mission_transfer": "missions, geofences and rally points",
    "files": "files",
    "gimbal": "gimbal commands",
    "camera": "camera commands",
    "arming_report": "reports of the arming checks",
    "shell": "console",
    "manual_control": "stick positions",
    "raw_messages": "single MAVLink messages",
}
"""Each feature as the object of "ROS 2 carries no …"."""
FEATURES: Final[tuple[Feature, ...]] = get_args(Feature)


@dataclass(frozen=True, slots=True)
class Reach:
    """Protocols over which a vehicle is connected, and the protocol of each kind of data."""

    protocols: tuple[str, ...]
    """Protocols over which the vehicle is connected now: MAVLink, ROS 2."""
    telemetry: str | None
    """Protocol of the shown telemetry; null if the vehicle is not connected."""
    commands: str | None
    """Protocol over which commands are sent."""
    setpoints: str | None
    """Protocol over which setpoints are sent."""
    missing: tuple[Feature, ...]
    """Features that the vehicle's links do not carry; requests that need them are refused immediately. Empty
    over MAVLink."""


def reach_of(endpoints: Sequence[Endpoint]) -> Reach:
    """The protocols of a vehicle with these endpoints."""
    newest_s = max((endpoint.received_s for endpoint in endpoints), default=0.0)
    protocols = {e.connection.protocol for e in endpoints if newest_s - e.received_s < NO_DATA_AFTER_S}
    commands = protocol_in_use(endpoints, MAVLINK) if endpoints else None
    return Reach(
        protocols=tuple(sorted(protocols)),
        telemetry=commands,
        commands=commands,
        setpoints=protocol_in_use(endpoints, ROS2) if endpoints else None,
        missing=FEATURES if protocols and MAVLINK not in protocols else (),
    )


def require_feature(vehicle_id: str, endpoints: Sequence[Endpoint], feature: Feature) -> None:
    """Checks that the vehicle's links carry a feature.

    Raises:
        Refused: the feature needs a MAVLink link on which the vehicle is connected.
    """
    if feature not in reach_of(endpoints).missing:
        return
    inactive_links = sorted({e.connection.name for e in endpoints if e.connection.protocol == MAVLINK})
    if inactive_links:
        raise Refused(
            f"ROS 2 carries no {NEEDS_MAVLINK[feature]}, and vehicle {vehicle_id} sends nothing on its "
            f"MAVLink link {', '.join(inactive_links)}. Nothing was sent.",
            remedy="Restore the MAVLink link, then try again.",
        )
    raise Refused(
        f"Vehicle {vehicle_id} is connected over ROS 2 only, which carries no {NEEDS_MAVLINK[feature]}. "
        "Nothing was sent.",
        remedy="This needs a MAVLink link: add one (POST /links, for example udpin://0.0.0.0:14550).",
    )
