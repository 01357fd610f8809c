"""One parameter at a time, verified.

PX4 carries integers as their bits in the float field (MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE),
knows INT32 and FLOAT only, answers nothing for unknown names, and takes any value without a range.
"""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.errors import InvalidRequest, NoReply, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.services.port import VehiclePort

RESEND_S = 0.5
DEADLINE_S = 5.0
NAME_LENGTH = 16
INT32 = d.MAV_PARAM_TYPE_INT32
REAL32 = d.MAV_PARAM_TYPE_REAL32

_int32 = struct.Struct("<i")


@dataclass(frozen=True, slots=True)
class Param:
    """A parameter as the vehicle reports it."""

    name: str
    value: int | float
    is_integer: bool


class ParamService:
    """PX4's bytewise parameters."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._is_integer: dict[str, bool] = {}

    async def get(self, name: str) -> Param:
        """Reads one.

        Raises:
            NoReply: PX4 is silent about unknown names, too.
        """
        raw = _name(name)
        self._vehicle.require_commandable()
        identity = self._vehicle.identity
        request = d.MAVLink_param_request_read_message(identity.system_id, identity.component_id, raw, -1)
        return await self._exchange(name, request.id, encode_payload(request), lambda _: True)

    async def set(self, name: str, value: float) -> Param:
        """Writes one and returns what the vehicle then reports.

        Raises:
            Rejected: the vehicle reports another value than was set.
        """
        raw = _name(name)
        if not math.isfinite(value):
            raise InvalidRequest("value", f"value must be a number, not {value}.")
        self._vehicle.require_commandable()
        if name not in self._is_integer:
            await self.get(name)
        is_integer = self._is_integer[name]
        if is_integer and (value != int(value) or not -(2**31) <= value < 2**31):
            raise InvalidRequest("value", f"{name} is a whole number of 32 bits; {value!r} is not.")
        if not is_integer and abs(value) > 3.4e38:
            raise InvalidRequest("value", f"{value!r} does not fit {name} (32-bit float).")
        wanted = int(value) if is_integer else _as_float32(value)
        identity = self._vehicle.identity
        request = d.MAVLink_param_set_message(
            identity.system_id,
            identity.component_id,
            raw,
            0.0 if is_integer else value,
            INT32 if is_integer else REAL32,
        )
        payload = encode_payload(request)
        if is_integer:  # as bits: a float of Python's would change some patterns (signalling NaN)
            payload = _int32.pack(int(value)) + payload[_int32.size :]
        # an answer to an earlier read may still be on its way with the old value: only silence about
        # the new one, to the deadline, is a refusal
        seen: list[Param] = []

        def is_ours(param: Param) -> bool:
            seen.append(param)
            return param.value == wanted

        try:
            return await self._exchange(name, request.id, payload, is_ours)
        except NoReply:
            if not seen:
                raise
            raise Rejected(
                f"Vehicle {self._vehicle.id} keeps {name} at {seen[-1].value}, not {wanted}.",
                remedy="It may be limited by another parameter; see the vehicle's messages.",
            ) from None

    async def _exchange(self, name: str, msg_id: int, payload: bytes, good: Callable[[Param], bool]) -> Param:
        vehicle = self._vehicle
        deadline_s = vehicle.clock.monotonic_s() + DEADLINE_S
        with vehicle.mailbox.expect(d.MAVLINK_MSG_ID_PARAM_VALUE, matches=self._is_of(name)) as waiter:
            while (left_s := deadline_s - vehicle.clock.monotonic_s()) > 0:
                vehicle.send_payload(msg_id, payload)
                try:
                    async with asyncio.timeout(min(RESEND_S, left_s)):
                        while True:
                            param = read_param(await waiter.next())
                            self._is_integer[name] = param.is_integer
                            if good(param):
                                return param
                except TimeoutError:
                    continue
        raise NoReply(
            f"Vehicle {vehicle.id} did not answer about parameter {name} within {DEADLINE_S:g} s.",
            deadline_s=DEADLINE_S,
            remedy="Check the spelling: PX4 says nothing about names that it does not know.",
        )

    def _is_of(self, name: str) -> Callable[[Reply], bool]:
        identity = self._vehicle.identity

        def matches(message: Reply) -> bool:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            return message.param_id == name and sender == (identity.system_id, identity.component_id)

        return matches


def read_param(message: Reply) -> Param:
    """From a PARAM_VALUE."""
    is_integer = message.param_type != REAL32
    bits = bytes(message.get_payload() or b"")[: _int32.size].ljust(_int32.size, b"\0")
    return Param(message.param_id, _int32.unpack(bits)[0] if is_integer else message.param_value, is_integer)


def _name(name: str) -> bytes:
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
