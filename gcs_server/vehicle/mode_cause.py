"""Finds the cause of a mode change: this server's command, the vehicle itself, its pilot or another
station. No I/O.

The vehicle does not report the cause. The server infers it from this server's commands, the vehicle's
acknowledgements to other stations, the intended mode and the current mode, and the RC link.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE
from gcs_server.vehicle.reducers import FlightState

FOREIGN_ACK_S = 3.0
"""Time after an acknowledgement to another station within which a mode change counts as commanded by that
station [s]."""
MODE_COMMANDS = frozenset(
    {
        d.MAV_CMD_DO_SET_MODE,
        d.MAV_CMD_NAV_TAKEOFF,
        d.MAV_CMD_NAV_LAND,
        d.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        d.MAV_CMD_DO_REPOSITION,
        d.MAV_CMD_DO_ORBIT,
        d.MAV_CMD_MISSION_START,
    }
)
PILOT_MODES = frozenset(
    {"manual", "altitude", "position", "position_slow", "altitude_cruise", "acro", "stabilized"}
)
ENDS_IN_HOLD = frozenset({"takeoff", "mission", "land", "rtl", "orbit", "precision_land", "vtol_takeoff"})
"""Modes after which PX4 itself switches to Hold."""
MAV_SYS_STATUS_SENSOR_RC_RECEIVER = 1 << 16

Source = Literal["command", "vehicle", "failsafe", "pilot", "station", "unknown"]


@dataclass(frozen=True, slots=True)
class ForeignAck:
    """The vehicle accepted a command of another station that may change its mode."""

    system: int
    component: int
    received_s: float


@dataclass(frozen=True, slots=True)
class ModeCause:
    """The inferred cause of the current mode."""

    source: Source
    """command (of this server), vehicle (the vehicle itself), failsafe, pilot (RC transmitter), station
    (another ground station), unknown."""
    who: str | None
    """The client or the other station; None: unknown, or the vehicle itself."""
    text: str
    """Message for the operator."""
    since_unix_s: float

    @property
    def is_external(self) -> bool:
        """Whether the inferred cause is neither this server nor the vehicle itself."""
        return self.source in ("pilot", "station", "unknown")


def cause_of(
    before: FlightState,
    after: FlightState,
    *,
    requested: tuple[str, str | None] | None,
    foreign: ForeignAck | None,
    has_transmitter: bool,
    stick_client: str | None,
    was_failsafe: bool,
    plan_returns: Callable[[], bool],
    now_s: float,
    unix_s: float,
) -> ModeCause:
    """Infers the cause of a mode change.

    Args:
        before: state before the change.
        after: state after the change.
        requested: (command, client) of this server's newest command for this mode.
        foreign: newest acknowledgement to another station.
        has_transmitter: whether an RC transmitter is connected.
        stick_client: the client whose stick positions this server sends; None: nobody's.
        was_failsafe: whether a failsafe selected the mode before the change.
        plan_returns: whether the plan on the vehicle is at its own Return.
        now_s: current time [s, monotonic].
        unix_s: current time [s since 1970 UTC].
    """
    if requested is not None:
        command, client = requested
        return ModeCause("command", client, f"{client or 'this server'} commanded {command}", unix_s)
    if foreign is not None and now_s - foreign.received_s <= FOREIGN_ACK_S:
        who = f"station {foreign.system}/{foreign.component}"
        return ModeCause("station", who, f"another ground station ({who})", unix_s)
    old, new = (_name(flight_state.custom_mode) for flight_state in (before, after))
    if is_overruled(after) or after.system_status in (d.MAV_STATE_CRITICAL, d.MAV_STATE_EMERGENCY):
        return ModeCause("failsafe", None, "the failsafe", unix_s)
    if was_failsafe and before.intended_custom_mode == after.custom_mode:
        return ModeCause("vehicle", None, "the vehicle itself, after its failsafe", unix_s)
    if not after.armed or (new == "hold" and old in ENDS_IN_HOLD):
        return ModeCause("vehicle", None, "the vehicle itself", unix_s)
    if old == "mission" and new == "rtl" and plan_returns():
        return ModeCause("vehicle", None, "the plan", unix_s)
    if new in PILOT_MODES and stick_client is not None:
        return ModeCause("pilot", stick_client, f"the sticks of {stick_client}", unix_s)
    if new in PILOT_MODES and has_transmitter:
        return ModeCause("pilot", None, "the RC pilot", unix_s)
    return ModeCause(
        "unknown", None, "not this server (RC pilot, another station or the vehicle itself)", unix_s
    )


def is_overruled(flight_state: FlightState) -> bool:
    """Whether the vehicle's intended mode differs from its current mode."""
    return flight_state.intended_custom_mode not in (None, flight_state.custom_mode)


def _name(custom_mode: int) -> str | None:
    mode = BY_CUSTOM_MODE.get(custom_mode)
    return None if mode is None else mode.name
