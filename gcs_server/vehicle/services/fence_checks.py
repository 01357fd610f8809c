"""Compares the targets of guided commands with the geofence that the vehicle has, before they are sent.

PX4 acknowledges a go-to outside its geofence, changes to Hold, and stays where it is. What it does with an
orbit that leaves the geofence no recording shows; GF_ACTION acts when the vehicle gets there. So both are
refused here, unless the caller accepts the finding.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Collection, Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np

from gcs_server.errors import PlanFindings
from gcs_server.vehicle.samples import Home
from gcs_server.vehicle.services.mission import MissionService
from gcs_server.vehicle.services.port import VehiclePort
from missions.errors import PlanError
from missions.fence import FenceArea
from missions.formats.mavlink_items import fence_from_wire
from missions.geodesy import LocalOrigin
from missions.offboard.positions import fence_area

ACTION_PARAMETER = "GF_ACTION"
"""What PX4 does at the geofence; 0: nothing, so that nothing is compared."""
RADIUS_PARAMETER, HEIGHT_PARAMETER = "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"
"""Greatest distance from home and altitude above home [m]; 0: no limit."""
LatLon = tuple[float, float]
Finding = tuple[str, str]
"""Code, as in the checks of plans, and text."""
READ_LIMITS_S = 2.0
"""Limits of the geofence that the vehicle has not stated after this time are not compared [s]: a go-to must
not wait for them longer."""
FENCE_UNKNOWN = "fence_unknown"
REMEDY = "Choose another target, or name the codes in `despite` if you accept this."


class FenceChecks:
    """The comparisons for one vehicle.

    Args:
        vehicle: the vehicle.
        mission: its plan, with the geofence.
        limit: the value of a parameter, read from the vehicle if it is not known; None: no answer.
    """

    def __init__(
        self,
        vehicle: VehiclePort,
        mission: Callable[[], MissionService],
        limit: Callable[[str], Awaitable[float | None]],
    ) -> None:
        self._vehicle = vehicle
        self._mission = mission
        self._limit = limit

    async def require_inside(
        self,
        start: LatLon,
        shape: Sequence[LatLon],
        alt_amsl_m: float,
        despite: Collection[str],
    ) -> None:
        """Checks that a vehicle at `start` stays inside on its straight way to the first position of `shape`,
        and on `shape` itself: one position, or the positions of a circle.

        Raises:
            PlanFindings: it does not, and the caller has not accepted this.
        """
        findings = [*await self._around_home(shape, alt_amsl_m), *self._stored(start, shape)]
        remaining = [each for each in findings if each[0] not in despite]
        if remaining and await self._limit(ACTION_PARAMETER) != 0.0:
            raise PlanFindings(
                " ".join(text for _, text in remaining),
                codes=tuple(dict.fromkeys(code for code, _ in remaining)),
                reasons=tuple(text for _, text in remaining),
                remedy=REMEDY,
            )

    async def _around_home(self, shape: Sequence[LatLon], alt_amsl_m: float) -> list[Finding]:
        """What is farther from home, or higher, than the parameters of the geofence allow."""
        sample = self._vehicle.topic("home")
        if sample is None or not isinstance(sample.value, Home):
            return []  # PX4 has no geofence around an unknown home
        home, findings = sample.value, list[Finding]()
        limits = dict[str, float | None]()
        with suppress(TimeoutError):
            async with asyncio.timeout(READ_LIMITS_S):
                for name in (RADIUS_PARAMETER, HEIGHT_PARAMETER):
                    limits[name] = await self._limit(name)
        radius_m, height_m = limits.get(RADIUS_PARAMETER), limits.get(HEIGHT_PARAMETER)
        origin = LocalOrigin(home.lat_deg, home.lon_deg, home.alt_amsl_m)
        away_m = max(math.hypot(*_north_east(origin, each)) for each in shape)
        if radius_m is not None and 0.0 < radius_m < away_m:
            text = f"{_subject(shape)} is up to {away_m:.0f} m from home"
            findings.append(
                ("radius_exceeded", f"{text}; the geofence allows {radius_m:g} m ({RADIUS_PARAMETER}).")
            )
        above_m = alt_amsl_m - home.alt_amsl_m
        if height_m is not None and 0.0 < height_m < above_m:
            text = f"The altitude is {above_m:.0f} m above home"
            findings.append(
                ("altitude_fence", f"{text}; the geofence allows {height_m:g} m ({HEIGHT_PARAMETER}).")
            )
        return findings

    def _stored(self, start: LatLon, shape: Sequence[LatLon]) -> list[Finding]:
        """What leaves the geofence that is stored on the vehicle."""
        ids = self._mission().ids()
        if ids is None or ids["fence"] == 0:
            return []
        origin = LocalOrigin(*shape[0], 0.0)
        area = self._area(ids["fence"], origin)
        if area is None:
            text = f"Vehicle {self._vehicle.id} has a geofence that this server does not know."
            return [(FENCE_UNKNOWN, f"{text} Read its plan first (mission/download).")]
        positions = [_north_east(origin, each) for each in shape]
        chords = pairwise((*positions, positions[0])) if len(positions) > 1 else ()
        is_outside = bool(area.are_outside(np.array(positions)).any())
        if is_outside or any(area.line_leaves(*each) for each in chords):
            return [("fence_violation", f"{_subject(shape)} leaves the vehicle's geofence.")]
        if area.line_leaves(_north_east(origin, start), positions[0]):
            return [("fence_crossed", "The straight way there leaves the vehicle's geofence.")]
        return []

    def _area(self, fence_id: int, origin: LocalOrigin) -> FenceArea | None:
        """The stored geofence; None: it is not known."""
        on_vehicle = self._mission().items_on_vehicle
        if on_vehicle is None or on_vehicle.ids["fence"] != fence_id:
            return None
        try:
            return fence_area(fence_from_wire(on_vehicle.items["fence"]), origin)
        except PlanError:
            return None


def _subject(shape: Sequence[LatLon]) -> str:
    return "The target" if len(shape) == 1 else "The circle"


def _north_east(origin: LocalOrigin, place: LatLon) -> tuple[float, float]:
    north_m, east_m, _ = origin.to_ned(*place, 0.0)
    return (north_m, east_m)
