"""The topics of a DDS domain with rate, age and last value, for the inspector. Uses neither DDS nor a clock.

All input comes from other programs, so the number of endpoints and topics is limited.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

from gcs_server.ros2.message_types import MESSAGES, MalformedMessage, MessageType
from gcs_server.ros2.topics import parse_topic, status_namespace, wire_type

MAX_ENDPOINTS: Final = 4000
"""Maximum number of writers and readers; further writers and readers are ignored."""
MAX_TOPICS: Final = 200
"""Maximum number of topics shown for one vehicle; the others are only counted."""
MAX_NAME: Final = 256
"""Longest name of a topic or type [characters]; endpoints with longer ones are ignored."""
RATE_WINDOW_S: Final = 10.0
"""Time over which a rate is measured."""
HIDDEN_TYPES: Final = "org::eclipse::cyclonedds::builtin::"
"""Start of the type names of Cyclone's own topics."""
_ROS_TYPE = re.compile(r"(\w+)::(msg|srv|action)::dds_::(\w+)_")
_TYPES: Final[Mapping[str, MessageType]] = {wire_type(message): message for message in MESSAGES.values()}
State = Literal["starting", "open", "failed"]


class TopicKey(NamedTuple):
    """A topic as DDS identifies it. Topics with the same name but different types are different topics."""

    name: str
    type: str


@dataclass(frozen=True, slots=True)
class Announcement:
    """A writer or reader that DDS has discovered, or that has ended."""

    key: str
    """Identifies the endpoint."""
    publishes: bool
    topic: TopicKey | None
    """None: the endpoint has ended."""
    participant: str = ""
    """Identifies the program's participant."""


@dataclass(frozen=True, slots=True)
class TopicView:
    """One ROS 2 topic of a vehicle's domain."""

    name: str
    """Name as in ROS 2; a DDS topic outside of ROS 2 has its DDS name."""
    type: str
    """Type as in ROS 2, for example px4_msgs/msg/VehicleStatus."""
    publishers: int
    """Number of publishers of the topic, including this server."""
    subscribers: int
    """Number of subscribers of the topic, without this inspector."""
    type_known: bool
    """Whether the server knows the topic's layout; other topics have no rate, age and value."""
    rate_hz: float | None
    """Messages per second, over the last 10 s; null before the second message."""
    rate_is_minimum: bool
    """True: more messages arrive than the inspector reads, so the rate is a lower limit."""
    age_s: float | None
    """Time since the last message; null: no message since the inspector was opened."""
    size_bytes: int | None
    """Size of the last message, with its header."""
    value: dict[str, Any] | None
    """Fields of the last message by name; a number that is NaN or infinite is null. Fields of nested types
    are called `outer.inner`."""
    problem: str | None
    """Why the last message, or the topic, cannot be shown."""
    layout: str | None = None
    """Hash of the layout that PX4 has confirmed for this topic, in hexadecimal digits; null: not a topic of
    the vehicle that this server uses, or not confirmed."""
    unusable: str | None = None
    """Why this server does not use the topic, and what is not available without it; null: it uses the topic,
    or needs none of this name."""


@dataclass(frozen=True, slots=True)
class Inspection:
    """The ROS 2 topics of a vehicle, and the topics of its domain that belong to no vehicle."""

    domain_id: int
    """DDS domain."""
    namespace: str
    """Namespace of the vehicle; empty: no namespace."""
    state: State
    """starting: the inspector has just been opened; open; failed: see `problem`."""
    problem: str | None
    """Why the topics cannot be shown."""
    topics: tuple[TopicView, ...]
    """The vehicle's topics, then the topics of no vehicle; both sorted by name."""
    left_out: int
    """Number of topics that are not shown because there are too many."""
    programs: int = 0
    """Number of programs (DDS participants) in the domain, with this server and PX4's agent."""
    vehicles: tuple[str, ...] = ()
    """Namespaces of all vehicles in the domain, as in ROS 2: `/px4_1`, `/` for none."""
    versions: str = ""
    """Releases of PX4 that have all the layouts which the vehicle has confirmed; empty: none."""
    problems: tuple[str, ...] = ()
    """Why topics are empty or setpoints do nothing, as sentences: topics that do not meet, and topics of the
    vehicle that this server cannot use."""


def ros_name(name: str) -> str:
    """A topic's name in ROS 2, without the prefix `rt`; other DDS topics keep their name."""
    return name[2:] if name.startswith("rt/") else name


def ros_type(name: str) -> str:
    """A type's name in ROS 2; other DDS types keep their name."""
    match = _ROS_TYPE.fullmatch(name)
    return "/".join(match.groups()) if match else name


class MessageRate:
    """Rate of a topic, from the number of messages in each reading."""

    def __init__(self) -> None:
        self._readings: deque[tuple[float, int]] = deque()

    def add(self, messages: int, now_s: float) -> None:
        """Counts messages that have arrived since the last reading."""
        self._readings.append((now_s, messages))

    def hz(self, now_s: float) -> float | None:
        """Current rate; None if fewer than two readings of the last `RATE_WINDOW_S` had messages."""
        readings = self._readings
        while readings and readings[0][0] < now_s - RATE_WINDOW_S:
            readings.popleft()
        if len(readings) < 2:
            return None
        first_s, last_s = readings[0][0], readings[-1][0]
        count = sum(number for _, number in readings) - readings[0][1]
        period_s = (last_s - first_s) / count
        # If messages stop, the rate decreases from the second missing message.
        end_s = now_s if now_s - last_s > 2 * period_s else last_s
        return count / (end_s - first_s)


class TopicRecord:
    """The last message and the rate of one topic whose layout is known."""

    def __init__(self, message: MessageType) -> None:
        self.message = message
        self._rate = MessageRate()
        self._last: tuple[bytes, float] | None = None
        self._overflowed = False
        self.problem: str | None = None
        """Why the topic cannot be read."""

    def take(self, messages: list[bytes], overflowed: bool, now_s: float) -> None:
        """Stores messages read now.

        Args:
            messages: messages with their headers, oldest first.
            overflowed: whether older messages may have been dropped before this reading.
            now_s: time of the reading [s, monotonic].
        """
        if messages:
            self._rate.add(len(messages), now_s)
            self._last = messages[-1], now_s
            self._overflowed = overflowed

    def view(self, key: TopicKey, publishers: int, subscribers: int, now_s: float) -> TopicView:
        """The topic's current view, with the decoded last message."""
        value, problem = None, self.problem
        if self._last is not None:
            try:
                value = self.message.decode(self._last[0])
            except MalformedMessage as error:
                problem = f"The last message is malformed: {error}."
        rate_hz = self._rate.hz(now_s)
        return TopicView(
            name=ros_name(key.name),
            type=ros_type(key.type),
            publishers=publishers,
            subscribers=subscribers,
            type_known=True,
            rate_hz=None if rate_hz is None else round(rate_hz, 2),
            rate_is_minimum=self._overflowed,
            age_s=None if self._last is None else round(now_s - self._last[1], 2),
            size_bytes=None if self._last is None else len(self._last[0]),
            value=value,
            problem=problem,
        )


class DomainTopics:
    """The topics of a domain, from the announcements of their writers and readers."""

    def __init__(self) -> None:
        self._endpoints: dict[str, tuple[bool, TopicKey]] = {}
        """(whether it is a writer, topic) by the endpoint's key."""
        self._counts: dict[TopicKey, list[int]] = {}
        """[readers, writers] of each topic."""
        self._namespaces: dict[str, int] = {}
        """Namespaces of vehicles, with the number of their writers of `vehicle_status`."""

    def apply(self, announcements: Iterable[Announcement]) -> None:
        """Adds and removes writers and readers."""
        for each in announcements:
            self._remove(each.key)
            topic = each.topic
            if topic is None or len(self._endpoints) >= MAX_ENDPOINTS:
                continue
            if max(map(len, topic)) > MAX_NAME or topic.type.startswith(HIDDEN_TYPES):
                continue
            self._endpoints[each.key] = each.publishes, topic
            self._count(each.publishes, topic, 1)

    def topics_of(self, namespace: str) -> list[TopicKey]:
        """The topics of a vehicle, then the topics of no vehicle; both sorted by name."""
        owned = [(self._owner(key), key) for key in self._counts]
        shown = [(owner != namespace, key) for owner, key in owned if owner in (namespace, None)]
        return [key for _, key in sorted(shown)]

    def vehicles(self) -> list[str]:
        """The namespaces of all vehicles, in order; empty for a vehicle without one."""
        return sorted(self._namespaces)

    def count(self, key: TopicKey) -> tuple[int, int]:
        """(publishers, subscribers) of a topic."""
        subscribers, publishers = self._counts.get(key, (0, 0))
        return publishers, subscribers

    def _owner(self, key: TopicKey) -> str | None:
        """Namespace of the vehicle to which a topic belongs; the longest one if several match."""
        name = ros_name(key.name)
        namespaces = [n for n in self._namespaces if name.startswith(f"/{n}/" if n else "/fmu/")]
        return max(namespaces, key=len, default=None)

    def _remove(self, endpoint_key: str) -> None:
        endpoint = self._endpoints.pop(endpoint_key, None)
        if endpoint is not None:
            self._count(*endpoint, -1)

    def _count(self, publishes: bool, topic: TopicKey, change: int) -> None:
        counts = self._counts.setdefault(topic, [0, 0])
        counts[publishes] += change
        if counts == [0, 0]:
            del self._counts[topic]
        namespace = status_namespace(topic.name)
        if publishes and namespace is not None:
            writers = self._namespaces.get(namespace, 0) + change
            self._namespaces[namespace] = writers
            if writers == 0:
                del self._namespaces[namespace]


def known_type(key: TopicKey, confirmed: Mapping[str, MessageType]) -> MessageType | None:
    """The layout of a topic's type; None if the server does not know it.

    Args:
        key: the topic.
        confirmed: the layouts that vehicles have confirmed, by the topic's name in DDS. Another topic of a
            vehicle may have any layout; other programs have PX4's current one.
    """
    if parse_topic(key.name) is None:
        return _TYPES.get(key.type)
    message = confirmed.get(key.name)
    return None if message is None or wire_type(message) != key.type else message


def unknown_view(key: TopicKey, publishers: int, subscribers: int) -> TopicView:
    """A topic whose layout the server does not know."""
    name, kind = ros_name(key.name), ros_type(key.type)
    return TopicView(name, kind, publishers, subscribers, False, None, False, None, None, None, None)
