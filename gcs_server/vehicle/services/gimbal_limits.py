"""Compares a gimbal's final attitude with its target, because PX4 accepts angles that the gimbal cannot
reach."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.errors import Disconnected
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.samples import GimbalReading
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Request
from missions.frames import wrap_pi

ATTITUDE_IDS = (d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS, d.MAVLINK_MSG_ID_MOUNT_ORIENTATION)
REACHED_DEG = 3.0
MIN_MOVEMENT_DEG = 0.5
"""The gimbal counts as stopped if its angles change by less than this between two reports [deg]."""
STOPPED_AFTER_S = 0.6
"""Time without movement after which the gimbal has stopped [s]."""
MIN_WAIT_S = 1.0
"""Time that the gimbal has to begin to move: before this time it does not count as stopped [s]."""
MAX_DURATION_S = 3.0
"""If the gimbal still moves after this time, no limit is reported [s]."""
REQUEST_PERIOD_S = 0.2


@dataclass(frozen=True, slots=True)
class GimbalLimited:
    """The gimbal stopped at its own limit, before the requested angles."""

    pitch_deg: float
    """Reached pitch; up is positive [deg]."""
    yaw_deg: float | None
    """Reached yaw, relative to the nose, or to north with `yaw_lock` [deg]; null if unknown."""
    asked_pitch_deg: float
    asked_yaw_deg: float
    text: str
    """The limit as a sentence."""


async def wait_until_stopped(
    vehicle: VehiclePort,
    component_id: int,
    read: Callable[[], GimbalReading | None],
    angles: tuple[float, float, bool],
) -> GimbalLimited | None:
    """Waits until the gimbal has reached the angles or has stopped. None if the gimbal has reached the
    angles, still moves after `MAX_DURATION_S`, or does not report its attitude.

    Args:
        vehicle: the vehicle of the gimbal.
        component_id: component id of the gimbal's manager, to which the requests for the attitude are sent.
        read: returns the gimbal's newest report.
        angles: requested pitch and yaw [deg], and whether yaw is from north (yaw lock).
    """
    pitch_deg, yaw_deg, yaw_lock = angles
    clock = vehicle.clock
    start_s = stopped_since_s = clock.monotonic_s()
    previous_angles: tuple[float, float | None] | None = None
    attitude_request = Request(d.MAV_CMD_REQUEST_MESSAGE, (float(ATTITUDE_IDS[0]), 0, 0, 0, 0, 0, 0)).message(
        vehicle.identity.system_id, component_id, 0, False
    )
    next_request_s = start_s
    with vehicle.mailbox.expect(*ATTITUDE_IDS) as waiter:
        while (now_s := clock.monotonic_s()) < start_s + MAX_DURATION_S:
            if now_s >= next_request_s:
                vehicle.send(attitude_request)
                next_request_s = now_s + REQUEST_PERIOD_S
            try:
                async with asyncio.timeout(max(0.0, next_request_s - now_s)):
                    await waiter.next()
            except TimeoutError:
                continue
            except Disconnected:
                return None
            current_angles = _angles(read(), yaw_lock)
            if current_angles is None:
                continue
            if not _differ(current_angles, (pitch_deg, yaw_deg), REACHED_DEG):
                return None
            now_s = clock.monotonic_s()
            if previous_angles is None or _differ(current_angles, previous_angles, MIN_MOVEMENT_DEG):
                previous_angles, stopped_since_s = current_angles, now_s
            elif now_s - stopped_since_s >= STOPPED_AFTER_S and now_s - start_s >= MIN_WAIT_S:
                return _limited(current_angles, pitch_deg, yaw_deg)
    return None


def _angles(gimbal: GimbalReading | None, yaw_lock: bool) -> tuple[float, float | None] | None:
    """Pitch and yaw [deg]; yaw is relative to north with `yaw_lock`, otherwise to the nose."""
    if gimbal is None:
        return None
    yaw_rad = gimbal.yaw_ned_rad if yaw_lock else gimbal.yaw_frd_rad
    return math.degrees(gimbal.pitch_rad), None if yaw_rad is None else math.degrees(yaw_rad)


def _differ(a: tuple[float, float | None], b: tuple[float, float | None], tolerance_deg: float) -> bool:
    return abs(a[0] - b[0]) > tolerance_deg or _yaw_difference_deg(a[1], b[1]) > tolerance_deg


def _yaw_difference_deg(a: float | None, b: float | None) -> float:
    return 0.0 if a is None or b is None else abs(math.degrees(wrap_pi(math.radians(a - b))))


def _limited(current_angles: tuple[float, float | None], pitch_deg: float, yaw_deg: float) -> GimbalLimited:
    pitch, yaw = (
        round(current_angles[0], 1),
        None if current_angles[1] is None else round(current_angles[1], 1),
    )
    axes: list[str] = []
    if abs(pitch - pitch_deg) > REACHED_DEG:
        axes.append(f"pitch {pitch:g}° instead of {pitch_deg:g}°")
    if yaw is not None and _yaw_difference_deg(yaw, yaw_deg) > REACHED_DEG:
        axes.append(f"yaw {yaw:g}° instead of {yaw_deg:g}°")
    return GimbalLimited(
        pitch, yaw, pitch_deg, yaw_deg, f"The gimbal stopped at its own limit: {', '.join(axes)}."
    )
