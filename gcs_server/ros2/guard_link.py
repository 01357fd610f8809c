"""The `ros2://…?guard=` link: to ROS 2 programs in its domain and namespace this server is PX4.

The vehicle's own topics are passed on as they come, by a thread. What programs send is passed, refused, or
becomes MAVLink messages (`program_topics.py`), which the guard handles as those of any program; each
participant of DDS is one. Without a vehicle over ROS 2 nothing is offered.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from queue import SimpleQueue
from typing import TYPE_CHECKING, Final

from gcs_server.links.base import DdsAddress, Link, Peer
from gcs_server.links.writer import LinkWriter
from gcs_server.mavlink.codec import FrameParser
from gcs_server.ros2.formats import REQUEST, RESPONSE, TopicFormat
from gcs_server.ros2.message_types import MESSAGES, MalformedMessage, Values
from gcs_server.ros2.program_topics import LOCAL_POSITION, NOT_PASSED, REFUSED, WAYS, ProgramTopics
from gcs_server.ros2.topics import COMMAND, COMMAND_ACK, STATUS

if TYPE_CHECKING:
    from gcs_server.ros2.dds_relay import RelayPort

SETTLED_S: Final = 2.0
"""The topics are offered when the vehicle's confirmed layouts have not changed for this time [s]."""
WAIT_S: Final = 0.02
"""Longest wait for a message of a program [s]."""
STOP_S: Final = 0.2
"""Longest wait for a message of the vehicle, before it is looked whether the link was closed [s]."""
LOOK_EVERY_S: Final = 1.0
"""Period at which ended programs are found, and at which a refusal is repeated [s]."""
RETRY_S: Final = 5.0
MAX_PROGRAMS: Final = 16
DEPTHS: Final = {COMMAND: 8, REQUEST: 8, RESPONSE: 8}
"""Messages of a topic that are kept until the next reading; of any other the newest."""
NO_VEHICLE: Final = "The vehicle is not connected over ROS 2: add a ros2:// link to it (POST /links)."
SETTLING: Final = "The layouts of the vehicle's topics are being confirmed."
OpenRelay = Callable[[DdsAddress, DdsAddress], "tuple[RelayPort, RelayPort]"]
"""(address of the programs, address of the vehicle) → programs' end, vehicle's end."""
OnRefused = Callable[[Peer, str, str], None]
"""(peer, topic, why)"""


class Ros2GuardLink(Link):
    """The programs of a DDS domain and namespace.

    Args:
        domain_id: number of the DDS domain.
        namespace: namespace of the topics; may be empty.
        interface: network interface; None: loopback.
        open_relay: opens DDS.
    """

    protocol = "ROS 2"

    def __init__(
        self,
        name: str,
        url: str,
        domain_id: int,
        namespace: str,
        interface: str | None,
        open_relay: OpenRelay,
    ) -> None:
        super().__init__(name, url)
        self.address = DdsAddress(domain_id, interface, namespace)
        self.on_refused: OnRefused = lambda _peer, _topic, _why: None
        """Called in the event loop with what is not passed."""
        self.open_relay = open_relay
        self._sender = LinkWriter(None, self._write, self._counts, self.faults, lambda: self.now_s())
        self._wanted: DdsAddress | None = None
        self._system_id = 1
        self._changed_s = 0.0
        self._run: _Run | None = None

    @property
    def reads_only(self) -> bool:
        """Whether programs may send nothing to the vehicle."""
        return self.guard is not None and self.guard.control == "read"

    def serve(self, vehicle: DdsAddress | None, system_id: int) -> None:
        """Offers the topics of this vehicle; called again and again, as its layouts are confirmed.

        Args:
            vehicle: its address, with the formats of its topics; None: it has none.
            system_id: its MAVLink system id.
        """
        now_s = self.now_s()
        if (vehicle, system_id) != (self._wanted, self._system_id):
            self._wanted, self._system_id, self._changed_s = vehicle, system_id, now_s
        run, detail = self._run, self._obstacle(vehicle)
        if run is not None and (vehicle is None or detail or not run.goes_on(vehicle, system_id)):
            self._close_and_forget_peers()
            run = None
        if run is not None or self._state != "open":
            return
        if vehicle is None or detail:
            self._set_state("open", detail)
        elif now_s - self._changed_s >= SETTLED_S:
            self._run = _Run(self, self._loop, vehicle, system_id)
            self._run.start()
            self._set_state("open", "")
        elif self._changed_s <= now_s:  # later: what has failed is still shown
            self._set_state("open", SETTLING)

    def _obstacle(self, vehicle: DdsAddress | None) -> str:
        """Why this vehicle's topics cannot be offered; empty: they can."""
        if vehicle is None:
            return NO_VEHICLE
        own = self.address
        if (own.domain_id, own.namespace) == (vehicle.domain_id, vehicle.namespace):
            return "Here are the vehicle's own topics: guard another domain or namespace (ros2://3)."
        return "" if vehicle.formats else SETTLING

    def _open(self) -> None:
        self._opened()

    def _close(self) -> None:
        if self._run is not None:
            self._run.stop.set()
            self._run = None

    async def close(self) -> None:
        """Closes the link; returns when DDS has released its sockets."""
        run = self._run
        await super().close()
        if run is not None:
            await asyncio.to_thread(run.join)

    def _writer(self, peer: Peer) -> LinkWriter | None:
        return self._sender

    def _write(self, data: bytes, peer: Peer) -> int:
        run = self._run
        if run is not None:
            run.answer(peer.name, data)
        return len(data)

    # --- in the event loop, called by the threads ----------------------------------------------------

    def on_frames(self, run: _Run, frames: Iterable[tuple[str, bytes]], taken_s: float) -> None:
        """Receives the messages of programs, by participant."""
        run.delivered.set()
        if run is not self._run:
            return
        for name, data in frames:
            self._received(data, self._peer(name), taken_s)

    def on_refusal(self, run: _Run, name: str, topic: str, why: str) -> None:
        """Receives what was not passed."""
        if run is self._run:
            self.on_refused(self._peer(name), topic, why)

    def on_gone(self, run: _Run, names: Iterable[str]) -> None:
        """Forgets programs that have ended."""
        if run is self._run:
            for name in names:
                peer = self._peers.get(name)
                if peer is not None:
                    self._forget(peer)
            self._changed()

    def on_failure(self, run: _Run, why: str) -> None:
        """Shows why DDS cannot be used; it is tried again."""
        if run is self._run:
            self._changed_s = self.now_s() + RETRY_S - SETTLED_S
            self._close_and_forget_peers()
            self._set_state("open", why)

    def _peer(self, name: str) -> Peer:
        peer = self._peers.get(name)
        if peer is None:
            peer = self._peers[name] = Peer(name)
            self._changed()
        return peer


class _Run:
    """The topics of one vehicle: two threads, one for each end."""

    def __init__(
        self, link: Ros2GuardLink, loop: asyncio.AbstractEventLoop, vehicle: DdsAddress, system_id: int
    ) -> None:
        self._link, self._loop = link, loop
        self._vehicle, self._system_id = vehicle, system_id
        self.stop = threading.Event()
        self.delivered = threading.Event()
        """Set while the event loop has no unread messages: until then DDS keeps only the newest."""
        self.delivered.set()
        self._formats: dict[str, TopicFormat] = {}
        self._to_vehicle: SimpleQueue[TopicFormat] = SimpleQueue()
        self._to_programs: SimpleQueue[TopicFormat] = SimpleQueue()
        """Topics that the threads have yet to open."""
        self._add(_always())
        self._add({each[0]: TopicFormat(*each) for each in vehicle.formats})
        self._programs: dict[str, ProgramTopics] = {}
        self._position: bytes | None = None
        """The vehicle's newest VehicleLocalPosition."""
        self._refused_s: dict[tuple[str, str], float] = {}
        self._looked_s = 0.0
        self._ends: tuple[RelayPort, RelayPort] | None = None
        """The programs' end and the vehicle's."""
        self._threads = [threading.Thread(target=self._main, name=f"link {link.name}", daemon=True)]

    def goes_on(self, vehicle: DdsAddress, system_id: int) -> bool:
        """Whether these are the topics of the same vehicle. PX4's agent announces a topic with its first
        message, many only in flight: they are opened then."""
        if (replace(vehicle, formats=()), system_id) != (replace(self._vehicle, formats=()), self._system_id):
            return False
        formats = {each[0]: TopicFormat(*each) for each in vehicle.formats}
        same = all(self._formats[topic] == each for topic, each in formats.items() if topic in self._formats)
        if same and STATUS in formats:
            self._add(formats)
            return True
        return False

    def _add(self, formats: Mapping[str, TopicFormat]) -> None:
        for topic, each in formats.items():
            if topic not in self._formats:
                self._formats[topic] = each
                (self._to_vehicle if topic.startswith("/fmu/in/") else self._to_programs).put(each)

    def start(self) -> None:
        """Starts the threads."""
        self._threads[0].start()

    def join(self) -> None:
        """Returns when DDS is closed."""
        for thread in self._threads:
            thread.join(5.0)

    def answer(self, name: str, data: bytes) -> None:
        """Sends what the guard answers to a program, if ROS 2 has a message for it. Raises OSError."""
        ends, program = self._ends, self._programs.get(name)
        ack_format = self._formats.get(COMMAND_ACK)
        if ends is None or program is None or ack_format is None:
            return
        for frame in FrameParser().feed(data, 0.0):
            fields = program.answer(frame)
            if fields is not None:
                message = MESSAGES["VehicleCommandAck"].encode(fields)
                ends[0].send(COMMAND_ACK, ack_format.to_vehicle(message))

    # --- threads --------------------------------------------------------------------------------------

    def _main(self) -> None:
        try:
            self.open()
            other = threading.Thread(target=self._pass_telemetry, name=f"link {self._link.name}", daemon=True)
            self._threads.append(other)
            other.start()
            while not self.stop.is_set():
                if self.delivered.wait(STOP_S):
                    self.read_programs(WAIT_S)
            other.join(5.0)
        except Exception as problem:
            self.stop.set()
            self._post(self._link.on_failure, str(problem))
        finally:
            self._ends = None  # Cyclone's entities end with the last reference

    def _pass_telemetry(self) -> None:
        try:
            while not self.stop.is_set():
                self.pass_telemetry(STOP_S)
        except Exception as problem:
            self.stop.set()
            self._post(self._link.on_failure, str(problem))

    def open(self) -> None:
        """Opens both ends. Raises DdsUnavailable."""
        ends = self._link.open_relay(self._link.address, replace(self._vehicle, formats=()))
        self._open_outputs(*ends)  # with the topic of answers, before the first command can come
        self._ends = ends

    def _open_outputs(self, programs: RelayPort, vehicle: RelayPort) -> None:
        """Offers the vehicle's topics that were added."""
        while not self._to_programs.empty():
            each = self._to_programs.get()
            programs.write(each)
            vehicle.read(each, DEPTHS.get(each.topic, 1))

    def pass_telemetry(self, timeout_s: float) -> None:
        """Passes the vehicle's messages to the programs; waits for the first one, at most for the timeout."""
        assert self._ends is not None
        programs, vehicle = self._ends
        self._open_outputs(programs, vehicle)
        for topic, _, data in vehicle.wait(timeout_s):
            if topic == LOCAL_POSITION:
                self._position = data
            if topic != COMMAND_ACK:  # the guard's: these are of other clients
                with contextlib.suppress(OSError):
                    programs.send(topic, data)

    def read_programs(self, timeout_s: float) -> None:
        """Takes the messages of the programs; waits for the first one, at most for the timeout."""
        assert self._ends is not None
        programs, vehicle = self._ends
        while not self._to_vehicle.empty():
            each = self._to_vehicle.get()
            programs.read(each, DEPTHS.get(each.topic, 1))
            if WAYS.get(each.topic) in ("read", "sensor"):
                vehicle.write(each)
        messages, now_s = programs.wait(timeout_s), self._loop.time()
        frames: dict[str, bytes] = {}
        for topic, name, data in messages:
            if name:
                frames[name] = frames.get(name, b"") + self._take(topic, name, data, vehicle, now_s)
        for name, program in self._programs.items():
            frames[name] = frames.get(name, b"") + program.due(now_s, self._newest_position)
        if any(frames.values()):
            self.delivered.clear()
            self._post(self._link.on_frames, [each for each in frames.items() if each[1]], now_s)
        if now_s - self._looked_s >= LOOK_EVERY_S:
            self._looked_s = now_s
            self._forget_ended(programs)

    def _take(self, topic: str, name: str, data: bytes, vehicle: RelayPort, now_s: float) -> bytes:
        """The frames of a program's message."""
        way = WAYS.get(topic)
        if way is None:
            self._refuse(name, topic, REFUSED.get(topic, NOT_PASSED), now_s)
            return b""
        if way in ("read", "sensor"):
            if way == "sensor" and self._link.reads_only:
                self._refuse(name, topic, "this link only reads: it was opened with guard=read.", now_s)
            else:
                with contextlib.suppress(OSError):  # as a lost message
                    vehicle.send(topic, data)
            return b""
        program = self._programs.get(name)
        if program is None:
            if len(self._programs) >= MAX_PROGRAMS:
                return b""
            program = self._programs[name] = ProgramTopics(self._system_id)
        try:
            return program.take(topic, self._decode(topic, data), now_s)
        except (MalformedMessage, ValueError, OverflowError) as problem:
            self._refuse(name, topic, f"the message cannot be read: {problem}.", now_s)
            return b""

    def _decode(self, topic: str, data: bytes) -> Values:
        topic_format = self._formats[topic]
        return MESSAGES[topic_format.type].decode(topic_format.to_server(data))

    def _newest_position(self) -> Values | None:
        data = self._position
        if data is None:
            return None
        try:
            return self._decode(LOCAL_POSITION, data)
        except MalformedMessage:
            return None

    def _refuse(self, name: str, topic: str, why: str, now_s: float) -> None:
        if now_s - self._refused_s.get((name, topic), float("-inf")) >= LOOK_EVERY_S:
            self._refused_s[name, topic] = now_s
            self._post(self._link.on_refusal, name, topic, why)

    def _forget_ended(self, programs: RelayPort) -> None:
        there = programs.participants()
        ended = [
            name for name in {*self._programs, *(name for name, _ in self._refused_s)} if name not in there
        ]
        for name in ended:
            self._programs.pop(name, None)
        self._refused_s = {key: at_s for key, at_s in self._refused_s.items() if key[0] in there}
        if ended:
            self._post(self._link.on_gone, ended)

    def _post(self, call: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the event loop is closed, so the server has ended
            self._loop.call_soon_threadsafe(call, self, *arguments)


def _always() -> dict[str, TopicFormat]:
    """Topics that are offered before the vehicle has announced them; their layouts are equal in all versions
    of PX4. The first answer to a command is often the first message of its topic."""
    kinds = {
        REQUEST: "MessageFormatRequest", RESPONSE: "MessageFormatResponse", COMMAND_ACK: "VehicleCommandAck"
    }  # fmt: skip
    return {topic: TopicFormat(topic, topic, kind, MESSAGES[kind].hash) for topic, kind in kinds.items()}


def open_relay(programs: DdsAddress, vehicle: DdsAddress) -> tuple[RelayPort, RelayPort]:
    """Both ends of a guarded link.

    Args:
        programs: where programs are.
        vehicle: where the vehicle is.

    Raises:
        DdsUnavailable: DDS cannot open one of them.
    """
    from gcs_server.ros2.dds_relay import RelayPort

    return RelayPort(programs, as_vehicle=True), RelayPort(vehicle, as_vehicle=False)
