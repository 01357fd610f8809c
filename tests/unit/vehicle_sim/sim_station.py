"""A ground station for tests: exchanges MAVLink bytes with a SimulatedFleet on a fake clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from vehicle_sim.autopilot.announcer import EVENTS
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import Message, pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2

NAN = math.nan
EVENT_NAMES = {event_id: name for name, (event_id, _) in EVENTS.items()}
HOLD_MODE, TAKEOFF_MODE, LAND_MODE, RTL_MODE = 0x3040000, 0x2040000, 0x6040000, 0x5040000
POSITION_MODE, OFFBOARD_MODE = 0x30000, 0x60000
"""Custom modes."""
ARM_DISARM, TAKEOFF_COMMAND, LAND_COMMAND, DO_SET_MODE = 400, 22, 21, 176
"""Numbers of MAV_CMD."""


GCS_LINK, GCS_AND_API_LINKS = (("gcs", "gcs"),), (("gcs", "gcs"), ("api", "api"))


class Station:
    """Sends messages to vehicle 1 and records its messages with their times.

    The offboard link would double the telemetry of a test, so it exists only with `links=GCS_AND_API_LINKS`.
    """

    def __init__(
        self, *, heartbeats: bool = True, links: tuple[tuple[str, str], ...] = GCS_LINK, **fleet: Any
    ) -> None:
        self.sim = SimulatedFleet(links=links, **fleet)
        self.heartbeats = heartbeats
        self.newest_messages: dict[str, Message] = {}
        self._log: list[tuple[float, str, Message]] = []
        self._by_name: dict[tuple[str, str], list[tuple[float, Message]]] = {}
        """Messages by link and name, so that reading texts at every tick does not search all telemetry."""
        self._parsers = {name: FrameParser() for name, _ in links}
        self._unread: list[tuple[float, str, bytes]] = []
        """Bytes of links other than "gcs", which are parsed when they are read."""
        self._sequence = 0
        self._next_heartbeat_s = 0.0

    @property
    def system_id(self) -> int:
        return self.sim.nodes[0].system_id

    @property
    def now_s(self) -> float:
        return self.sim.time_s

    def send(
        self, name: str, /, *, via: str = "gcs", sender: tuple[int, int] = (255, 190), **fields: Any
    ) -> None:
        layout, payload = pack(name, **fields)
        self._sequence = (self._sequence + 1) & 0xFF
        self.sim.feed(0, via, frame_v2(layout, payload, self._sequence, *sender))

    def command(self, command_id: int, *parameters: float, **extra: Any) -> None:
        values = {f"param{n + 1}": value for n, value in enumerate(parameters)}
        self.send(
            "COMMAND_LONG",
            target_system=self.system_id,
            target_component=1,
            command=command_id,
            **values,
            **extra,
        )

    def run(
        self, seconds: float, before_each_step: Callable[[], None] | None = None, *, tick_s: float = 0.02
    ) -> None:
        end_s = self.now_s + seconds - 1e-6
        while self.now_s < end_s:
            if self.heartbeats and self.now_s >= self._next_heartbeat_s:
                self.send("HEARTBEAT", type=6, autopilot=8, mavlink_version=3)
                self._next_heartbeat_s += 1.0
            if before_each_step is not None:
                before_each_step()
            self.sim.step(tick_s)
            self.collect()

    def run_until(
        self, condition: Callable[[], bool], timeout_s: float, before_each_step: Any = None
    ) -> float:
        """Runs until the condition is true; returns the elapsed time [s]."""
        start_s = self.now_s
        while not condition():
            assert self.now_s - start_s < timeout_s, (
                f"not within {timeout_s} s; received {self.status_texts()[-5:]}"
            )
            self.run(0.02, before_each_step)
        return self.now_s - start_s

    def collect(self) -> None:
        for name in self._parsers:
            data = self.sim.drain(0, name)
            if name == "gcs":
                for message in self._record(self.now_s, name, data):
                    self.newest_messages[message.name] = message
            elif data:
                self._unread.append((self.now_s, name, data))

    def _record(self, time_s: float, link: str, data: bytes) -> list[Message]:
        messages = [m for m in self._parsers[link].feed(data) if m.system_id == self.system_id]
        for message in messages:
            self._log.append((time_s, link, message))
            self._by_name.setdefault((link, message.name), []).append((time_s, message))
        return messages

    def _parse_unread(self) -> None:
        unread, self._unread = self._unread, []
        for time_s, link, data in unread:
            self._record(time_s, link, data)

    @property
    def log(self) -> list[tuple[float, str, Message]]:
        """All received messages: time, link, message; in order of time on each link."""
        self._parse_unread()
        return self._log

    def received(self, name: str, via: str = "gcs", since_s: float = 0.0) -> list[Message]:
        if via != "gcs":
            self._parse_unread()
        return [m for t, m in self._by_name.get((via, name), ()) if t >= since_s]

    def status_texts(self, since_s: float = 0.0, via: str = "gcs") -> list[str]:
        """Status texts; the chunks of a text are joined."""
        joined: dict[int, str] = {}
        for message in self.received("STATUSTEXT", via, since_s):
            joined[message.values["id"]] = joined.get(message.values["id"], "") + message.text
        return list(joined.values())

    def events(self, since_s: float = 0.0) -> list[str]:
        return [EVENT_NAMES[m.values["id"]] for m in self.received("EVENT", since_s=since_s)]

    def acks(self, command: int, since_s: float = 0.0) -> list[int]:
        return [m.result for m in self.received("COMMAND_ACK", since_s=since_s) if m.command == command]

    @property
    def mode(self) -> int:
        """Custom mode in the newest heartbeat."""
        return self.newest_messages["HEARTBEAT"].custom_mode

    @property
    def armed(self) -> bool:
        return self.sim.autopilots[0].commander.armed

    @property
    def active_mode(self) -> int:
        """Custom mode that the commander has selected now."""
        return self.sim.autopilots[0].commander.custom_mode()

    @property
    def height_m(self) -> float:
        return -float(self.sim.simulation.truth.position_ned_m[0, 2])

    @property
    def can_be_armed(self) -> bool:
        status = self.newest_messages.get("SYS_STATUS")
        return status is not None and bool(status.onboard_control_sensors_health & 0x10000000)

    def take_off_and_hover(self, height_m: float) -> None:
        """Waits until the vehicle can be armed, arms it, takes off and waits until the vehicle hovers."""
        self.run_until(lambda: self.can_be_armed, 15)
        self.command(ARM_DISARM, 1)
        self.run(0.1)
        self.command(
            TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, self.sim.autopilots[0].home.alt_amsl_m + height_m
        )
        self.run_until(lambda: self.active_mode == HOLD_MODE and self.height_m > height_m - 1.5, 40)
        self.run(3.0)
