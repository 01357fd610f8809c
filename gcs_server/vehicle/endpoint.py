"""Decides whether two endpoints (link, peer, system id) belong to the same vehicle.

System ids are set by hand, and duplicates are common. Therefore an endpoint is assigned to a vehicle only by
one of these rules:

1. If both autopilots report a unique uid, equal uids mean the same vehicle, and different uids two vehicles.
2. On one link, two peers that both send are two vehicles, because a vehicle has one address per link. A peer
that starts to send after the other has stopped is the same vehicle with a new port.
3. On two links, endpoints with the same boot time belong to the same vehicle; different boot times mean two
vehicles. This also distinguishes simulators, which all have the same uid.

If no rule applies, the endpoints belong to two vehicles. The decision takes at most `DECISION_TIMEOUT_S`;
until then, the endpoint's messages are ignored. Later uids and boot times correct the decision
(`same_vehicle.py`).
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gcs_server.links.base import DdsAddress, Peer, UnusableTopic
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, encode_payload, full_payload
from gcs_server.mavlink.connection import Connection
from gcs_server.vehicle.identity import Version

if TYPE_CHECKING:
    from gcs_server.vehicle.vehicle import Vehicle

DECISION_TIMEOUT_S = 3.0
UID_TIMEOUT_S = 2.0
"""Maximum wait for a uid before the other rules are applied [s]."""
NO_DATA_AFTER_S = 3.5
"""Time without a message after which an endpoint no longer sends [s]."""
SAME_BOOT_S = 1.5
"""Maximum difference of boot times that count as the same, because of radio delays [s]."""
BOOT_TIME_EVERY_S = 0.5
"""Period at which the boot time is measured [s]."""
REQUEST_PERIOD_S = 1.0
MAX_REQUESTS = 5
SLOW_REQUEST_PERIOD_S = 30.0
"""Period of version requests after the first `MAX_REQUESTS` requests [s]."""
ESTIMATE_IDS = frozenset(
    {
        d.MAVLINK_MSG_ID_ATTITUDE,
        d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        d.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        d.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    }
)
_boot_ms = struct.Struct("<I")


MAVLINK, ROS2 = "MAVLink", "ROS 2"
"""Protocols of links."""
STAY_ON_LINK_S = 0.4
"""The server changes the link when the newest message of another link is newer by this time [s]. The time is
much shorter than PX4's timeout of a setpoint stream (COM_OF_LOSS_T, 1 s)."""
RECEIVED_WITHIN_S = {MAVLINK: 1.5, ROS2: STAY_ON_LINK_S}
"""The preferred protocol is used while its newest message is at most this much older than the newest message
of all links [s]. Setpoints prefer ROS 2, whose topics arrive every few milliseconds; a slow radio has longer
gaps."""
ESTIMATES_WITHIN_S = STAY_ON_LINK_S
"""The same for position and attitude over MAVLink: a setpoint needs an estimate of the last second, so that
those of ROS 2 fill the gap. Modes and other states wait longer, because a delayed radio would report each
change again."""


class SameVehicle(enum.Enum):
    """Result of the decision whether an endpoint belongs to a vehicle."""

    YES = enum.auto()
    NO = enum.auto()
    UNDECIDED = enum.auto()


@dataclass(slots=True, eq=False)
class Endpoint:
    """A link and peer on which a system id is received."""

    connection: Connection
    peer: Peer
    system_id: int
    component_id: int
    heartbeat: bytes
    """Payload of the endpoint's first heartbeat."""
    first_received_s: float
    """Time of the first message, and of the first one after `NO_DATA_AFTER_S` without any [s, monotonic]."""
    received_s: float
    vehicle: Vehicle | None = None
    version: Version | None = None
    boot_at_s: float | None = None
    """Time of the vehicle's boot on this server's monotonic clock, from the newest frame."""
    boot_next_s: float = float("-inf")
    """Time from which `boot_at_s` is measured again [s, monotonic]."""
    requests_sent: int = 0
    next_request_s: float = 0.0
    refused_until_s: float = float("-inf")
    """Time until which new vehicles of this endpoint are refused, because a limit of
    `population.py` is reached."""
    over_ros2: bool = field(init=False)
    """Whether the connection uses ROS 2; stored, because it is read for each frame."""

    def __post_init__(self) -> None:
        self.over_ros2 = self.connection.protocol == ROS2

    def take_boot_time(self, frame: Frame) -> None:
        """Measures the vehicle's boot time if the frame is one of `ESTIMATE_IDS`."""
        if frame.msg_id not in ESTIMATE_IDS:
            return
        if frame.component_id == self.component_id:  # a companion computer has its own boot clock
            now_s = frame.received_monotonic_s
            self.boot_next_s = now_s + BOOT_TIME_EVERY_S
            self.boot_at_s = now_s - _boot_ms.unpack_from(full_payload(frame))[0] / 1e3

    def request_version(self, now_s: float) -> None:
        """Requests AUTOPILOT_VERSION, which contains the uid; sends nothing to a recording."""
        if self.connection.link.replay:
            self.next_request_s = float("inf")
            return
        self.requests_sent += 1
        self.next_request_s = now_s + (
            REQUEST_PERIOD_S if self.requests_sent < MAX_REQUESTS else SLOW_REQUEST_PERIOD_S
        )
        request = d.MAVLink_command_long_message(
            self.system_id,
            self.component_id,
            d.MAV_CMD_REQUEST_MESSAGE,
            0,
            d.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
            *(0.0,) * 6,
        )
        self.connection.sender.send(request.id, encode_payload(request), self.peer)

    @property
    def unique_uid(self) -> str | None:
        """The vehicle's uid, if it is unique."""
        return self.version.uid if self.version is not None and self.version.unique else None


def preferred_endpoints(
    endpoints: Sequence[Endpoint], protocol: str, within_s: float | None = None
) -> Sequence[Endpoint]:
    """The connected endpoints of this protocol; all endpoints if no endpoint has this protocol.

    For a vehicle that is connected over both protocols, commands and state use MAVLink. Setpoints use ROS 2,
    which supports all kinds of setpoints; they use MAVLink if the server does not know the versions of the
    vehicle's ROS 2 topics for commands and setpoints.
    """
    if len(endpoints) < 2:
        return endpoints
    candidates = [e for e in endpoints if protocol != ROS2 or not _has_unusable_inputs(e)]
    matching = [e for e in candidates if e.connection.protocol == protocol]
    if not matching and len(candidates) < len(endpoints):
        matching = candidates
    if not matching or len(matching) == len(endpoints):
        return endpoints
    newest_s = max(endpoint.received_s for endpoint in endpoints)
    within_s = RECEIVED_WITHIN_S[protocol] if within_s is None else within_s
    return [e for e in matching if newest_s - e.received_s < within_s] or endpoints


def endpoint_to_use(endpoints: Sequence[Endpoint], in_use: Endpoint | None) -> Endpoint | None:
    """The endpoint on which to send now: the one in use until another one is newer by `STAY_ON_LINK_S`. None
    if there is no endpoint."""
    newest = _newest(endpoints)
    if (
        newest is not None
        and in_use is not None
        and in_use in endpoints
        and newest.received_s - in_use.received_s < STAY_ON_LINK_S
    ):
        return in_use
    return newest


def protocol_in_use(endpoints: Sequence[Endpoint], preferred_protocol: str) -> str:
    """The protocol that is used now; MAVLink for a vehicle without endpoints.

    Args:
        endpoints: the vehicle's endpoints.
        preferred_protocol: `MAVLINK` for telemetry and commands, `ROS2` for setpoints.
    """
    newest = _newest(preferred_endpoints(endpoints, preferred_protocol))
    return MAVLINK if newest is None else newest.connection.protocol


def unusable_topics(endpoints: Sequence[Endpoint]) -> Mapping[str, UnusableTopic]:
    """ROS 2 topics of the vehicle that this server cannot use, and why; empty if setpoints are sent over
    MAVLink."""
    newest = _newest(preferred_endpoints(endpoints, ROS2))
    return {} if newest is None else _unusable(newest)


def dds_address(endpoints: Sequence[Endpoint]) -> DdsAddress | None:
    """The vehicle's ROS 2 address with the formats of its topics; None if it is not connected over ROS 2."""
    addresses = (endpoint.connection.link.dds_address(endpoint.peer) for endpoint in endpoints)
    return next((address for address in addresses if address is not None), None)


def _has_unusable_inputs(endpoint: Endpoint) -> bool:
    return any(topic.startswith("/fmu/in/") for topic in _unusable(endpoint))


def _unusable(endpoint: Endpoint) -> Mapping[str, UnusableTopic]:
    connection = endpoint.connection
    return connection.link.unusable_topics(endpoint.peer) if connection.protocol == ROS2 else {}


def _newest(endpoints: Sequence[Endpoint]) -> Endpoint | None:
    return max(endpoints, key=lambda endpoint: endpoint.received_s, default=None)


def same_vehicle(new: Endpoint, vehicle: Vehicle, now_s: float) -> SameVehicle:
    """Applies the rules of this module. No I/O."""
    assigned = [e for e in vehicle.endpoints if e is not new]
    uid = next((e.unique_uid for e in assigned if e.unique_uid), None)
    if uid and new.unique_uid:
        return SameVehicle.YES if uid == new.unique_uid else SameVehicle.NO
    waited_s = now_s - new.first_received_s
    if new.version is None and waited_s < UID_TIMEOUT_S:
        return SameVehicle.UNDECIDED
    sending = [e for e in assigned if now_s - e.received_s < NO_DATA_AFTER_S]
    if not sending:
        return SameVehicle.YES
    if any(e.connection is new.connection and e.received_s > new.first_received_s for e in sending):
        return SameVehicle.NO
    on_other_links = [e for e in sending if e.connection is not new.connection]
    boots = [e.boot_at_s for e in on_other_links if e.boot_at_s is not None]
    if boots and new.boot_at_s is not None:
        return SameVehicle.YES if min(abs(b - new.boot_at_s) for b in boots) < SAME_BOOT_S else SameVehicle.NO
    if on_other_links and waited_s > DECISION_TIMEOUT_S:
        return SameVehicle.NO
    return SameVehicle.UNDECIDED
