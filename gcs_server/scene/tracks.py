"""State of each vehicle between two updates, kept while a view is open.

Nothing is computed while no view is open. When a view opens, trails are built from the vehicles' history: one
vehicle per update, so that the server does not have to decode the history of many vehicles at once.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Sequence, Set
from dataclasses import dataclass, field

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.faults import Isolation
from gcs_server.scene.clicks import REACH_M, ground_point
from gcs_server.scene.placement import Placement, VehiclePlace
from gcs_server.scene.ports import OffboardTarget, OffboardTargets, SceneFleet, SceneVehicle
from gcs_server.scene.pose import pose_of
from gcs_server.scene.smoothing import Smoother, Trail
from gcs_server.scene.snapshots import MAX_ALL_UPDATED, UPDATE_DIVISOR
from gcs_server.scene.terrain import TerrainShape
from missions.frames import Vector3

log = logging.getLogger(__name__)

TRAIL_LENGTH_S = 290.0
"""Length of a trail built from the history [s]; the history contains five minutes."""
PAUSE_S = 1.0
"""Time without an update after which the trail has a gap [s]."""


@dataclass(slots=True)
class Track:
    """Position and trail of one vehicle."""

    vehicle: weakref.ref[SceneVehicle]
    updated_s: float
    """Time of the last update, on the clock of the vehicle's samples."""
    incomplete_since_s: float | None
    """Time on the same clock from which the trail must still be built from the history; None: the trail is
    complete."""
    place: VehiclePlace | None = None
    """Position at the last update; None: the vehicle could not be placed."""
    since_update_s: float = 0.0
    """Time since the last update [s]."""
    local_origin_enu_m: Vector3 | None = None
    """Origin of the vehicle's local frame; None: not known."""
    smoother: Smoother = field(default_factory=Smoother)
    trail: Trail = field(default_factory=Trail)


class Tracks:
    """Tracks of all vehicles, in the order of the fleet.

    Args:
        clock: clock that limits how often errors are logged.
        offboard: returns the setpoint that this server streams to a vehicle; None: draw the target that the
            vehicle reports.
    """

    def __init__(self, fleet: SceneFleet, offboard: OffboardTargets | None, clock: Clock) -> None:
        self._fleet, self._offboard = fleet, offboard
        self.isolation = Isolation(clock, log, "The 3D view")
        self._placement = Placement()
        self._tracks: dict[str, Track] = {}
        self._updated_s = float("-inf")
        self._due_remainder = 0

    def update(self, now_s: float, dt_s: float, followed: Set[str] = frozenset()) -> dict[str, Track]:
        """Reads the newest samples. Returns the tracks by vehicle id, in the order of the identity colours.

        A vehicle that cannot be placed is left out.

        Args:
            followed: vehicles that views follow; they are always updated, and their trails are built first.
        """
        vehicles = self._fleet.all()
        self._forget_removed(vehicles)
        paused, self._updated_s = now_s - self._updated_s > PAUSE_S, now_s
        self._due_remainder = (self._due_remainder + 1) % UPDATE_DIVISOR
        places: dict[str, VehiclePlace] = {}
        for index, vehicle in enumerate(vehicles):
            track = self._track(vehicle, paused=paused)
            track.since_update_s += dt_s
            is_due = (
                len(vehicles) <= MAX_ALL_UPDATED
                or vehicle.id in followed
                or index % UPDATE_DIVISOR == self._due_remainder
            )
            if is_due or paused or track.place is None:
                work_name = f"vehicle {vehicle.id}"
                track.place = self.isolation.run(
                    work_name, self._update_track, vehicle, track, track.since_update_s
                )
                track.since_update_s = 0.0
            if track.place is not None:
                places[vehicle.id] = track.place
        incomplete = [
            v for v in vehicles if v.id in places and self._tracks[v.id].incomplete_since_s is not None
        ]
        if incomplete:
            vehicle = next((v for v in incomplete if v.id in followed), incomplete[0])
            work_name = f"the trail of vehicle {vehicle.id}"
            self.isolation.run(work_name, self._build_trail, vehicle, places[vehicle.id])
        return {vehicle_id: self._tracks[vehicle_id] for vehicle_id in places}

    def _update_track(self, vehicle: SceneVehicle, track: Track, dt_s: float) -> VehiclePlace:
        place = self._placement.place(vehicle)
        track.local_origin_enu_m = place.local_origin_enu_m
        if place.position_known and track.incomplete_since_s is None:
            track.trail.add(place.position_enu_m)
        setpoint = self._offboard(vehicle.id) if self._offboard is not None else None
        target = OffboardTarget(*setpoint) if setpoint is not None else None
        track.smoother.step(pose_of(vehicle, place, target, track.updated_s), dt_s)
        return place

    def selected(self, vehicle_id: str | None) -> tuple[str, Track] | None:
        """The vehicle that a view shows; for None or a removed vehicle, the first vehicle."""
        vehicle_id = vehicle_id if vehicle_id in self._tracks else next(iter(self._tracks), None)
        return None if vehicle_id is None else (vehicle_id, self._tracks[vehicle_id])

    @property
    def origin_deg_m(self) -> tuple[float, float, float] | None:
        """(lat_deg, lon_deg, alt_amsl_m) of the world's origin; None until a vehicle has reported a global
        position."""
        return self._placement.origin_deg_m

    def enu(self, position_deg_m: tuple[float, float, float]) -> Vector3 | None:
        """Position at which (lat_deg, lon_deg, alt_amsl_m) is drawn; None until a vehicle has reported a
        global position.
        """
        return self._placement.enu(position_deg_m)

    def ground_position(
        self,
        vehicle_id: str | None,
        eye_enu_m: Vector3,
        ray_enu: Vector3,
        terrain: TerrainShape | None = None,
    ) -> tuple[str, float, float, float] | None:
        """(vehicle, lat_deg, lon_deg, alt_amsl_m) of the point where a ray meets the known ground, or else
        the level ground at a vehicle's home.

        Args:
            vehicle_id: for None, and for a removed vehicle, the first vehicle is used.
            eye_enu_m: begin of the ray.
            ray_enu: direction of the ray.
            terrain: the known ground.

        Raises:
            Refused: no vehicle has reported a global position.
        """
        selected = self.selected(vehicle_id)
        pose = selected[1].smoother.pose if selected is not None else None
        if selected is None or pose is None:
            raise Refused("There is no vehicle yet, so the 3D ground has no geographic position.")
        point = None if terrain is None else terrain.hit(eye_enu_m, ray_enu, REACH_M)
        point = point or ground_point(eye_enu_m, ray_enu, pose.ground_z_m)
        if point is None:
            return None
        geodetic = self._placement.geodetic(point)
        if geodetic is None:
            raise Refused(
                "No vehicle has reported its position yet, so the 3D ground has no geographic position.",
                remedy="Wait for a position fix.",
            )
        return (selected[0], *geodetic)

    def _forget_removed(self, vehicles: Sequence[SceneVehicle]) -> None:
        current = {vehicle.id: vehicle for vehicle in vehicles}
        for vehicle_id, track in list(self._tracks.items()):
            # Another vehicle may have received the same id while no view was open.
            if (vehicle := track.vehicle()) is None or current.get(vehicle_id) is not vehicle:
                del self._tracks[vehicle_id]
                self._placement.forget(vehicle_id)
        if not self._tracks:
            self._placement.reset()

    def _track(self, vehicle: SceneVehicle, *, paused: bool) -> Track:
        now_s = vehicle.clock.monotonic_s()
        track = self._tracks.get(vehicle.id)
        if track is None or now_s - track.updated_s > TRAIL_LENGTH_S:
            track = Track(weakref.ref(vehicle), now_s, now_s - TRAIL_LENGTH_S)
            self._tracks[vehicle.id] = track
        elif paused and track.incomplete_since_s is None:
            track.incomplete_since_s = track.updated_s
        track.updated_s = now_s
        return track

    def _build_trail(self, vehicle: SceneVehicle, place: VehiclePlace) -> None:
        track = self._tracks[vehicle.id]
        since_s = track.incomplete_since_s
        if since_s is not None and place.position_known:
            since_unix_s = vehicle.clock.unix_s() - (track.updated_s - since_s)
            points = self._placement.earlier_positions(vehicle, place, since_unix_s)
            if points is None:
                return
            track.incomplete_since_s = None
            for point in points:
                track.trail.add(point)
        track.incomplete_since_s = None
