"""Stores the operator's limits of each vehicle in the data folder and restores them after a restart.

A vehicle is recognised by its autopilot's uid. All PX4 simulators report the same uid; a vehicle without a
unique uid is recognised by its MAVLink system id.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Annotated

from pydantic import Field

from gcs_server.storage.files import StoredTime, typed
from gcs_server.storage.records import MAX_RECORDS, Records, Unreadable
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.vehicle.identity import PX4_SITL_UID, Identity

log = logging.getLogger(__name__)

FORMAT = 1
MAX_NAME_LENGTH = 200
_SHARED_UID = f"{PX4_SITL_UID:016x}"


@dataclass(frozen=True, slots=True)
class VehicleKey:
    """Identifies a vehicle across restarts."""

    system_id: int
    uid: str | None
    """None: the vehicle has no unique uid."""

    @property
    def recognised_by(self) -> str:
        """How the vehicle is recognised: `uid` or `system_id`."""
        return "system_id" if self.uid is None else "uid"

    @property
    def name(self) -> str:
        """Name of the vehicle's record."""
        return f"system-{self.system_id}" if self.uid is None else f"uid-{self.uid}"


@dataclass(frozen=True, slots=True)
class LimitRecord:
    """Limits, the time at which they were set, and the client that set them."""

    limits: OperatorLimits
    set_unix_s: float
    set_by: str


@dataclass(frozen=True, slots=True)
class StoredLimits:
    """The content of a file, besides its format."""

    system_id: Annotated[int, Field(gt=0, lt=256)]
    uid: str | None
    set_unix_s: StoredTime
    set_by: Annotated[str, Field(max_length=MAX_NAME_LENGTH)]
    limits: dict[str, object]


def key_of(identity: Identity) -> VehicleKey | None:
    """The key of a vehicle; None for a recording, and until the vehicle has sent AUTOPILOT_VERSION."""
    if identity.replayed or identity.firmware is None:
        return None
    has_own_uid = identity.uid is not None and identity.uid != _SHARED_UID
    return VehicleKey(identity.system_id, identity.uid if has_own_uid else None)


class LimitStore:
    """Limits of all vehicles.

    Args:
        records: storage of the limits; None: limits are not stored.
        parse: parses limits from the body of `PUT …/offboard/limits`; raises ValueError.
    """

    def __init__(
        self,
        records: Records | None = None,
        parse: Callable[[Mapping[str, object]], OperatorLimits] = lambda _: OperatorLimits(),
    ) -> None:
        self._records = records
        self._parse = parse
        self._stored: dict[str, LimitRecord | Unreadable] = {}
        self._system_ids: dict[str, int] = {}
        """System id in each readable record, by the record's name."""
        self._folder_problem: str | None = None
        self._write_problems: dict[str, str] = {}

    async def load(self) -> None:
        """Reads the stored limits; unreadable records become warnings."""
        if self._records is None:
            return
        try:
            records = await asyncio.to_thread(self._records.read_all)
        except OSError as error:
            self._folder_problem = (
                f"The stored limits in {self._records.folder} cannot be read: {error.strerror or error}."
            )
            return
        for name, content in records.items():
            self._stored[name] = content if isinstance(content, Unreadable) else self._record(name, content)

    def find(self, key: VehicleKey) -> LimitRecord | Unreadable | None:
        """The stored record of a vehicle; None if there is no record."""
        record = self._stored.get(key.name)
        if isinstance(record, Unreadable):
            return Unreadable(f"The file {self._file(key.name)} cannot be read: {record}.")
        if record is None and self._folder_problem is not None:
            return Unreadable(self._folder_problem)
        return record

    def may_have_record(self, system_id: int) -> bool:
        """Whether a record may exist for a vehicle with this system id, before its uid is known."""
        unreadable = [name for name in self._stored if name not in self._system_ids]
        return bool(self._folder_problem or unreadable) or system_id in self._system_ids.values()

    async def save(self, key: VehicleKey, record: LimitRecord) -> str | None:
        """Stores a record; returns None once it is on disk, or the reason for a failure."""
        if self._records is None:
            return "This server has no data folder."
        is_empty = record.limits == OperatorLimits()
        if not is_empty and key.name not in self._stored and len(self._stored) >= MAX_RECORDS:
            return f"Limits of {MAX_RECORDS} vehicles are already stored."
        content = None if is_empty else _content(key, record)
        future = self._records.write(key.name, content)
        try:
            await asyncio.shield(asyncio.wrap_future(future))
        except OSError as error:
            problem = f"The file {self._file(key.name)} cannot be written: {error.strerror or error}."
            self._write_problems[key.name] = problem
            log.warning(problem)
            return problem
        self._write_problems.pop(key.name, None)
        self._system_ids[key.name] = key.system_id
        if is_empty:
            self._stored.pop(key.name, None)
        else:
            self._stored[key.name] = record
        return None

    def warnings(self) -> list[str]:
        """Messages about records that cannot be read or written."""
        texts = [
            f"Limits of a vehicle cannot be restored: the file {self._file(name)} cannot be read: {record}. "
            "Set them again; that replaces the file."
            for name, record in self._stored.items()
            if isinstance(record, Unreadable)
        ]
        if self._folder_problem is not None:
            texts.append(
                f"{self._folder_problem} Limits could not be restored for any vehicle: set them again."
            )
        texts += [
            f"{problem} These limits are lost when the server restarts."
            for problem in self._write_problems.values()
        ]
        return texts

    def close(self) -> None:
        """Waits for pending writes."""
        if self._records is not None:
            self._records.close()

    def _file(self, name: str) -> str:
        return "" if self._records is None else str(self._records.folder / f"{name}.json")

    def _record(self, name: str, content: Mapping[str, object]) -> LimitRecord | Unreadable:
        try:
            key, record = _read(content, self._parse)
        except (ValueError, TypeError, KeyError) as error:
            first_line = (str(error).splitlines() or [type(error).__name__])[0]
            return Unreadable(f"it does not contain limits ({first_line})")
        if key.name != name:
            return Unreadable(f"it contains the limits of another vehicle ({key.name})")
        self._system_ids[name] = key.system_id
        return record


def _content(key: VehicleKey, record: LimitRecord) -> dict[str, object]:
    defaults = asdict(OperatorLimits())
    limits = {name: value for name, value in asdict(record.limits).items() if value != defaults[name]}
    return {
        "format": FORMAT,
        "system_id": key.system_id,
        "uid": key.uid,
        "set_unix_s": record.set_unix_s,
        "set_by": record.set_by[:MAX_NAME_LENGTH],
        "limits": limits,
    }


def _read(
    content: Mapping[str, object], parse: Callable[[Mapping[str, object]], OperatorLimits]
) -> tuple[VehicleKey, LimitRecord]:
    if content.get("format") != FORMAT:
        raise ValueError(f"format {content.get('format')!r} is not known")
    stored = typed(StoredLimits, {name: value for name, value in content.items() if name != "format"})
    record = LimitRecord(parse(stored.limits), stored.set_unix_s, stored.set_by)
    return VehicleKey(stored.system_id, stored.uid), record


def limits_text(limits: OperatorLimits) -> str:
    """The limits as text: `speed_max_m_s 5, fence polygon`."""
    settings = [
        f"{field.name} {value:g}"
        for field in fields(limits)
        if isinstance(value := getattr(limits, field.name), float | int) and not isinstance(value, bool)
    ]
    if not limits.obstacle_brake:
        settings.append("obstacle brake off")
    if limits.fence is not None:
        settings.append(f"fence {limits.fence.kind}")
    return ", ".join(settings) or "none"
