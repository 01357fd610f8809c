"""The combinations of axes that PX4 can fly; with other combinations PX4 descends level, or stops. PX4's
position controller needs both north and east of a quantity, or neither, and a value on every axis.
"""

from __future__ import annotations

from missions.setpoints import UNCONTROLLED, Acceleration, Partial3, Position, Setpoint, Trajectory, Velocity

FRAME_TEXT = (
    "PX4 follows only the local frames 1 (LOCAL_NED) and 8 (BODY_NED) and the global frames 5, 6 and 11. The "
    "type of the setpoint selects the frame: position and velocity are local NED, velocity_body is relative "
    "to the heading, position_body is an offset from the current position (like MAVLink frames 7 and 9), "
    "position_global is latitude and longitude."
)
FORCE_TEXT = (
    "PX4 does not support force setpoints: with their flag (512) it ignores the acceleration. Remove "
    "this field and give acceleration_ned_m_s2 in m/s²."
)
MASK_TEXT = "The ignore bits follow from the fields: give null for what is not to be controlled."
MAVLINK_ONLY_FIELDS = {
    **dict.fromkeys(("frame", "coordinate_frame", "mav_frame"), FRAME_TEXT),
    **dict.fromkeys(("force", "force_ned_n", "is_force", "use_force"), FORCE_TEXT),
    **dict.fromkeys(("type_mask", "mask"), MASK_TEXT),
}
"""MAVLink fields that a client may send by mistake, with the text that explains the API's fields."""
_AXES = ("north", "east", "down")


def axes_problem(
    position: Partial3 = UNCONTROLLED,
    velocity: Partial3 = UNCONTROLLED,
    acceleration: Partial3 = UNCONTROLLED,
) -> str | None:
    """Why PX4 would not fly this combination of axes; None if PX4 would fly it."""
    named = {
        "position_ned_m": position,
        "velocity_ned_m_s": velocity,
        "acceleration_ned_m_s2": acceleration,
    }
    if all(value is None for vector in named.values() for value in vector):
        return (
            "Only yaw is controlled: PX4 refuses a setpoint without position, velocity or acceleration. "
            "Give the current position to turn on the spot."
        )
    for name, (north, east, _) in named.items():
        if (north is None) != (east is None):
            return f"{name}: north and east are needed together; PX4 does not fly one without the other."
    for axis, name in enumerate(_AXES):
        if all(vector[axis] is None for vector in named.values()):
            return (
                f"{name} is not controlled: PX4 stops instead of flying the rest. Give a position, a "
                "velocity or an acceleration on every axis (type trajectory mixes them)."
            )
    return None


def problem_of(setpoint: Setpoint) -> str | None:
    """Why PX4 would never fly this setpoint, in any state of the vehicle; None if PX4 can fly it."""
    if isinstance(setpoint, Position):
        return axes_problem(position=setpoint.position_ned_m)
    if isinstance(setpoint, Velocity):
        return axes_problem(velocity=setpoint.velocity_ned_m_s)
    if isinstance(setpoint, Acceleration):
        return axes_problem(acceleration=setpoint.acceleration_ned_m_s2)
    if isinstance(setpoint, Trajectory):
        return axes_problem(
            setpoint.position_ned_m, setpoint.velocity_ned_m_s, setpoint.acceleration_ned_m_s2
        )
    return None
