"""The address for an external client, and the server's view of the vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gcs_server.client import SyncVehicle


@dataclass(frozen=True)
class ObservedVehicle:
    """The address for an external client, and the server's view of the vehicle."""

    tcp_port: int
    drone: SyncVehicle

    def history(self, topic: str) -> list[dict[str, Any]]:
        """All stored values of a topic, oldest first."""
        samples = self.drone.request("GET", f"/history?topics={topic}&since_unix_s=0")["samples"]
        return [sample["value"] for sample in samples]
