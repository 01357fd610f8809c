"""The separation guards in the stream process, each with the function that receives its findings."""

from __future__ import annotations

import logging
from collections.abc import Callable

from gcs_server.clock import Clock
from gcs_server.faults import Isolation
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.separation import Finding, GroupGuard

log = logging.getLogger(__name__)


class Guards:
    """The guards of all groups and missions of several vehicles.

    Args:
        clock: the server's clock.
        streams: runs the guards.
    """

    def __init__(self, clock: Clock, streams: Streams) -> None:
        self._streams = streams
        self._isolation = Isolation(clock, log, "The separation guards")
        self._receivers: dict[str, Callable[[Finding], None]] = {}

    def watch(self, guard: GroupGuard, on_finding: Callable[[Finding], None]) -> None:
        """Starts a guard, or starts it again after a restart of the stream process."""
        self._receivers[guard.name] = on_finding
        self._streams.watch(guard)

    def forget(self, name: str) -> None:
        """Drops the receiver of a guard that has ended, whose last findings may have arrived later."""
        self._receivers.pop(name, None)

    def collect(self) -> None:
        """Passes new findings on; called periodically, and before the end of a guard is judged."""
        for name, finding in self._streams.take_findings():
            if (receiver := self._receivers.get(name)) is not None:
                self._isolation.run(f"a finding of {name}", receiver, finding)

    def isolated(self, work_name: str, work: Callable[[], None]) -> None:
        """Runs periodic work on groups, so that its fault becomes a warning."""
        self._isolation.run(work_name, work)

    def faults(self) -> list[str]:
        """Messages about current faults."""
        return self._isolation.faults
