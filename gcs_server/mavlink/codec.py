"""Bytes to frames and back, without I/O and without message objects."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Frame:
    """One checked frame; `payload` still without the zeros that MAVLink 2 cuts off."""

    msg_id: int
    system_id: int
    component_id: int
    seq: int
    payload: bytes
    raw: bytes
    received_monotonic_s: float
    known: bool = True
    """False: not in the dialect, so its CRC could not be checked."""
