"""A setpoint preview in the 3D view: drawn, dragged by handles, and checked against invalid messages."""

from __future__ import annotations

import asyncio
import math

import httpx
import msgspec
import pytest

from gcs_server.scene.gizmo import GROUND_HANDLE, HEIGHT_HANDLE, MAX_DRAG_DISTANCE_M, Drag, apply_drag
from gcs_server.scene.preview_node import drag_label
from gcs_server.scene.proxy import parse_message
from gcs_server.scene.texts import altitude_text
from gcs_server.scene.views import HANDLES_DISTANCE_M, HANDLES_MAX_OFFSET_RAD, Preview, camera_for_handles
from missions.frames import q_from_yaw
from tests.integration.gcs_server.scene.scene_server import DRAG_MESSAGE, open_stream, wait_until
from tests.support.viser_camera import CAMERA_MESSAGE

pack = msgspec.msgpack.encode
DRAG_END_MESSAGE = {"type": "TransformControlsDragEndMessage", "name": GROUND_HANDLE, "owner": "client:1"}
PREVIEW = Preview((10.0, 0.0, -5.0), 0.0, handles=True, serial=1)


def test_a_drag_becomes_a_position_in_the_vehicles_local_frame():
    drag = Drag((3.0, 14.0, 7.0), q_from_yaw(0.0), changes_yaw=True)
    dragged = apply_drag(PREVIEW, drag, (1.0, 2.0, 0.0), (0.0, 0.0, 5.0))
    assert dragged.position_ned_m == pytest.approx((12.0, 2.0, -7.0))
    assert dragged.yaw_ned_rad == pytest.approx(math.pi / 2)  # the x axis is east
    assert dragged.serial == PREVIEW.serial


def test_the_height_handle_changes_no_yaw_and_an_unknown_yaw_stays_unknown():
    drag_up = Drag((0.0, 10.0, 9.0), q_from_yaw(1.0), changes_yaw=False)
    assert apply_drag(PREVIEW, drag_up, (0.0, 0.0, 0.0), (0.0, 0.0, 5.0)).yaw_ned_rad == 0.0
    without_yaw = Preview((0.0, 0.0, 0.0), None, handles=True, serial=1)
    drag_turn = Drag((0.0, 0.0, 0.0), q_from_yaw(1.0), changes_yaw=True)
    assert apply_drag(without_yaw, drag_turn, (0.0, 0.0, 0.0), (0.0, 0.0, 5.0)).yaw_ned_rad is None


def test_a_drag_beyond_the_limit_is_ignored():
    drag = Drag((MAX_DRAG_DISTANCE_M + 10, 0.0, 5.0), q_from_yaw(0.0), changes_yaw=True)
    assert apply_drag(PREVIEW, drag, (0.0, 0.0, 0.0), (0.0, 0.0, 5.0)) is None


def test_the_end_of_a_drag_keeps_the_preview():
    assert apply_drag(PREVIEW, Drag(None, None, changes_yaw=True), (0, 0, 0), (0, 0, 5)) is PREVIEW


def test_the_label_shows_distance_altitude_and_yaw():
    assert (
        drag_label(PREVIEW, 10.0, altitude_text(4.0, above_home=True))
        == "10.0 m away · 4.0 m above home · yaw 000°"
    )


EYE, VEHICLE = (-7.0, 0.0, 16.0), (0.0, 0.0, 10.0)


def test_visible_handles_do_not_move_the_camera():
    assert camera_for_handles(EYE, VEHICLE, (0.5, 0.5, 10.0), VEHICLE) == (EYE, VEHICLE)


@pytest.mark.parametrize(
    ("eye_m", "handles_m"),
    [
        pytest.param(EYE, (0.0, 9.0, 10.0), id="outside the picture"),
        pytest.param(EYE, (-20.0, 0.0, 10.0), id="behind the eye"),
        pytest.param((-2.0, 0.0, 11.2), VEHICLE, id="too near"),
        pytest.param((-9.0, 0.0, 10.5), VEHICLE, id="seen from the side: the handles' square is a line"),
        pytest.param((0.0, 0.0, 30.0), (5.0, 5.0, 10.0), id="straight from above"),
    ],
)
def test_the_camera_follows_moved_handles_from_the_same_side(eye_m, handles_m):
    eye, look_at = camera_for_handles(eye_m, VEHICLE, handles_m, VEHICLE)
    assert look_at == handles_m
    assert math.dist(eye, handles_m) >= HANDLES_DISTANCE_M - 1e-9
    assert eye[0] <= handles_m[0] + 1e-6  # looks to the east, as before
    assert eye[2] > handles_m[2] + 2.0
    # Vehicle and handles are both in the picture, so the camera does not move again.
    assert math.dist(eye, handles_m) > 1.5 * math.dist(handles_m, VEHICLE)
    assert camera_for_handles(eye, look_at, handles_m, VEHICLE) == (eye, look_at)
    moved_handles_m = tuple(
        h + 0.5 * HANDLES_MAX_OFFSET_RAD * math.dist(eye, handles_m) * (i == 1)
        for i, h in enumerate(handles_m)
    )
    assert camera_for_handles(eye, look_at, moved_handles_m, VEHICLE) == (eye, look_at)


@pytest.mark.parametrize("name", [GROUND_HANDLE, HEIGHT_HANDLE])
def test_drags_of_both_handles_are_accepted(name):
    moved = parse_message(pack({**DRAG_MESSAGE, "name": name}))
    assert moved == Drag((3.0, 4.0, 5.0), (1.0, 0.0, 0.0, 0.0), changes_yaw=name == GROUND_HANDLE)
    assert parse_message(pack({**DRAG_END_MESSAGE, "name": name})) == Drag(
        None, None, changes_yaw=name == GROUND_HANDLE
    )


@pytest.mark.parametrize(
    "message",
    [
        {**DRAG_MESSAGE, "name": "/world/vehicle_1"},
        {**DRAG_MESSAGE, "position": (math.nan, 0.0, 0.0)},
        {**DRAG_MESSAGE, "position": (math.inf, 0.0, 0.0)},
        {**DRAG_MESSAGE, "wxyz": (0.0, 0.0, 0.0, 0.0)},
        {**DRAG_MESSAGE, "position": (0.0, 0.0)},
        {**DRAG_MESSAGE, "more": 1},
        {**DRAG_END_MESSAGE, "name": 3},
        {**DRAG_MESSAGE, "type": "TransformControlsDragStartMessage"},
        {**DRAG_MESSAGE, "name": "x" * 5000},
    ],
)
def test_invalid_messages_and_messages_of_other_handles_are_dropped(message):
    assert parse_message(pack(message)) is None


def handle_count(scene_server) -> int:
    client = next(iter(scene_server.host.clients().values()))
    return len(client.scene._handle_from_transform_controls_name)


def test_a_dragged_preview_is_published_with_its_view(scene_server):
    """The drag is published only for its own view and only while the scene does not move with the vehicle;
    viser does not receive the message."""

    async def drag_ground_handle():
        async with httpx.AsyncClient() as http, open_stream(scene_server, "?view=hand&vehicle=2") as stream:
            await stream.send(pack(CAMERA_MESSAGE))
            await wait_until(lambda: scene_server.scene.viewers == 1)
            assert handle_count(scene_server) == 0
            preview = {"position_ned_m": [0, 0, -5], "yaw_ned_rad": 0, "handles": True}
            await http.post(scene_server.url + "view/hand", json={"preview": preview})
            await stream.send(pack(DRAG_MESSAGE))  # in chase mode the scene moves during the drag
            await http.post(scene_server.url + "view/hand", json={"mode": "free"})
            await wait_until(lambda: handle_count(scene_server) == 2)
            assert scene_server.gizmos == []
            await stream.send(pack(DRAG_MESSAGE))
            await stream.send(pack(DRAG_END_MESSAGE))
            await wait_until(lambda: len(scene_server.gizmos) == 2)
            await http.post(scene_server.url + "view/hand", json={"preview": None})
            await wait_until(lambda: handle_count(scene_server) == 0)
            await stream.send(pack(DRAG_MESSAGE))
            await stream.send(pack(CAMERA_MESSAGE))
            await asyncio.sleep(0.1)

    scene_server.gizmos.clear()
    asyncio.run(drag_ground_handle())
    moved, released = scene_server.gizmos
    assert (moved.view, moved.vehicle, moved.released, released.released) == ("hand", "2", False, True)
    assert moved.position_ned_m == released.position_ned_m
    assert moved.yaw_ned_rad == pytest.approx(math.pi / 2)


def test_selecting_another_vehicle_removes_the_preview(scene_server):
    preview = {"position_ned_m": [0, 0, -5]}
    httpx.post(scene_server.url + "view/other", json={"vehicle": "1", "preview": preview})
    assert scene_server.scene._views["other"].preview is not None
    httpx.post(scene_server.url + "view/other", json={"theme": "light"})
    assert scene_server.scene._views["other"].preview is not None
    httpx.post(scene_server.url + "view/other", json={"vehicle": "2"})
    assert scene_server.scene._views["other"].preview is None


@pytest.mark.parametrize(
    ("preview", "field"),
    [({"position_ned_m": [0, 0]}, "position_ned_m"), ({"position_ned_m": [0, 0, 1e9]}, "position_ned_m")],
)
def test_the_error_about_an_invalid_preview_names_its_field(scene_server, preview, field):
    response = httpx.post(scene_server.url + "view/hand", json={"preview": preview})
    assert response.status_code == 422
    assert field in response.text
