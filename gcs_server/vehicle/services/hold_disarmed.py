"""Keeps a disarmed vehicle out of the modes in which arming starts a flight.

A command that selects such a mode and ends before the vehicle is armed is followed by Hold, and so is a
disarming in such a mode: otherwise the next arming would start the flight.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager

from gcs_server.errors import GcsError, Interrupted
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.px4.modes import BY_NAME, Mode
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.tickets import Ticket

FLIES_WHEN_ARMED = frozenset({"takeoff", "mission"})
"""Modes in which PX4 takes off by itself once it is armed."""
OTHER_COMMAND_PERIOD_S = 0.2
"""Period at which the end of another command is awaited [s]."""


class HoldDisarmed:
    """Hold for one vehicle that is disarmed in a mode of `FLIES_WHEN_ARMED`.

    Args:
        vehicle: the vehicle.
        commanded_mode: the mode that this server has just requested; None: no recent request.
        kill_pending: whether Stop motors is not confirmed yet.
        hold: commands Hold, with a ticket of its own.
    """

    def __init__(
        self,
        vehicle: VehiclePort,
        commanded_mode: Callable[[], str | None],
        kill_pending: Callable[[], bool],
        hold: Callable[[], Awaitable[None]],
    ) -> None:
        self._vehicle = vehicle
        self._commanded_mode = commanded_mode
        self._kill_pending = kill_pending
        self._hold = hold

    def flight_when_armed(self) -> str | None:
        """The flight that arming would start now, as a sentence; None: no flight. A mode that this server
        has just requested counts, too, because the vehicle may not have reported it yet."""
        vehicle = self._vehicle
        modes = FLIES_WHEN_ARMED & {vehicle.status.mode, self._commanded_mode()}
        mode = min(modes, default=None)
        if mode is None or vehicle.flight_state.armed:
            return None
        state = "is in" if mode == vehicle.status.mode else "was just commanded to"
        return f"Vehicle {vehicle.id} {state} {BY_NAME[mode].label}: arming it would start the flight."

    @asynccontextmanager
    async def hold_unless_armed(self, ticket: Ticket, mode: Mode) -> AsyncGenerator[None]:
        """For a command that selects a mode of `FLIES_WHEN_ARMED`: if it ends before the vehicle is armed,
        the vehicle is put into Hold."""
        try:
            yield
        except BaseException as error:
            if not self._vehicle.flight_state.armed:
                hold = self._hold_disarmed(f"The command to switch to {mode.label} was not completed")
                if isinstance(error, GcsError) and ticket.reason is None:
                    ticket.close()
                    await hold
                else:
                    self._vehicle.in_background("Hold after an interrupted command", hold)
            raise

    def hold_after_disarming(self) -> None:
        """Puts a vehicle that was disarmed in a mode of `FLIES_WHEN_ARMED` into Hold, in the background."""
        mode = self._vehicle.status.mode
        if mode in FLIES_WHEN_ARMED:
            why = f"The vehicle was disarmed in {BY_NAME[mode].label}"
            self._vehicle.in_background("Hold after disarming", self._hold_disarmed(why))

    async def _hold_disarmed(self, why: str) -> None:
        """Puts a disarmed vehicle into Hold, once no other command is being executed; reports it."""
        vehicle, clock, again = self._vehicle, self._vehicle.clock, False
        while True:
            while vehicle.tickets.commanding() is not None or self._kill_pending():
                again = True
                await clock.sleep(OTHER_COMMAND_PERIOD_S)
            if vehicle.flight_state.armed or (again and self.flight_when_armed() is None):
                return
            text = f"{why}; the server has put it into Hold."
            severity, kind = d.MAV_SEVERITY_NOTICE, "command"
            try:
                await self._hold()
            except Interrupted:
                again = True
                continue
            except GcsError as error:
                text = f"{why}, and it is not in Hold: {error} Select Hold before you arm, or it takes off."
                severity, kind = d.MAV_SEVERITY_WARNING, "warning"
            data = {"source": "command", "code": "held_disarmed"}
            vehicle.events.add(kind, clock.unix_s(), text, severity=severity, data=data)
            return
