"""The corridor of many flights, and what they come near to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.clearance import FenceDistance, obstacle_distance_m
from missions.dry_run.setup import AnyObstacle
from missions.frames import Vector3
from missions.what_if.futures.document import SHARE, FuturesCorridor, FuturesQuantiles, NearestThing
from missions.what_if.futures.flight import Tracks
from missions.what_if.futures.start import OtherVehicle

Values = NDArray[np.float64]

MIN_RADIUS_M = 0.1
"""Spread of the flights at each time that is taken at least, so that a moment at which all agree does not
decide about the whole corridor [m]."""
OUTPUT_SAMPLES = 2
"""Every so many samples of the tracks are in the corridor: 5 Hz."""
OBSTACLE_M, VEHICLE_M = 0.5, 2.0
"""A flight that comes nearer touches an obstacle, or another vehicle."""


def corridor(tracks: Tracks) -> FuturesCorridor:
    """The tube around the mean in which `SHARE` of the flights stay from begin to end.

    At each time its size is in proportion to the spread of the flights then. One factor for all times makes
    it so large that it holds that share of whole flights, and of a further one (the quantile of a conformal
    prediction).
    """
    position = tracks.position_ned_m
    mean = position.mean(axis=1)
    offset = position - mean[:, None]
    across, above = np.hypot(offset[:, :, 0], offset[:, :, 1]), np.abs(offset[:, :, 2])
    radius = np.sqrt((across**2).mean(axis=1)) + MIN_RADIUS_M
    height = np.sqrt((above**2).mean(axis=1)) + MIN_RADIUS_M
    farthest = np.maximum(across / radius[:, None], above / height[:, None]).max(axis=0)
    count = len(farthest)
    factor = np.sort(farthest)[min(count - 1, math.ceil((count + 1) * SHARE) - 1)]
    kept = slice(None, None, OUTPUT_SAMPLES)
    return FuturesCorridor(
        t_s=np.round(tracks.t_s[kept], 2).tolist(),
        position_ned_m=[tuple(each) for each in np.round(mean[kept], 2).tolist()],
        horizontal_m=np.round(factor * radius[kept], 2).tolist(),
        vertical_m=np.round(factor * height[kept], 2).tolist(),
    )


def arrivals_s(tracks: Tracks, target_ned_m: Vector3, within_m: float) -> Values:
    """(A,) times of the flights that come as near as this to a target, as their estimators see it."""
    near = np.linalg.norm(tracks.estimated_ned_m - np.array(target_ned_m), axis=2) <= within_m
    return tracks.t_s[near.argmax(axis=0)[near.any(axis=0)]]


def quantiles(values: Values, digits: int) -> FuturesQuantiles | None:
    """Quantiles of the values; None without values."""
    if not len(values):
        return None
    p5, p50, p95 = np.round(np.quantile(values, (0.05, 0.5, 0.95)), digits).tolist()
    return FuturesQuantiles(p5, p50, p95)


def nearest_fence(tracks: Tracks, fence: FenceDistance, home_ned_m: Vector3) -> NearestThing | None:
    """How near the flights come to the geofence, which is relative to home; None: there is none."""
    if not fence.exists:
        return None
    return _nearest(
        tracks, lambda position: (fence.distance_m(position - np.array(home_ned_m)), None), ["geofence"], 0.0
    )


def nearest_obstacle(
    tracks: Tracks, obstacles: Sequence[AnyObstacle], home_ned_m: Vector3
) -> NearestThing | None:
    """How near the flights come to an obstacle; the obstacles are relative to home. None: there are none."""
    if not obstacles:
        return None
    return _nearest(
        tracks,
        lambda position: obstacle_distance_m(obstacles, position - np.array(home_ned_m)),
        [each.name for each in obstacles],
        OBSTACLE_M,
    )


def nearest_vehicle(tracks: Tracks, others: Sequence[OtherVehicle]) -> NearestThing | None:
    """How near the flights come to other vehicles at the same time; None: there are no others."""
    if not others:
        return None
    samples, count, _ = tracks.position_ned_m.shape

    def distances(position: Values) -> tuple[Values, NDArray[np.intp]]:
        found: list[Values] = []
        for other in others:
            at = np.stack([np.interp(tracks.t_s, other.t_s, axis) for axis in other.position_ned_m.T], axis=1)
            apart = position.reshape(samples, count, 3) - at[:, None]
            found.append(np.linalg.norm(apart, axis=2).ravel())
        table = np.stack(found)
        return table.min(axis=0), table.argmin(axis=0)

    return _nearest(tracks, distances, [each.vehicle for each in others], VEHICLE_M)


def _nearest(
    tracks: Tracks,
    distances: Callable[[Values], tuple[Values, NDArray[np.intp] | None]],
    names: Sequence[str],
    touches_m: float,
) -> NearestThing:
    samples, count, _ = tracks.position_ned_m.shape
    distance_m, which = distances(tracks.position_ned_m.reshape(-1, 3))
    at = int(distance_m.argmin())
    sample, flight = divmod(at, count)
    touched = int((distance_m.reshape(samples, count).min(axis=0) < touches_m).sum())
    north, east, down = np.round(tracks.position_ned_m[sample, flight], 2).tolist()
    return NearestThing(
        name=names[0 if which is None else int(which[at])],
        distance_m=round(float(distance_m[at]), 2),
        t_s=round(float(tracks.t_s[sample]), 2),
        position_ned_m=(north, east, down),
        touched=touched,
    )
