"""Stores in the data folder how far each vehicle has flown its plan, so that the flight can be resumed after
the vehicle or the server was restarted.

The server writes a flight's record during the flight: at each item, and when the flight is interrupted.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from gcs_server.storage.files import StoredTime, typed
from gcs_server.storage.records import MAX_RECORDS, Records, Unreadable
from gcs_server.streamer.offboard.limit_store import VehicleKey
from missions.values import HomePosition

log = logging.getLogger(__name__)

FORMAT = 1
MAX_TEXT, MAX_ITEM = 300, 100_000


@dataclass(frozen=True, slots=True)
class FlightProgress:
    """How far a vehicle has flown its plan."""

    mission_id: Annotated[int, Field(ge=0, lt=2**32)]
    """The vehicle's checksum of the mission."""
    name: Annotated[str, Field(max_length=MAX_TEXT)] | None
    """Name of the stored plan."""
    item: Annotated[int, Field(ge=0, le=MAX_ITEM)]
    """Index of the item to which the vehicle was flying."""
    leg_start: Annotated[int, Field(ge=0, le=MAX_ITEM)]
    """Index of the item at which that leg begins."""
    finished: bool
    """Whether the vehicle has flown the plan to its end."""
    unix_s: StoredTime
    """Time at which the flight was interrupted, or at which this leg began [s since 1970]."""
    home: HomePosition | None
    """Where the flight took off."""


class ProgressStore:
    """The newest progress of each vehicle.

    Args:
        records: storage; None: nothing is stored for the next start of the server.
    """

    def __init__(self, records: Records | None = None) -> None:
        self._records = records
        self._stored: dict[str, FlightProgress] = {}
        self._problems: dict[str, str] = {}

    async def load(self) -> None:
        """Reads the records; unreadable records become warnings."""
        if self._records is None:
            return
        try:
            records = await asyncio.to_thread(self._records.read_all)
        except OSError as error:
            folder, reason = self._records.folder, error.strerror or error
            self._add_problem(
                "", f"The folder {folder} cannot be read: {reason}. Interrupted flights cannot be resumed."
            )
            return
        for name, content in records.items():
            try:
                if isinstance(content, Unreadable):
                    raise ValueError(content)
                self._stored[name] = _progress_of(content)
            except (ValueError, TypeError, KeyError) as error:
                reason = (str(error).splitlines() or [type(error).__name__])[0]
                self._add_problem(
                    name,
                    f"The file {self._file(name)} cannot be read: {reason}. Its flight cannot be resumed.",
                )

    def find(self, key: VehicleKey) -> FlightProgress | None:
        """The progress of a vehicle's newest flight; None: not known."""
        return self._stored.get(key.name)

    def save(self, key: VehicleKey, progress: FlightProgress) -> None:
        """Replaces the progress of a vehicle; a thread writes the record."""
        if self._stored.get(key.name) == progress:
            return
        if key.name not in self._stored and len(self._stored) >= MAX_RECORDS:
            self._forget_oldest()
        self._stored[key.name] = progress
        if self._records is not None:
            future = self._records.write(key.name, {"format": FORMAT, **_record_of(progress)})
            future.add_done_callback(lambda done: self._on_written(key.name, done))

    def warnings(self) -> list[str]:
        """Messages about records that cannot be read or written."""
        return list(self._problems.values())

    def close(self) -> None:
        """Waits for pending writes."""
        if self._records is not None:
            self._records.close()

    def _forget_oldest(self) -> None:
        oldest = min(self._stored, key=lambda name: self._stored[name].unix_s)
        del self._stored[oldest]
        if self._records is not None:
            self._records.write(oldest, None)

    def _on_written(self, name: str, done: Future[None]) -> None:
        """Updates the warnings after a write; called in the writing thread."""
        error = done.exception()
        if error is None:
            self._problems.pop(name, None)
        elif name not in self._problems:
            reason = (error.strerror if isinstance(error, OSError) else None) or error
            self._add_problem(
                name,
                f"The file {self._file(name)} cannot be written: {reason}. After a restart of the server, "
                "its flight cannot be resumed.",
            )

    def _add_problem(self, name: str, text: str) -> None:
        self._problems[name] = text
        log.warning(text)

    def _file(self, name: str) -> str:
        return "" if self._records is None else str(self._records.folder / f"{name}.json")


def _record_of(progress: FlightProgress) -> dict[str, object]:
    home = None if progress.home is None else progress.home.model_dump()
    name = None if progress.name is None else progress.name[:MAX_TEXT]
    values = {field: getattr(progress, field) for field in FlightProgress.__slots__}
    return {**values, "name": name, "home": home}


def _progress_of(content: Mapping[str, Any]) -> FlightProgress:
    if content.get("format") != FORMAT:
        raise ValueError(f"format {content.get('format')!r} is not known")
    return typed(FlightProgress, {name: value for name, value in content.items() if name != "format"})
