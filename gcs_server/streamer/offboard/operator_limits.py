"""The operator's limits of one vehicle: in force, kept, restored once the vehicle is recognised, and told."""

from __future__ import annotations

import time
from dataclasses import dataclass

from gcs_server.storage.records import Unreadable
from gcs_server.streamer.offboard.limit_store import LimitRecord, LimitStore, VehicleKey, key_of, words_of
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.vehicle.identity import Identity
from gcs_server.vehicle.vehicle import Vehicle

NOTICE, WARNING = 5, 4
RECOGNISED_WITHIN_S = 2.0
LOOK_EVERY_S = 0.05
SET_AGAIN = "Set the limits again before you fly."


@dataclass(frozen=True, slots=True)
class LimitsOrigin:
    """Where the operator's limits come from, and what became of those set before a restart."""

    active: bool
    """Whether limits of the operator's are in force."""
    restored: bool
    """They were set before the server's last start and read back from its data folder."""
    set_by: str | None
    """The client that set them; null where none was ever set."""
    set_unix_s: float | None
    """When it did [s since 1970 UTC]."""
    kept: bool
    """They are in the data folder: a restart brings them back."""
    recognised_by: str | None
    """How a restarted server knows the vehicle: `uid` (its autopilot's), `system_id` (it has no uid of its
    own); null before it told its identity."""
    warning: str | None
    """Why limits that were set are not in force, or would be lost by a restart; null where all is well."""
    text: str
    """All of this in a sentence."""


class VehicleOperatorLimits:
    """Of one vehicle.

    Args:
        vehicle: whose.
        store: of all vehicles.
        owners: which vehicle has the record of a name, shared by all: twins without a uid cannot share one.
    """

    def __init__(self, vehicle: Vehicle, store: LimitStore, owners: dict[str, str]) -> None:
        self._vehicle = vehicle
        self._store = store
        self._owners = owners
        self._seen: Identity | None = None
        self._key: VehicleKey | None = None
        self._record: LimitRecord | None = None
        self._restored = False
        self._not_restored: str | None = None
        self._not_kept: str | None = None

    @property
    def limits(self) -> OperatorLimits:
        """Those in force."""
        return OperatorLimits() if self._record is None else self._record.limits

    async def set(self, limits: OperatorLimits, by: str) -> None:
        """In force at once; returns when they are kept, or `origin` says why they are not."""
        self.recognise()
        record = LimitRecord(limits, self._vehicle.clock.unix_s(), by)
        self._record, self._restored, self._not_restored = record, False, None
        await self._keep(record)

    def recognise(self) -> None:
        """With each beat: restores what was kept once the vehicle has told who it is."""
        identity = self._vehicle.identity
        if identity is self._seen:
            return
        self._seen = identity
        key = key_of(identity)
        if key is None or key == self._key:
            return
        if self._owners.setdefault(key.name, self._vehicle.id) != self._vehicle.id:
            self._not_kept = (
                f"Vehicle {self._owners[key.name]} has the same system id and neither has a uid of its own: "
                "limits of this one are not kept."
            )
            return
        before, self._key = self._key, key
        if before is None and self._record is not None:  # set before it told who it is: newer than any file
            record = self._record
            self._vehicle.in_background("keep limits", self._keep(record))
            return
        if before is not None:
            self._tell("limits_other_vehicle", "Another vehicle has come in its place.", WARNING)
        self._restore(key)

    async def recognised(self) -> None:
        """Before a stream begins: waits a moment for a vehicle of which something may be kept."""
        clock, identity = self._vehicle.clock, self._vehicle.identity
        until_s = clock.monotonic_s() + RECOGNISED_WITHIN_S
        if identity.replayed or self._record is not None or not self._store.may_know(identity.system_id):
            return
        while self._vehicle.identity.firmware is None and clock.monotonic_s() < until_s:
            await clock.sleep(LOOK_EVERY_S)
        self.recognise()

    def tell_at_start(self) -> None:
        """As a stream begins: restored limits and missing ones are never a surprise."""
        origin = self.origin()
        if origin.warning is not None:
            self._tell("limits_warning", origin.text, WARNING)
        elif origin.active and origin.restored:
            self._tell("limits_restored", origin.text, NOTICE)

    def origin(self) -> LimitsOrigin:
        """Where they come from, for status and answers."""
        record = self._record
        warning = self._not_restored or (self._not_kept if record is not None else None)
        if record is None and self._key is None and warning is None:
            identity = self._vehicle.identity
            unknown = not identity.replayed and identity.firmware is None
            if unknown and self._store.may_know(identity.system_id):
                warning = (
                    "The vehicle has not told its identity (AUTOPILOT_VERSION), so limits that were kept for "
                    f"it could not be found. {SET_AGAIN}"
                )
        active = record is not None and record.limits != OperatorLimits()
        kept = active and self._key is not None and self._not_kept is None
        return LimitsOrigin(
            active=active,
            restored=self._restored,
            set_by=None if record is None else record.set_by,
            set_unix_s=None if record is None else record.set_unix_s,
            kept=kept,
            recognised_by=None if self._key is None else self._key.by,
            warning=warning,
            text=self._text(active, warning),
        )

    # --- inside -------------------------------------------------------------------------------------

    def _restore(self, key: VehicleKey) -> None:
        found = self._store.find(key)
        self._record, self._restored = None, False
        self._not_restored = self._not_kept = None
        if isinstance(found, Unreadable):
            self._not_restored = f"Limits kept for this vehicle are not in force. {found} {SET_AGAIN}"
            self._tell("limits_warning", self._not_restored, WARNING)
        elif found is not None:
            self._record, self._restored = found, True
            self._tell("limits_restored", self.origin().text, NOTICE)

    async def _keep(self, record: LimitRecord) -> None:
        if self._vehicle.identity.replayed:
            self._not_kept = "A recording's limits are not kept."
            return
        if self._key is None:
            twin = self._not_kept
            self._not_kept = twin or "They are kept once the vehicle has told its identity."
            return
        problem = await self._store.keep(self._key, record)
        if self._record is record:
            self._not_kept = None if problem is None else f"{problem} A restart forgets these limits."

    def _text(self, active: bool, warning: str | None) -> str:
        record = self._record
        if not active or record is None:
            return warning or "No limits set here; the vehicle's own limits apply."
        when = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(record.set_unix_s))
        how = "restored after a restart, " if self._restored else ""
        said = (
            f"Limits in force: {words_of(record.limits)} ({how}set by {record.set_by or 'a client'}, {when})."
        )
        return said if warning is None else f"{said} {warning}"

    def _tell(self, code: str, text: str, severity: int) -> None:
        kind = "warning" if severity <= WARNING else "command"
        data = {"source": "offboard", "code": code}
        self._vehicle.events.add(kind, self._vehicle.clock.unix_s(), text, severity=severity, data=data)
