"""What is kept of each vehicle between two looks, for as long as somebody looks.

With nobody looking on nothing is done at all. What was missed meanwhile is made up for from the vehicles'
own history when somebody looks again: one vehicle a look, so that opening a view of many holds up nothing.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Sequence, Set
from dataclasses import dataclass, field

from gcs_server.clock import Clock
from gcs_server.errors import Refused
from gcs_server.isolation import Isolation
from gcs_server.scene.clicks import ground_point
from gcs_server.scene.placement import Placement, VehiclePlace
from gcs_server.scene.ports import OffboardTarget, OffboardTargets, SceneFleet, SceneVehicle
from gcs_server.scene.pose import pose_of
from gcs_server.scene.smoothing import Smoother
from gcs_server.scene.trail import Trail
from missions.frames import Vector3

log = logging.getLogger(__name__)

REMEMBERED_S = 290.0
"""How far back a trail is made up; a vehicle's history reaches five minutes."""
AWAY_AFTER_S = 1.0
"""Not looked for this long: the trail has a gap."""
FEW = 3
"""So many vehicles are looked at each time, all of them."""
TURNS = 3
"""Of more, those that no view follows are looked at once in so many times: most of what a view of a fleet
costs is the vehicles that nobody follows."""


@dataclass(slots=True)
class Track:
    """Of one vehicle."""

    vehicle: weakref.ref[SceneVehicle]
    looked_s: float
    """When it was looked at, by the clock of its samples."""
    owed_since_s: float | None
    """Since then, by the same clock, its trail is yet to be made up; None: it is whole."""
    place: VehiclePlace | None = None
    """Where it was when last looked at; None where it could not be placed."""
    waits_s: float = 0.0
    """Since it was last looked at."""
    local_origin_enu_m: Vector3 | None = None
    """Where its own local frame starts; None while it has none."""
    smoother: Smoother = field(default_factory=Smoother)
    trail: Trail = field(default_factory=Trail)


class Tracks:
    """Of the fleet, in its order.

    Args:
        clock: limits the log.
        offboard: what our own stream asks of a vehicle; None: the vehicle's own report is drawn.
    """

    def __init__(self, fleet: SceneFleet, offboard: OffboardTargets | None, clock: Clock) -> None:
        self._fleet, self._offboard = fleet, offboard
        self.isolation = Isolation(clock, log, "The 3D view")
        self._placement = Placement()
        self._tracks: dict[str, Track] = {}
        self._looked_s = float("-inf")
        self._turn = 0

    def look(self, now_s: float, dt_s: float, wanted: Set[str] = frozenset()) -> dict[str, Track]:
        """Reads the newest samples; by id, in the order that gives the identity colours.

        A vehicle that cannot be placed is not there; the others are.

        Args:
            wanted: vehicles that views follow: always looked at, and their trails made up first.
        """
        vehicles = self._fleet.all()
        self._forget_gone(vehicles)
        away, self._looked_s = now_s - self._looked_s > AWAY_AFTER_S, now_s
        self._turn = (self._turn + 1) % TURNS
        places: dict[str, VehiclePlace] = {}
        for index, vehicle in enumerate(vehicles):
            track = self._track(vehicle, away=away)
            track.waits_s += dt_s
            its_turn = len(vehicles) <= FEW or vehicle.id in wanted or index % TURNS == self._turn
            if its_turn or away or track.place is None:
                name = f"vehicle {vehicle.id}"
                track.place = self.isolation.run(name, self._look_at, vehicle, track, track.waits_s)
                track.waits_s = 0.0
            if track.place is not None:
                places[vehicle.id] = track.place
        owing = [v for v in vehicles if v.id in places and self._tracks[v.id].owed_since_s is not None]
        if owing:
            vehicle = next((v for v in owing if v.id in wanted), owing[0])
            what = f"the trail of vehicle {vehicle.id}"
            self.isolation.run(what, self._make_up, vehicle, places[vehicle.id])
        return {vehicle_id: self._tracks[vehicle_id] for vehicle_id in places}

    def _look_at(self, vehicle: SceneVehicle, track: Track, dt_s: float) -> VehiclePlace:
        place = self._placement.place(vehicle)
        track.local_origin_enu_m = place.local_origin_enu_m
        if place.known and track.owed_since_s is None:
            track.trail.add(place.position_enu_m)
        asked = self._offboard(vehicle.id) if self._offboard is not None else None
        target = OffboardTarget(*asked) if asked is not None else None
        track.smoother.step(pose_of(vehicle, place, target, track.looked_s), dt_s)
        return place

    def shown(self, vehicle_id: str | None) -> tuple[str, Track] | None:
        """The vehicle a view shows; None, or one that has gone: the first there is."""
        vehicle_id = vehicle_id if vehicle_id in self._tracks else next(iter(self._tracks), None)
        return None if vehicle_id is None else (vehicle_id, self._tracks[vehicle_id])

    def enu(self, place_deg_m: tuple[float, float, float]) -> Vector3 | None:
        """Where (lat_deg, lon_deg, alt_amsl_m) is drawn; None while no vehicle has told its position."""
        return self._placement.enu(place_deg_m)

    def on_ground(
        self, vehicle_id: str | None, eye_enu_m: Vector3, ray_enu: Vector3
    ) -> tuple[str, float, float, float] | None:
        """(vehicle, lat_deg, lon_deg, alt_amsl_m) where a look meets the ground of a vehicle's home.

        Args:
            vehicle_id: None, or one that has gone: the first there is.

        Raises:
            Refused: nobody knows where on earth that is.
        """
        shown = self.shown(vehicle_id)
        pose = shown[1].smoother.pose if shown is not None else None
        if shown is None or pose is None:
            raise Refused("There is no vehicle yet, so the 3D ground has no geographic position.")
        point = ground_point(eye_enu_m, ray_enu, pose.ground_z_m)
        if point is None:
            return None
        geodetic = self._placement.geodetic(point)
        if geodetic is None:
            raise Refused(
                "No vehicle has reported its position yet, so the 3D ground has no geographic position.",
                remedy="Wait for a position fix.",
            )
        return (shown[0], *geodetic)

    def _forget_gone(self, vehicles: Sequence[SceneVehicle]) -> None:
        present = {vehicle.id: vehicle for vehicle in vehicles}
        for vehicle_id, track in list(self._tracks.items()):
            # Another one may have come under the same id while nobody looked.
            if (there := track.vehicle()) is None or present.get(vehicle_id) is not there:
                del self._tracks[vehicle_id]
                self._placement.forget(vehicle_id)
        if not self._tracks:
            self._placement.reset()

    def _track(self, vehicle: SceneVehicle, *, away: bool) -> Track:
        now_s = vehicle.clock.monotonic_s()
        track = self._tracks.get(vehicle.id)
        if track is None or now_s - track.looked_s > REMEMBERED_S:
            track = Track(weakref.ref(vehicle), now_s, now_s - REMEMBERED_S)
            self._tracks[vehicle.id] = track
        elif away and track.owed_since_s is None:
            track.owed_since_s = track.looked_s
        track.looked_s = now_s
        return track

    def _make_up(self, vehicle: SceneVehicle, place: VehiclePlace) -> None:
        track = self._tracks[vehicle.id]
        since_s, track.owed_since_s = track.owed_since_s, None
        if since_s is not None and place.known:
            since_unix_s = vehicle.clock.unix_s() - (track.looked_s - since_s)
            for point in self._placement.past(vehicle, place, since_unix_s):
                track.trail.add(point)
