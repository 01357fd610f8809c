"""Sends telemetry to WebSocket clients: the newest value of each topic of each vehicle, at the rate of each
client.

A sample is encoded once, when the first client needs it, and the same bytes are sent to all clients. A slow
client receives fewer frames, always with the newest values. Events are queued per client. If the queue is
full, the client is disconnected, so that no client misses events unnoticed. A topic that cannot be decoded or
encoded is omitted; all other topics are sent.

A vehicle's topic is sent after each of its messages, even if it has not changed, because the time of the
newest message shows the age of the value. A topic of the server (`PERIODS_S`, readiness) is sent after a
subscription and when it changes; it is valid until the next change. The topics of `ON_REQUEST` are
expensive, so only subscriptions that name them contain them.

A client that has the newest values gets the next ones when a message of its vehicles arrives, once a period.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from gcs_server.clock import Clock
from gcs_server.telemetry.wire import (
    Subscribe,
    WireSample,
    encode,
    error_frame,
    event_frame,
    hello,
    parse_subscribe,
    replays_frame,
    samples_frame,
)
from gcs_server.vehicle.events import Event
from gcs_server.vehicle.fleet import Fleet
from gcs_server.vehicle.samples import TOPICS
from gcs_server.vehicle.services.inspector import MessageInspector
from gcs_server.vehicle.services.manual_control import ManualControlService
from gcs_server.vehicle.services.shell import ShellService
from gcs_server.vehicle.vehicle import Vehicle

log = logging.getLogger(__name__)

EVENT_QUEUE_LENGTH = 500
EVENT_QUEUE_CHARACTERS = 1 << 20
"""Maximum size of the events that wait for one client [characters]."""
MAX_WAITING_ERRORS = 10
"""Maximum number of error frames that wait for one client; further error frames are dropped."""
OFFBOARD_PERIOD_S = 0.1
IDENTITY_PERIOD_S = 1.0
CONTROL_PERIOD_S = 0.5
ROS2_TOPICS_PERIOD_S = 0.5
LANDED_LOG_PERIOD_S = 0.5
SHELL_PERIOD_S = 0.1
MAVLINK_PERIOD_S = 0.5
PERIODS_S = {
    "offboard": OFFBOARD_PERIOD_S,
    "offboard_mission": OFFBOARD_PERIOD_S,
    "waypoint_flight": OFFBOARD_PERIOD_S,
    "identity": IDENTITY_PERIOD_S,
    "components": IDENTITY_PERIOD_S,
    "reach": CONTROL_PERIOD_S,
    "control": CONTROL_PERIOD_S,
    "manual_control": OFFBOARD_PERIOD_S,
    "landed_log": LANDED_LOG_PERIOD_S,
    "ros2_topics": ROS2_TOPICS_PERIOD_S,
    "shell": SHELL_PERIOD_S,
    "mavlink_messages": MAVLINK_PERIOD_S,
}
"""Topics of the server, and the period at which each is checked for a change [s]. Only a change creates a new
sample."""
SERVER_TOPICS = frozenset(PERIODS_S) | {"readiness"}
ALL_TOPICS = frozenset(TOPICS) | SERVER_TOPICS
ON_REQUEST = frozenset({"ros2_topics", "shell", "mavlink_messages"})
"""Topics that `"topics": "*"` does not include."""
CLOSE_TOO_SLOW = 1013


class Socket(Protocol):
    """The part of a WebSocket that the hub uses."""

    async def send_text(self, data: str) -> None: ...
    async def receive_text(self) -> str: ...
    async def close(self, code: int = 1000, reason: str | None = None) -> None: ...


class EncodedSamples:
    """The newest samples of all vehicles as JSON; each sample is encoded once."""

    def __init__(self, clock: Clock, fleet: Fleet) -> None:
        self._clock = clock
        self._fleet = fleet
        self._encoded: dict[str, dict[str, tuple[float, bytes]]] = {}
        """(time of the sample, JSON) by vehicle id and topic; see `_newest`."""
        self._checked: dict[tuple[str, str], tuple[float, object]] = {}
        """(time of the last check, value) of the server's topics, by vehicle id and topic."""
        self.replays: Callable[[], Sequence[object]] = tuple
        """Returns the open replays; the replay service sets this function."""
        self.inspect: Callable[[Vehicle], object | None] = lambda _vehicle: None
        """Returns the ROS 2 topics of a vehicle; the inspector sets this function."""
        self.landed_log: Callable[[Vehicle], object | None] = lambda _vehicle: None
        """Returns what happens with the log of a vehicle's newest flight."""

    def replays_text(self) -> str | None:
        """A frame with the open replays; None: no replay is open."""
        replays = self.replays()
        return replays_frame(replays) if replays else None

    def vehicles(self) -> list[Vehicle]:
        """All vehicles."""
        return self._fleet.all()

    def forget(self, vehicle_id: str) -> None:
        """Drops all data of a removed vehicle."""
        self._encoded.pop(vehicle_id, None)
        for key in [key for key in self._checked if key[0] == vehicle_id]:
            del self._checked[key]

    def new_samples(self, vehicle: Vehicle, topics: Sequence[str], seen: dict[str, float]) -> Iterator[bytes]:
        """JSON of the newest samples that a client does not have yet.

        Args:
            seen: by topic, the time of the newest sample that the client has; updated by this call.
        """
        samples = self._encoded.setdefault(vehicle.id, {})
        for topic in topics:
            newest = samples.get(topic)
            # Most topics have not changed, or the vehicle never sends them: this check is most of the work.
            received_s = None if topic in SERVER_TOPICS else vehicle.topic_received_s(topic)
            if received_s is None and topic not in SERVER_TOPICS:
                continue
            if newest is None or newest[0] != received_s:
                task_name = f"telemetry of {topic}"
                newest = vehicle.isolation.run(task_name, self._newest, vehicle, topic, samples)
            if newest is not None and seen.get(topic) != newest[0]:
                seen[topic] = newest[0]
                yield newest[1]

    def _newest(
        self, vehicle: Vehicle, topic: str, stored_samples: dict[str, tuple[float, bytes]]
    ) -> tuple[float, bytes] | None:
        """The newest sample as (time of reception or of the change [s, monotonic], JSON); None: no sample
        yet."""
        key = (vehicle.id, topic)
        stored = stored_samples.get(topic)
        if topic == "readiness":
            health = vehicle.health
            if health.changed_s is None or (stored is not None and stored[0] == health.changed_s):
                return stored
            wire = WireSample(vehicle.id, topic, None, self._clock.unix_s(), health.readiness)
            new_sample = (health.changed_s, encode(wire))
        elif topic in PERIODS_S:
            now_s = self._clock.monotonic_s()
            checked = self._checked.get(key)
            if stored is not None and checked is not None and now_s - checked[0] < PERIODS_S[topic]:
                return stored
            value = self._server_value(vehicle, topic)
            if value is None:
                return None
            if stored is None or checked is None or checked[1] != value:
                stored = (now_s, encode(WireSample(vehicle.id, topic, None, self._clock.unix_s(), value)))
            self._checked[key] = (now_s, value)
            new_sample = stored
        else:
            sample = vehicle.topic(topic)
            if sample is None:
                return None
            if stored is not None and stored[0] == sample.received_monotonic_s:
                return stored
            wire = WireSample(
                vehicle.id, topic, sample.vehicle_time_boot_s, sample.received_unix_s, sample.value
            )
            new_sample = (sample.received_monotonic_s, encode(wire))
        stored_samples[topic] = new_sample
        return new_sample

    def _server_value(self, vehicle: Vehicle, topic: str) -> object | None:
        """The current value of a topic of the server; None if the vehicle does not have it."""
        if topic == "ros2_topics":
            return self.inspect(vehicle)
        if topic == "landed_log":
            return self.landed_log(vehicle)
        if topic == "mavlink_messages":
            return vehicle.service(MessageInspector).received()
        if topic == "shell":
            return vehicle.service(ShellService).newest()
        if topic == "manual_control":
            return None if vehicle.identity.replayed else vehicle.service(ManualControlService).status()
        if topic == "identity":
            return vehicle.identity
        if topic == "components":
            return vehicle.components.all()
        if topic == "reach":
            return vehicle.reach
        if topic == "control":
            return None if vehicle.identity.replayed or not vehicle.control else vehicle.control.status()
        if topic == "offboard_mission":
            return None if vehicle.offboard_mission is None else vehicle.offboard_mission.status()
        if topic == "waypoint_flight":
            return None if vehicle.waypoint_flight is None else vehicle.waypoint_flight.status()
        return None if vehicle.offboard is None else vehicle.offboard.status()


class Subscriber:
    """One telemetry client: its subscription, the samples it has received, and its waiting events."""

    def __init__(self, clock: Clock, socket: Socket, samples: EncodedSamples) -> None:
        self._clock = clock
        self._socket = socket
        self._samples = samples
        self._subscription: Subscribe | None = None
        self._topics: tuple[str, ...] = ()
        self._seen: dict[str, dict[str, float]] = {}
        """By vehicle id and topic, the time of the newest sample that was sent."""
        self._seen_replays: str | None = None
        self._events: deque[str] = deque()
        self._events_size = 0
        self._errors = 0
        self._wake = asyncio.Event()
        self._watched: list[Vehicle] = []
        """Vehicles whose next message wakes this client."""
        self._data_arrived = False
        self.overflowed = False

    def queue_event(self, event: Event, text: str) -> None:
        """Queues an event; if the queue is full, the client is disconnected."""
        subscription = self._subscription
        chosen = (
            subscription.vehicles
            if subscription is not None and isinstance(subscription.vehicles, list)
            else None
        )
        if chosen is None or event.vehicle is None or event.vehicle in chosen:
            self.queue_text(text)

    def queue_text(self, text: str) -> None:
        """Queues a frame that must not be skipped."""
        if len(self._events) >= EVENT_QUEUE_LENGTH or self._events_size > EVENT_QUEUE_CHARACTERS:
            self.overflowed = True
        else:
            self._events.append(text)
            self._events_size += len(text)
        self._wake.set()

    def queue_error(self, detail: str) -> None:
        """Queues an error frame for an invalid request, unless too many error frames wait."""
        if self._errors < MAX_WAITING_ERRORS:
            self._errors += 1
            self.queue_text(error_frame(detail))

    def subscribe(self, request: Subscribe) -> None:
        """Applies a subscription immediately, and sends all its values again."""
        self._subscription = request
        all_topics = ALL_TOPICS - ON_REQUEST
        self._topics = tuple(sorted(all_topics if isinstance(request.topics, str) else set(request.topics)))
        self._seen.clear()
        self._seen_replays = None
        self._wake.set()

    async def send_loop(self) -> None:
        """Sends one frame at a time, until the socket closes or too many events wait."""
        await self._socket.send_text(hello(self._clock.unix_s()))
        next_s = self._clock.monotonic_s()
        while not self.overflowed:
            while self._events and not self.overflowed:
                text = self._events.popleft()
                self._events_size -= len(text)
                await self._socket.send_text(text)
            self._errors = 0
            now_s = self._clock.monotonic_s()
            subscription = self._subscription
            if subscription is not None and (now_s >= next_s or self._data_arrived):
                replays = self._samples.replays_text()
                if replays != self._seen_replays:
                    self._seen_replays = replays
                    await self._socket.send_text(replays or replays_frame([]))
                    # events are sent first, so that a replaced vehicle is announced before its samples
                    if self._events:
                        continue
                period_s, data_arrived = 1.0 / subscription.rate_hz, self._data_arrived
                self._unwatch()
                new_samples = self._new_samples(subscription)
                if new_samples:
                    await self._socket.send_text(samples_frame(new_samples))
                elif not data_arrived:
                    self._watch(subscription)
                next_s = (now_s if data_arrived else next_s) + period_s
                next_s = max(next_s, self._clock.monotonic_s())
            await self._wait(None if subscription is None else next_s - self._clock.monotonic_s())
        await self._socket.close(CLOSE_TOO_SLOW, "too slow: events were lost; connect again")

    async def _wait(self, seconds: float | None) -> None:
        if seconds is not None and seconds <= 0:
            await asyncio.sleep(0)
            return
        try:
            async with asyncio.timeout(seconds):
                await self._wake.wait()
        except TimeoutError:
            return
        self._wake.clear()

    def _new_samples(self, subscription: Subscribe) -> list[bytes]:
        new_samples: list[bytes] = []
        for vehicle in self._vehicles(subscription):
            seen = self._seen.setdefault(vehicle.id, {})
            new_samples.extend(self._samples.new_samples(vehicle, self._topics, seen))
        return new_samples

    def _vehicles(self, subscription: Subscribe) -> list[Vehicle]:
        vehicles = self._samples.vehicles()
        if isinstance(subscription.vehicles, str):
            return vehicles
        return [vehicle for vehicle in vehicles if vehicle.id in subscription.vehicles]

    def _watch(self, subscription: Subscribe) -> None:
        """Wakes this client when the next message of one of its vehicles arrives."""
        self._watched = self._vehicles(subscription)
        for vehicle in self._watched:
            vehicle.listeners.add(self._on_message)

    def _unwatch(self) -> None:
        for vehicle in self._watched:
            vehicle.listeners.discard(self._on_message)
        self._watched, self._data_arrived = [], False

    def _on_message(self) -> None:
        self._unwatch()
        self._data_arrived = True
        self._wake.set()

    def close(self) -> None:
        """Drops the references to the vehicles."""
        self._unwatch()


class Hub:
    """All telemetry clients."""

    def __init__(self, clock: Clock, fleet: Fleet) -> None:
        self._clock = clock
        self._samples = EncodedSamples(clock, fleet)
        self._clients: set[Subscriber] = set()
        self._unsubscribe: Callable[[], None] = fleet.subscribe(self.publish)

    def set_replays_source(self, replays: Callable[[], Sequence[object]]) -> None:
        """Sets the function that returns the open replays."""
        self._samples.replays = replays

    def set_ros2_topics_source(self, inspect: Callable[[Vehicle], object | None]) -> None:
        """Sets the function that returns the ROS 2 topics of a vehicle, or None if it has no ROS 2 link."""
        self._samples.inspect = inspect

    def set_landed_logs_source(self, landed_log: Callable[[Vehicle], object | None]) -> None:
        """Sets the function that returns what happens with the log of a vehicle's newest flight, or None."""
        self._samples.landed_log = landed_log

    def publish(self, event: Event) -> None:
        """Passes an event on to all clients, encoded once."""
        if event.kind == "vehicle_removed" and event.vehicle is not None:
            self._samples.forget(event.vehicle)
        if not self._clients:
            return
        try:
            text = event_frame(event)
        except Exception:
            log.exception("event %r could not be encoded", event.kind)
            return
        for client in self._clients:
            client.queue_event(event, text)

    async def serve(self, socket: Socket) -> None:
        """Serves one accepted socket until it closes."""
        client = Subscriber(self._clock, socket, self._samples)
        self._clients.add(client)
        try:
            async with asyncio.TaskGroup() as group:
                sending = group.create_task(client.send_loop())
                receiving = group.create_task(self._receive(socket, client))
                await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
                sending.cancel()
                receiving.cancel()
        finally:
            self._clients.discard(client)
            client.close()

    def close(self) -> None:
        """Stops receiving events."""
        self._unsubscribe()

    async def _receive(self, socket: Socket, client: Subscriber) -> None:
        while True:
            text = await socket.receive_text()
            try:
                client.subscribe(parse_subscribe(text, ALL_TOPICS))
            except ValueError as error:
                client.queue_error(str(error))
