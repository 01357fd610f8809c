"""Creates setpoint bodies for the API; one function for each type. None means "not controlled" or "not
given"."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, TypedDict, Unpack

ExpiryAction = Literal["hold", "land", "stop_stream"]
"""Action when a setpoint expires."""
Body = dict[str, object]
Partial = Sequence[float | None]
"""One value per axis, motor or servo; None: not controlled, or disarmed."""
PathPoints = Iterable[tuple[float, Sequence[float]] | tuple[float, Sequence[float], float]]
"""Points: (time since the start [s], (north, east, down) [m]) or (time, position, yaw [rad]); all points
have a yaw, or none."""


class Yaw(TypedDict, total=False):
    """The yaw of a setpoint; omitted: the vehicle keeps its yaw."""

    yaw_ned_rad: float | None
    """From north, clockwise [rad]."""
    yaw_rate_ned_rad_s: float | None
    """[rad/s]."""


class Altitude(Yaw, total=False):
    """Exactly one altitude, and the yaw."""

    alt_amsl_m: float | None
    alt_home_m: float | None


class Motion(Yaw, total=False):
    """Position, velocity and acceleration in the local frame, and the yaw."""

    position_ned_m: Partial | None
    velocity_ned_m_s: Partial | None
    acceleration_ned_m_s2: Partial | None


class Rotation(Yaw, total=False):
    """Three angles (with the yaw), or a quaternion (w, x, y, z)."""

    roll_rad: float | None
    pitch_rad: float | None
    q_ned_frd: Sequence[float] | None


def _body(setpoint_type: str, **fields: object) -> Body:
    sent_fields = {
        name: value if isinstance(value, float | int | str) else list(value)  # type: ignore[call-overload]
        for name, value in fields.items()
        if value is not None
    }
    return {"type": setpoint_type, **sent_fields}


def position_ned(north_m: float, east_m: float, down_m: float, **yaw: Unpack[Yaw]) -> Body:
    """Flies to a position in the vehicle's local frame and keeps it."""
    return _body("position", position_ned_m=(north_m, east_m, down_m), **yaw)


def position_global(lat_deg: float, lon_deg: float, **altitude: Unpack[Altitude]) -> Body:
    """Flies to a global position, with exactly one altitude."""
    return _body("position_global", lat_deg=lat_deg, lon_deg=lon_deg, **altitude)


def position_body(
    forward_m: float, right_m: float, down_m: float, *, yaw_offset_rad: float | None = None
) -> Body:
    """Flies to an offset along the heading from the vehicle's position at the time when the server accepts
    the setpoint; with zeros the vehicle keeps its position.
    """
    return _body("position_body", offset_frd_m=(forward_m, right_m, down_m), yaw_offset_rad=yaw_offset_rad)


def velocity_ned(north_m_s: float, east_m_s: float, down_m_s: float, **yaw: Unpack[Yaw]) -> Body:
    """Flies at a velocity in the local NED frame."""
    return _body("velocity", velocity_ned_m_s=(north_m_s, east_m_s, down_m_s), **yaw)


def velocity_body(forward_m_s: float, right_m_s: float, down_m_s: float, **yaw: Unpack[Yaw]) -> Body:
    """Flies at a velocity in the level heading frame, which turns with the vehicle."""
    return _body("velocity_body", velocity_frd_m_s=(forward_m_s, right_m_s, down_m_s), **yaw)


def acceleration_ned(north_m_s2: float, east_m_s2: float, down_m_s2: float, **yaw: Unpack[Yaw]) -> Body:
    """Flies at an acceleration in the local NED frame, without gravity."""
    return _body("acceleration", acceleration_ned_m_s2=(north_m_s2, east_m_s2, down_m_s2), **yaw)


def trajectory(**motion: Unpack[Motion]) -> Body:
    """Position, velocity and acceleration: on each axis, the vehicle controls the first of them that is
    given; the others are feed-forward."""
    return _body("trajectory", **motion)


def attitude(thrust: float, **rotation: Unpack[Rotation]) -> Body:
    """Flies an attitude, given by three angles or a quaternion (w, x, y, z), with collective thrust (0 to
    1)."""
    return _body("attitude", thrust=thrust, **rotation)


def rates(roll_rad_s: float, pitch_rad_s: float, yaw_rad_s: float, thrust: float) -> Body:
    """Flies body rates with collective thrust (0 to 1)."""
    return _body("rates", rates_frd_rad_s=(roll_rad_s, pitch_rad_s, yaw_rad_s), thrust=thrust)


def thrust_torque(thrust_frd: Sequence[float], torque_frd: Sequence[float]) -> Body:
    """Applies body thrust and torque, which bypass all controllers; refused on MAVLink links."""
    return _body("thrust_torque", thrust_frd=thrust_frd, torque_frd=torque_frd)


def actuators(motors: Partial = (), servos: Partial = ()) -> Body:
    """Sets individual motors and servos, -1 to 1, None: disarmed; refused on MAVLink links."""
    return _body("actuators", motors=motors, servos=servos)


def path(points: PathPoints) -> Body:
    """Starts a curve through timed points; the server flies it even if this program ends."""
    sent_points: list[Body] = []
    for t_s, position_ned_m, *yaw in points:
        point: Body = {"t_s": t_s, "position_ned_m": list(position_ned_m)}
        sent_points.append({**point, "yaw_ned_rad": yaw[0]} if yaw else point)
    return {"type": "path", "points": sent_points}


def follow(
    vehicle_id: str,
    *,
    offset_ned_m: Sequence[float] | None = None,
    offset_frd_m: Sequence[float] | None = None,
    yaw: Literal["keep", "same", "face"] = "keep",
) -> Body:
    """Keeps a position relative to another vehicle, in NED or along its heading; the server updates the
    setpoint as that vehicle moves."""
    return _body("follow", vehicle=vehicle_id, offset_ned_m=offset_ned_m, offset_frd_m=offset_frd_m, yaw=yaw)


def follow_device(
    lat_deg: float,
    lon_deg: float,
    *,
    accuracy_m: float,
    offset_ne_m: Sequence[float],
    alt_home_m: float,
    age_s: float = 0.0,
    velocity_ne_m_s: Sequence[float] | None = None,
    yaw: Literal["keep", "face"] = "keep",
) -> Body:
    """Keeps a position beside a device that this program locates, such as a tracker that a person carries:
    send each new position, about once a second, valid for at most 5 s. Without them the vehicle holds."""
    return _body(
        "follow_device",
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        accuracy_m=accuracy_m,
        age_s=age_s,
        offset_ne_m=offset_ne_m,
        alt_home_m=alt_home_m,
        velocity_ne_m_s=velocity_ne_m_s,
        yaw=yaw,
    )


def first_setpoint(
    body: Body | None,
    position_ned_m: Sequence[float] | None,
    velocity_ned_m_s: Sequence[float] | None,
    yaw_ned_rad: float | None,
    yaw_rate_ned_rad_s: float | None,
) -> Body:
    """The first setpoint of a stream: any setpoint body, a position, or a velocity; default: hold the current
    position.

    Raises:
        ValueError: more than one setpoint was given, or a yaw without a position or velocity.
    """
    if sum(setpoint is not None for setpoint in (body, position_ned_m, velocity_ned_m_s)) > 1:
        raise ValueError("Give one setpoint: a body, position_ned_m or velocity_ned_m_s.")
    if body is not None:
        return body
    yaw = {"yaw_ned_rad": yaw_ned_rad, "yaw_rate_ned_rad_s": yaw_rate_ned_rad_s}
    if position_ned_m is not None:
        return _body("position", position_ned_m=position_ned_m, **yaw)
    if velocity_ned_m_s is not None:
        return _body("velocity", velocity_ned_m_s=velocity_ned_m_s, **yaw)
    if yaw_ned_rad is not None or yaw_rate_ned_rad_s is not None:
        raise ValueError("Give a yaw only together with position_ned_m or velocity_ned_m_s.")
    return position_body(0, 0, 0)


def validity_fields(
    valid_for_s: float | None, on_expiry: ExpiryAction | None, hold_for_s: float | None
) -> Body:
    """Validity of a setpoint and the action on expiry; the server has defaults for omitted values."""
    body: Body = {}
    if valid_for_s is not None:
        body["valid_for_s"] = valid_for_s
    if on_expiry is not None or hold_for_s is not None:
        expiry: Body = {"action": on_expiry or "hold"}
        if hold_for_s is not None:
            expiry["hold_for_s"] = hold_for_s
        body["on_expiry"] = expiry
    return body
