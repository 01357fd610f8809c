"""The components of a vehicle (autopilot, gimbals, cameras, companion computers), detected by their
heartbeats. Only the autopilot's messages are used for the vehicle's state (`state.py`). Another component
that claims to be an autopilot is listed here, but has no effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, full_payload

LOST_AFTER_S = 10.0
"""Time without a heartbeat after which a component is lost [s]; no usable link loses ten heartbeats in
succession."""
MAX_COMPONENTS = 16
"""Maximum number of components of one vehicle; further components are ignored."""
KIND_OF_TYPE = {
    d.MAV_TYPE_GIMBAL: "gimbal",
    d.MAV_TYPE_CAMERA: "camera",
    d.MAV_TYPE_ONBOARD_CONTROLLER: "companion",
    d.MAV_TYPE_GCS: "ground station",
}
KIND_OF_ID = {
    **dict.fromkeys(range(d.MAV_COMP_ID_CAMERA, d.MAV_COMP_ID_CAMERA6 + 1), "camera"),
    **dict.fromkeys(
        (d.MAV_COMP_ID_GIMBAL, *range(d.MAV_COMP_ID_GIMBAL2, d.MAV_COMP_ID_GIMBAL6 + 1)), "gimbal"
    ),
    **dict.fromkeys(range(d.MAV_COMP_ID_ONBOARD_COMPUTER, d.MAV_COMP_ID_ONBOARD_COMPUTER4 + 1), "companion"),
}


@dataclass(frozen=True, slots=True)
class Component:
    """A component of a vehicle."""

    component_id: int
    """MAVLink component id."""
    kind: str
    """autopilot, gimbal, camera, companion, ground station, other."""
    mav_type: int
    """MAV_TYPE of the component's heartbeat."""
    lost: bool
    """Whether the component is lost: no heartbeat for 10 s."""
    last_heard_unix_s: float | None
    """Time of a lost component's last heartbeat [s since 1970 UTC]; null while it is connected."""


def is_peripheral(component_id: int, mav_type: int) -> bool:
    """Whether a component is certainly not an autopilot, by its heartbeat."""
    return mav_type in KIND_OF_TYPE or component_id in KIND_OF_ID


class Components:
    """All components of one vehicle.

    Args:
        autopilot: the autopilot's component id.
        clock: the vehicle's clock.
        report: called with (text, whether the connection was lost) when a component connects, is lost or
            connects again. Not called for the autopilot: `Vehicle` reports its connection.
    """

    def __init__(self, autopilot: int, clock: Clock, report: Callable[[str, bool], None]) -> None:
        self._autopilot = autopilot
        self._clock = clock
        self._report = report
        self._last_heartbeats: dict[int, tuple[int, float]] = {}
        """By component id: MAV_TYPE, and time of the last heartbeat."""
        self._lost: set[int] = set()

    def heartbeat(self, frame: Frame) -> None:
        """Handles a heartbeat of a component."""
        component_id, is_known = frame.component_id, frame.component_id in self._last_heartbeats
        if not is_known and len(self._last_heartbeats) >= MAX_COMPONENTS and component_id != self._autopilot:
            return
        self._last_heartbeats[component_id] = (full_payload(frame)[4], frame.received_monotonic_s)
        if component_id == self._autopilot:
            return
        if not is_known:
            self._report(f"{self._name(component_id)} connected", False)
        elif component_id in self._lost:
            self._lost.discard(component_id)
            self._report(f"{self._name(component_id)}: connection restored", False)

    def tick(self) -> None:
        """Detects lost components; called periodically."""
        now_s = self._clock.monotonic_s()
        for component_id, (_, received_s) in self._last_heartbeats.items():
            if now_s - received_s > LOST_AFTER_S and component_id not in self._lost:
                self._lost.add(component_id)
                if component_id != self._autopilot:
                    self._report(f"{self._name(component_id)}: connection lost", True)

    def all(self) -> tuple[Component, ...]:
        """All components: the autopilot first, then by id."""
        ids = sorted(self._last_heartbeats, key=lambda each: (each != self._autopilot, each))
        return tuple(self._component(component_id) for component_id in ids)

    def camera(self, component_id: int | None = None) -> int | None:
        """The component id, if a camera with this id is connected; None: no such camera. Without an id, the
        first connected camera."""
        cameras = [c.component_id for c in self.all() if c.kind == "camera" and not c.lost]
        return next((camera_id for camera_id in cameras if component_id in (None, camera_id)), None)

    def _component(self, component_id: int) -> Component:
        mav_type, received_s = self._last_heartbeats[component_id]
        lost = self._is_lost(component_id)
        age_s = self._clock.monotonic_s() - received_s
        received_unix_s = round(self._clock.unix_s() - age_s, 3) if lost else None
        return Component(component_id, self._kind(component_id), mav_type, lost, received_unix_s)

    def _is_lost(self, component_id: int) -> bool:
        return self._clock.monotonic_s() - self._last_heartbeats[component_id][1] > LOST_AFTER_S

    def _kind(self, component_id: int) -> str:
        if component_id == self._autopilot:
            return "autopilot"
        kind_of_type = KIND_OF_TYPE.get(self._last_heartbeats[component_id][0])
        return kind_of_type or KIND_OF_ID.get(component_id, "other")

    def _name(self, component_id: int) -> str:
        kind = self._kind(component_id)
        label = "Component" if kind == "other" else kind.capitalize()
        return f"{label} {component_id}"
