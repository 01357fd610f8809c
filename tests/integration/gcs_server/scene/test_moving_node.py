"""`MovingNode` queues the same messages as viser's own scene handles."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from viser import _messages
from zstandard import ZstdDecompressor

from gcs_server.scene.moving_node import MIN_MOVE_M, MovingNode
from tests.integration.gcs_server.scene.scene_server import open_stream
from tests.support.viser_camera import CAMERA_MESSAGE
from tests.unit.gcs_server.scene.scene_fakes import local_position

POINTS = np.array([[[0, 0, 0], [1, 2, 3]], [[1, 2, 3], [4, 5, 6]]], np.float32)
Q = (0.5, 0.5, 0.5, 0.5)


def node_and_queue() -> tuple[MovingNode, list[Any]]:
    queued: list[Any] = []
    connection = SimpleNamespace(queue_message=queued.append)
    return MovingNode(SimpleNamespace(client_id=7, _websock_connection=connection), "/a/b"), queued


def encode_as_viser(message: Any) -> tuple[Any, list[bytes]]:
    """A message and its arrays, encoded like viser's `_message_producer`."""
    buffers: list[memoryview] = []
    packed = msgspec.msgpack.encode(message.as_serializable_dict(buffers))
    return msgspec.msgpack.decode(packed), [bytes(buffer) for buffer in buffers]


def messages_in(data: bytes) -> list[dict[str, Any]]:
    size, compressed = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:16], "little")
    inner = ZstdDecompressor().decompress(data[16 : 16 + compressed], max_output_size=size)
    return msgspec.msgpack.decode(inner)["messages"]


CHANGES = {
    "position": (lambda n: n.place((1.0, 2.0, 3.0)), _messages.SetPositionMessage("/a/b", (1.0, 2.0, 3.0))),
    "orientation": (lambda n: n.turn(Q), _messages.SetOrientationMessage("/a/b", Q)),
    "scale": (
        lambda n: n.scale(1.0, 1.0, 4.5),
        _messages.SceneNodeUpdateMessage("/a/b", {"scale": (1.0, 1.0, 4.5)}),
    ),
    "array": (
        lambda n: n.set_property("points", POINTS),
        _messages.SceneNodeUpdateMessage("/a/b", {"points": POINTS}),
    ),
}
"""For each property: a function that changes it, and viser's message for the change."""


@pytest.mark.parametrize(("change", "viser_message"), CHANGES.values(), ids=CHANGES)
def test_a_change_is_encoded_as_viser_encodes_it(change, viser_message):
    node, queued = node_and_queue()
    change(node)
    (message,) = queued
    viser_message.owner = "7"
    assert encode_as_viser(message) == encode_as_viser(viser_message)
    assert message.redundancy_key() == viser_message.redundancy_key(), (
        "the messages do not replace each other in the queue"
    )


def test_visers_handles_queue_the_same_kinds_of_messages(scene_server):
    """This test fails if a new version of viser uses other messages."""
    server = scene_server.host._server
    sent_messages: list[Any] = []
    frame = server.scene.add_frame("/moving", show_axes=False)
    lines = server.scene.add_line_segments("/moving/lines", POINTS, (1, 2, 3))
    api = frame._impl.api
    real_interface, api._websock_interface = (
        api._websock_interface,
        SimpleNamespace(queue_message=sent_messages.append),
    )
    try:
        frame.position, frame.wxyz = (1.0, 2.0, 3.0), Q
        lines.scale, lines.points = (1.0, 1.0, 4.5), POINTS + 1
    finally:
        api._websock_interface = real_interface
        frame.remove()
    kinds = [type(viser_message) for _, viser_message in CHANGES.values()]
    assert [type(message) for message in sent_messages] == kinds
    assert [list(m.updates) for m in sent_messages if isinstance(m, _messages.SceneNodeUpdateMessage)] == [
        ["scale"],
        ["points"],
    ]
    assert sent_messages[-1].updates["points"].dtype == POINTS.dtype


def test_a_browser_gets_a_vehicles_final_position(scene_server, monkeypatch):
    vehicle = scene_server.fleet.vehicles[0]
    client_ids: set[str] = set()

    async def wait_for_height(stream, height_m: float) -> None:
        async for data in stream:
            for message in messages_in(data):
                if message["type"] == "SetPositionMessage" and message["name"].endswith("/place"):
                    client_ids.add(message["owner"])
                    if message["position"][2] == pytest.approx(height_m, abs=0.01):
                        return

    async def run():
        async with asyncio.timeout(20), open_stream(scene_server, f"?vehicle={vehicle.id}") as stream:
            await stream.send(msgspec.msgpack.encode(CAMERA_MESSAGE))
            for height_m in (12.0, 9.0):
                monkeypatch.setitem(vehicle.values, "local_position", local_position(0.0, 0.0, -height_m))
                await wait_for_height(stream, height_m)
            assert client_ids == set(map(str, scene_server.host.clients())), "the owner is not this browser"

    asyncio.run(run())


def test_unchanged_values_are_not_sent_and_a_slow_drift_is_sent_in_steps():
    node, queued = node_and_queue()
    node.place((0.0, 0.0, 0.0))
    node.turn((1.0, 0.0, 0.0, 0.0))
    assert queued == []
    for step in range(1, 11):
        node.place((step * MIN_MOVE_M * 0.3, 0.0, 0.0))
    assert len(queued) == 2, "a slow drift is not sent each time that it exceeds MIN_MOVE_M"


def test_numpy_numbers_are_encoded():
    node, queued = node_and_queue()
    node.place(tuple(np.array([1.0, 2.0, 3.0])))
    node.scale(*np.array([1.0, 1.0, 3.0]))
    assert [encode_as_viser(message)[0]["name"] for message in queued] == ["/a/b", "/a/b"]
