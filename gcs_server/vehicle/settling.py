"""Waits for what a vehicle has not reported yet, directly after its ROS 2 connection has begun.

A server that starts beside a flying PX4 knows the vehicle with its first status, but learns the layouts of
its topics one after the other, and the estimates after that: for a few seconds a command would be refused for
reasons that end by themselves. A vehicle that has been connected for longer is refused at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

from gcs_server.errors import NotYet
from gcs_server.vehicle.services.transaction import ReportProgress
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

T = TypeVar("T")
SETTLING_S: Final = 10.0
"""Time after the beginning of a ROS 2 connection, or after PX4's boot, within which layouts and estimates are
expected [s]. PX4 answers for all its topics in about 2 s, and sends home with its next change."""
CHECK_PERIOD_S: Final = 0.1


async def settled(
    vehicle: Vehicle,
    check: Callable[[], T],
    *,
    ticket: Ticket | None = None,
    progress: ReportProgress | None = None,
) -> T:
    """The result of a check, which is repeated while the vehicle's ROS 2 connection is new.

    Args:
        vehicle: the vehicle.
        check: raises NotYet for what the vehicle may still report.
        ticket: ticket of the command; its end ends the waiting.
        progress: reports what the command waits for.

    Raises:
        NotYet: the vehicle has not reported it in time.
        Interrupted: the ticket was cancelled.
        GcsError: the check failed for another reason, or the vehicle cannot be commanded any more.
    """
    told = ""
    while True:
        try:
            return check()
        except NotYet as missing:
            if vehicle.clock.monotonic_s() >= _settles_at_s(vehicle):
                raise
            if progress is not None and str(missing) != told:
                told = str(missing)
                progress(f"Waiting for vehicle {vehicle.id}, which has just connected. {told}", None)
        await vehicle.clock.sleep(CHECK_PERIOD_S)
        vehicle.require_commandable()
        if ticket is not None:
            ticket.require()


def _settles_at_s(vehicle: Vehicle) -> float:
    """Time from which nothing more is expected of the newest ROS 2 connection [s, monotonic]."""
    began_s = (
        max(each.first_received_s, each.boot_at_s or float("-inf"))
        for each in vehicle.endpoints
        if each.over_ros2
    )
    return max(began_s, default=float("-inf")) + SETTLING_S
