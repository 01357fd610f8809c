"""One common ENU frame for vehicles with different local origins.

The world's origin is the first known home, or else the first global position. The grid begins there, and its
altitude is the altitude of the ground. A vehicle's local origin is computed from its home, which is reported
in the global and the local frame, or else from one pair of global and local position. A vehicle
without a global position uses the world's origin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from gcs_server.scene.frames import enu_from_geodetic, enu_from_ned, geodetic_from_enu
from gcs_server.scene.ports import SceneVehicle, value_of
from gcs_server.vehicle.samples import GlobalPosition, Home, LocalPosition, Sample, Status
from missions.frames import Vector3

STANDING_HEIGHT_M = 0.225
"""Height of the drawn body above its skids."""
MAX_LANDED_HEIGHT_M = 3.0
"""A landed vehicle is drawn on the ground if its estimated altitude above home is below this [m], because
estimates drift by a metre in a flight. A landed vehicle at a higher altitude is on a hill or a roof."""
MAX_ORIGIN_DRIFT_M = 5.0
"""If global and local position differ by more [m], an estimator reset has moved the local origin."""


@dataclass(frozen=True, slots=True)
class VehiclePlace:
    """Position of a vehicle in the world's ENU [m]."""

    position_enu_m: Vector3
    local_origin_enu_m: Vector3 | None
    """Origin of the vehicle's local frame; None: not known, so that targets cannot be drawn."""
    ground_z_m: float
    """z of the vehicle's home."""
    home_enu_m: Vector3 | None
    height_m: float
    """Estimated altitude above the vehicle's home; it may differ from zero on the ground."""
    position_known: bool
    """Whether a position is known; otherwise the vehicle is drawn at the origin to show its attitude."""


class Placement:
    """Keeps the world's origin and each vehicle's local origin."""

    def __init__(self) -> None:
        self._world_origin_deg_m: tuple[float, float, float] | None = None
        self._local_origins_enu_m: dict[str, Vector3] = {}

    def forget(self, vehicle_id: str) -> None:
        """Removes a vehicle."""
        self._local_origins_enu_m.pop(vehicle_id, None)

    def reset(self) -> None:
        """Drops the world's origin, because no vehicle is left."""
        self._world_origin_deg_m = None
        self._local_origins_enu_m.clear()

    def place(self, vehicle: SceneVehicle) -> VehiclePlace:
        """The position at which the vehicle is drawn."""
        home = value_of(vehicle, "home", Home)
        global_position = value_of(vehicle, "global_position", GlobalPosition)
        local = value_of(vehicle, "local_position", LocalPosition)
        home_enu_m = self._enu_of(home.lat_deg, home.lon_deg, home.alt_amsl_m) if home else None
        global_enu_m = (
            self._enu_of(global_position.lat_deg, global_position.lon_deg, global_position.alt_amsl_m)
            if global_position
            else None
        )
        local_enu_m = enu_from_ned(local.position_ned_m) if local else None
        if local_enu_m is not None and not _finite(local_enu_m):
            local_enu_m = None
        origin = self._local_origin(vehicle.id, home, home_enu_m, global_enu_m, local_enu_m)
        if local_enu_m is not None and origin is not None:
            position = _add(origin, local_enu_m)
        else:
            position = global_enu_m
        # Without a home, the origin of the local frame is the position at which the vehicle was switched on,
        # on the ground.
        ground = home_enu_m or origin or (0.0, 0.0, 0.0)
        height_m = position[2] - ground[2] if position is not None else 0.0
        status = value_of(vehicle, "status", Status)
        if status is not None and status.landed_state == "on_ground" and abs(height_m) < MAX_LANDED_HEIGHT_M:
            x, y, _ = position or ground
            drawn_position = (x, y, ground[2] + STANDING_HEIGHT_M)
        else:
            drawn_position = position or ground
        return VehiclePlace(
            position_enu_m=drawn_position,
            local_origin_enu_m=origin,
            ground_z_m=ground[2],
            home_enu_m=home_enu_m,
            height_m=height_m,
            position_known=position is not None,
        )

    def earlier_positions(
        self, vehicle: SceneVehicle, place: VehiclePlace, since_unix_s: float
    ) -> Iterator[Vector3] | None:
        """Earlier positions in the current frame, oldest first; None: the history has not arrived yet.

        Args:
            place: the vehicle's current position.
        """
        origin = place.local_origin_enu_m
        topic = "local_position" if origin is not None else "global_position"
        samples = vehicle.history((topic,), since_unix_s)
        return None if samples is None else self._positions(samples, origin)

    def _positions(self, samples: list[Sample], origin: Vector3 | None) -> Iterator[Vector3]:
        for sample in samples:
            value = sample.value
            if isinstance(value, LocalPosition) and origin is not None:
                yield _add(origin, enu_from_ned(value.position_ned_m))
            elif isinstance(value, GlobalPosition):
                position_enu_m = self._enu_of(value.lat_deg, value.lon_deg, value.alt_amsl_m)
                if position_enu_m is not None:
                    yield position_enu_m

    @property
    def origin_deg_m(self) -> tuple[float, float, float] | None:
        """(lat_deg, lon_deg, alt_amsl_m) of the world's origin; None if it has no global position."""
        return self._world_origin_deg_m

    def geodetic(self, point_enu_m: Vector3) -> tuple[float, float, float] | None:
        """(lat_deg, lon_deg, alt_amsl_m) of a point of the world; None if the world's origin has no global
        position."""
        origin = self._world_origin_deg_m
        return None if origin is None else geodetic_from_enu(point_enu_m, origin_deg_m=origin)

    def enu(self, position_deg_m: tuple[float, float, float]) -> Vector3 | None:
        """Position of (lat_deg, lon_deg, alt_amsl_m) in the world; None if the world's origin has no global
        position."""
        origin = self._world_origin_deg_m
        return None if origin is None else enu_from_geodetic(*position_deg_m, origin_deg_m=origin)

    def _enu_of(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Vector3 | None:
        """A global position in the world; None if it is not valid. The first one sets the world's origin."""
        if not _finite((lat_deg, lon_deg, alt_amsl_m)) or (lat_deg == 0.0 and lon_deg == 0.0):
            return None
        if self._world_origin_deg_m is None:
            self._world_origin_deg_m = (lat_deg, lon_deg, alt_amsl_m)
        return enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m, origin_deg_m=self._world_origin_deg_m)

    def _local_origin(
        self,
        vehicle_id: str,
        home: Home | None,
        home_enu_m: Vector3 | None,
        global_enu_m: Vector3 | None,
        local_enu_m: Vector3 | None,
    ) -> Vector3 | None:
        if local_enu_m is None:
            return None
        for origin in (_home_origin(home, home_enu_m), self._local_origins_enu_m.get(vehicle_id)):
            # The home is reported in both frames at the same time, so that the altitude above home equals the
            # vehicle's own value. An old home would give a different altitude after an estimator reset.
            if origin is not None and (
                global_enu_m is None
                or math.dist(_add(origin, local_enu_m), global_enu_m) < MAX_ORIGIN_DRIFT_M
            ):
                return origin
        if global_enu_m is not None:
            origin = _subtract(global_enu_m, local_enu_m)
            self._local_origins_enu_m[vehicle_id] = origin
            return origin
        return (0.0, 0.0, 0.0)


def _home_origin(home: Home | None, home_enu_m: Vector3 | None) -> Vector3 | None:
    if home is None or home_enu_m is None or home.position_ned_m is None:
        return None
    home_local_enu_m = enu_from_ned(home.position_ned_m)
    return _subtract(home_enu_m, home_local_enu_m) if _finite(home_local_enu_m) else None


def _finite(values: Vector3) -> bool:
    return all(math.isfinite(v) for v in values)


def _add(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _subtract(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
