"""PX4's own action when Offboard setpoints stop, from its parameters and its release."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

DEFAULT_COM_OF_LOSS_T_S: Final = 1.0
PARAMETERS: Final = ("COM_OF_LOSS_T", "COM_OBL_RC_ACT", "NAV_RCL_ACT")
"""The parameters that determine the action."""
ACTION_MODES: Final = ("position", "altitude", "stabilized", "rtl", "land", "hold", "terminate", "disarm")
"""The mode for each value of COM_OBL_RC_ACT, from 0."""
_STICK_MODES: Final = ("Position", "Altitude", "Stabilized")
"""The modes of the first values of COM_OBL_RC_ACT: they need a pilot's sticks."""
_WITHOUT_STICKS: Final = (
    "descends and lands at its current position; it reports Position mode",
    "drifts and descends without control; it reports Altitude mode",
    "drifts and descends without control; it reports Stabilized mode",
)
"""What PX4 up to v1.16 does in these modes in flight without sticks."""
ACTIONS: Final = {
    "rtl": "returns to launch and lands there",
    "land": "lands at its current position",
    "hold": "holds its position in Hold mode",
    "terminate": "terminates the flight: the motors stop and it falls",
    "disarm": "disarms: the motors stop and it falls",
}
"""What the vehicle does, by mode of `ACTION_MODES`."""
STICK_LOSS: Final = {1: "hold", 2: "rtl", 3: "land", 5: "terminate", 6: "disarm"}
"""The mode for each value of NAV_RCL_ACT."""
_FALLS_BACK_FROM: Final = (1, 17)
"""From this release on, PX4 without sticks executes NAV_RCL_ACT instead of a mode that needs them (flown:
with v1.17.0 and COM_OBL_RC_ACT 0, 1 and 2 it returns, NAV_RCL_ACT 2)."""


@dataclass(frozen=True, slots=True)
class StreamLoss:
    """The vehicle's action when setpoints stop; None: not known."""

    loss_timeout_s: float | None
    """COM_OF_LOSS_T."""
    action: int | None
    """COM_OBL_RC_ACT."""
    transmitter: bool
    """Whether an RC transmitter is connected."""
    stick_loss_action: int | None = None
    """NAV_RCL_ACT."""
    release: tuple[int, int] | None = None
    """Major and minor version of PX4."""

    @classmethod
    def of(
        cls, parameters: Mapping[str, float], transmitter: bool, release: tuple[int, int] | None
    ) -> StreamLoss:
        """The action that a vehicle's parameters select; those that are not known are missing."""

        def choice(name: str) -> int | None:
            return int(parameters[name]) if name in parameters else None

        timeout_s = parameters.get("COM_OF_LOSS_T")
        return cls(timeout_s, choice("COM_OBL_RC_ACT"), transmitter, choice("NAV_RCL_ACT"), release)

    @property
    def action_mode(self) -> str | None:
        """The selected action's mode; None if unknown."""
        known = self.action is not None and 0 <= self.action < len(ACTION_MODES)
        return ACTION_MODES[self.action] if known and self.action is not None else None

    def text(self) -> str:
        """The action as a sentence."""
        rc_state = "RC connected" if self.transmitter else "no RC"
        if self.action is None:
            return (
                "Action when setpoints stop: unknown (COM_OBL_RC_ACT could not be read; "
                f"{rc_state}). By default and without RC, {self._default_without_sticks()}, after 1 s."
            )
        after_s = DEFAULT_COM_OF_LOSS_T_S if self.loss_timeout_s is None else self.loss_timeout_s
        return (
            f"after {after_s:g} s the vehicle {self._action_text(self.action)} "
            f"(COM_OBL_RC_ACT {self.action}, {rc_state})."
        )

    def _default_without_sticks(self) -> str:
        if self.release is None:
            return "PX4 up to v1.16 lands at its current position, and from v1.17 on returns to launch"
        falls_back = self.release >= _FALLS_BACK_FROM
        return "PX4 returns to launch" if falls_back else "PX4 lands at its current position"

    def _action_text(self, action: int) -> str:
        if self.action_mode is None:
            return "does an action that is unknown to this server"
        if action >= len(_STICK_MODES):
            return ACTIONS[self.action_mode]
        if self.transmitter:
            return f"is flown by the RC pilot in {_STICK_MODES[action]} mode"
        if self.release is not None and self.release < _FALLS_BACK_FROM:
            return _WITHOUT_STICKS[action]
        mode = STICK_LOSS.get(2 if self.stick_loss_action is None else self.stick_loss_action)
        falls_back = ACTIONS[mode] if mode is not None else "does what NAV_RCL_ACT selects"
        known = "NAV_RCL_ACT's default" if self.stick_loss_action is None else "NAV_RCL_ACT"
        if self.release is None:
            return f"{_WITHOUT_STICKS[action]}, or with PX4 v1.17 or newer {falls_back} ({known})"
        return f"{falls_back}, because it has no sticks for {_STICK_MODES[action]} mode ({known})"
