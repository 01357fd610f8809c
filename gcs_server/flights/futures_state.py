"""The present state of a vehicle and what is around it, for futures of its commands."""

from __future__ import annotations

import fnmatch
import functools
import math
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydantic import TypeAdapter

from gcs_server.errors import Refused
from gcs_server.flights.futures_task import Surroundings
from gcs_server.flights.proofs import USED
from gcs_server.flights.readings import MAX_WIND_AGE_S, vehicle_reading
from gcs_server.flights.traffic import predictions_of
from gcs_server.flights.vehicle_models import VehicleModels
from gcs_server.streamer.offboard.estimates import MAX_ACCURACY_AGE_S, VehicleEstimates
from gcs_server.vehicle.samples import Battery, Estimator, Home, Wind
from gcs_server.vehicle.vehicle import Vehicle
from missions.dry_run.setup import AIRFRAME_SPECIFIC, release_name, simulated_release
from missions.errors import PlanError
from missions.fence import CircleFence, Fence
from missions.formats.mavlink_items import fence_from_wire
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.values import FenceCircle, FencePolygon, FenceZone, Obstacle, Point
from missions.what_if.futures.start import GRAVITY_M_S2, OtherVehicle, Start

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights

UNKNOWN_ERROR_M = 0.8
"""One sigma of a position or height whose accuracy the vehicle does not report."""
FAR_BELOW_M = 1000.0
"""An unknown ground is taken this far below the vehicle."""
CONTROLLERS = ("MPC_*", "NAV_ACC_RAD", "NAV_MC_ALT_RAD", "HTE_*")
"""Parameters of any vehicle that do not depend on its body."""
SIMULATED = (*USED, *CONTROLLERS, "SIH_*", "CA_ROTOR*", "SIM_BAT_*", "BAT1_*")
"""Those of a simulated vehicle, with its body."""
SIMULATED_MASS_KG, SIMULATED_THRUST_N = 1.0, 5.0
"""Mass, and thrust of one motor, of the quadrotor whose body is taken for an unknown one."""
_zones = TypeAdapter(tuple[FenceZone, ...])
_obstacles = TypeAdapter(tuple[Obstacle, ...])


def require_flight(vehicle: Vehicle) -> None:
    """Raises Refused, NotVerified or Disconnected for a vehicle whose futures cannot be flown now."""
    vehicle.require_commandable()
    estimates = VehicleEstimates(vehicle)
    if not vehicle_reading(vehicle).in_air:
        raise Refused(
            f"Vehicle {vehicle.id} is not flying: futures begin in flight.",
            remedy="Take off first; a plan is flown from the ground in a dry run.",
        )
    if not (estimates.has_position() and estimates.has_velocity()) or estimates.attitude() is None:
        raise Refused(
            f"Vehicle {vehicle.id} has no valid position, velocity or attitude of the last second: "
            "its futures have no begin.",
            remedy="Wait for GPS and the estimator.",
        )


def start_of(vehicle: Vehicle, models: VehicleModels, assumed: list[str]) -> Start:
    """The present state, moved on by the age of the position; assumptions are added to `assumed`.

    Raises:
        Refused, NotVerified, Disconnected: see `require_flight`.
    """
    require_flight(vehicle)
    estimates, snapshot = VehicleEstimates(vehicle), VehicleEstimates(vehicle).snapshot()
    local, attitude = estimates.local(), estimates.attitude()
    assert local is not None
    assert attitude is not None
    position = snapshot.position_at(vehicle.clock.monotonic_s()) or local.position_ned_m
    horizontal_m, vertical_m = _errors(vehicle, assumed)
    release = simulated_release(vehicle.identity.software.release)
    return Start(
        position_ned_m=position,
        velocity_ned_m_s=local.velocity_ned_m_s,
        q_ned_frd=attitude.q_ned_frd,
        rates_frd_rad_s=attitude.rates_frd_rad_s or (0.0, 0.0, 0.0),
        ground_down_m=_ground_down_m(estimates, position[2], assumed),
        position_error_m=horizontal_m,
        height_error_m=vertical_m,
        wind_ne_m_s=_wind(vehicle),
        in_hold=vehicle.status.mode == "hold",
        hold_target_ned_m=_hold_target(vehicle, estimates),
        battery_share=_battery(vehicle),
        parameters=_parameters(vehicle, models, assumed),
        px4=release_name(release),
    )


def surroundings_of(
    flights: Flights, vehicle: Vehicle, obstacles: Sequence[Obstacle], horizon_s: float, assumed: list[str]
) -> Callable[[], Surroundings]:
    """Reads what is around a vehicle. The returned function, for a thread, computes the rest; assumptions
    are added to `assumed` by both."""
    estimates = VehicleEstimates(vehicle)
    origin, home = estimates.origin(), estimates.home()
    known = {param.name: float(param.value) for param in vehicle.params.all()}
    operator = flights.offboard(vehicle.id).operator_limits.limits
    on_vehicle, ids = vehicle.mission.items_on_vehicle, vehicle.mission.ids()
    stored = None if ids is None or ids["fence"] == 0 else ids["fence"]
    items = () if on_vehicle is None or on_vehicle.ids["fence"] != stored else on_vehicle.items["fence"]
    others = _others(flights, vehicle, origin, horizon_s, assumed)

    def compute() -> Surroundings:
        zones: list[FenceZone] = []
        if stored is not None:
            try:
                zones += fence_from_wire(items)
            except PlanError:
                zones = []
            if not zones:
                assumed.append(
                    f"Vehicle {vehicle.id} has a geofence that this server does not know: read its plan."
                )
        if operator.fence is not None:
            zones.append(_zone(operator.fence))
        frame = origin or LocalOrigin(0.0, 0.0, 0.0)
        if origin is None or home is None:
            assumed.append("Home or the global position is not known: geofence and obstacles are left out.")
            return Surroundings(frame, (0.0, 0.0, 0.0), b"[]", 0.0, 0.0, b"[]", others())
        home_frame = LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
        return Surroundings(
            home=home_frame,
            home_ned_m=home.position_ned_m or origin.to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m),
            zones=_zones.dump_json(tuple(zones)),
            radius_m=_smallest(known.get("GF_MAX_HOR_DIST"), operator.distance_max_m),
            height_m=_smallest(known.get("GF_MAX_VER_DIST"), operator.height_max_m),
            obstacles=_obstacles.dump_json(tuple(obstacles)),
            others=others(),
        )

    return compute


def _smallest(*limits_m: float | None) -> float:
    """The smallest limit above 0; 0: there is none."""
    return min((each for each in limits_m if each is not None and each > 0.0), default=0.0)


def _zone(fence: Fence) -> FenceZone:
    """The operator's fence as a zone of a plan."""
    if isinstance(fence, CircleFence):
        center = Point(lat_deg=fence.lat_deg, lon_deg=fence.lon_deg)
        return FenceCircle(inclusion=True, center=center, radius_m=fence.radius_m)
    corners = tuple(Point(lat_deg=lat, lon_deg=lon) for lat, lon in fence.points_deg)
    return FencePolygon(inclusion=True, polygon=corners)


def _others(
    flights: Flights, vehicle: Vehicle, origin: LocalOrigin | None, horizon_s: float, assumed: list[str]
) -> Callable[[], tuple[OtherVehicle, ...]]:
    """The function that predicts the other vehicles, in the frame of `origin`."""
    if origin is None:
        return lambda: ()
    others = [
        (other.id, predictions_of(flights, other), VehicleEstimates(other).as_leader(origin))
        for other in flights.fleet.all()
        if other.id != vehicle.id and not other.identity.replayed
    ]

    def predict() -> tuple[OtherVehicle, ...]:
        found: list[OtherVehicle] = []
        for vehicle_id, predictions, now in others:
            path = next((path for each in predictions if (path := each()) is not None), None)
            if path is not None:
                moved = path.origin.to_frame_of(origin, (0.0, 0.0, 0.0))
                found.append(OtherVehicle(vehicle_id, path.t_s, path.position_ned_m + np.array(moved)))
            elif now is not None:
                if math.hypot(*now.velocity_ned_m_s) > 0.5:
                    assumed.append(f"Vehicle {vehicle_id} flies straight on as it does now.")
                times = np.array([0.0, horizon_s])
                along = times[:, None] * np.array(now.velocity_ned_m_s)
                found.append(OtherVehicle(vehicle_id, times, np.array(now.position_ned_m) + along))
        return tuple(found)

    return predict


def _errors(vehicle: Vehicle, assumed: list[str]) -> tuple[float, float]:
    """One sigma of the horizontal and of the vertical position estimate [m]."""
    sample, now_s = vehicle.topic("estimator"), vehicle.clock.monotonic_s()
    errors: list[float | None] = [None, None]
    if (
        sample is not None
        and isinstance(sample.value, Estimator)
        and now_s - sample.received_monotonic_s <= MAX_ACCURACY_AGE_S
    ):
        errors = [sample.value.horizontal_accuracy_m, sample.value.vertical_accuracy_m]
    if None in errors:
        assumed.append(
            f"The accuracy of the position is not known: {UNKNOWN_ERROR_M:g} m (one sigma) is taken."
        )
    horizontal_m, vertical_m = (UNKNOWN_ERROR_M if each is None else each for each in errors)
    return horizontal_m, vertical_m


def _hold_target(vehicle: Vehicle, estimates: VehicleEstimates) -> Vector3 | None:
    origin, target = estimates.origin(), vehicle.guided.hold_target()
    return None if origin is None or target is None else origin.to_ned(*target)


def _wind(vehicle: Vehicle) -> tuple[float, float] | None:
    sample = vehicle.topic("wind")
    if sample is None or not isinstance(sample.value, Wind):
        return None
    if vehicle.clock.monotonic_s() - sample.received_monotonic_s > MAX_WIND_AGE_S:
        return None
    north, east, _ = sample.value.wind_ned_m_s
    return (north, east)


def _battery(vehicle: Vehicle) -> float | None:
    sample = vehicle.topic("battery")
    percent = sample.value.remaining_percent if sample and isinstance(sample.value, Battery) else None
    return None if percent is None else min(1.0, max(0.0, percent / 100.0))


def _ground_down_m(estimates: VehicleEstimates, down_m: float, assumed: list[str]) -> float:
    """Position down of the ground: the level of home."""
    home, origin = estimates.home(), estimates.origin()
    if isinstance(home, Home):
        if home.position_ned_m is not None:
            return home.position_ned_m[2]
        if origin is not None:
            return origin.to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m)[2]
    assumed.append("Home is not known: the ground is taken far below the vehicle.")
    return down_m + FAR_BELOW_M


def _parameters(vehicle: Vehicle, models: VehicleModels, assumed: list[str]) -> dict[str, float]:
    """The parameters with which the vehicle is simulated, with its body."""
    known = {param.name: float(param.value) for param in vehicle.params.all()}
    if "SIH_MASS" in known:
        return _chosen(known, SIMULATED)
    if not known:
        assumed.append(
            f"The parameters of vehicle {vehicle.id} have not been read: PX4's defaults are taken."
        )
    controllers = _chosen(known, CONTROLLERS)
    kept = models.find(vehicle.identity)
    if kept is not None:
        assumed.append(f"The body of vehicle {vehicle.id} is the one identified in a flight: {kept.text()}.")
        gains = _chosen(known, USED) if kept.turns_known else {}
        return controllers | gains | dict(kept.parameters)
    hover = controllers.get("MPC_THR_HOVER")
    assumed.append(
        f"Nothing is known of the body of vehicle {vehicle.id}: that of PX4's simulated quadrotor is taken, "
        "with the hover thrust of MPC_THR_HOVER if that is known."
    )
    if hover is None or not 0.1 <= hover <= 0.8:
        return {name: value for name, value in controllers.items() if name not in AIRFRAME_SPECIFIC}
    thrust_n = SIMULATED_MASS_KG * GRAVITY_M_S2 / (4.0 * hover)
    return controllers | {"SIH_T_MAX": thrust_n} | _turning(thrust_n / SIMULATED_THRUST_N)


def _turning(stronger: float) -> dict[str, float]:
    """Moments and inertia with which a body with stronger motors turns as before by the same signals."""
    inertia = {"SIH_IXX": 0.025, "SIH_IYY": 0.025, "SIH_IZZ": 0.030}
    return {"SIH_Q_MAX": 0.1 * stronger} | {name: value * stronger for name, value in inertia.items()}


def _chosen(known: dict[str, float], patterns: tuple[str, ...]) -> dict[str, float]:
    matches = _pattern(patterns).match
    return {name: value for name, value in known.items() if math.isfinite(value) and matches(name)}


@functools.cache
def _pattern(patterns: tuple[str, ...]) -> re.Pattern[str]:
    """One pattern for all: there are a thousand parameters, and this runs in the event loop."""
    return re.compile("|".join(map(fnmatch.translate, patterns)))
