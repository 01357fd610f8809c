"""Where an outside client connects, and what our server sees of it meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.client import SyncVehicle


@dataclass(frozen=True)
class Watched:
    """Where the client connects, and what the server sees meanwhile."""

    tcp_port: int
    drone: SyncVehicle

    def history(self, topic: str) -> list[dict[str, object]]:
        """Every value of a topic that the server remembers, oldest first."""
        samples = self.drone.request("GET", f"/history?topics={topic}&since_unix_s=0")["samples"]
        return [sample["value"] for sample in samples]
