"""What downloads of logs and of other files share: one at a time, because vehicles may share a link; paused
while the vehicle is armed or takes a plan; saved while they arrive; continued after a lost link; compared
with the vehicle's checksum."""

from __future__ import annotations

import asyncio
import errno
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from gcs_server.clock import Clock
from gcs_server.errors import Disconnected, GcsError, LogUnusable, NoReply, Refused
from gcs_server.logbook.partial_logs import PartialLog
from gcs_server.operations.operations import ReportProgress
from gcs_server.vehicle.vehicle import Vehicle

T = TypeVar("T")
SAVE_PERIOD_S = 1.0
MAX_UNSAVED = 200_000
"""Pieces in memory; with more, while the disk is still busy with earlier ones, the download ends."""
LOST_S = 600.0
"""A download waits so long for a lost vehicle, or one that does not answer [s]."""
RETRY_S = 2.0
CHECK_BYTES_S = 500_000
"""A vehicle's checksum of a log is awaited as long as reading it takes at this rate."""


class _Paused(Exception):
    """The link is needed for something else; the download continues afterwards."""


class Transfers:
    """The downloads of one server.

    Args:
        clock: the server's clock.
        vehicle: returns a vehicle by its id; raises UnknownVehicle.
    """

    def __init__(self, clock: Clock, vehicle: Callable[[str], Vehicle]) -> None:
        self._clock, self._vehicle = clock, vehicle
        self._turn = asyncio.Lock()
        self._saver = ThreadPoolExecutor(1, "logs")
        """Writes in the order of the calls, also when a download was cancelled."""

    async def until_done(
        self,
        vehicle_id: str,
        attempt: Callable[[], Awaitable[T]],
        arrived: Callable[[], int],
        report: ReportProgress,
    ) -> T:
        """Tries a download until it is done, and waits for a lost vehicle between.

        Args:
            vehicle_id: the vehicle.
            attempt: downloads what is missing.
            arrived: size of what has arrived [bytes]; blocks.
            report: reports progress.

        Raises:
            Disconnected, NoReply: the vehicle did not come back.
            GcsError: what the attempt raises besides.
        """
        progress_s, received = self._clock.monotonic_s(), 0
        while True:
            if await self._wait_until_free(vehicle_id, report):
                progress_s = self._clock.monotonic_s()
            if self._turn.locked():
                report("Waits for another download.", None)
            async with self._turn:
                try:
                    if self._in_the_way(vehicle_id) is None:
                        return await attempt()
                except (Disconnected, NoReply) as error:
                    now_s = self._clock.monotonic_s()
                    if (size := await asyncio.to_thread(arrived)) > received:
                        received, progress_s = size, now_s
                    if now_s - progress_s > LOST_S:
                        raise
                    report(f"Waits for the vehicle to continue. {error}", None)
                except (_Paused, Refused):
                    if self._in_the_way(vehicle_id) is None:
                        raise
                    continue
            await self._clock.sleep(RETRY_S)
            while self._vehicle(vehicle_id).link_lost and self._clock.monotonic_s() - progress_s <= LOST_S:
                await self._clock.sleep(RETRY_S)

    def _in_the_way(self, vehicle_id: str) -> str | None:
        """Why a vehicle's link is not for a download now; None: it is. A flight comes first."""
        vehicle = self._vehicle(vehicle_id)
        if vehicle.flight_state.armed:
            return (
                f"Paused while vehicle {vehicle_id} is armed, because a download takes its link's whole "
                "capacity; continues when it is disarmed."
            )
        if vehicle.mission.running_transfer is not None:
            return f"Paused while a plan is transferred to or from vehicle {vehicle_id}."
        return None

    async def _wait_until_free(self, vehicle_id: str, report: ReportProgress) -> bool:
        """Waits until nothing is in the way; returns whether it has waited."""
        has_waited = False
        while (reason := self._in_the_way(vehicle_id)) is not None:
            has_waited = True
            report(reason, None)
            await self._clock.sleep(RETRY_S)
        return has_waited

    async def receive(
        self,
        vehicle_id: str,
        partial: PartialLog,
        report: ReportProgress,
        read: Callable[[Callable[[int, int], None]], Awaitable[T]],
    ) -> T:
        """Reads what is missing, and saves it while it arrives.

        Args:
            vehicle_id: the vehicle.
            partial: gets it.
            report: reports size and rate.
            read: reads; called with a function for its progress.

        Raises:
            Refused: the disk is full.
            GcsError: what `read` raises.
        """
        clock, file = self._clock, partial.file
        began_s, before = clock.monotonic_s(), file.received
        saving, saved_s = self._saver.submit(partial.saver()), began_s

        def progress(received: int, size: int) -> None:
            nonlocal saving, saved_s
            if self._in_the_way(vehicle_id) is not None:
                raise _Paused
            now_s = clock.monotonic_s()
            if saving.done():
                saving.result()
                if now_s - saved_s >= SAVE_PERIOD_S:
                    saving, saved_s = self._saver.submit(partial.saver()), now_s
            elif partial.unsaved_count > MAX_UNSAVED:
                raise OSError(errno.EIO, "the disk is too slow")
            rate = (received - before) / max(now_s - began_s, 0.1)
            text = f"{received / 1e6:.1f} of {size / 1e6:.1f} MB received, {rate / 1e3:.0f} kB/s."
            report(text, received / size if size else 1.0)

        try:
            try:
                return await read(progress)
            finally:  # also of a cancelled download
                await asyncio.wrap_future(self._saver.submit(partial.saver()))
        except OSError as error:
            raise Refused(
                f"The server cannot write the file: {error.strerror or error}.",
                remedy="Make room on its disk, then try again.",
            ) from error

    async def verified(self, vehicle_id: str, path: str, partial: PartialLog) -> bool:
        """Compares the checksum; False: the vehicle computes none.

        Raises:
            LogUnusable: it differs; what arrived is deleted.
            Disconnected: the vehicle was lost.
        """
        wait_s = partial.file.size / CHECK_BYTES_S
        try:
            crc = await self._vehicle(vehicle_id).ftp.crc32(path, wait_s=wait_s)
        except Disconnected:
            raise
        except GcsError:
            return False
        if crc == await asyncio.to_thread(partial.crc32):
            return True
        await asyncio.to_thread(partial.discard)
        raise LogUnusable(
            f"What arrived of {path} differs from the vehicle's checksum; it was deleted.",
            remedy="Download it again.",
        )
