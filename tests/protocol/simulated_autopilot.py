"""A complete simulated PX4, with FTP, parameters and events, on a lossy link and on simulated time."""

from __future__ import annotations

import asyncio
import random
from typing import Any

from vehicle_sim.fleet import SimulatedFleet

STEP_S = 0.02


class SimulatedAutopilot:
    """A simulated PX4 in place of a `FakeAutopilot`, as one peer of a memory link.

    Args:
        loss: share of packets lost in each direction; may be changed in flight.
    """

    def __init__(self, link: Any, *, peer: str = "peer", loss: float = 0.0, seed: int = 0, **options: Any):
        self.link, self.peer, self.loss = link, peer, loss
        self.random = random.Random(seed)
        self.sim = SimulatedFleet(1, links=(("gcs", "gcs"),), **options)
        self.loop = asyncio.get_running_loop()
        self.received_frames: list[bytes] = []
        self.alive = True
        link.autopilots[peer] = self
        self.loop.call_later(STEP_S, self.step)

    def step(self) -> None:
        """Steps the simulation, and delivers the frames of the vehicle to the server."""
        if not self.alive:
            return
        self.sim.step(STEP_S)
        for frame in self.sim.frames(0, "gcs"):
            if self.random.random() >= self.loss:
                self.link.inject(frame, self.peer)
        self.loop.call_later(STEP_S, self.step)

    def receive(self, data: bytes) -> None:
        """Delivers a frame of the server to the vehicle."""
        if self.random.random() >= self.loss:
            self.received_frames.append(data)
            self.sim.feed(0, "gcs", data)

    def count(self, msg_id: int) -> int:
        """Number of messages with this id received from the server."""
        return sum(data[7] | data[8] << 8 | data[9] << 16 == msg_id for data in self.received_frames)
