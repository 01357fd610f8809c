"""Events about missions that are registered with PX4 as flight modes."""

from __future__ import annotations

from typing import Any

from gcs_server.clock import Clock
from gcs_server.errors import GcsError
from gcs_server.vehicle.vehicle import Vehicle

WARNING, NOTICE = 4, 5


def add_event(vehicle: Vehicle, clock: Clock, name: str, code: str, text: str, severity: int) -> None:
    """Adds an event about the mode with this name to the vehicle's events."""
    data: dict[str, Any] = {"source": "mission_mode", "code": code, "name": name}
    kind = "warning" if severity == WARNING else "command"
    vehicle.events.add(kind, clock.unix_s(), text, severity=severity, data=data)


def with_remedy(error: GcsError) -> str:
    """An error and its remedy, as text."""
    return f"{error} {error.remedy}" if error.remedy else str(error)
