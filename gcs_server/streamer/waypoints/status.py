"""Status of a vehicle's flight of a waypoint plan, as in the topic `waypoint_flight`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class WaypointFlightStatus:
    """Status of the newest flight of a waypoint plan in PX4's Mission mode: the topic `waypoint_flight`. The
    server only monitors the flight."""

    state: Literal["flying", "paused", "done", "stopped"]
    """paused: the vehicle is in another mode, so the server does not monitor it now; done, stopped: the
    flight has ended."""
    name: str | None
    """Name of the plan; null: the plan is not stored on this server."""
    plan_id: str | None
    """Id of the stored plan; null: the plan is not stored on this server."""
    version: int | None
    client: str | None
    """Client that started the flight; null: the pilot, another station, or a mode switch."""
    started_unix_s: float
    """Time from which the server has monitored the flight."""
    item: int | None
    """Index of the current item, from 0; null: the vehicle has not reported an item."""
    count: int
    """Number of items."""
    place: str | None
    """Current item, as in the dry run: "item 3"."""
    title: str | None
    """Kind of the current item: "Waypoint"."""
    planned_by: Literal["dry_run", "plan"] | None
    """Source of the planned path: the dry run that the start named, or straight lines between the items with
    estimated times; null: the flight is not compared with its plan."""
    dry_run: str | None
    """Id of the dry run that the start named."""
    duration_s: float | None
    """Planned time of the whole plan, from arming to disarming; null: not known."""
    remaining_s: float | None
    """Planned time until disarming; null: not known, or the flight has ended."""
    deviation_horizontal_m: float | None
    """Horizontal distance from the planned path [m]; null: see `not_compared`."""
    deviation_vertical_m: float | None
    """Vertical distance from the planned path [m]: positive above it, negative below it; null: see
    `not_compared`."""
    outside_corridor_m: float | None
    """Distance of the vehicle from the dry run's corridor [m], 0 inside; null: no corridor is monitored
    now."""
    not_compared: str | None
    """Why there is no deviation now."""
    reason: str | None
    """Why the flight is paused or has stopped."""
