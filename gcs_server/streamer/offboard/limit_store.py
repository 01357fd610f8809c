"""The operator's limits of each vehicle: applied, stored in the data folder, and restored after a restart
once the vehicle is recognised.

A vehicle is recognised by its autopilot's uid. All PX4 simulators report the same uid; a vehicle without a
unique uid is recognised by its MAVLink system id.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Annotated

from pydantic import Field

from gcs_server.storage.files import StoredTime, typed
from gcs_server.storage.records import MAX_RECORDS, Records, Unreadable
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.vehicle.identity import PX4_SITL_UID, Identity
from gcs_server.vehicle.vehicle import Vehicle

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


NOTICE, WARNING = 5, 4
RECOGNITION_TIMEOUT_S = 2.0
CHECK_PERIOD_S = 0.05
SET_LIMITS_AGAIN = "Set the limits again before you fly."


@dataclass(frozen=True, slots=True)
class LimitsOrigin:
    """Origin of the operator's limits, and whether limits from before a restart were restored."""

    active: bool
    """Whether the operator has set limits."""
    restored: bool
    """Whether the limits were set before the server's last start and restored from its data folder."""
    set_by: str | None
    """Client that set the limits; null: no limits were ever set."""
    set_unix_s: float | None
    """Time when the limits were set [s since 1970 UTC]."""
    kept: bool
    """Whether the limits are stored in the data folder, so that they are restored after a restart."""
    recognised_by: str | None
    """How a restarted server recognises the vehicle: `uid` (of the autopilot), `system_id` (no unique uid);
    null: the vehicle is not identified yet."""
    warning: str | None
    """Why the set limits are not in force or would be lost in a restart; null if there is no problem."""
    text: str
    """Summary in a sentence."""


class VehicleOperatorLimits:
    """The operator's limits of one vehicle.

    Args:
        vehicle: the vehicle.
        store: the stored limits of all vehicles.
        owners: id of the vehicle that uses each record, by the record's name. All vehicles share this
            dictionary, because two vehicles without a unique uid cannot use the same record.
    """

    def __init__(self, vehicle: Vehicle, store: LimitStore, owners: dict[str, str]) -> None:
        self._vehicle = vehicle
        self._store = store
        self._owners = owners
        self._last_identity: Identity | None = None
        self._key: VehicleKey | None = None
        self._record: LimitRecord | None = None
        self._restored = False
        self._reason_not_restored: str | None = None
        self._reason_not_stored: str | None = None

    @property
    def limits(self) -> OperatorLimits:
        """The limits in force."""
        return OperatorLimits() if self._record is None else self._record.limits

    async def set(self, limits: OperatorLimits, by: str) -> None:
        """Applies limits immediately. Returns once the limits are stored, or once `origin` contains the
        reason why they are not stored."""
        self.recognise()
        record = LimitRecord(limits, self._vehicle.clock.unix_s(), by)
        self._record, self._restored, self._reason_not_restored = record, False, None
        await self._store_record(record)

    @property
    def identity_changed(self) -> bool:
        """Whether the vehicle's identity has changed since `recognise` was called."""
        return self._vehicle.identity is not self._last_identity

    def recognise(self) -> None:
        """Restores stored limits once the vehicle is identified; no effect if the identity is unchanged."""
        if not self.identity_changed:
            return
        identity = self._last_identity = self._vehicle.identity
        key = key_of(identity)
        if key is None or key == self._key:
            return
        if self._owners.setdefault(key.name, self._vehicle.id) != self._vehicle.id:
            self._reason_not_stored = (
                f"Vehicle {self._owners[key.name]} has the same system id and neither has a unique uid: "
                "limits of this vehicle are not stored."
            )
            return
        previous_key, self._key = self._key, key
        # the client set limits before the vehicle was identified, so they are newer than the stored limits
        if previous_key is None and self._record is not None:
            record = self._record
            self._vehicle.in_background("keep limits", self._store_record(record))
            return
        if previous_key is not None:
            self._publish(
                "limits_other_vehicle", "Another vehicle now uses this id; its limits are loaded.", WARNING
            )
        self._restore(key)

    async def wait_for_identity(self) -> None:
        """Waits briefly for the identity of a vehicle that may have stored limits; called before a stream
        starts."""
        clock, identity = self._vehicle.clock, self._vehicle.identity
        until_s = clock.monotonic_s() + RECOGNITION_TIMEOUT_S
        if (
            identity.replayed
            or self._record is not None
            or not self._store.may_have_record(identity.system_id)
        ):
            return
        while self._vehicle.identity.firmware is None and clock.monotonic_s() < until_s:
            await clock.sleep(CHECK_PERIOD_S)
        self.recognise()

    def report_at_start(self) -> None:
        """Reports restored and missing limits; called when a stream starts."""
        origin = self.origin()
        if origin.warning is not None:
            self._publish("limits_warning", origin.text, WARNING)
        elif origin.active and origin.restored:
            self._publish("limits_restored", origin.text, NOTICE)

    def origin(self) -> LimitsOrigin:
        """Origin of the limits, for status and responses."""
        record = self._record
        warning = self._reason_not_restored or (self._reason_not_stored if record is not None else None)
        if record is None and self._key is None and warning is None:
            identity = self._vehicle.identity
            unknown = not identity.replayed and identity.firmware is None
            if unknown and self._store.may_have_record(identity.system_id):
                warning = (
                    "The vehicle has not sent its identity (AUTOPILOT_VERSION), so its stored limits "
                    f"could not be found. {SET_LIMITS_AGAIN}"
                )
        active = record is not None and record.limits != OperatorLimits()
        is_stored = active and self._key is not None and self._reason_not_stored is None
        return LimitsOrigin(
            active=active,
            restored=self._restored,
            set_by=None if record is None else record.set_by,
            set_unix_s=None if record is None else record.set_unix_s,
            kept=is_stored,
            recognised_by=None if self._key is None else self._key.recognised_by,
            warning=warning,
            text=self._text(active, warning),
        )

    # --- inside -------------------------------------------------------------------------------------

    def _restore(self, key: VehicleKey) -> None:
        stored = self._store.find(key)
        self._record, self._restored = None, False
        self._reason_not_restored = self._reason_not_stored = None
        if isinstance(stored, Unreadable):
            self._reason_not_restored = (
                f"Stored limits of this vehicle are not in force. {stored} {SET_LIMITS_AGAIN}"
            )
            self._publish("limits_warning", self._reason_not_restored, WARNING)
        elif stored is not None:
            self._record, self._restored = stored, True
            self._publish("limits_restored", self.origin().text, NOTICE)

    async def _store_record(self, record: LimitRecord) -> None:
        if self._vehicle.identity.replayed:
            self._reason_not_stored = "Limits of a recording are not stored."
            return
        if self._key is None:
            reason = self._reason_not_stored
            self._reason_not_stored = reason or "They are stored once the vehicle is identified."
            return
        problem = await self._store.save(self._key, record)
        if self._record is record:
            self._reason_not_stored = (
                None if problem is None else f"{problem} These limits are lost when the server restarts."
            )

    def _text(self, active: bool, warning: str | None) -> str:
        record = self._record
        if not active or record is None:
            return warning or "No limits set here; the vehicle's own limits apply."
        time_text = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(record.set_unix_s))
        restored_text = "restored after a restart, " if self._restored else ""
        client = record.set_by or "a client"
        text = f"Limits in force: {limits_text(record.limits)} ({restored_text}set by {client}, {time_text})."
        return text if warning is None else f"{text} {warning}"

    def _publish(self, code: str, text: str, severity: int) -> None:
        kind = "warning" if severity <= WARNING else "command"
        data = {"source": "offboard", "code": code}
        self._vehicle.events.add(kind, self._vehicle.clock.unix_s(), text, severity=severity, data=data)
