"""Reads all parameters of a vehicle over a link that loses packets.

The list is requested once. What is still missing when the vehicle stops sending is requested by index, a few
at a time. Reading changes nothing on the vehicle.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from gcs_server.errors import NoReply
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.param_table import (
    HASH_NAME,
    MAX_PARAMETERS,
    NO_INDEX,
    ParamReport,
    ParamTable,
    checksum_of,
    read_report,
)
from gcs_server.vehicle.services.port import VehiclePort

LIST_TIMES = 4
FIRST_SILENCE_S, SILENCE_S = 2.0, 1.0
"""PX4 sends the list at a part of the link's rate: on a slow link values are tenths of a second apart."""
AT_ONCE = 10
"""Missing indexes requested at once."""
GAP_TIMEOUT_S = 0.5
MAX_EMPTY_ROUNDS = 12
HASH_TIMES, HASH_EVERY_S = 4, 0.5
RESTARTS = 3
READ_TIMEOUT_S = 600.0
"""Time for the whole list, on the slowest link."""
MAX_REPEATED_VALUES = 5_000
"""After this many known values in a row, the vehicle is considered to repeat itself endlessly."""
YIELD_AFTER_VALUES = 100
"""Values handled in a row before the event loop does other work."""

ReportValue = Callable[[], None]


class ParamReader:
    """Reads the parameter list once."""

    def __init__(self, vehicle: VehiclePort, progress: ReportValue) -> None:
        self._vehicle = vehicle
        self._progress = progress

    async def hash(self) -> tuple[int, int] | None:
        """(checksum, number of parameters); None if the vehicle has no parameter hash."""
        with self._values() as waiter:
            for _ in range(HASH_TIMES):
                self._request(HASH_NAME.encode(), -1)
                report = await self._next(waiter, HASH_EVERY_S, HASH_NAME)
                if report is not None:
                    checksum = checksum_of(report.param)
                    return None if checksum is None else (checksum, report.count)
        return None

    async def read(self, table: Callable[[], ParamTable]) -> None:
        """Fills a new table; starts again with another one if the list's length changes while it is read.

        Args:
            table: returns an empty table.

        Raises:
            NoReply: the vehicle stopped sending, or its list is too long or never complete.
        """
        try:
            async with asyncio.timeout(READ_TIMEOUT_S):
                for _ in range(RESTARTS):
                    if await self._fill(table()):
                        return
        except TimeoutError:
            raise self._given_up(f"they were not complete within {READ_TIMEOUT_S:.0f} s") from None
        raise NoReply(
            f"The parameters of vehicle {self._vehicle.id} changed in number while they were read.",
            deadline_s=0.0,
            remedy="Wait until its setup is finished, and read them again.",
        )

    async def _fill(self, table: ParamTable) -> bool:
        with self._values() as waiter:
            for _ in range(LIST_TIMES):
                identity = self._vehicle.identity
                message = d.MAVLink_param_request_list_message(identity.system_id, identity.component_id)
                self._vehicle.send_payload(message.get_msgId(), encode_payload(message))
                if not await self._receive(waiter, table, FIRST_SILENCE_S, SILENCE_S):
                    return False
                if table.count is not None:
                    break
            else:
                raise NoReply(
                    f"Vehicle {self._vehicle.id} did not send its parameters.",
                    deadline_s=LIST_TIMES * FIRST_SILENCE_S,
                    remedy="Check the link, then read them again.",
                )
            return await self._fill_gaps(waiter, table)

    async def _fill_gaps(self, waiter: Waiter, table: ParamTable) -> bool:
        empty_rounds = 0
        while not table.complete:
            if empty_rounds >= MAX_EMPTY_ROUNDS:
                raise NoReply(
                    f"Vehicle {self._vehicle.id} sent {table.filled} of {table.count} parameters, "
                    "then stopped sending.",
                    deadline_s=MAX_EMPTY_ROUNDS * GAP_TIMEOUT_S,
                    remedy="Check the link, then read them again.",
                )
            before = table.filled
            wanted_indexes = table.missing(AT_ONCE)
            for index in wanted_indexes:
                self._request(b"", index)
            if not await self._receive(
                waiter, table, GAP_TIMEOUT_S, GAP_TIMEOUT_S, frozenset(wanted_indexes)
            ):
                return False
            empty_rounds = 0 if table.filled > before else empty_rounds + 1
        return True

    async def _receive(
        self,
        waiter: Waiter,
        table: ParamTable,
        first_s: float,
        silence_s: float,
        wanted_indexes: frozenset[int] | None = None,
    ) -> bool:
        """Receives values until none arrive, or all wanted ones have arrived; False if the list changed."""
        timeout_s = first_s
        taken = known_in_a_row = 0
        left_indexes = set(wanted_indexes) if wanted_indexes is not None else None
        while not table.complete and (left_indexes is None or left_indexes):
            report = await self._next(waiter, timeout_s)
            if report is None:
                return True
            if report.count > MAX_PARAMETERS and report.index != NO_INDEX:
                raise self._given_up(
                    f"it reports {report.count:,} parameters; at most {MAX_PARAMETERS:,} are read"
                )
            before = table.filled
            if not table.put(report):
                return False
            known_in_a_row = 0 if table.filled > before else known_in_a_row + 1
            if known_in_a_row > MAX_REPEATED_VALUES:
                raise self._given_up("it repeats values endlessly")
            taken += 1
            if taken % YIELD_AFTER_VALUES == 0:
                await asyncio.sleep(0)
            if left_indexes is not None:
                left_indexes.discard(report.index)
            timeout_s = silence_s
            self._progress()
        return True

    async def _next(self, waiter: Waiter, timeout_s: float, name: str | None = None) -> ParamReport | None:
        try:
            async with asyncio.timeout(timeout_s):
                while True:
                    report = _report(await waiter.next())
                    if report is not None and (name is None or report.param.name == name):
                        return report
        except TimeoutError:
            return None

    def _given_up(self, reason: str) -> NoReply:
        return NoReply(
            f"The server stopped reading the parameters of vehicle {self._vehicle.id}: {reason}.",
            deadline_s=READ_TIMEOUT_S,
            remedy="Single parameters can still be read and set.",
        )

    def _values(self):  # noqa: ANN202 the mailbox's context manager
        vehicle = self._vehicle

        def matches(message: Reply) -> bool:
            identity = vehicle.identity
            return (message.get_srcSystem(), message.get_srcComponent()) == (
                identity.system_id,
                identity.component_id,
            )

        return vehicle.mailbox.expect(d.MAVLINK_MSG_ID_PARAM_VALUE, matches=matches)

    def _request(self, name: bytes, index: int) -> None:
        identity = self._vehicle.identity
        message = d.MAVLink_param_request_read_message(identity.system_id, identity.component_id, name, index)
        self._vehicle.send_payload(message.get_msgId(), encode_payload(message))


def _report(message: Reply) -> ParamReport | None:
    payload = bytes(message.get_payload() or b"")
    return read_report(payload.ljust(25, b"\0"))
