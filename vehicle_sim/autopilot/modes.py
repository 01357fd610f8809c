"""PX4's flight modes: numbers, names and requirements, in one table."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cache

from vehicle_sim.px4_version import Px4Version


class NavState(IntEnum):
    """PX4's navigation states; event masks use them as bit numbers."""

    MANUAL = 0
    ALTITUDE = 1
    POSITION = 2
    MISSION = 3
    HOLD = 4
    RTL = 5
    POSITION_SLOW = 6
    ALTITUDE_CRUISE = 8
    """From PX4 v1.17 on."""
    ACRO = 10
    DESCEND = 12
    TERMINATION = 13
    OFFBOARD = 14
    STABILIZED = 15
    TAKEOFF = 17
    LAND = 18
    FOLLOW = 19
    PRECISION_LAND = 20
    ORBIT = 21
    VTOL_TAKEOFF = 22
    EXTERNAL1 = 23
    EXTERNAL2 = 24
    EXTERNAL3 = 25
    EXTERNAL4 = 26
    EXTERNAL5 = 27
    EXTERNAL6 = 28
    EXTERNAL7 = 29
    EXTERNAL8 = 30


MAIN_AUTO = 4
MAIN_POSITION = 3
"""Main modes that have sub modes."""
CUSTOM_MODE, AUTO, GUIDED, MANUAL_INPUT = 1, 4, 8, 64
"""Bits of MAV_MODE_FLAG."""


@dataclass(frozen=True, slots=True)
class Mode:
    """Numbers, names and requirements of one mode."""

    state: NavState
    main_mode: int
    sub_mode: int
    name: str
    """Name in PX4's texts."""
    listed_name: str
    """Name in AVAILABLE_MODES; empty for standard modes."""
    standard_mode: int
    """MAV_STANDARD_MODE."""
    properties: int
    """MAV_MODE_PROPERTY."""
    index: int
    """Place in AVAILABLE_MODES; 0: not listed."""
    needs_sticks: bool = False
    needs_position: bool = False
    auto: bool = False

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        return self.main_mode << 16 | self.sub_mode << 24

    @property
    def base_flags(self) -> int:
        """HEARTBEAT.base_mode without armed and stabilise bits."""
        return CUSTOM_MODE | (MANUAL_INPUT if self.needs_sticks else 0) | (GUIDED | AUTO if self.auto else 0)


_S = NavState  # short, for the tables
_UNAVAILABLE = "(Mode not available)"

MODES: dict[NavState, Mode] = {
    mode.state: mode
    for mode in (
        # State, main mode, sub mode, name, listed name, standard mode, properties, index.
        Mode(_S.MANUAL, 1, 0, "Manual", "Manual", 0, 1, 1, needs_sticks=True),
        Mode(_S.ALTITUDE, 2, 0, "Altitude", "", 4, 0, 2, needs_sticks=True),
        Mode(_S.POSITION, 3, 0, "Position", "", 1, 0, 3, needs_sticks=True, needs_position=True),
        Mode(_S.MISSION, 4, 4, "Mission", "", 6, 1, 4, needs_position=True, auto=True),
        Mode(_S.HOLD, 4, 3, "Hold", "Hold", 0, 1, 5, needs_position=True, auto=True),
        Mode(_S.RTL, 4, 5, "Return", "", 5, 1, 6, needs_position=True, auto=True),
        Mode(
            _S.POSITION_SLOW, 3, 2, "Position Slow", "Position Slow", 0, 1, 7,
            needs_sticks=True, needs_position=True,
        ),
        Mode(_S.ALTITUDE_CRUISE, 11, 0, "Altitude Cruise", "Altitude Cruise", 0, 0, 8, needs_sticks=True),
        Mode(_S.ACRO, 5, 0, "Acro", "Acro", 0, 1, 8, needs_sticks=True),
        Mode(_S.DESCEND, 4, 6, "Descend", "", 0, 0, 0, auto=True),
        Mode(_S.TERMINATION, 10, 0, "Termination", "Termination", 0, 3, 9),
        Mode(_S.OFFBOARD, 6, 0, "Offboard", "Offboard", 0, 1, 10),
        Mode(_S.STABILIZED, 7, 0, "Stabilized", "Stabilized", 0, 1, 11, needs_sticks=True),
        Mode(_S.TAKEOFF, 4, 2, "Takeoff", "", 8, 1, 12, needs_position=True, auto=True),
        Mode(_S.LAND, 4, 6, "Land", "", 7, 1, 13, needs_position=True, auto=True),
        Mode(_S.FOLLOW, 4, 8, "Follow Target", "Follow Target", 0, 1, 14, needs_position=True),
        Mode(
            _S.PRECISION_LAND, 4, 9, "Precision Landing", "Precision Landing", 0, 1, 15,
            needs_position=True, auto=True,
        ),
        Mode(_S.ORBIT, 3, 1, "Orbit", "", 2, 1, 16, needs_position=True),
        Mode(_S.VTOL_TAKEOFF, 4, 10, "VTOL Takeoff", "VTOL Takeoff", 0, 1, 17, needs_position=True),
        *(
            Mode(NavState(22 + n), 4, 10 + n, f"External {n}", _UNAVAILABLE, 0, 2, 17 + n)
            for n in range(1, 9)
        ),
    )
}  # fmt: skip
"""All modes; their order in AVAILABLE_MODES was recorded on PX4."""


def exists(state: int, px4: Px4Version) -> bool:
    """Whether a version of PX4 has a mode."""
    return state in MODES and (state != _S.ALTITUDE_CRUISE or px4.altitude_cruise)


@cache
def listed_modes(px4: Px4Version) -> tuple[Mode, ...]:
    """The modes in AVAILABLE_MODES; the first has the index 1."""
    listed = (mode for mode in MODES.values() if mode.index and exists(mode.state, px4))
    return tuple(sorted(listed, key=lambda mode: mode.index))


CANNOT_TAKE_OFF = frozenset(
    {_S.RTL, _S.DESCEND, _S.TERMINATION, _S.LAND, _S.FOLLOW, _S.PRECISION_LAND, _S.ORBIT}
)
"""Modes in which the vehicle cannot take off, and which therefore do not allow arming."""

_EVENT_ORDER = (
    _S.MANUAL, _S.ALTITUDE, _S.POSITION, _S.MISSION, _S.HOLD, _S.RTL,
    _S.ACRO, _S.OFFBOARD, _S.STABILIZED, _S.POSITION_SLOW, _S.TAKEOFF,
    _S.LAND, _S.FOLLOW, _S.PRECISION_LAND, _S.ORBIT, _S.VTOL_TAKEOFF,
    *(NavState(_S.EXTERNAL1 + n) for n in range(8)), _S.ALTITUDE_CRUISE,
)  # fmt: skip
_EVENT_NUMBERS = {state: number for number, state in enumerate(_EVENT_ORDER)}
_NO_EVENT_NUMBER = 255

STANDARD_MODES: dict[int, NavState] = {
    1: _S.POSITION,
    2: _S.ORBIT,
    4: _S.ALTITUDE,
    5: _S.RTL,
    6: _S.MISSION,
    7: _S.LAND,
    8: _S.TAKEOFF,
}
"""Modes by MAV_STANDARD_MODE, for DO_SET_STANDARD_MODE."""

_WITHOUT_SUB_MODE = {
    1: _S.MANUAL, 2: _S.ALTITUDE, 5: _S.ACRO, 6: _S.OFFBOARD, 7: _S.STABILIZED, 11: _S.ALTITUDE_CRUISE,
}  # fmt: skip
_POSITION_SUB_MODES = {0: _S.POSITION, 2: _S.POSITION_SLOW}
"""Without sub mode 1 (Orbit): only DO_ORBIT starts Orbit; PX4 treats a request for Orbit as Position."""
_AUTO_SUB_MODES = {
    0: _S.MISSION,
    2: _S.TAKEOFF,
    3: _S.HOLD,
    4: _S.MISSION,
    5: _S.RTL,
    6: _S.LAND,
    8: _S.FOLLOW,
    9: _S.PRECISION_LAND,
    **{10 + n: NavState(22 + n) for n in range(1, 9)},
}


class UnsupportedAutoMode(Exception):
    """PX4 does not have this sub mode of the automatic modes, or only for other vehicle types."""


def from_numbers(main_mode: int, sub_mode: int, px4: Px4Version) -> NavState | None:
    """The mode with these PX4 mode numbers; None: PX4 accepts the request without a mode change.

    Raises:
        UnsupportedAutoMode: an automatic sub mode that does not exist.
    """
    if main_mode == MAIN_POSITION:
        return _POSITION_SUB_MODES.get(sub_mode, _S.POSITION)
    if main_mode == MAIN_AUTO:
        try:
            return _AUTO_SUB_MODES[sub_mode]
        except KeyError:
            raise UnsupportedAutoMode(sub_mode) from None
    mode = _WITHOUT_SUB_MODE.get(main_mode)
    return mode if mode is not None and exists(mode, px4) else None


def event_number(state: NavState) -> int:
    """Number of the mode in events; 255: none."""
    return _EVENT_NUMBERS.get(state, _NO_EVENT_NUMBER)
