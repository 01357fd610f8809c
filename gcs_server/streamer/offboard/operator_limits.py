"""The operator's limits of one vehicle: applied, stored, and restored once the vehicle is recognised."""

from __future__ import annotations

import time
from dataclasses import dataclass

from gcs_server.storage.records import Unreadable
from gcs_server.streamer.offboard.limit_store import LimitRecord, LimitStore, VehicleKey, key_of, limits_text
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.vehicle.identity import Identity
from gcs_server.vehicle.vehicle import Vehicle

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
