"""Stop motors (kill): repeated until the vehicle reports that it is disarmed; no other command replaces it.

The command runs in the background until its deadline, even if the caller is cancelled, the vehicle refuses,
or the link is lost.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gcs_server.errors import Disconnected, GcsError, Refused
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Goal, ReportProgress, Request, Transaction

DEADLINE_S = 6.0
RESEND_S = 0.2
FORCE = 21196.0
"""Magic number of MAV_CMD_COMPONENT_ARM_DISARM: disarm also in flight."""
ARMING_SETTLES_S = 1.0
"""Time within which a report of "disarmed" does not count [s], because an earlier arm command may still
arrive."""


class StopMotors:
    """Stop motors of one vehicle. Concurrent calls run independently."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._running = 0
        self._none_pending = asyncio.Event()
        self._none_pending.set()
        self._by: str | None = None

    @property
    def pending(self) -> bool:
        """Whether Stop motors was commanded and the vehicle has not reported that it is disarmed."""
        return self._running > 0

    def require_none(self, label: str) -> None:
        """Checks that no Stop motors is pending; called before any other command is sent.

        Raises:
            Refused: motors are being stopped; the command `label` was not sent.
        """
        if self.pending:
            by = "" if self._by is None else f" by {self._by}"
            raise Refused(
                f"Stop motors was commanded{by} and vehicle {self._vehicle.id} has not confirmed it yet: "
                f"“{label}” was not sent.",
                remedy=f"Wait until the vehicle reports that it is disarmed, at most {DEADLINE_S:g} s.",
            )

    async def wait(self) -> None:
        """Returns once no Stop motors command is pending."""
        while self.pending:
            await self._none_pending.wait()

    async def run(
        self,
        *,
        by: str | None,
        arming: bool,
        progress: ReportProgress | None,
        on_disarmed: Callable[[], None],
    ) -> None:
        """Stops the motors; returns once the vehicle reports that it is disarmed.

        Args:
            by: the client.
            arming: whether an arm command was waiting for its acknowledgement.
            progress: called at each attempt.
            on_disarmed: called once the vehicle reports that it is disarmed, also if the caller was
                cancelled.

        Raises:
            Rejected: the vehicle refused, and was still armed at the deadline.
            NoReply: no report arrived by the deadline.
        """
        result: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        # read the error here, because the caller may have been cancelled
        result.add_done_callback(lambda future: future.cancelled() or future.exception())
        self._running += 1
        self._by = by
        self._none_pending.clear()
        self._vehicle.in_background(
            "stop motors", self._until_disarmed(result, arming, progress, on_disarmed)
        )
        await asyncio.shield(result)

    async def _until_disarmed(
        self,
        result: asyncio.Future[None],
        arming: bool,
        progress: ReportProgress | None,
        on_disarmed: Callable[[], None],
    ) -> None:
        settle_s = ARMING_SETTLES_S if arming else 0.0

        def reached(flight_state: FlightState, since_s: float) -> bool:
            return flight_state.heartbeat_s > since_s + settle_s and not flight_state.armed

        goal = Goal(
            "stop its motors",
            reached,
            DEADLINE_S,
            requested_ids=(d.MAVLINK_MSG_ID_HEARTBEAT,),
            repeat_s=RESEND_S,
            on_lost_link=True,
        )
        request = Request(d.MAV_CMD_COMPONENT_ARM_DISARM, (0.0, FORCE, 0, 0, 0, 0, 0))
        error: GcsError = Disconnected(
            f"The server was shut down before vehicle {self._vehicle.id} was disarmed."
        )
        disarmed = False
        try:
            await Transaction(self._vehicle, request, goal, progress).run()
            disarmed = True
        except GcsError as problem:
            error = problem
        finally:
            self._running -= 1
            if not self._running:
                self._none_pending.set()
            if disarmed:
                on_disarmed()
                result.set_result(None)
            else:
                result.set_exception(error)
