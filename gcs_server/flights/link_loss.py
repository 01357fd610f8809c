"""Describes what PX4 does in Mission mode when no ground station is connected any more."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_server.clock import Clock
from gcs_server.errors import GcsError
from gcs_server.vehicle.vehicle import Vehicle

PARAMETERS = ("NAV_DLL_ACT", "COM_DL_LOSS_T", "COM_DLL_EXCEPT", "COM_FAIL_ACT_T")
EXCEPT_MISSION = 1
"""Bit of COM_DLL_EXCEPT."""
REQUEST_PERIOD_S = 10.0
"""Time between two requests for the parameters [s]."""
_ACTIONS = {
    1: "holds its position in Hold mode",
    2: "returns (RTL)",
    3: "lands at its current position",
    5: "terminates the flight: the motors stop and it falls",
    6: "disarms: the motors stop and it falls",
}
"""The vehicle's action by NAV_DLL_ACT."""
_AFTER_HOLD = (2, 3)
"""Actions that PX4 begins with Hold for COM_FAIL_ACT_T, so that the pilot can take over."""


class LinkLoss:
    """What one vehicle does in Mission mode without a ground station.

    Args:
        vehicle: the vehicle.
        clock: the server's clock.
    """

    def __init__(self, vehicle: Vehicle, clock: Clock) -> None:
        self._vehicle, self._clock = vehicle, clock
        self._requested_s: float | None = None
        self._read_values: dict[str, float] = {}
        """Values of the parameters that were read by name."""

    def text(self) -> str | None:
        """The action as a sentence; None: not known yet.

        Parameters that the vehicle's parameter list does not contain are read in the background
        repeatedly, because they may change.
        """
        known_values = {name: each.value for name in PARAMETERS if (each := self._vehicle.params.known(name))}
        now_s = self._clock.monotonic_s()
        due = self._requested_s is None or now_s - self._requested_s >= REQUEST_PERIOD_S
        if len(known_values) < len(PARAMETERS) and due and "parameters" not in self._vehicle.reach.missing:
            self._requested_s = now_s
            self._vehicle.in_background("its action without a ground station", self._request(known_values))
        return link_loss_text({**self._read_values, **known_values})

    async def _request(self, known_values: Mapping[str, float]) -> None:
        self._vehicle.require_commandable()
        for name in PARAMETERS:
            try:
                if name not in known_values:
                    self._read_values[name] = (await self._vehicle.params.get(name)).value
            except GcsError:
                continue  # the parameter stays unknown: the firmware does not have it, or the link is bad


def link_loss_text(parameters: Mapping[str, float]) -> str | None:
    """The action by the vehicle's parameters, as a sentence; None if NAV_DLL_ACT is not known."""
    if "NAV_DLL_ACT" not in parameters:
        return None
    action, exceptions = int(parameters["NAV_DLL_ACT"]), int(parameters.get("COM_DLL_EXCEPT", 0))
    if action == 0:
        return "The vehicle continues the mission (NAV_DLL_ACT 0)."
    if exceptions & EXCEPT_MISSION:
        return f"The vehicle continues the mission (COM_DLL_EXCEPT {exceptions})."
    after_s = parameters.get("COM_DL_LOSS_T")
    after_text = "After COM_DL_LOSS_T" if after_s is None else f"After about {after_s:g} s"
    action_text = _ACTIONS.get(action, "does an action that is unknown to this server")
    hold_s = parameters.get("COM_FAIL_ACT_T")
    if action in _AFTER_HOLD and hold_s != 0.0:
        action_text = (
            f"holds for {'COM_FAIL_ACT_T' if hold_s is None else f'{hold_s:g} s'}, then {action_text}"
        )
    return f"{after_text} without any ground station, the vehicle {action_text} (NAV_DLL_ACT {action})."
