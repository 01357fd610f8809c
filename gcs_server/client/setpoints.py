"""Setpoints as the API takes them: one function a kind, the same keywords everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

Expiry = Literal["hold", "land", "stop_stream"]
Body = dict[str, object]


def setpoint(
    *,
    position_ned_m: Sequence[float] | None = None,
    velocity_ned_m_s: Sequence[float] | None = None,
    yaw_ned_rad: float | None = None,
    yaw_rate_ned_rad_s: float | None = None,
) -> Body:
    """A setpoint's body: exactly one of position and velocity, at most one of yaw and yaw rate.

    Raises:
        ValueError: not exactly one kind was given.
    """
    if (position_ned_m is None) == (velocity_ned_m_s is None):
        raise ValueError("Give exactly one of position_ned_m and velocity_ned_m_s.")
    body: Body = {}
    if position_ned_m is not None:
        body = {"type": "position", "position_ned_m": list(position_ned_m)}
    elif velocity_ned_m_s is not None:
        body = {"type": "velocity", "velocity_ned_m_s": list(velocity_ned_m_s)}
    if yaw_ned_rad is not None:
        body["yaw_ned_rad"] = yaw_ned_rad
    if yaw_rate_ned_rad_s is not None:
        body["yaw_rate_ned_rad_s"] = yaw_rate_ned_rad_s
    return body


def lifetime(valid_for_s: float | None, on_expiry: Expiry | None, hold_for_s: float | None) -> Body:
    """How long a setpoint counts and what follows; what is not given is left to the server."""
    body: Body = {}
    if valid_for_s is not None:
        body["valid_for_s"] = valid_for_s
    if on_expiry is not None or hold_for_s is not None:
        expiry: Body = {"action": on_expiry or "hold"}
        if hold_for_s is not None:
            expiry["hold_for_s"] = hold_for_s
        body["on_expiry"] = expiry
    return body
