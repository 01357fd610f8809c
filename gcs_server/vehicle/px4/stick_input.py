"""Whether PX4 takes stick positions from a ground station, and what it does when they stop, from its
parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gcs_server.vehicle.px4.stream_loss import ACTIONS, STICK_LOSS

INPUT: Final = "COM_RC_IN_MODE"
LOSS_PARAMETERS: Final = ("COM_RC_LOSS_T", "NAV_RCL_ACT", "COM_RCL_EXCEPT", "COM_FAIL_ACT_T")
TAKES_STICKS: Final = frozenset({1, 2, 3, 5, 6, 7, 8})
"""Values of COM_RC_IN_MODE with which PX4 uses MANUAL_CONTROL; 5 to 8 are of v1.17."""
TRANSMITTER_ONLY: Final = 0
EXCEPT_HOLD: Final = 2
"""Bit of COM_RCL_EXCEPT: no action in Hold."""
DIRECT_THRUST_MODES: Final = frozenset({"manual", "stabilized", "acro"})
"""Modes in which the throttle stick is the thrust. In the others its middle keeps the altitude."""


def input_problem(value: float) -> str | None:
    """Why PX4 with this value of COM_RC_IN_MODE ignores stick positions, as a sentence; None: it does not."""
    choice = round(value)
    if choice in TAKES_STICKS:
        return None
    if choice == TRANSMITTER_ONLY:
        return f"{INPUT} is 0: the vehicle takes sticks from its RC transmitter only."
    return f"{INPUT} is {choice}: the vehicle takes no stick positions."


INPUT_REMEDY: Final = f"Set {INPUT} to 1 (joystick only), or to 2 (RC transmitter and joystick)."


@dataclass(frozen=True, slots=True)
class StickLoss:
    """The vehicle's action when stick positions stop in flight."""

    after_s: float | None
    """Time after the last stick positions [s] (COM_RC_LOSS_T); null: not known."""
    action: str | None
    """`hold`, `rtl`, `land`, `terminate` or `disarm` (NAV_RCL_ACT); null: not known."""
    also_in_hold: bool | None
    """Whether the vehicle does so in Hold, too (COM_RCL_EXCEPT); null: not known."""
    text: str
    """The action as a sentence."""

    @classmethod
    def of(cls, parameters: Mapping[str, float]) -> StickLoss:
        """The action that a vehicle's parameters select; those that are not known are missing."""
        if any(name not in parameters for name in LOSS_PARAMETERS):
            return cls(None, None, None, "What the vehicle does when stick positions stop is not known.")
        after_s, delay_s = parameters["COM_RC_LOSS_T"], parameters["COM_FAIL_ACT_T"]
        choice = round(parameters["NAV_RCL_ACT"])
        mode = STICK_LOSS.get(choice)
        if mode is None:
            text = f"When stick positions stop, the vehicle does nothing by itself (NAV_RCL_ACT {choice})."
            return cls(after_s, None, False, text)
        excepts_hold = bool(round(parameters["COM_RCL_EXCEPT"]) & EXCEPT_HOLD)
        sentences = [
            f"When stick positions stop in flight, after {after_s:g} s the vehicle {ACTIONS[mode]} "
            f"(NAV_RCL_ACT {choice})."
        ]
        if mode in ("rtl", "land") and delay_s > 0:
            sentences.append(f"Before, it holds its position for {delay_s:g} s (COM_FAIL_ACT_T).")
        if mode != "hold" and excepts_hold:
            sentences.append("In Hold it stays there (COM_RCL_EXCEPT).")
        elif mode != "hold":
            sentences.append("From Hold, too, unless COM_RCL_EXCEPT has it.")
        return cls(after_s, mode, not excepts_hold, " ".join(sentences))
