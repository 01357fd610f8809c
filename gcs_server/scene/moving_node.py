"""Moves the nodes of one browser's scene without viser's handles, which are slow.

A handle of viser compares values with NumPy, casts them by type hints, and serializes each message by its
annotations. For the values that change at each step, this would cost more than the rest of an open 3D view.
Therefore these values are put directly into viser's queue for the browser. They keep the order of messages
and use viser's own keys, so that a newer value replaces a value that has not been sent. Tests compare these
messages with the messages of viser's handles, for the pinned minor version.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from viser.infra import Message

from missions.frames import Quaternion, Vector3

MIN_MOVE_M = 2e-4
"""A smaller move is not sent, because it is not visible [m]."""
MIN_TURN = 2e-5
"""A smaller change of a quaternion's components is not sent."""
MIN_SCALING = 5e-3
"""A smaller change of a scale factor is not sent. Unscaled lines are one metre long, so for lines this is a
length [m]."""


class NodeChange(Message):
    """One value of one node, as viser writes it.

    Args:
        key: a message with the same key that has not been sent yet is replaced.
        fields: fields of the message; arrays are written as viser writes them.
    """

    include_in_scene_serialization = False

    def __init__(self, key: str, fields: dict[str, Any]) -> None:
        self._key = key
        self._fields = fields

    def redundancy_key(self) -> str:
        """Viser's key of the same change."""
        return self._key

    def entity_state_key(self) -> None:
        """Always None, because viser does not have to find these messages by node. Messages that wait when a
        node is removed are sent before the removal.
        """

    def as_serializable_dict(self, binary_buffers: list[memoryview] | None = None) -> dict[str, Any]:
        """The message, with its arrays in `binary_buffers`."""
        updates = self._fields.get("updates")
        if updates is None or binary_buffers is None:
            return self._fields
        return {**self._fields, "updates": {k: _extract_array(v, binary_buffers) for k, v in updates.items()}}


class MovingNode:
    """Sends pose and properties of a moving node without viser's handle. Do not set the same values through
    the handle as well.

    Args:
        name: name of the node.
        position_m: initial position of the node, in its parent's frame.
        q: initial rotation of the node.
    """

    __slots__ = ("_name", "_owner", "_position_m", "_q", "_queue", "_scale")

    def __init__(
        self,
        client: viser.ClientHandle,
        name: str,
        position_m: Vector3 = (0.0, 0.0, 0.0),
        q: Quaternion = (1.0, 0.0, 0.0, 0.0),
    ) -> None:
        self._name = name
        self._owner = str(client.client_id)
        self._queue = client._websock_connection.queue_message  # pyright: ignore[reportPrivateUsage]
        self._position_m, self._q = position_m, q
        self._scale: tuple[float, ...] = ()

    def place(self, position_m: Vector3) -> None:
        """Moves the node, in its parent's frame."""
        if _differs(position_m, self._position_m, MIN_MOVE_M):
            self._position_m = position_m
            self._send("SetPositionMessage", "position", position_m)

    def turn(self, q: Quaternion) -> None:
        """Turns the node, in its parent's frame."""
        if _differs(q, self._q, MIN_TURN):
            self._q = q
            self._send("SetOrientationMessage", "wxyz", q)

    def scale(self, x: float, y: float, z: float) -> None:
        """Scales the node along its axes."""
        scale = (x, y, z)
        if not self._scale or _differs(scale, self._scale, MIN_SCALING):
            self._scale = scale
            self.set_property("scale", tuple(map(float, scale)))

    def set_property(self, prop: str, value: tuple[float, ...] | NDArray[np.float32]) -> None:
        """Sends a property.

        Args:
            value: an array is sent later without a copy, so it must not be changed.
        """
        fields = {"name": self._name, "updates": {prop: value}, "owner": self._owner}
        fields["type"] = "SceneNodeUpdateMessage"
        self._queue(NodeChange(f"scene:{self._name}:update:{prop}", fields))

    def _send(self, message_type: str, field: str, value: tuple[float, ...]) -> None:
        # A float of NumPy cannot be encoded, and a value that cannot be encoded ends the browser's
        # connection.
        floats = tuple(map(float, value))
        fields = {"name": self._name, field: floats, "owner": self._owner, "type": message_type}
        self._queue(NodeChange(f"scene:{self._name}:update:{message_type}", fields))


def _differs(a: Sequence[float], b: Sequence[float], tolerance: float) -> bool:
    return a != b and any(abs(x - y) > tolerance for x, y in zip(a, b, strict=True))


def _extract_array(value: Any, binary_buffers: list[memoryview]) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    binary_buffers.append(np.ascontiguousarray(value).data)
    return {"__binary_index": len(binary_buffers) - 1, "dtype": value.dtype.str}
