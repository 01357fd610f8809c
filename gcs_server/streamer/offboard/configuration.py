"""The parameters that a stream needs: the vehicle's limits, and its action when setpoints stop."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, NoReply
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.values.limit_values import VEHICLE_PARAMETERS
from gcs_server.vehicle.numbers import number
from gcs_server.vehicle.px4 import stream_loss
from gcs_server.vehicle.px4.stream_loss import StreamLoss
from gcs_server.vehicle.vehicle import Vehicle

PARAMETERS_TIMEOUT_S = 3.0
"""Maximum wait for the parameters [s]; parameters that have not arrived by then stay unknown."""
REQUEST_PERIOD_S = 10.0
"""Minimum time between two requests for the parameters [s]."""
PARAMETERS = (*stream_loss.PARAMETERS, *VEHICLE_PARAMETERS)


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

    async def read(self) -> StreamLoss:
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
                if number(value) is not None and (value >= 0.0 or name in stream_loss.PARAMETERS)
            }
        return self._values

    def failsafe(self) -> StreamLoss | None:
        """The vehicle's action when the stream stops; None before the parameters were read."""
        parameters = self.parameters()
        return self._failsafe_of(parameters) if parameters or self._read_s is not None else None

    def _failsafe_of(self, parameters: Mapping[str, float]) -> StreamLoss:
        return self._vehicle.identity.software.stream_loss(parameters, self._estimates.has_transmitter())
