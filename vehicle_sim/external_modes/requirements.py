"""Requirements of the flight modes: each field is a bit mask of navigation states."""

from __future__ import annotations

from typing import NamedTuple


class Requirements(NamedTuple):
    """The fields `mode_req_*` of `failsafe_flags`, in message order; the defaults are for PX4's modes."""

    angular_velocity: int = 0x7ED47E
    attitude: int = 0x7ED07E
    local_alt: int = 0x7E007E
    local_position: int = 0x7A0038
    local_position_relaxed: int = 0x040044
    global_position: int = 0x38
    global_position_relaxed: int = 0
    """No mode of PX4 has this requirement; an external mode can have it from v1.17 on."""
    mission: int = 0x08
    offboard_signal: int = 0x4000
    home_position: int = 0x20
    wind_and_flight_time_compliance: int = 0x280018
    prevent_arming: int = 0x3C3020
    manual_control: int = 0x8447
    other: int = 0x7F800000
    """Bit mask of the external modes that are not registered or report that they cannot run."""


BUILT_IN_REQUIREMENTS = Requirements()
"""Requirements of PX4's own modes, while no external mode is registered."""
ALTITUDE_CRUISE_BIT = 1 << 8


def built_in_requirements(*, altitude_cruise: bool) -> Requirements:
    """Requirements of the modes of a version of PX4, with or without Altitude Cruise."""
    if not altitude_cruise:
        return BUILT_IN_REQUIREMENTS
    masks = BUILT_IN_REQUIREMENTS._asdict()
    for name in ("angular_velocity", "attitude", "local_alt", "manual_control"):
        masks[name] |= ALTITUDE_CRUISE_BIT
    return Requirements(**masks)


REPORTED = (
    "angular_velocity", "attitude", "local_alt", "local_position", "local_position_relaxed",
    "global_position", "global_position_relaxed", "mission", "home_position", "prevent_arming",
    "manual_control",
)  # fmt: skip
"""Requirements that a component reports in the fields `mode_req_*` of ArmingCheckReply, if its version of PX4
has them."""


def with_external_mode(
    requirements: Requirements, modes: int, requires: frozenset[str], *, can_run: bool
) -> Requirements:
    """The requirements of all modes after an external mode has reported its requirements.

    Args:
        requirements: the requirements before the report.
        modes: bit mask of the external mode and the mode that it replaces.
        requires: names in `REPORTED` that the external mode requires.
        can_run: whether the external mode can run.
    """
    masks = requirements._asdict()
    for name in REPORTED:
        masks[name] = masks[name] | modes if name in requires else masks[name] & ~modes
    masks["other"] = masks["other"] & ~modes if can_run else masks["other"] | modes
    return Requirements(**masks)
