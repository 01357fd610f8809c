"""Links in, vehicles' frames out: owns the connections, heartbeats, forwarding and recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gcs_server.clock import Clock
from gcs_server.links.base import LinkInfo
from gcs_server.supervise import Supervisor


@dataclass(frozen=True, slots=True)
class RouterSettings:
    """What the operator may choose."""

    system_id: int = 255
    component_id: int = 190
    recording_dir: Path | None = None
    """Where tlogs go; None records nothing."""
    recording_max_bytes: int = 200_000_000
    """A tlog is closed and the next begun at this size."""
    recording_keep_free_bytes: int = 500_000_000
    """Recording stops while the disk has less than this free."""


class Router:
    """All links of the server."""

    def __init__(self, clock: Clock, supervisor: Supervisor, settings: RouterSettings) -> None:
        raise NotImplementedError

    def start(self) -> None:
        """Begins heartbeats (1 Hz to each peer of each link that is no replay)."""
        raise NotImplementedError

    def add_link(self, url: str, name: str | None = None) -> LinkInfo:
        """Opens a link: udpin, udpout, tcp, tcpin, serial, tlog; options as in `links/url.py`.

        Raises:
            InvalidRequest: the URL is not understood, or the name is taken.
        """
        raise NotImplementedError

    async def remove_link(self, name: str) -> None:
        """Closes a link and forgets it.

        Raises:
            UnknownLink: no link of that name.
        """
        raise NotImplementedError

    def links(self) -> list[LinkInfo]:
        """State and counters of all links."""
        raise NotImplementedError

    def warnings(self) -> list[tuple[str, str, str]]:
        """(kind, link, text) of what stands now: links that wait, recordings that stopped."""
        raise NotImplementedError

    def on_change(self, callback: Callable[[LinkInfo], None]) -> None:
        """Calls back when a link's state changes."""
        raise NotImplementedError

    async def close(self) -> None:
        """Closes all links and ends the recordings."""
        raise NotImplementedError
