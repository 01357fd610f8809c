"""Inspects the ROS 2 topics of vehicles while a client requests them.

Each domain has its own thread and DDS participant, which exist only while a client requests its topics. Many
messages on an inspected topic do not delay the thread of the link.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final, Protocol

from gcs_server.links.base import UnusableTopic
from gcs_server.ros2.diagnosis import reasons, versions_with
from gcs_server.ros2.formats import TopicFormat
from gcs_server.ros2.inspection import (
    MAX_ENDPOINTS,
    MAX_TOPICS,
    Announcement,
    DomainTopics,
    Inspection,
    State,
    TopicKey,
    TopicRecord,
    TopicView,
    known_type,
    unknown_view,
)
from gcs_server.ros2.message_types import MessageType
from gcs_server.ros2.topics import parse_topic, wire_name
from gcs_server.vehicle.endpoint import dds_address, unusable_topics
from gcs_server.vehicle.vehicle import Vehicle

log = logging.getLogger(__name__)

READ_EVERY_S: Final = 0.1
SHOW_EVERY_S: Final = 0.5
DISCOVERY_S: Final = 1.0
"""Time in which a new participant discovers the other participants [s]."""
RETRY_S: Final = 5.0
MAX_PROBLEMS: Final = 20
"""Maximum number of problems of a domain that are shown."""
KEEP_READING_S: Final = 12.0
"""Time after the last request for which a vehicle's topics are read [s]; the slowest subscription requests
them every 10 s.
"""


class Port(Protocol):
    """The interface to DDS that the inspector uses (`dds_inspection.InspectionPort`)."""

    def announcements(self) -> list[Announcement]: ...
    def open(self, key: TopicKey, message: MessageType) -> str | None: ...
    def close(self, key: TopicKey) -> None: ...
    def take(self, key: TopicKey) -> tuple[list[bytes], bool]: ...


OpenPort = Callable[[int, "str | None"], Port]


class Session:
    """One use of a port, from the first request to the last. Uses neither a clock nor a thread."""

    def __init__(self, port: Port, domain_id: int, now_s: float) -> None:
        self._port, self._domain_id, self._start_s = port, domain_id, now_s
        self._domain = DomainTopics()
        self._records: dict[TopicKey, TopicRecord] = {}
        self._endpoints: dict[str, Announcement] = {}
        """The writers and readers of the domain, by key."""

    def read(self, confirmed: Mapping[str, Mapping[str, MessageType]], now_s: float) -> None:
        """Reads the topics of vehicles, and stops reading other topics.

        Args:
            confirmed: by namespace, the confirmed layouts of the vehicle's topics by name in DDS.
            now_s: current time [s, monotonic].
        """
        announcements = self._port.announcements()
        self._domain.apply(announcements)
        for each in announcements:
            self._endpoints.pop(each.key, None)
            if each.topic is not None and len(self._endpoints) < MAX_ENDPOINTS:
                self._endpoints[each.key] = each
        required = {
            key: message
            for namespace, layouts in confirmed.items()
            for key in self._domain.topics_of(namespace)[:MAX_TOPICS]
            if (message := known_type(key, layouts)) is not None
        }
        for key in [key for key, record in self._records.items() if required.get(key) is not record.message]:
            self._port.close(key)
            del self._records[key]
        for key in required.keys() - self._records.keys():
            self._records[key] = record = TopicRecord(required[key])
            record.problem = self._port.open(key, required[key])
        for key, record in self._records.items():
            record.take(*self._port.take(key), now_s)

    def inspection(self, namespace: str, now_s: float) -> Inspection:
        """The topics of a vehicle."""
        keys = self._domain.topics_of(namespace)
        vehicles, starting = self._domain.vehicles(), now_s - self._start_s < DISCOVERY_S
        texts = () if starting else reasons(self._endpoints.values(), vehicles)
        problems = itertools.islice(texts, MAX_PROBLEMS)
        return Inspection(
            domain_id=self._domain_id,
            namespace=namespace,
            state="starting" if starting else "open",
            problem=None,
            topics=tuple(self._view(key, now_s) for key in keys[:MAX_TOPICS]),
            left_out=max(0, len(keys) - MAX_TOPICS),
            programs=len({each.participant for each in self._endpoints.values()}),
            vehicles=tuple(f"/{each}" for each in vehicles),
            problems=tuple(f"{text[0].upper()}{text[1:]}" for text in problems),
        )

    def _view(self, key: TopicKey, now_s: float) -> TopicView:
        record, counts = self._records.get(key), self._domain.count(key)
        return unknown_view(key, *counts) if record is None else record.view(key, *counts, now_s)


class DomainInspector:
    """The inspector of one domain; its methods may be called from any thread.

    Args:
        domain_id: the DDS domain.
        interface: network interface; None: loopback.
        open_port: opens DDS.
    """

    def __init__(self, domain_id: int, interface: str | None, open_port: OpenPort) -> None:
        self._domain_id, self._interface, self._open_port = domain_id, interface, open_port
        self._lock = threading.Lock()
        self._requested_s: dict[str, float] = {}
        """Time of the last request for each namespace."""
        self._confirmed: dict[str, Mapping[str, MessageType]] = {}
        """By namespace, the confirmed layouts of the vehicle's topics by name in DDS."""
        self._shown: dict[str, Inspection] = {}
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def inspect(self, namespace: str, formats: Iterable[TopicFormat]) -> Inspection:
        """The topics of a vehicle, at most half a second old; the first request starts the reading."""
        confirmed = {wire_name(each.name, namespace): each.message for each in formats}
        with self._lock:
            self._confirmed[namespace] = confirmed
            self._requested_s[namespace] = time.monotonic()
            if self._thread is None and not self._stop.is_set():
                name = f"inspector of DDS domain {self._domain_id}"
                self._thread = threading.Thread(target=self._main, name=name, daemon=True)
                self._thread.start()
            return self._shown.get(namespace) or self._empty(namespace, "starting")

    def close(self) -> None:
        """Ends the thread; returns when DDS has released its sockets."""
        self._stop.set()
        with self._lock:
            thread = self._thread
        if thread is not None:
            thread.join(5.0)

    @property
    def running(self) -> bool:
        """Whether topics are being read."""
        return self._thread is not None

    def _main(self) -> None:
        while self._active_namespaces():
            try:
                self._serve()
            except Exception as problem:
                log.warning("DDS domain %d cannot be inspected: %s", self._domain_id, problem)
                with self._lock:
                    self._shown = {
                        name: self._empty(name, "failed", str(problem)) for name in self._requested_s
                    }
                self._stop.wait(RETRY_S)

    def _serve(self) -> None:
        """Reads topics until no client requests them. Cyclone's participant and readers end with this
        call."""
        now_s = time.monotonic()
        session = Session(self._open_port(self._domain_id, self._interface), self._domain_id, now_s)
        next_show_s = now_s
        while not self._stop.wait(READ_EVERY_S) and (active := self._active_namespaces()):
            now_s = time.monotonic()
            session.read(active, now_s)
            if now_s >= next_show_s:
                next_show_s = now_s + SHOW_EVERY_S
                shown = {name: session.inspection(name, now_s) for name in active}
                with self._lock:
                    self._shown = shown

    def _active_namespaces(self) -> dict[str, Mapping[str, MessageType]]:
        """Namespaces that clients request, with the confirmed layouts. If there are none, the thread must
        end."""
        since_s = time.monotonic() - KEEP_READING_S
        with self._lock:
            self._requested_s = {name: at_s for name, at_s in self._requested_s.items() if at_s > since_s}
            if self._requested_s and not self._stop.is_set():
                return {name: self._confirmed[name] for name in self._requested_s}
            self._thread = None
            self._shown = {}
            return {}

    def _empty(self, namespace: str, state: State, problem: str | None = None) -> Inspection:
        return Inspection(self._domain_id, namespace, state, problem, (), 0)


class TopicInspectors:
    """The inspectors of all domains."""

    def __init__(self, open_port: OpenPort | None = None) -> None:
        self._open_port = open_port or _open_port
        self._inspectors: dict[tuple[int, str | None], DomainInspector] = {}

    def inspect(self, vehicle: Vehicle) -> Inspection | None:
        """The ROS 2 topics of a vehicle; None if it has no ROS 2 link."""
        address = dds_address(vehicle.endpoints)
        if address is None:
            return None
        domain = address.domain_id, address.interface
        inspector = self._inspectors.get(domain)
        if inspector is None:
            inspector = self._inspectors[domain] = DomainInspector(*domain, self._open_port)
        formats = [TopicFormat(*each) for each in address.formats]
        inspection = inspector.inspect(address.namespace, formats)
        return with_layouts(inspection, formats, unusable_topics(vehicle.endpoints))

    def close(self) -> None:
        """Ends all inspectors; returns when DDS has released their sockets."""
        for inspector in self._inspectors.values():
            inspector.close()


def with_layouts(
    inspection: Inspection, formats: Sequence[TopicFormat], unusable: Mapping[str, UnusableTopic]
) -> Inspection:
    """Adds to the topics which layouts are used, which are not, and what is missing without them.

    Args:
        inspection: the topics of a vehicle.
        formats: the vehicle's topics with confirmed layouts.
        unusable: topics that the server cannot use, by name without namespace and version.
    """
    hashes = {each.name: f"{each.message_hash:08x}" for each in formats}
    topics: list[TopicView] = []
    for each in inspection.topics:
        parsed = parse_topic(f"rt{each.name}")
        if parsed is not None and parsed.namespace == inspection.namespace:
            reason = unusable.get(parsed.base)
            text = None if reason is None else f"{reason.text}."
            each = replace(each, layout=hashes.get(parsed.name), unusable=text)
        topics.append(each)
    refused = [f"{each.text}." for each in unusable.values() if not each.awaited]
    return replace(
        inspection,
        topics=tuple(topics),
        versions=versions_with(formats),
        problems=(*refused, *inspection.problems)[:MAX_PROBLEMS],
    )


def _open_port(domain_id: int, interface: str | None) -> Port:
    from gcs_server.ros2.dds_inspection import InspectionPort

    return InspectionPort(domain_id, interface)
