"""Stop motors (kill): repeated until the vehicle reports that it is disarmed; no other command replaces it.

It runs in the background until its deadline, even if the caller is cancelled, the vehicle refuses, or the
link is lost.
"""

from __future__ import annotations

import asyncio

from gcs_server.errors import Disconnected, GcsError, Refused
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Goal, ReportProgress, Request, Transaction

DEADLINE_S = 6.0
RESEND_S = 0.2
FORCE = 21196.0
"""MAV_CMD_COMPONENT_ARM_DISARM's magic number: also in flight."""
ARMING_SETTLES_S = 1.0
"""An arm command that was sent before may still arrive. Therefore a report of "disarmed" within this
time does not count [s]."""


class StopMotors:
    """Stop motors of one vehicle. Concurrent calls run independently."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._running = 0
        self._over = asyncio.Event()
        self._over.set()
        self._by: str | None = None

    @property
    def pending(self) -> bool:
        """Whether it was commanded and the vehicle has not reported that it is disarmed."""
        return self._running > 0

    def require_none(self, what: str) -> None:
        """Called before any other command is sent.

        Raises:
            Refused: motors are being stopped; `what` was not sent.
        """
        if self.pending:
            by = "" if self._by is None else f" by {self._by}"
            raise Refused(
                f"Stop motors was commanded{by} and vehicle {self._vehicle.id} has not confirmed it yet: "
                f"“{what}” was not sent.",
                remedy=f"Wait until the vehicle reports that it is disarmed, at most {DEADLINE_S:g} s.",
            )

    async def wait(self) -> None:
        """Returns once no Stop motors command is pending."""
        while self.pending:
            await self._over.wait()

    async def run(self, *, by: str | None, arming: bool, progress: ReportProgress | None) -> None:
        """Stops the motors; returns once the vehicle reports that it is disarmed.

        Args:
            by: the client.
            arming: whether an arm command was waiting for its answer.
            progress: called at each attempt.

        Raises:
            Rejected: the vehicle refused, and was still armed at the deadline.
            NoReply: no report came within the deadline.
        """
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        # read the error here, because the caller may have been cancelled
        done.add_done_callback(lambda ended: ended.cancelled() or ended.exception())
        self._running += 1
        self._by = by
        self._over.clear()
        self._vehicle.in_background("stop motors", self._until_disarmed(done, arming, progress))
        await asyncio.shield(done)

    async def _until_disarmed(
        self, done: asyncio.Future[None], arming: bool, progress: ReportProgress | None
    ) -> None:
        settles_s = ARMING_SETTLES_S if arming else 0.0

        def reached(flight_state: FlightState, since_s: float) -> bool:
            return flight_state.heartbeat_s > since_s + settles_s and not flight_state.armed

        goal = Goal(
            "stop its motors",
            reached,
            DEADLINE_S,
            requested_ids=(d.MAVLINK_MSG_ID_HEARTBEAT,),
            repeat_s=RESEND_S,
        )
        request = Request(d.MAV_CMD_COMPONENT_ARM_DISARM, (0.0, FORCE, 0, 0, 0, 0, 0))
        error: GcsError = Disconnected(
            f"The server was shut down before vehicle {self._vehicle.id} was disarmed."
        )
        ended = False
        try:
            await Transaction(self._vehicle, request, goal, progress).run()
            ended = True
        except GcsError as problem:
            error = problem
        finally:
            self._running -= 1
            if not self._running:
                self._over.set()
            if ended:
                done.set_result(None)
            else:
                done.set_exception(error)
