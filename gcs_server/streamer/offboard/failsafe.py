"""Describes PX4's action when the setpoint stream stops."""

from __future__ import annotations

from dataclasses import dataclass

MAV_SYS_STATUS_SENSOR_RC_RECEIVER = 0x10000
DEFAULT_COM_OF_LOSS_T_S = 1.0

ACTION_MODES = ("position", "altitude", "stabilized", "rtl", "land", "hold", "terminate", "disarm")
"""The mode for each value of COM_OBL_RC_ACT, from 0."""

# By COM_OBL_RC_ACT: the action with an RC transmitter, and the action without one. The text of action 0
# without a transmitter describes what PX4 v1.16 does in flight.
_ACTIONS: dict[int, tuple[str, str]] = {
    0: (
        "is flown by the RC pilot in Position mode",
        "descends and lands at its current position; it reports Position mode",
    ),
    1: (
        "is flown by the RC pilot in Altitude mode",
        "drifts and descends without control; it reports Altitude mode",
    ),
    2: (
        "is flown by the RC pilot in Stabilized mode",
        "drifts and descends without control; it reports Stabilized mode",
    ),
    3: ("returns to launch and lands there", "returns to launch and lands there"),
    4: ("lands at its current position", "lands at its current position"),
    5: ("holds its position in Hold mode", "holds its position in Hold mode"),
    6: (
        "terminates the flight: the motors stop and it falls",
        "terminates the flight: the motors stop and it falls",
    ),
    7: ("disarms: the motors stop and it falls", "disarms: the motors stop and it falls"),
}


@dataclass(frozen=True, slots=True)
class Failsafe:
    """The vehicle's parameters for its action when setpoints stop; None: not known."""

    loss_timeout_s: float | None
    """COM_OF_LOSS_T."""
    action: int | None
    """COM_OBL_RC_ACT."""
    transmitter: bool
    """Whether an RC transmitter is connected."""

    @property
    def action_mode(self) -> str | None:
        """The action's mode; None if unknown."""
        known = self.action is not None and 0 <= self.action < len(ACTION_MODES)
        return ACTION_MODES[self.action] if known and self.action is not None else None

    def text(self) -> str:
        """The action as a sentence."""
        rc_state = "RC connected" if self.transmitter else "no RC"
        if self.action is None:
            return (
                "Action when setpoints stop: unknown (COM_OBL_RC_ACT could not be read; "
                f"{rc_state}). PX4's default without RC is to land at the current position, after 1 s."
            )
        after_s = DEFAULT_COM_OF_LOSS_T_S if self.loss_timeout_s is None else self.loss_timeout_s
        options = _ACTIONS.get(self.action)
        action_text = (
            "does an action that is unknown to this server"
            if options is None
            else options[0 if self.transmitter else 1]
        )
        return f"after {after_s:g} s the vehicle {action_text} (COM_OBL_RC_ACT {self.action}, {rc_state})."
