"""The simulator's mission service without a simulated flight, so that thousands of items take little time."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

from tests.protocol.fake_autopilot import LATENCY_S, FakeAutopilot
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.mavlink import generated_dialect as sim
from vehicle_sim.mavlink.services.mission import MissionService
from vehicle_sim.px4_version import DEFAULT

REQUEST_MESSAGE, MISSION_CURRENT = 512, 42


class NavigatorMission:
    """The mission state of PX4's navigator; this autopilot flies no mission."""

    active = finished = False

    def __init__(self) -> None:
        self.current, self.reached, self.reached_count = 0, None, 0

    def set_current(self, seq: int) -> None:
        self.current = seq


class MissionAutopilot(FakeAutopilot):
    """A scripted autopilot with the simulator's own mission service."""

    def __init__(self, link: Any, **options: Any) -> None:
        super().__init__(link, **options)
        loop = self.loop

        class View:
            px4 = DEFAULT

            @property
            def time_s(self) -> float:
                return loop.time()

        self.texts: list[str] = []
        self.last_delivery_s = 0.0
        self.flight = NavigatorMission()
        self.station_link = SimpleNamespace(name="gcs", send=self.send_named)
        announcer = SimpleNamespace(announce=lambda _severity, text, _event: self.texts.append(text))
        self.autopilot_parts = SimpleNamespace(
            navigator=SimpleNamespace(mission=self.flight),
            plans=SimpleNamespace(store=lambda _kind, _items, _start_seq: None),
            announcer=announcer,
            commander=SimpleNamespace(active=NavState.HOLD),
        )
        context = SimpleNamespace(
            autopilot=self.autopilot_parts,
            view=View(),
            links=[self.station_link],
            addresses_autopilot=lambda message: message.target_system == self.system,
            broadcast=self.send_named,
        )
        self.service = MissionService(context)  # type: ignore[arg-type]
        self._every(0.02, self.service.step)
        self._every(1.0, lambda: self.service.send_current(self.station_link))  # type: ignore[arg-type]

    def send_named(self, name: str, /, **fields: Any) -> None:
        self.send(getattr(sim, f"MAVLink_{name.lower()}_message")(**fields))

    def receive(self, data: bytes) -> None:
        """Delivers the messages of a packet after the latency, in the order of the packets."""
        if self.random.random() >= self.loss:
            for message in self.parser.parse_buffer(data) or []:
                self.last_delivery_s = max(self.loop.time() + LATENCY_S, self.last_delivery_s + 1e-6)
                self.loop.call_at(self.last_delivery_s, self.handle, message)

    def handle(self, message: Any) -> None:
        name = message.get_type()
        if name in self.service.handlers:
            self.handle_mission_message(message, (message.get_srcSystem(), message.get_srcComponent()))
        elif name == "COMMAND_LONG" and (message.command, message.param1) == (
            REQUEST_MESSAGE,
            MISSION_CURRENT,
        ):
            self.service.send_current(self.station_link)  # type: ignore[arg-type]
        else:
            super().handle(message)

    def handle_mission_message(self, message: Any, sender: tuple[int, int]) -> None:
        """Passes a mission message of any station to the mission service."""
        fields = {name: getattr(message, name) for name in message.fieldnames}
        name = message.get_type()
        parsed = SimpleNamespace(
            name=name, sender=sender, system_id=sender[0], component_id=sender[1], values=fields, **fields
        )
        self.service.handlers[name](self.station_link, parsed)  # type: ignore[arg-type]


class UploadingStation:
    """Another ground station, which uploads missions on the same link without packet loss."""

    def __init__(self, autopilot: MissionAutopilot) -> None:
        self._autopilot = autopilot

    async def upload(self, items: Any, pause_s: float = 0.05) -> None:
        """Sends all items without waiting for requests."""
        self._autopilot.handle_mission_message(
            sim.MAVLink_mission_count_message(1, 1, len(items), 0), (254, 190)
        )
        for item in items:
            await asyncio.sleep(pause_s)
            values = (item.param1, item.param2, item.param3, item.param4, item.x, item.y, item.z)
            message = sim.MAVLink_mission_item_int_message(
                1, 1, item.seq, item.frame, item.command, 0, 1, *values, 0
            )
            self._autopilot.handle_mission_message(message, (254, 190))
        await asyncio.sleep(pause_s)
