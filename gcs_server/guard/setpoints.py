"""Converts the setpoint messages of programs to this server's kinds. Pure.

What PX4 v1.16 and v1.17 make of these messages (mavlink_receiver.cpp): of the local frames they follow 1
(LOCAL_NED) and 8 (BODY_NED), of the global ones 5, 6 and 11; a field whose *ignore* bit is set does not
count. What PX4 flies and this server has no kind for is left out, and said in `left_out`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from gcs_server.errors import InvalidRequest
from gcs_server.mavlink import dialect as d
from missions import setpoints as s
from missions.setpoints import Partial3, Setpoint

LOCAL: Final = d.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
GLOBAL: Final = d.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
ATTITUDE: Final = d.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET
MESSAGES: Final = frozenset({LOCAL, GLOBAL, ATTITUDE})
FRAME_LOCAL_NED, FRAME_BODY_NED = 1, 8
FRAME_AMSL, FRAME_HOME = 5, 6
POSITION, VELOCITY, ACCELERATION = (1, 2, 4), (8, 16, 32), (64, 128, 256)
"""*Ignore* bits of the axes."""
FORCE, IGNORE_YAW, IGNORE_YAW_RATE = 512, 1024, 2048
IGNORE_RATES, THRUST_BODY, IGNORE_THRUST, IGNORE_ATTITUDE = 7, 32, 64, 128
NOTHING: Final[Partial3] = (None, None, None)


@dataclass(frozen=True, slots=True)
class Converted:
    """A setpoint of a program as one of this server's kinds."""

    setpoint: Setpoint
    left_out: tuple[str, ...] = ()
    """Fields that PX4 would use and this server does not send, each with the reason."""


def convert(message: Any) -> Converted:
    """The setpoint of a message.

    Args:
        message: a decoded message whose id is one of `MESSAGES`.

    Raises:
        InvalidRequest: a field is not a number or outside its limits, or PX4 does not fly this frame or these
            axes.
    """
    msg_id = message.get_msgId()
    if msg_id == ATTITUDE:
        return _attitude(message)
    return _local(message) if msg_id == LOCAL else _global(message)


def _local(message: Any) -> Converted:
    velocity, acceleration, left_out = _motion(message)
    yaw, yaw_rate = _heading(message, left_out)
    heading = {"yaw_ned_rad": yaw, "yaw_rate_ned_rad_s": yaw_rate}
    frame = message.coordinate_frame
    position = _axes(message, ("x", "y", "z"), POSITION)
    if frame == FRAME_BODY_NED:
        if None in velocity:
            raise InvalidRequest(
                "type_mask",
                "In frame 8 (BODY_NED) PX4 flies only velocities, and only with all three axes.",
                remedy="Clear the ignore bits of vx, vy and vz, or use frame 1 (LOCAL_NED).",
            )
        if position != NOTHING:
            left_out.append("the position, which PX4 ignores in frame 8")
        if acceleration != NOTHING:
            left_out.append("the acceleration in frame 8")
        return Converted(_checked(s.VelocityBody, velocity_frd_m_s=velocity, **heading), tuple(left_out))
    if frame != FRAME_LOCAL_NED:
        raise InvalidRequest(
            "coordinate_frame",
            f"PX4 does not fly SET_POSITION_TARGET_LOCAL_NED in frame {frame}.",
            remedy="Use frame 1 (LOCAL_NED) or 8 (BODY_NED).",
        )
    return Converted(_by_axes(position, velocity, acceleration, heading), tuple(left_out))


def _by_axes(
    position: Partial3, velocity: Partial3, acceleration: Partial3, heading: dict[str, float | None]
) -> Setpoint:
    given = [each != NOTHING for each in (position, velocity, acceleration)]
    if given == [True, False, False]:
        return _checked(s.Position, position_ned_m=position, **heading)
    if given == [False, True, False]:
        return _checked(s.Velocity, velocity_ned_m_s=velocity, **heading)
    if given == [False, False, True]:
        return _checked(s.Acceleration, acceleration_ned_m_s2=acceleration, **heading)
    if not any(given):
        raise InvalidRequest(
            "type_mask", "All axes are ignored.", remedy="Clear the ignore bits of what is to be flown."
        )
    return _checked(
        s.Trajectory,
        position_ned_m=position,
        velocity_ned_m_s=velocity,
        acceleration_ned_m_s2=acceleration,
        **heading,
    )


def _global(message: Any) -> Converted:
    velocity, acceleration, left_out = _motion(message)
    yaw, yaw_rate = _heading(message, left_out)
    heading = {"yaw_ned_rad": yaw, "yaw_rate_ned_rad_s": yaw_rate}
    ignored = message.type_mask & sum(POSITION)
    if ignored == sum(POSITION):
        return Converted(_by_axes(NOTHING, velocity, acceleration, heading), tuple(left_out))
    if ignored:
        raise InvalidRequest("type_mask", "A global position needs latitude, longitude and altitude.")
    if velocity != NOTHING or acceleration != NOTHING:
        left_out.append("velocity and acceleration beside a global position")
    frame = message.coordinate_frame
    if frame not in (FRAME_AMSL, FRAME_HOME):
        raise InvalidRequest(
            "coordinate_frame",
            f"Frame {frame} of a global position is not flown through a guard.",
            remedy="Use frame 5 (above mean sea level) or 6 (above home).",
        )
    altitude = {"alt_amsl_m" if frame == FRAME_AMSL else "alt_home_m": _finite("alt", message.alt)}
    setpoint = _checked(
        s.PositionGlobal,
        lat_deg=message.lat_int / 1e7,
        lon_deg=message.lon_int / 1e7,
        **altitude,
        **heading,
    )
    return Converted(setpoint, tuple(left_out))


def _attitude(message: Any) -> Converted:
    mask, left_out = message.type_mask, list[str]()
    if mask & IGNORE_THRUST:
        raise InvalidRequest("type_mask", "An attitude or rates need a thrust.")
    if mask & THRUST_BODY:
        left_out.append("thrust_body, of which PX4 flies only the part along the body's axis")
    thrust = _finite("thrust", message.thrust)
    rates = [_finite(name, getattr(message, name)) for name in _rate_names(mask)]
    if mask & IGNORE_ATTITUDE:
        if len(rates) < 3:
            raise InvalidRequest("type_mask", "Rates need all three axes, or an attitude.")
        return Converted(_checked(s.Rates, rates_frd_rad_s=tuple(rates), thrust=thrust), tuple(left_out))
    q = [_finite("q", each) for each in message.q]
    norm = math.hypot(*q)
    if abs(norm - 1.0) > 0.01:
        raise InvalidRequest("q", f"The quaternion must have length 1, not {norm:.3g}.")
    yaw_rate = None if mask & 4 else rates[-1]
    if any(rates[: len(rates) - (yaw_rate is not None)]):
        left_out.append("roll and pitch rates, which PX4 ignores beside an attitude")
    if not 0.0 <= thrust <= 1.0:
        raise InvalidRequest("thrust", f"The thrust must be from 0 to 1, not {thrust:g}.")
    w, x, y, z = (each / norm for each in q)
    return Converted(s.Attitude((w, x, y, z), thrust, yaw_rate), tuple(left_out))


def _rate_names(mask: int) -> list[str]:
    names = ("body_roll_rate", "body_pitch_rate", "body_yaw_rate")
    return [name for bit, name in zip((1, 2, 4), names, strict=True) if not mask & bit]


def _motion(message: Any) -> tuple[Partial3, Partial3, list[str]]:
    velocity = _axes(message, ("vx", "vy", "vz"), VELOCITY)
    acceleration = _axes(message, ("afx", "afy", "afz"), ACCELERATION)
    left_out = list[str]()
    if message.type_mask & FORCE and acceleration != NOTHING:
        acceleration = NOTHING
        left_out.append("the force, which PX4 ignores")
    return velocity, acceleration, left_out


def _axes(message: Any, names: tuple[str, str, str], bits: tuple[int, int, int]) -> Partial3:
    x, y, z = (
        None if message.type_mask & bit else _finite(name, getattr(message, name))
        for name, bit in zip(names, bits, strict=True)
    )
    return (x, y, z)


def _heading(message: Any, left_out: list[str]) -> tuple[float | None, float | None]:
    yaw = None if message.type_mask & IGNORE_YAW else math.remainder(_finite("yaw", message.yaw), math.tau)
    rate = None if message.type_mask & IGNORE_YAW_RATE else _finite("yaw_rate", message.yaw_rate)
    if yaw is None or rate is None:
        return yaw, rate
    if rate:
        left_out.append("the yaw rate beside a yaw")
    return yaw, None


def _finite(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise InvalidRequest(name, f"{name} is not a number.", remedy="Set its ignore bit, or send a number.")
    return value


@cache
def _adapter(kind: type[Setpoint]) -> TypeAdapter[Setpoint]:
    return TypeAdapter(kind)


def _checked(kind: type[Setpoint], **fields: object) -> Setpoint:
    """The setpoint, within the limits that apply to all clients."""
    try:
        setpoint = _adapter(kind).validate_python(fields)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = ".".join(str(part) for part in first["loc"])
        raise InvalidRequest(name, f"{name}: {first['msg']} (given: {first['input']!r}).") from None
    problem = s.contradiction_of(setpoint)
    if problem is not None:
        raise InvalidRequest("setpoint", problem)
    return setpoint
