"""Checks of the positions of a device that a vehicle follows (`follow_device`).

They come from a phone or a program of a person, who stands beside the vehicle. A position that is old, far
away, inaccurate, or farther from the one before than anybody moves is refused, as is a long validity: without
usable positions the setpoint expires, and the vehicle holds.
"""

from __future__ import annotations

import math

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.geodesy import distance_m
from missions.setpoints import FollowDevice

MAX_VALID_FOR_S = 5.0
MAX_AGE_S = 3.0
MAX_ACCURACY_M = 20.0
MAX_AWAY_M = 200.0
MAX_SPEED_M_S = 15.0
"""Speed of a device from one position to the next; faster is taken for an error of its position [m/s]."""
ENDS = "Without usable positions the vehicle holds."


def check_device(
    request: StreamRequest,
    vehicle_deg: tuple[float, float] | None,
    previous: StreamRequest | None,
    since_s: float | None,
) -> None:
    """Checks one position of a device.

    Args:
        request: the request, whose setpoint is a `FollowDevice`.
        vehicle_deg: latitude and longitude of the vehicle; None: not known.
        previous: the request that the stream flies now; None: there is none.
        since_s: age of that request [s]; None: unknown.

    Raises:
        InvalidRequest: the setpoint would be valid for too long.
        Refused: the position cannot be used.
    """
    device = request.setpoint
    assert isinstance(device, FollowDevice)
    if request.valid_for_s > MAX_VALID_FOR_S:
        raise InvalidRequest(
            "valid_for_s",
            f"The position of a device is valid for at most {MAX_VALID_FOR_S:g} s: it moves.",
            remedy="Send a newer position about once a second.",
        )
    if device.age_s > MAX_AGE_S:
        raise Refused(f"The position of the device is {device.age_s:.0f} s old.", remedy=ENDS)
    if device.accuracy_m > min(MAX_ACCURACY_M, math.hypot(*device.offset_ne_m)):
        raise Refused(
            f"The position of the device is accurate to {device.accuracy_m:.0f} m; following needs "
            f"{MAX_ACCURACY_M:g} m, and no less than the distance from the device.",
            remedy="Wait for a better position, outdoors.",
        )
    if vehicle_deg is not None:
        away_m = distance_m(*vehicle_deg, device.lat_deg, device.lon_deg)
        if away_m > MAX_AWAY_M:
            raise Refused(
                f"The device is {away_m:.0f} m from the vehicle; it may be at most {MAX_AWAY_M:g} m away.",
                remedy="Go closer, or fly there first.",
            )
    before = None if previous is None else previous.setpoint
    if isinstance(before, FollowDevice) and since_s is not None:
        moved_m = distance_m(before.lat_deg, before.lon_deg, device.lat_deg, device.lon_deg)
        elapsed_s = max(since_s + before.age_s - device.age_s, 0.0)
        if moved_m > MAX_SPEED_M_S * elapsed_s + before.accuracy_m + device.accuracy_m:
            raise Refused(
                f"The position of the device jumped by {moved_m:.0f} m in {elapsed_s:.1f} s.", remedy=ENDS
            )
