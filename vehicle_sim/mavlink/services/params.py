"""The parameter protocol as PX4 speaks it: values as bytes in a float, a hash first, no reply to nonsense."""

from __future__ import annotations

import struct
from collections import deque

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.parameters import ParameterValue

HASH_NAME = "_HASH_CHECK"
HASH_INDEX = 65535
UINT32, INT32, REAL32 = 5, 6, 9
"""MAV_PARAM_TYPE."""
BURST_PER_STEP = 5
"""With 250 steps a second this sends 930 values in 0.8 s."""


class ParamService:
    """PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._parameters = context.body.parameters
        self._lists: dict[str, deque[str]] = {}
        self._changed: list[str] = []
        self._parameters.add_listener(self._note)
        self.handlers = {
            "PARAM_REQUEST_LIST": self.request_list,
            "PARAM_REQUEST_READ": self.request_read,
            "PARAM_SET": self.set,
        }

    def request_list(self, link: Link, message: Message) -> None:
        """Send everything, paced by `step`."""
        if message.target_system == self._context.system_id and message.target_component in (0, 1):
            self._lists[link.name] = deque((HASH_NAME, *self._parameters.names))

    def request_read(self, link: Link, message: Message) -> None:
        """One value by name or index."""
        if not self._context.is_for_me(message):
            return
        name = (
            message.param_id if message.param_index == -1 else self._parameters.name_at(message.param_index)
        )
        if name:
            self._send(link, name)

    def set(self, link: Link, message: Message) -> None:
        """Store a value of the right type; the answer is the stored value, at once and again on all links."""
        name = message.param_id
        if not self._context.is_for_me(message) or name not in self._parameters:
            return
        integer = self._parameters.type_of(name) == "INT32"
        if message.param_type != (INT32 if integer else REAL32):
            return
        raw = struct.pack("<f", message.param_value)
        value: ParameterValue = struct.unpack("<i", raw)[0] if integer else message.param_value
        self._parameters.set(name, value)
        self._send(link, name)
        if name not in self._changed:
            self._changed.append(name)

    def _note(self, name: str, value: ParameterValue) -> None:
        del value
        why = self._context.body.simulation.reload_parameters(self._context.body.row)
        if why is not None:
            self._context.autopilot.announcer.text(4, f"{name} stored, not used: {why}"[:200])
        if name not in self._changed:
            self._changed.append(name)

    @property
    def busy(self) -> bool:
        """Whether anything is left to send."""
        return bool(self._changed or any(self._lists.values()))

    def step(self) -> None:
        """Send what is due: changed values to every link, and the next part of running lists."""
        if self._changed and self._context.body.simulation.steps % 3 == 0:
            names, self._changed = self._changed, []
            for name in names:
                for link in self._context.links:
                    self._send(link, name)
        for link in self._context.links:
            pending = self._lists.get(link.name)
            if not pending:
                continue
            for _ in range(min(BURST_PER_STEP, len(pending))):
                self._send(link, pending.popleft())

    def _send(self, link: Link, name: str) -> None:
        parameters = self._parameters
        if name == HASH_NAME:
            value = struct.unpack("<f", struct.pack("<I", parameters.hash()))[0]
            index, kind = HASH_INDEX, UINT32
        elif name in parameters:
            stored = parameters.get(name)
            integer = parameters.type_of(name) == "INT32"
            value = struct.unpack("<f", struct.pack("<i", int(stored)))[0] if integer else stored
            index, kind = parameters.index_of(name), INT32 if integer else REAL32
        else:
            return
        link.send(
            "PARAM_VALUE", param_id=name, param_value=value, param_type=kind, param_count=len(parameters),
            param_index=index,
        )  # fmt: skip
