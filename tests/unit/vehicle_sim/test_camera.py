"""The camera: its identity, single pictures and series, the list of pictures, and the content of pictures."""

import io
import math

import numpy as np
import pytest
from PIL import Image

from tests.unit.vehicle_sim.sim_station import GCS_AND_API_LINKS, NAN, Station
from vehicle_sim.mavlink.framing import FrameParser
from vehicle_sim.payload.picture import HEIGHT, WIDTH, Painter
from vehicle_sim.world.terrain import Hill, Terrain
from vehicle_sim.world.world import Box, World

pytestmark = pytest.mark.flight

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
REQUEST_MESSAGE, START_CAPTURE, STOP_CAPTURE, REQUEST_CAPTURE = 512, 2000, 2001, 2002
FORMAT_STORAGE, RESET_SETTINGS, SET_MODE, SET_ZOOM = 526, 529, 530, 531
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture
def station():
    station = Station(camera=True, links=GCS_AND_API_LINKS)
    station.run(4.0)
    return station


def acks_of(station, number, *parameters):
    """The camera's acknowledgements of a command."""
    since_s = station.now_s
    values = {f"param{n + 1}": value for n, value in enumerate(parameters)}
    station.send("COMMAND_LONG", target_system=1, target_component=100, command=number, **values)
    station.run(0.06)
    acks = [m for m in station.received("COMMAND_ACK", since_s=since_s) if m.component_id == 100]
    return [m.result for m in acks if m.command == number]


def camera_messages(station, name, since_s=0.0, via="gcs"):
    return [m for m in station.received(name, via, since_s) if m.component_id == 100]


def test_by_default_there_is_no_camera():
    station = Station()
    station.run(3.0)
    assert acks_of(station, REQUEST_MESSAGE, 259) == []
    assert {m.component_id for _, _, m in station.log} == {1}


def test_the_camera_sends_heartbeats_and_its_information(station):
    heartbeats = camera_messages(station, "HEARTBEAT")
    assert len(heartbeats) in (4, 5)
    assert (heartbeats[0].type, heartbeats[0].autopilot) == (30, 8)
    for number in (259, 260, 261, 262, 271):
        assert acks_of(station, REQUEST_MESSAGE, number) == [ACCEPTED]
    info = camera_messages(station, "CAMERA_INFORMATION")[-1]
    assert bytes(info.model_name).rstrip(b"\0") == b"Simulated camera"
    assert (info.resolution_h, info.resolution_v) == (WIDTH, HEIGHT)
    assert info.flags & 0x102 == 2, "pictures, no stream"
    assert camera_messages(station, "STORAGE_INFORMATION")[-1].total_capacity == 32 * 1024
    assert camera_messages(station, "CAMERA_CAPTURE_STATUS")[-1].image_count == 0
    fov = camera_messages(station, "CAMERA_FOV_STATUS")[-1]
    assert (fov.hfov, fov.vfov) == (pytest.approx(60.0, abs=0.1), pytest.approx(46.8, abs=0.2))
    assert acks_of(station, REQUEST_MESSAGE, 269) == [DENIED], "no video stream"
    assert acks_of(station, 2500) == [UNSUPPORTED], "no video"


@pytest.mark.parametrize("opened_after_s", [0.1, 0.4, 0.7, 0.996])
def test_the_cameras_heartbeats_follow_the_vehicles_heartbeats_on_a_link_opened_at_any_time(opened_after_s):
    station = Station(camera=True)
    station.run(opened_after_s)
    station.sim.add_link(0, "tcp", "gcs")
    station.run(4.0)
    messages = FrameParser().feed(station.sim.drain(0, "tcp"))
    for heartbeats in ([m for m in messages if m.name == "HEARTBEAT"], station.received("HEARTBEAT")):
        senders = [m.component_id for m in heartbeats if m.system_id == 1]
        assert senders == [1, 100] * (len(senders) // 2)
        assert len(senders) >= 6


def test_a_picture_is_reported_and_stored_and_its_report_can_be_requested_again(station):
    since_s = station.now_s
    assert acks_of(station, START_CAPTURE, 0, 0, 1, 5) == [ACCEPTED]
    reported = camera_messages(station, "CAMERA_IMAGE_CAPTURED", since_s)
    assert [m.image_index for m in reported] == [0]
    assert camera_messages(station, "CAMERA_IMAGE_CAPTURED", since_s, via="api"), (
        "not reported on the other link"
    )
    assert acks_of(station, START_CAPTURE, 0, 0, 1, 5) == [ACCEPTED], "the repeated command was refused"
    assert len(camera_messages(station, "CAMERA_IMAGE_CAPTURED", since_s)) == 1, (
        "the repeated command took a second picture"
    )
    estimate = station.sim.autopilots[0].view.estimate
    assert reported[0].lat == pytest.approx(estimate.lat_deg * 1e7, abs=100)
    assert reported[0].capture_result == 1
    path = reported[0].file_url.removeprefix("mftp://[;comp=1]")
    files = station.sim.files[0]
    data = files.read(path, 0, files.size(path))
    picture = Image.open(io.BytesIO(data))
    assert picture.size == (WIDTH, HEIGHT)
    degrees, minutes, seconds = picture.getexif().get_ifd(0x8825)[2]  # GPS latitude
    assert float(degrees + minutes / 60 + seconds / 3600) == pytest.approx(estimate.lat_deg, abs=1e-4)
    for number, parameters in ((REQUEST_CAPTURE, (0,)), (REQUEST_MESSAGE, (263, 0))):
        since_s = station.now_s
        assert acks_of(station, number, *parameters) == [ACCEPTED]
        assert camera_messages(station, "CAMERA_IMAGE_CAPTURED", since_s)[0].values == reported[0].values
    assert acks_of(station, REQUEST_CAPTURE, 7) == [DENIED]


@pytest.mark.story
def test_a_series_has_its_interval_and_count_and_can_be_stopped(station):
    since_s = station.now_s
    assert acks_of(station, START_CAPTURE, 0, 1.0, 3) == [ACCEPTED]
    assert camera_messages(station, "CAMERA_CAPTURE_STATUS")[-1].image_status == 2
    assert acks_of(station, START_CAPTURE, 0, 0, 1) == [TEMPORARILY_REJECTED], "busy"
    station.run(5.0)
    reported = camera_messages(station, "CAMERA_IMAGE_CAPTURED", since_s)
    assert [m.image_index for m in reported] == [0, 1, 2]
    assert np.diff([m.time_boot_ms for m in reported]) == pytest.approx([1000, 1000], abs=5)
    assert camera_messages(station, "CAMERA_CAPTURE_STATUS")[-1].image_status == 0
    assert acks_of(station, START_CAPTURE, 0, 0.5, 0) == [ACCEPTED]
    station.run(1.2)
    assert acks_of(station, STOP_CAPTURE) == [ACCEPTED]
    picture_count = len(station.sim.nodes[0]._camera._camera.captures)
    station.run(2.0)
    assert len(station.sim.nodes[0]._camera._camera.captures) == picture_count >= 5
    assert acks_of(station, START_CAPTURE, 0, 0, 5) == [DENIED], "no interval"


def test_commands_for_mode_zoom_format_and_reset_are_executed(station):
    assert acks_of(station, SET_MODE, 0, 2) == [ACCEPTED]
    assert camera_messages(station, "CAMERA_SETTINGS")[-1].mode_id == 2
    assert acks_of(station, SET_MODE, 0, 1) == [UNSUPPORTED], "video"
    assert acks_of(station, SET_ZOOM, 2, 100) == [ACCEPTED]
    assert camera_messages(station, "CAMERA_SETTINGS")[-1].zoomLevel == 100.0
    assert acks_of(station, REQUEST_MESSAGE, 271) == [ACCEPTED]
    assert camera_messages(station, "CAMERA_FOV_STATUS")[-1].hfov == pytest.approx(16.4, abs=0.2)
    assert acks_of(station, SET_ZOOM, 2, 101) == [DENIED]
    assert acks_of(station, SET_ZOOM, 1, 1) == [UNSUPPORTED], "no motor zoom"
    acks_of(station, START_CAPTURE, 0, 0, 1)
    assert acks_of(station, FORMAT_STORAGE, 1, 1) == [ACCEPTED]
    assert station.sim.files[0].is_directory("camera") is False
    assert acks_of(station, REQUEST_MESSAGE, 262) == [ACCEPTED]
    assert camera_messages(station, "CAMERA_CAPTURE_STATUS")[-1].image_count == 0
    assert acks_of(station, RESET_SETTINGS, 1) == [ACCEPTED]
    assert camera_messages(station, "CAMERA_SETTINGS")[-1].zoomLevel == 0.0


@pytest.mark.story
def test_pictures_have_the_attitude_of_the_gimbal():
    station = Station(camera=True, sensor_noise=False)
    station.take_off_and_hover(15.0)
    station.command(1001, 255, 190)
    station.command(1000, -40, 0, NAN, NAN, 0)
    station.run(2.0)
    since_s = station.now_s
    acks_of(station, START_CAPTURE, 0, 0, 1)
    reported = camera_messages(station, "CAMERA_IMAGE_CAPTURED", since_s)[0]
    w, x, y, z = reported.q
    assert math.degrees(math.asin(2 * (w * y - z * x))) == pytest.approx(-40, abs=2)
    assert reported.relative_alt == pytest.approx(15_000, abs=1500)


def test_horizon_and_boxes_are_at_their_positions_in_a_level_picture():
    without_box = Painter(World()).draw(np.array([0, 0, -10.0]), LEVEL, math.radians(60))
    assert without_box.shape == (HEIGHT, WIDTH, 3)
    horizon_row = HEIGHT // 2
    assert without_box[: horizon_row - 2, :, 2].min() > without_box[horizon_row + 20 :, :, 2].max() - 60, (
        "the sky is not bluer than the grass"
    )
    box = World(boxes=(Box("box", 20.0, 0.0, 2.0, 4.0, 30.0),))
    with_box = Painter(box).draw(np.array([0, 0, -10.0]), LEVEL, math.radians(60))
    changed = (without_box.astype(int) != with_box.astype(int)).any(axis=2)
    columns = np.flatnonzero(changed[horizon_row])
    half_width_px = WIDTH / 2 / math.tan(math.radians(30)) * 2.0 / 19.0
    assert columns.min() == pytest.approx(WIDTH / 2 - half_width_px, abs=2)
    assert columns.max() == pytest.approx(WIDTH / 2 + half_width_px, abs=2)


def test_a_hill_hides_the_horizon():
    hill = World(terrain=Terrain((Hill(100, 0, 60, 40),)))
    flat = Painter(World()).draw(np.array([0, 0, -10.0]), LEVEL, math.radians(60))
    with_hill = Painter(hill).draw(np.array([0, 0, -10.0]), LEVEL, math.radians(60))
    sky_row = HEIGHT // 2 - 30
    assert (flat[sky_row, WIDTH // 2].astype(int) != with_hill[sky_row, WIDTH // 2].astype(int)).any()
    assert (flat[sky_row, 2] == with_hill[sky_row, 2]).all(), "the hill changed the sky beside it"
