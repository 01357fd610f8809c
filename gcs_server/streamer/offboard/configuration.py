"""The vehicle's own parameters that matter to a stream: its limits, and what it does when setpoints stop."""

from __future__ import annotations

import asyncio

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, NoReply
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.failsafe import Failsafe
from gcs_server.streamer.values.limit_values import VEHICLE_PARAMETERS
from gcs_server.vehicle.numbers import number
from gcs_server.vehicle.vehicle import Vehicle

PARAMETERS_WITHIN_S = 3.0
"""What the vehicle has not told by then stays unknown."""
ASK_AGAIN_S = 10.0
FAILSAFE_PARAMETERS = ("COM_OF_LOSS_T", "COM_OBL_RC_ACT")


class OffboardConfiguration:
    """Reads these parameters and keeps what was told.

    Args:
        clock: the server's.
        vehicle: whose.
        estimates: says whether the vehicle hears a transmitter.
    """

    def __init__(self, clock: Clock, vehicle: Vehicle, estimates: VehicleEstimates) -> None:
        self._clock = clock
        self._vehicle = vehicle
        self._estimates = estimates
        self._read: dict[str, float] = {}
        """Parameters that were asked for by name."""
        self._read_s: float | None = None

    async def read(self) -> Failsafe:
        """Asks the vehicle for its limits and what it does when the stream stops; the rest stays unknown."""
        values: dict[str, float] = {}

        async def read(name: str) -> None:
            try:
                values[name] = (await self._vehicle.params.get(name)).value
            except NoReply:
                return

        try:
            async with asyncio.timeout(PARAMETERS_WITHIN_S), asyncio.TaskGroup() as group:
                for name in (*FAILSAFE_PARAMETERS, *VEHICLE_PARAMETERS):
                    group.create_task(read(name))
        except TimeoutError:
            pass  # what came in time counts
        except ExceptionGroup as several:
            raise several.exceptions[0] from several
        self._read = values
        self._read_s = self._clock.monotonic_s()
        return self._failsafe_of(self.parameters())

    async def ensure(self) -> None:
        """As `read`, unless it is known or was asked lately; of a vehicle that refuses it stays unknown."""
        now_s = self._clock.monotonic_s()
        asked_lately = self._read_s is not None and now_s - self._read_s < ASK_AGAIN_S
        if "COM_OBL_RC_ACT" not in self.parameters() and not asked_lately:
            try:
                self._vehicle.require_commandable()
                await self.read()
            except GcsError:
                pass  # replayed, lost or of another kind: the status says the rest

    def parameters(self) -> dict[str, float]:
        """As the vehicle last told them: whoever changes one changes what holds here.

        What is not finite, and a limit below zero, counts as not told.
        """
        values = dict(self._read)
        for name in (*FAILSAFE_PARAMETERS, *VEHICLE_PARAMETERS):
            known = self._vehicle.params.known(name)
            if known is not None:
                values[name] = known.value
        return {
            name: value
            for name, value in values.items()
            if number(value) is not None and (value >= 0.0 or name in FAILSAFE_PARAMETERS)
        }

    def failsafe(self) -> Failsafe | None:
        """What it does when the stream stops; None before it was asked."""
        parameters = self.parameters()
        return self._failsafe_of(parameters) if parameters or self._read_s is not None else None

    def _failsafe_of(self, parameters: dict[str, float]) -> Failsafe:
        action = parameters.get("COM_OBL_RC_ACT")
        return Failsafe(
            parameters.get("COM_OF_LOSS_T"),
            None if action is None else int(action),
            self._estimates.hears_transmitter(),
        )
