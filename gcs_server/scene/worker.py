"""The process of the 3D view: viser, and all drawing.

`handle.py` starts the process with a socket. Each snapshot of the vehicles results in one picture; if several
snapshots arrive while a picture is drawn, only the last one is drawn. A failure in drawing ends the process,
and the server starts it again. The process also ends when the server closes the socket. It runs at a lower
priority than the server, so that flying comes first on a busy machine.
"""

from __future__ import annotations

import asyncio
import logging
import os
import select
import signal
import socket
import sys
from collections import OrderedDict
from dataclasses import replace

from gcs_server.clock import SystemClock
from gcs_server.errors import GcsError
from gcs_server.scene import messages as m
from gcs_server.scene.dry_runs import DryRunPath
from gcs_server.scene.mirror import MirrorFleet
from gcs_server.scene.scene import Scene
from gcs_server.streamer.process.message_pipe import MessagePipe

NICENESS = 5
MAX_WAITING_BYTES = 1_000_000
"""Size of the buffer for a stalled server; the buffer contains only responses, so it never fills up while the
server runs."""


class Worker:
    """Handles the server's messages.

    Args:
        pipe: the pipe to the server.
    """

    def __init__(self, pipe: MessagePipe) -> None:
        self._pipe = pipe
        self._fleet = MirrorFleet(self._request_history)
        self._dry_runs: OrderedDict[str, tuple[DryRunPath, ...]] = OrderedDict()
        self._snapshots = 0
        self._reported = m.DrawingState(0, 0, frozenset(), ())
        self.scene = Scene(
            self._fleet,
            SystemClock(),
            self._fleet.target,
            lambda gizmo: self._pipe.send(m.GizmoMoved(gizmo)),
            self._dry_runs.__getitem__,
            lambda bridge: bridge in self._fleet.stalled,
        )

    def run(self) -> None:
        """Starts the 3D view, and draws until the server closes the socket."""
        address = asyncio.run(self.scene.start())
        try:
            self._pipe.send(m.Started(address))
            while True:
                select.select([self._pipe], [self._pipe] if self._pipe.has_unsent_data else [], [])
                self._pipe.flush()
                previous_snapshots = self._snapshots
                for message in self._pipe.receive():
                    self._handle(message)
                if self._snapshots > previous_snapshots:
                    self.scene.draw()
                    self._report()
        except EOFError:
            pass
        finally:
            asyncio.run(self.scene.stop())

    def _report(self) -> None:
        faults = (*self._fleet.faults, *self.scene.faults())
        state = m.DrawingState(self._snapshots, self.scene.viewers, self.scene.followed, faults)
        reported = replace(self._reported, snapshots=self._snapshots)
        if state != reported or self._snapshots - self._reported.snapshots >= m.MAX_SNAPSHOTS_PER_REPORT:
            self._reported = state
            self._pipe.send(state)

    def _request_history(self, vehicle: int, topics: tuple[str, ...], since_unix_s: float) -> None:
        self._pipe.send(m.HistoryRequest(vehicle, topics, since_unix_s))

    def _handle(self, message: object) -> None:
        match message:
            case m.Snapshot(data):
                self._fleet.apply(data)
                self._snapshots += 1
            case m.HistoryResponse(vehicle, samples):
                self._fleet.store_history(vehicle, samples)
            case m.SetView(number, token, request):
                view = self.scene.set_view(token, request)
                self._pipe.send(m.Response(number, (view.mode, view.vehicle, view.theme)))
            case m.Click(number, token, request):
                try:
                    self._pipe.send(m.Response(number, self.scene.click(token, request)))
                except GcsError as error:
                    self._pipe.send(m.Response(number, None, error))
            case m.HandleDragged(bridge, drag):
                self.scene.drag(bridge, drag)
            case m.NewTerrain(terrain):
                self.scene.set_terrain(terrain)
            case m.DryRunPaths(dry_run, paths):
                self._dry_runs[dry_run] = paths
                while len(self._dry_runs) > m.MAX_DRY_RUNS:
                    self._dry_runs.popitem(last=False)
            case _:
                raise TypeError(f"an unknown message: {message!r}")


def main(arguments: list[str]) -> None:
    """`worker SOCKET_FD`."""
    for number in (signal.SIGINT, signal.SIGTERM):  # the server handles these signals, then closes the socket
        signal.signal(number, signal.SIG_IGN)
    os.nice(NICENESS)
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")
    # websockets logs a traceback for each connection that closes before its request (a closed browser tab).
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    Worker(MessagePipe(socket.socket(fileno=int(arguments[0])), MAX_WAITING_BYTES)).run()


if __name__ == "__main__":
    main(sys.argv[1:])
