"""Commands of a mission through the executor of its mode.

PX4 accepts these commands only while the executor is in charge. So if a pilot, another station or a failsafe
takes over while a command is sent, PX4 rejects the command.
"""

from __future__ import annotations

import itertools
import math
from typing import Final

from gcs_server.clock import Clock
from gcs_server.errors import NoReply, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.ros2.mode_executor import ExecutorCommand, ExecutorState
from gcs_server.streamer.process.streams import Streams
from gcs_server.vehicle.px4.modes import BY_NAME
from gcs_server.vehicle.samples import GlobalPosition
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

SET_NAV_STATE: Final = 100_001
"""VehicleCommand.VEHICLE_CMD_SET_NAV_STATE: param1 is the mode, as `nav_state`."""
TAKE_OFF_STATE: Final = 17
"""VehicleStatus.NAVIGATION_STATE_AUTO_TAKEOFF."""
POLL_S: Final = 0.02
DEADLINE_S: Final = 4.0
"""Time within which the vehicle must report the new mode."""
REJECTED_AFTER_S: Final = 0.7
"""Time to wait after PX4 has rejected a command: up to 0.5 s later it reports that the executor is no
longer in charge."""
PX4_MODES: Final = ("takeoff", "land")
"""PX4's own modes that the executor selects."""
IF_SILENT_IN_PX4_MODE: Final = (
    "PX4 removes the mission's mode, completes its take-off or landing by itself, and holds after a take-off."
)
"""Text: what happens during PX4's own take-off or landing when the component of the mode ends."""
NAN: Final = math.nan
_numbers = itertools.count(1)


class MissionExecutor:
    """The executor of one mode on one vehicle.

    Args:
        clock: the server's clock.
        vehicle: the vehicle.
        streams: sends the commands.
        mode: the mode, as in `Status.mode`.
    """

    def __init__(self, clock: Clock, vehicle: Vehicle, streams: Streams, mode: str) -> None:
        self._clock, self._vehicle, self._streams, self._mode = clock, vehicle, streams, mode

    @property
    def state(self) -> ExecutorState | None:
        """State of the executor; None: the mode has no executor, or is not registered."""
        modes = self._streams.modes().get(self._vehicle.id, ())
        return next((each.executor for each in modes if each.mode == self._mode), None)

    @property
    def in_charge(self) -> bool:
        """Whether PX4 accepts the executor's commands."""
        state = self.state
        return state is not None and state.in_charge

    @property
    def take_off_complete(self) -> bool:
        """Whether PX4 has reported that the current take-off is complete."""
        state = self.state
        return state is not None and state.completed_nav_state == TAKE_OFF_STATE

    async def take_off(self, height_m: float, by: str, ticket: Ticket) -> None:
        """Takes off; returns once the vehicle reports the mode Takeoff.

        Args:
            height_m: height above the current position [m].
            by: the mission, for messages.
            ticket: ticket of the mission's command.

        Raises:
            Interrupted: the ticket was cancelled.
            Refused: the executor is not in charge, or the altitude is unknown.
            Rejected: PX4 refused the command.
            NoReply: the vehicle did not report the mode in time.
        """
        sample = self._vehicle.topic("global_position")
        if sample is None or not isinstance(sample.value, GlobalPosition):
            raise Refused(
                f"Vehicle {self._vehicle.id} reports no altitude above sea level.",
                remedy="Wait for GPS and the estimator, then select the mode and arm again.",
            )
        altitude_m = sample.value.alt_amsl_m + height_m
        await self._run(
            d.MAV_CMD_NAV_TAKEOFF,
            (NAN, NAN, NAN, NAN, NAN, NAN, altitude_m),
            "take off",
            "takeoff",
            by,
            ticket,
        )

    async def set_mode(self, mode: str, by: str, ticket: Ticket) -> None:
        """Changes the mode; returns once the vehicle reports the mode. Raises the same errors as
        `take_off`."""
        label = self._vehicle.mode_names.label(BY_NAME[mode])
        params = (float(BY_NAME[mode].nav_state), NAN, NAN, NAN, NAN, NAN, NAN)
        await self._run(SET_NAV_STATE, params, f"mode {label}", mode, by, ticket)

    async def _run(
        self,
        command: int,
        params: tuple[float, float, float, float, float, float, float],
        action: str,
        mode: str,
        by: str,
        ticket: Ticket,
    ) -> None:
        vehicle = self._vehicle
        vehicle.require_commandable()
        self._require_in_charge(action)
        ticket.require()
        vehicle.command.record_executor_request(action, mode, by)
        number = next(_numbers)
        self._streams.execute_command(vehicle.id, self._mode, ExecutorCommand(number, command, params))
        until_s = self._clock.monotonic_s() + DEADLINE_S
        rejected = False
        while vehicle.status.mode != mode:
            ticket.require()
            self._require_in_charge(action)
            now_s, state = self._clock.monotonic_s(), self.state
            if state is not None and state.command == number and state.outcome == "rejected" and not rejected:
                rejected, until_s = True, now_s + REJECTED_AFTER_S
            if now_s >= until_s:
                text = f"Vehicle {vehicle.id}: PX4 {{}} {action!r} of the mission's mode."
                if rejected:
                    raise Rejected(text.format("refused"))
                raise NoReply(text.format("did not execute"), deadline_s=DEADLINE_S)
            await self._clock.sleep(POLL_S)

    def _require_in_charge(self, action: str) -> None:
        if not self.in_charge:
            raise Refused(
                f"PX4 does not accept {action!r} of the mission's mode, because the executor is not "
                "in charge.",
                remedy="Select the mode again, then arm.",
            )
