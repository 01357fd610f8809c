"""A vehicle's parameters: reads and sets single parameters with verification, and reads all parameters, with
a cache by the vehicle's checksum.

All parameters are read only on request. PX4's checksum (`_HASH_CHECK`) then shows whether the cached values
are still valid. The checksum excludes parameters that PX4 changes by itself (`volatile`), so the cached value
of such a parameter may be older.

PX4 sends integers as their bits in the float field (MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE),
has only INT32 and FLOAT, does not reply for unknown names (v1.17: PARAM_ERROR), and accepts any value without
a range check.
"""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from gcs_server.errors import GcsError, InvalidRequest, NoReply, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.param_metadata import MetadataByName, ParamMetadata
from gcs_server.vehicle.param_table import HASH_NAME, Param, ParamTable, read_report
from gcs_server.vehicle.services.metadata import MetadataService
from gcs_server.vehicle.services.param_list import ParamReader
from gcs_server.vehicle.services.port import VehiclePort

RESEND_S = 0.5
DEADLINE_S = 5.0
NAME_LENGTH = 16
INT32 = d.MAV_PARAM_TYPE_INT32
REAL32 = d.MAV_PARAM_TYPE_REAL32

PARAM_ERRORS = {
    d.MAV_PARAM_ERROR_DOES_NOT_EXIST: "it has no parameter of that name",
    d.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE: "the value is out of its range",
    d.MAV_PARAM_ERROR_PERMISSION_DENIED: "this station may not set it",
    d.MAV_PARAM_ERROR_COMPONENT_NOT_FOUND: "it has no such component",
    d.MAV_PARAM_ERROR_READ_ONLY: "it can only be read",
}
"""Texts for the errors of PARAM_ERROR, which PX4 sends from v1.17 on."""

_int32 = struct.Struct("<i")


ListState = Literal["unknown", "reading", "ready", "outdated", "failed"]


@dataclass(frozen=True, slots=True)
class ParamList:
    """State of the server's copy of the vehicle's parameters."""

    state: ListState
    """unknown (never read), reading, ready, outdated (the link was lost after reading), failed."""
    received: int
    """Number of parameters received."""
    count: int | None
    """Number of parameters on the vehicle; null if unknown."""
    source: Literal["vehicle", "cache"] | None
    """Source of the values; `cache`: unchanged according to the vehicle's checksum."""
    hash: str | None
    """The vehicle's checksum at the time of reading, hexadecimal."""
    read_unix_s: float | None
    """Time at which the values were last confirmed to be valid [s since 1970 UTC]."""
    problem: str | None
    """Why the parameters could not be read."""
    facts: bool
    """Whether the vehicle's metadata (unit, range, default) is available."""
    facts_problem: str | None
    """Why the metadata is not available, or which entries were omitted."""
    left_out: int
    """Number of entries with an invalid name, or beyond the server's limit."""


class ParamService:
    """Parameters of one vehicle, with PX4's bytewise encoding.

    Args:
        vehicle: the vehicle.
        metadata: metadata of the parameters; None: not available.
    """

    def __init__(self, vehicle: VehiclePort, metadata: MetadataService | None = None) -> None:
        self._vehicle = vehicle
        self._metadata = metadata
        self._is_integer: dict[str, bool] = {}
        self._table = ParamTable()
        self._metadata_by_name: MetadataByName | None = None
        self._reading = asyncio.Lock()
        self._state: ListState = "unknown"
        self._source: Literal["vehicle", "cache"] | None = None
        self._read_unix_s: float | None = None
        self._problem: str | None = None
        self._metadata_problem: str | None = None

    @property
    def list(self) -> ParamList:
        """State of the list."""
        table = self._table
        return ParamList(
            self._state,
            table.received_count,
            table.count,
            self._source,
            None if table.hash is None else f"{table.hash:08x}",
            self._read_unix_s,
            self._problem,
            self._metadata_by_name is not None,
            self._metadata_problem,
            table.omitted_count,
        )

    def all(self) -> list[Param]:
        """Known parameters by name."""
        return self._table.all()

    def known(self, name: str) -> Param | None:
        """Newest known value of a parameter; None: not read yet."""
        return self._table.get(name)

    def known_each(self, names: Iterable[str]) -> tuple[Param | None, ...]:
        """Newest known values of these parameters; None for each that was not read yet."""
        return self._table.get_each(names)

    def metadata_of(self, name: str) -> ParamMetadata | None:
        """Metadata of a parameter; None: no metadata."""
        return None if self._metadata_by_name is None else self._metadata_by_name.get(name)

    async def refresh(
        self, *, ignore_cache: bool = False, progress: Callable[[ParamList], None] = lambda _: None
    ) -> ParamList:
        """Reads all parameters, unless the known values are still valid; concurrent callers share one
        reading.

        Args:
            ignore_cache: reads the parameters even if the vehicle's checksum is unchanged.
            progress: called during the reading.

        Raises:
            NoReply: the vehicle did not send all parameters; the received parameters stay available.
        """
        if self._reading.locked():
            async with self._reading:
                return self.list
        async with self._reading:
            self._state, self._problem = "reading", None
            try:
                self._vehicle.require("parameters")
                await self._read_all(ignore_cache, lambda: progress(self.list))
            except GcsError as error:
                self._state, self._problem = "failed", str(error)
                raise
            except BaseException:
                self._state, self._problem = "failed", "The reading was interrupted."
                raise
            self._state, self._read_unix_s = "ready", self._vehicle.clock.unix_s()
            await self._fetch_metadata()
        return self.list

    def mark_reading(self) -> None:
        """Sets the state to reading."""
        self._state, self._problem = "reading", None

    async def describe(self) -> None:
        """Fetches missing metadata; does not raise if the vehicle has none."""
        if self._metadata_by_name is None:
            await self._fetch_metadata()

    async def _fetch_metadata(self) -> None:
        if self._metadata is None:
            return
        try:
            self._metadata_by_name = await self._metadata.parameters()
            self._metadata_problem = self._metadata_by_name.omission_text
        except GcsError as error:
            self._metadata_problem = str(error)

    async def _read_all(self, ignore_cache: bool, progress: Callable[[], None]) -> None:
        reader = ParamReader(self._vehicle, progress)
        hash_before = await reader.hash()
        if hash_before is not None and not ignore_cache:
            if self._table.complete and (self._table.hash, self._table.count) == hash_before:
                return
            cached = await self._from_cache(*hash_before)
            if cached is not None:
                self._table, self._source = cached, "cache"
                return

        def new_table() -> ParamTable:
            self._table = ParamTable()
            return self._table

        await reader.read(new_table)
        self._source = "vehicle"
        hash_after = await reader.hash() if hash_before is not None else None
        if hash_after is not None and self._table.complete:
            self._table.hash = hash_after[0]
            # if a value has changed meanwhile, the next reading requests all values again
            if hash_before == hash_after:
                await self._write_cache()

    async def _from_cache(self, expected_hash: int, count: int) -> ParamTable | None:
        metadata = self._metadata
        if metadata is None or metadata.cache is None:
            return None
        cache, name = metadata.cache, self._cache_name()

        def load() -> ParamTable | None:
            content = cache.read(name)
            return None if content is None else ParamTable.load(content, expected_hash, count)

        return await metadata.run_in_thread(load)

    async def _write_cache(self) -> None:
        metadata = self._metadata
        if metadata is None or metadata.cache is None:
            return
        cache, name, content = metadata.cache, self._cache_name(), self._table.dump()
        await metadata.run_in_thread(lambda: cache.write(name, content))

    def _cache_name(self) -> str:
        """Name of the cached file. It includes the vehicle, because another vehicle with the same checksum
        may differ in excluded parameters."""
        identity = self._vehicle.identity
        uid = "".join(c for c in identity.uid or "none" if c.isascii() and c.isalnum())[:40]
        return f"params-{uid}-{identity.system_id}.json"

    # --- called by the vehicle only -------------------------------------------------------------------

    def take_value(self, payload: bytes) -> None:
        """Handles PARAM_VALUE, also if another station has requested it."""
        report = read_report(payload)
        if report is None or report.param.name == HASH_NAME or self._state in ("unknown", "reading"):
            return  # during a reading, the reader handles the message
        if not self._table.put(report) and self._state == "ready":
            self._state = "outdated"  # the length of the list has changed, so the indexes have changed, too

    def link_restored(self) -> None:
        """Marks the list as outdated, because changes during the loss were not received."""
        if self._state == "ready":
            self._state = "outdated"

    # --- one parameter --------------------------------------------------------------------------------

    async def get(self, name: str) -> Param:
        """Reads one parameter.

        Raises:
            NoReply: no reply; PX4 also does not reply for unknown names.
        """
        raw = _checked_name(name)
        self._vehicle.require("parameters")
        identity = self._vehicle.identity
        request = d.MAVLink_param_request_read_message(identity.system_id, identity.component_id, raw, -1)
        return await self._exchange(name, request.id, encode_payload(request), lambda _: True)

    async def set(self, name: str, value: float, *, force: bool = False) -> Param:
        """Sets one parameter and returns the value that the vehicle reports afterwards.

        Args:
            name: the parameter.
            value: new value.
            force: skips the check against the metadata's range and choices.

        Raises:
            InvalidRequest: the value does not fit the parameter.
            Rejected: the vehicle reports another value.
        """
        raw = _checked_name(name)
        if not math.isfinite(value):
            raise InvalidRequest("value", f"value must be a number, not {value}.")
        self._vehicle.require("parameters")
        if name not in self._is_integer:
            await self.get(name)
        is_integer = self._is_integer[name]
        if is_integer and (value != int(value) or not -(2**31) <= value < 2**31):
            raise InvalidRequest("value", f"{name} is a 32-bit integer; {value!r} is not.")
        if not is_integer and abs(value) > 3.4e38:
            raise InvalidRequest("value", f"{value!r} does not fit {name} (32-bit float).")
        metadata = self.metadata_of(name)
        if metadata is not None and not force:
            metadata.check(value)
        new_value = int(value) if is_integer else _as_float32(value)
        identity = self._vehicle.identity
        request = d.MAVLink_param_set_message(
            identity.system_id,
            identity.component_id,
            raw,
            0.0 if is_integer else value,
            INT32 if is_integer else REAL32,
        )
        payload = encode_payload(request)
        # the value is sent as bits, because Python floats would change some patterns (signalling NaN)
        if is_integer:
            payload = _int32.pack(int(value)) + payload[_int32.size :]
        # A reply to an earlier request may still arrive with the old value. Therefore an old value means a
        # refusal only if the new value is not reported by the deadline.
        reported: list[Param] = []

        def is_new_value(param: Param) -> bool:
            reported.append(param)
            return param.value == new_value

        try:
            return await self._exchange(name, request.id, payload, is_new_value)
        except NoReply:
            if not reported:
                raise
            raise Rejected(
                f"Vehicle {self._vehicle.id} still has {name} = {reported[-1].value}, not {new_value}.",
                remedy="Another parameter may limit it; see the vehicle's messages.",
            ) from None

    async def _exchange(
        self, name: str, msg_id: int, payload: bytes, accepts: Callable[[Param], bool]
    ) -> Param:
        vehicle = self._vehicle
        deadline_s = vehicle.clock.monotonic_s() + DEADLINE_S
        ids = d.MAVLINK_MSG_ID_PARAM_VALUE, d.MAVLINK_MSG_ID_PARAM_ERROR
        with vehicle.mailbox.expect(*ids, matches=self._matches_parameter(name)) as waiter:
            while (left_s := deadline_s - vehicle.clock.monotonic_s()) > 0:
                vehicle.send_payload(msg_id, payload)
                try:
                    async with asyncio.timeout(min(RESEND_S, left_s)):
                        while True:
                            message = await waiter.next()
                            if message.get_msgId() == d.MAVLINK_MSG_ID_PARAM_ERROR:
                                raise self._refusal(name, message.error)
                            param = read_param(message)
                            if param is None:
                                continue
                            self._is_integer[name] = param.is_integer
                            if accepts(param):
                                return param
                except TimeoutError:
                    continue
        raise NoReply(
            f"Vehicle {vehicle.id} did not answer about parameter {name} within {DEADLINE_S:g} s.",
            deadline_s=DEADLINE_S,
            remedy="Check the spelling: PX4 does not answer for unknown names.",
        )

    def _refusal(self, name: str, error: int) -> Rejected:
        why = PARAM_ERRORS.get(error, f"error {error} (MAV_PARAM_ERROR)")
        return Rejected(
            f"Vehicle {self._vehicle.id} refuses parameter {name}: {why}.",
            remedy="Check name and value against the vehicle's parameter list.",
        )

    def _matches_parameter(self, name: str) -> Callable[[Reply], bool]:
        identity, own_ids = self._vehicle.identity, self._vehicle.own_ids

        def matches(message: Reply) -> bool:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            if message.param_id != name or sender != (identity.system_id, identity.component_id):
                return False
            is_error = message.get_msgId() == d.MAVLINK_MSG_ID_PARAM_ERROR
            return not is_error or (message.target_system, message.target_component) == own_ids

        return matches


def read_param(message: Reply) -> Param | None:
    """The parameter in a PARAM_VALUE; None for an unknown type."""
    report = read_report(bytes(message.get_payload() or b"").ljust(25, b"\0"))
    return None if report is None else report.param


def _checked_name(name: str) -> bytes:
    raw = name.encode("ascii", errors="replace")
    if (
        not 0 < len(raw) <= NAME_LENGTH
        or not all(c.isalnum() or c == "_" for c in name)
        or not name.isascii()
    ):
        raise InvalidRequest("name", f"{name!r} is not a parameter name (up to 16 of A–Z, 0–9, _).")
    return raw


def _as_float32(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]
