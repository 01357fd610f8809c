"""Obstacle avoidance of one stream: between the setpoint that is resolved and its limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gcs_server.streamer.values.events import NOTICE, WARNING, StreamEvent
from gcs_server.streamer.values.snapshot import Snapshot
from missions.avoidance.avoider import Avoider
from missions.avoidance.values import Adjusted, Allowed, AvoidanceState, AvoidanceWay, Here, Wanted
from missions.fence import FenceArea
from missions.frames import Vector3
from missions.setpoints import (
    DirectSetpoint,
    Position,
    PositionGlobal,
    Trajectory,
    Velocity,
    complete,
    zeros_for_none,
)

AHEAD_S = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
"""So far ahead a path is looked at."""
NOT_AVOIDED = "Setpoints of this type are not led around obstacles; the obstacle brake still acts."
Later = Callable[[float], DirectSetpoint | None]
"""The setpoint at another time; for setpoints that move."""


@dataclass(frozen=True, slots=True)
class Avoiding:
    """What avoidance does now."""

    state: AvoidanceState
    text: str
    """Empty while it flies as ordered."""


class AvoidanceStage:
    """Of one stream; off until a snapshot or an order switches it on."""

    def __init__(self) -> None:
        self._avoider: Avoider | None = None
        self._reports: list[StreamEvent] = []
        self.doing: Avoiding | None = None
        """None: off."""

    @property
    def on_a_detour(self) -> bool:
        """Whether it flies otherwise than ordered."""
        return self.doing is not None and self.doing.state != "clear"

    def forget(self) -> None:
        """A new stream begins, or no order is followed any more."""
        self._avoider = self.doing = None

    def take_reports(self) -> list[StreamEvent]:
        """What it did since the last call."""
        taken, self._reports = self._reports, []
        return taken

    def apply(
        self,
        now_s: float,
        snapshot: Snapshot,
        ordered: DirectSetpoint,
        later: Later | None,
        way: AvoidanceWay | None,
        fence: FenceArea | None = None,
    ) -> DirectSetpoint:
        """What to send instead of what is ordered.

        Args:
            now_s: the moment.
            snapshot: the vehicle, with what its sensors measured.
            ordered: at this moment.
            later: what is ordered at other moments; None: the same.
            way: what is tried first; None: avoidance is off.
            fence: of the mission that is flown.
        """
        if way is None:
            self.forget()
            return ordered
        if self._avoider is None or self._avoider.way != way:
            self._avoider = Avoider(way)
        place = _place(ordered, snapshot)
        if place is None:
            self._tell(Avoiding("clear", NOT_AVOIDED))
            return ordered
        here = _here(now_s, snapshot)
        if here is None:
            self._tell(Avoiding("stopped", "No valid position estimate: the vehicle is stopped."))
            return Velocity((0.0, 0.0, 0.0), yaw_rate_ned_rad_s=0.0)
        feed = (
            zeros_for_none(ordered.velocity_ned_m_s) if isinstance(ordered, Trajectory) else (0.0, 0.0, 0.0)
        )
        yaw = getattr(ordered, "yaw_ned_rad", None)
        wanted = Wanted(place, feed, yaw, _ahead(now_s, later, snapshot))
        adjusted = self._avoider.adjust(now_s, here, wanted, snapshot.scans, _allowed(snapshot, fence))
        self._tell(Avoiding(adjusted.state, adjusted.text))
        return _flown(ordered, adjusted)

    def _tell(self, doing: Avoiding) -> None:
        before, self.doing = self.doing, doing
        if before is not None and before.state == doing.state:
            return
        if doing.state == "stopped":
            self._reports.append(StreamEvent("avoidance_stopped", WARNING, doing.text))
        elif doing.text:
            self._reports.append(StreamEvent("avoidance", NOTICE, doing.text))
        elif before is not None:
            self._reports.append(StreamEvent("avoidance", NOTICE, "The way is free: flying as ordered."))


def _flown(ordered: DirectSetpoint, adjusted: Adjusted) -> DirectSetpoint:
    if adjusted.motion is not None:
        return adjusted.motion
    if adjusted.yaw_ned_rad is None:
        return ordered
    return replace(ordered, yaw_ned_rad=adjusted.yaw_ned_rad, yaw_rate_ned_rad_s=None)  # type: ignore[call-arg]


def _place(setpoint: DirectSetpoint, snapshot: Snapshot) -> Vector3 | None:
    """Where a setpoint leads; None for one that steers no place."""
    if isinstance(setpoint, Position | Trajectory):
        return complete(setpoint.position_ned_m)
    origin = snapshot.bounds.origin
    if isinstance(setpoint, PositionGlobal) and origin is not None and setpoint.alt_amsl_m is not None:
        return origin.to_ned(setpoint.lat_deg, setpoint.lon_deg, setpoint.alt_amsl_m)
    return None


def _ahead(now_s: float, later: Later | None, snapshot: Snapshot) -> tuple[Vector3, ...]:
    if later is None:
        return ()
    found = (later(now_s + ahead_s) for ahead_s in AHEAD_S)
    return tuple(
        place for each in found if each is not None and (place := _place(each, snapshot)) is not None
    )


def _here(now_s: float, snapshot: Snapshot) -> Here | None:
    position, velocity, yaw = snapshot.position_at(now_s), snapshot.velocity_ned_m_s, snapshot.yaw_ned_rad
    if position is None:
        return None
    return Here(position, velocity or (0.0, 0.0, 0.0), yaw or 0.0)


def _allowed(snapshot: Snapshot, fence: FenceArea | None) -> Allowed:
    bounds = snapshot.bounds
    return Allowed(
        min(bounds.speed_m_s, bounds.approach_m_s),
        min(bounds.climb_m_s, bounds.approach_climb_m_s),
        min(bounds.sink_m_s, bounds.approach_sink_m_s),
        bounds.region,
        fence,
    )
