"""The parameters that a stream needs: the vehicle's limits, and its action when setpoints stop."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, NoReply
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.values.limit_values import VEHICLE_PARAMETERS
from gcs_server.vehicle.numbers import number
from gcs_server.vehicle.vehicle import Vehicle

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


PARAMETERS_TIMEOUT_S = 3.0
"""Maximum wait for the parameters [s]; parameters that have not arrived by then stay unknown."""
REQUEST_PERIOD_S = 10.0
"""Minimum time between two requests for the parameters [s]."""
FAILSAFE_PARAMETERS = ("COM_OF_LOSS_T", "COM_OBL_RC_ACT")
PARAMETERS = (*FAILSAFE_PARAMETERS, *VEHICLE_PARAMETERS)


class OffboardConfiguration:
    """Reads the parameters and stores their values.

    Args:
        clock: the server's clock.
        vehicle: the vehicle.
        estimates: the vehicle's estimates, including whether an RC transmitter is connected.
    """

    def __init__(self, clock: Clock, vehicle: Vehicle, estimates: VehicleEstimates) -> None:
        self._clock = clock
        self._vehicle = vehicle
        self._estimates = estimates
        self._read_values: Mapping[str, float] = {}
        """Values from the last call of `read`, by name."""
        self._values: Mapping[str, float] = {}
        """Result of the last call of `parameters`."""
        self._values_sources: tuple[object, ...] = ()
        """The values from which it was computed."""
        self._read_s: float | None = None
        """Time of the last call of `read` [s, monotonic]; None: not called yet."""

    async def read(self) -> Failsafe:
        """Reads the vehicle's limits and its action when setpoints stop; missing values stay unknown.

        ROS 2 carries no parameters, so nothing is requested from a vehicle without a MAVLink link.
        """
        values: dict[str, float] = {}
        if "parameters" in self._vehicle.reach.missing:
            self._read_s = self._clock.monotonic_s()
            return self._failsafe_of(self.parameters())

        async def read_one(name: str) -> None:
            try:
                values[name] = (await self._vehicle.params.get(name)).value
            except NoReply:
                return

        try:
            async with asyncio.timeout(PARAMETERS_TIMEOUT_S), asyncio.TaskGroup() as group:
                for name in PARAMETERS:
                    group.create_task(read_one(name))
        except TimeoutError:
            pass  # the values that arrived in time are used
        except ExceptionGroup as errors:
            raise errors.exceptions[0] from errors
        self._read_values = values
        self._read_s = self._clock.monotonic_s()
        return self._failsafe_of(self.parameters())

    async def ensure(self) -> None:
        """Reads the parameters unless they are known or were requested recently. If the vehicle refuses,
        they stay unknown."""
        now_s = self._clock.monotonic_s()
        requested_recently = self._read_s is not None and now_s - self._read_s < REQUEST_PERIOD_S
        if "COM_OBL_RC_ACT" not in self.parameters() and not requested_recently:
            try:
                self._vehicle.require_commandable()
                await self.read()
            except GcsError:
                pass  # the vehicle is replayed, lost or not PX4, as shown in its status

    def parameters(self) -> Mapping[str, float]:
        """The newest values from the vehicle, so that a changed parameter applies immediately. Values that
        are not finite, and limits below zero, count as unknown.
        """
        known = self._vehicle.params.known_each(PARAMETERS)
        sources = (known, self._read_values)
        if sources != self._values_sources:
            newest = {param.name: param.value for param in known if param is not None}
            self._values_sources = sources
            self._values = {
                name: value
                for name, value in {**self._read_values, **newest}.items()
                if number(value) is not None and (value >= 0.0 or name in FAILSAFE_PARAMETERS)
            }
        return self._values

    def failsafe(self) -> Failsafe | None:
        """The vehicle's action when the stream stops; None before the parameters were read."""
        parameters = self.parameters()
        return self._failsafe_of(parameters) if parameters or self._read_s is not None else None

    def _failsafe_of(self, parameters: Mapping[str, float]) -> Failsafe:
        action = parameters.get("COM_OBL_RC_ACT")
        return Failsafe(
            parameters.get("COM_OF_LOSS_T"),
            None if action is None else int(action),
            self._estimates.has_transmitter(),
        )
