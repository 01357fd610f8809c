"""A whole ground station with simulated vehicles in one event loop: server, HTTP, streams, simulator.

On simulated time (`SimulatedTimeLoop`) a flight of a minute takes seconds, and the same seed gives the same
bytes; on paced time programs of other processes can take part. The station listens on free loopback ports
only, and its data are in a folder that is removed at its end.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import socket
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self, cast

from gcs_server.app import Work, create_app
from gcs_server.client import Gcs, Vehicle
from gcs_server.clock import Clock, LoopClock
from gcs_server.http_server.server import HttpServer
from gcs_server.mavlink.tlog_writer import stamp
from gcs_server.plans import tasks
from gcs_server.plans.work import PlanWork
from gcs_server.scenarios.in_loop_scheduler import InLoopScheduler
from gcs_server.scenarios.memory_link import MemoryLink
from gcs_server.settings import Settings
from gcs_server.streamer.process.streams import Streams
from gcs_server.supervise import Supervisor
from vehicle_sim.fleet import SimulatedFleet

TICK_S = 0.02
"""Period of autopilots and streams [s]."""
LINK = "gcs"
CLIENT = "flight test"
HOST = "127.0.0.1"
CHECK_PERIOD_S = 0.05


class _InLoopPlanWork(PlanWork):
    """Work on plans in the event loop: simulated time must not advance while a process works."""

    async def _in_process(self, task: str, arguments: Mapping[str, Any]) -> tasks.Answer:
        return tasks.run(task, arguments)


class _Http(HttpServer):
    """A server whose signals are those of the program that it is part of."""

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None]:
        yield


class Station:
    """A running ground station; use it as a context manager, in the event loop whose time it has.

    Args:
        fleet: the simulated vehicles, without links.
        after_tick: called after each tick of the simulation.
        silent: whether the server sends the vehicles nothing, so that they are alone with another program.
    """

    def __init__(
        self, fleet: SimulatedFleet, after_tick: Callable[[], None] = lambda: None, *, silent: bool = False
    ) -> None:
        self.sim = fleet
        self.clock = LoopClock(asyncio.get_running_loop())
        """The time of the flight."""
        self.fault: Exception | None = None
        """The error that stopped the simulation; None: it runs."""
        self.url = ""
        """Address of the server."""
        self.gcs: Gcs
        """A connected client."""
        self._after_tick, self._silent = after_tick, silent
        self._recorded: list[bytes] = []
        self._transfers: list[Callable[[], None]] = []
        self._supervisor = Supervisor(self.clock)
        self._exit = contextlib.AsyncExitStack()
        self._scheduler: InLoopScheduler

    async def __aenter__(self) -> Self:
        async with contextlib.AsyncExitStack() as stack:
            data = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gcs-test-")))
            settings = Settings(host=HOST, port=0, links=(), sim=0, data=data, scene=False, record=False)
            work = Work(self._streams, _InLoopPlanWork)
            self.app = create_app(settings, self.clock, static=data / "no page", work=work)
            stack.push_async_callback(self._supervisor.close)
            await self._serve(stack)
            self._add_vehicles()
            self._supervisor.spawn("simulator", self._simulate())
            self.gcs = await stack.enter_async_context(Gcs(self.url, client=CLIENT, client_id=CLIENT))
            self._exit = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._exit.aclose()

    async def vehicle(self, number: int = 1) -> Vehicle:
        """A vehicle (from 1), once it can be armed.

        Raises:
            Timeout: it cannot be armed in time.
        """
        return await self.gcs.wait_for_vehicle(str(number), ready=True)

    async def vehicles(self) -> list[Vehicle]:
        """All vehicles, once they can be armed."""
        return [await self.vehicle(row + 1) for row in range(len(self.sim.nodes))]

    def on_tick(self, transfer: Callable[[], None]) -> Callable[[], None]:
        """Calls a function after each tick, which transfers what further links of the vehicles carry; returns
        what ends that."""
        self._transfers.append(transfer)
        return lambda: self._transfers.remove(transfer)

    def recording(self) -> bytes:
        """What server and vehicles have sent each other (tlog)."""
        return b"".join(self._recorded)

    def _streams(self, _: Settings, clock: Clock) -> Streams:
        self._scheduler = InLoopScheduler(clock)
        return cast(Streams, self._scheduler)

    async def _serve(self, stack: contextlib.AsyncExitStack) -> None:
        """Starts the server at a free loopback port; it stops when the stack ends."""
        # IPPROTO_TCP, because asyncio disables Nagle's algorithm only with an explicit protocol.
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        stack.callback(listener.close)
        listener.bind((HOST, 0))
        listener.listen()
        listener.setblocking(False)
        server = _Http(self.app, self.app.state.connections, self.clock, [])
        serving = self._supervisor.spawn("server", server.serve(sockets=[listener]))

        async def stop() -> None:
            server.should_exit = True
            await serving

        stack.push_async_callback(stop)
        while not server.started:
            if serving.done():
                raise RuntimeError("the server of the flight test did not start")
            await asyncio.sleep(CHECK_PERIOD_S)
        gc.unfreeze()  # a server of long life freezes its objects; this one's are garbage in a minute
        self.url = f"http://{HOST}:{listener.getsockname()[1]}"

    def _add_vehicles(self) -> None:
        for row in range(len(self.sim.nodes)):
            self.sim.add_link(row, LINK, LINK)
            link = MemoryLink(f"vehicle {row + 1}", outgoing=self._feed(row))
            self.app.state.server.router.add(link)
            self.on_tick(self._transfer(row, link))

    def _feed(self, row: int) -> Callable[[bytes, object], None]:
        def feed(data: bytes, _: object) -> None:
            if not self._silent:
                self._record([data])
                self.sim.feed(row, LINK, data)

        return feed

    def _transfer(self, row: int, link: MemoryLink) -> Callable[[], None]:
        def transfer() -> None:
            if frames := self.sim.frames(row, LINK):
                self._record(frames)
                link.inject(b"".join(frames), "vehicle")

        return transfer

    def _record(self, frames: Sequence[bytes]) -> None:
        time = stamp(round(self.clock.unix_s() * 1e6))
        self._recorded += [time + frame for frame in frames]

    async def _simulate(self) -> None:
        """Advances streams and vehicles with the loop's time; what is late is made up for."""
        next_s = self.clock.monotonic_s()
        try:
            while True:
                self._scheduler.step()
                self.sim.step(TICK_S)
                self._after_tick()
                for transfer in self._transfers:
                    transfer()
                next_s += TICK_S
                await asyncio.sleep(max(0.0, next_s - self.clock.monotonic_s()))
        except Exception as error:
            self.fault = error
            raise
