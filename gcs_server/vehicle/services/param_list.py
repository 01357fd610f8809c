"""Reads all parameters of a vehicle over a link that loses packets.

The list is requested once. When the vehicle stops sending, the missing parameters are requested by index, a
few at a time. Reading changes nothing on the vehicle.
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

LIST_ATTEMPTS = 4
FIRST_SILENCE_S, SILENCE_S = 2.0, 1.0
"""Time without a value after which the vehicle has stopped sending, before and after the first value [s]. On
a slow link, PX4 sends a value only every few tenths of a second."""
INDEXES_AT_ONCE = 10
"""Number of missing indexes that are requested at once."""
MISSING_TIMEOUT_S = 0.5
MAX_EMPTY_ROUNDS = 12
HASH_ATTEMPTS, HASH_EVERY_S = 4, 0.5
MAX_READINGS = 3
READ_TIMEOUT_S = 600.0
"""Maximum time for the whole list, on the slowest link [s]."""
MAX_REPEATED_VALUES = 5_000
"""Maximum number of known values in a row; after that, the vehicle counts as repeating itself endlessly."""
YIELD_AFTER_VALUES = 100
"""Number of values that are handled before the event loop does other work."""

ReportValue = Callable[[], None]


class ParamReader:
    """Reads the parameter list once."""

    def __init__(self, vehicle: VehiclePort, progress: ReportValue) -> None:
        self._vehicle = vehicle
        self._progress = progress

    async def hash(self) -> tuple[int, int] | None:
        """(checksum, number of parameters); None if the vehicle sends no checksum."""
        with self._expect_values() as waiter:
            for _ in range(HASH_ATTEMPTS):
                self._request(HASH_NAME.encode(), -1)
                report = await self._next(waiter, HASH_EVERY_S, HASH_NAME)
                if report is not None:
                    checksum = checksum_of(report.param)
                    return None if checksum is None else (checksum, report.count)
        return None

    async def read(self, table: Callable[[], ParamTable]) -> None:
        """Fills a new table; starts again with another table if the list's length changes during the reading.

        Args:
            table: returns an empty table.

        Raises:
            NoReply: the vehicle stopped sending, or its list is too long or never complete.
        """
        try:
            async with asyncio.timeout(READ_TIMEOUT_S):
                for _ in range(MAX_READINGS):
                    if await self._fill(table()):
                        return
        except TimeoutError:
            raise self._stopped_error(f"they were not complete within {READ_TIMEOUT_S:.0f} s") from None
        raise NoReply(
            f"The parameters of vehicle {self._vehicle.id} changed in number while they were read.",
            deadline_s=0.0,
            remedy="Wait until the vehicle's setup is finished, then read the parameters again.",
        )

    async def _fill(self, table: ParamTable) -> bool:
        with self._expect_values() as waiter:
            for _ in range(LIST_ATTEMPTS):
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
                    deadline_s=LIST_ATTEMPTS * FIRST_SILENCE_S,
                    remedy="Check the link, then read the parameters again.",
                )
            return await self._fill_missing(waiter, table)

    async def _fill_missing(self, waiter: Waiter, table: ParamTable) -> bool:
        empty_rounds = 0
        while not table.complete:
            if empty_rounds >= MAX_EMPTY_ROUNDS:
                raise NoReply(
                    f"Vehicle {self._vehicle.id} sent {table.received_count} of {table.count} parameters, "
                    "then stopped sending.",
                    deadline_s=MAX_EMPTY_ROUNDS * MISSING_TIMEOUT_S,
                    remedy="Check the link, then read the parameters again.",
                )
            count_before = table.received_count
            requested_indexes = table.missing(INDEXES_AT_ONCE)
            for index in requested_indexes:
                self._request(b"", index)
            if not await self._receive(
                waiter, table, MISSING_TIMEOUT_S, MISSING_TIMEOUT_S, frozenset(requested_indexes)
            ):
                return False
            empty_rounds = 0 if table.received_count > count_before else empty_rounds + 1
        return True

    async def _receive(
        self,
        waiter: Waiter,
        table: ParamTable,
        first_s: float,
        silence_s: float,
        requested_indexes: frozenset[int] | None = None,
    ) -> bool:
        """Receives values until no value arrives or all requested indexes have arrived; False if the list
        changed."""
        timeout_s = first_s
        value_count = known_in_a_row = 0
        missing_indexes = set(requested_indexes) if requested_indexes is not None else None
        while not table.complete and (missing_indexes is None or missing_indexes):
            report = await self._next(waiter, timeout_s)
            if report is None:
                return True
            if report.count > MAX_PARAMETERS and report.index != NO_INDEX:
                raise self._stopped_error(
                    f"it reports {report.count:,} parameters; at most {MAX_PARAMETERS:,} are read"
                )
            count_before = table.received_count
            if not table.put(report):
                return False
            known_in_a_row = 0 if table.received_count > count_before else known_in_a_row + 1
            if known_in_a_row > MAX_REPEATED_VALUES:
                raise self._stopped_error("it repeats values endlessly")
            value_count += 1
            if value_count % YIELD_AFTER_VALUES == 0:
                await asyncio.sleep(0)
            if missing_indexes is not None:
                missing_indexes.discard(report.index)
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

    def _stopped_error(self, reason: str) -> NoReply:
        return NoReply(
            f"The server stopped reading the parameters of vehicle {self._vehicle.id}: {reason}.",
            deadline_s=READ_TIMEOUT_S,
            remedy="Single parameters can still be read and set.",
        )

    def _expect_values(self):  # noqa: ANN202 the mailbox's context manager
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
