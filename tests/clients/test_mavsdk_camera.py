"""MAVSDK's camera plug-in with the simulated camera on the gimbal (`--camera`)."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from mavsdk.camera import CameraError, CameraResult, Mode, PhotosRange
from mavsdk.ftp import FtpError, FtpResult

from tests.clients.mavsdk_drone import TIMEOUT_S, connected_drone, next_value, until

WIDTH_PX, HEIGHT_PX = 320, 240

pytestmark = pytest.mark.timeout(TIMEOUT_S + 20.0)


def test_pictures_are_taken_listed_downloaded_and_deleted(tmp_path: Path) -> None:
    asyncio.run(_photograph(tmp_path))


async def _photograph(folder: Path) -> None:
    async with asyncio.timeout(TIMEOUT_S), connected_drone(arguments=["--camera"]) as drone:
        camera = drone.camera
        listed = await until(camera.camera_list(), lambda found: found.cameras, "a camera", 40)
        (model,) = listed.cameras
        assert (model.vendor_name, model.model_name) == ("Simulated", "Simulated camera")
        assert (model.horizontal_resolution_px, model.vertical_resolution_px) == (WIDTH_PX, HEIGHT_PX)
        camera_id = model.component_id

        await camera.set_mode(camera_id, Mode.PHOTO)
        assert await camera.get_mode(camera_id) is Mode.PHOTO
        update = await until(
            camera.storage(), lambda storage: storage.component_id == camera_id, "the camera's storage", 20
        )
        assert update.storage.total_storage_mib == pytest.approx(32 * 1024)
        assert update.storage.storage_id == 1

        captures = _StreamCollector(camera.capture_info())
        await asyncio.sleep(0.5)
        await camera.take_photo(camera_id)
        await _wait_until(lambda: len(captures.values) == 1, "the first picture")
        picture = captures.values[0]
        home = await next_value(drone.telemetry.home())
        assert picture.is_success
        assert picture.position.latitude_deg == pytest.approx(home.latitude_deg, abs=2e-5)
        path = picture.file_url.removeprefix("mftp://[;comp=1]")
        async for _ in drone.ftp.download(path, str(folder), use_burst=False):
            pass
        assert (folder / Path(path).name).read_bytes()[:2] == b"\xff\xd8", "the picture is not a JPEG"

        await camera.start_photo_interval(camera_id, 1.0)
        await _wait_until(lambda: len(captures.values) >= 4, "a series of pictures")
        await camera.stop_photo_interval(camera_id)
        captures.task.cancel()
        photos = await camera.list_photos(camera_id, PhotosRange.ALL)
        assert [photo.index for photo in photos] == list(range(len(photos)))
        assert len(photos) >= 4

        await camera.zoom_range(camera_id, 50.0)
        await _assert_refused(camera.start_video(camera_id))
        await _assert_refused(camera.track_point(camera_id, 0.5, 0.5, 0.1))
        await camera.reset_settings(camera_id)
        await camera.format_storage(camera_id, 1)
        with pytest.raises(FtpError) as refused:
            await drone.ftp.list_directory(str(Path(path).parent))
        assert refused.value._result.result is FtpResult.Result.FILE_DOES_NOT_EXIST


class _StreamCollector:
    """Collects all values of a stream from now on."""

    def __init__(self, stream: AsyncIterator[Any]) -> None:
        self.values: list[Any] = []
        self.task = asyncio.ensure_future(self._listen(stream))

    async def _listen(self, stream: AsyncIterator[Any]) -> None:
        async for value in stream:
            self.values.append(value)


async def _wait_until(condition: Any, what: str, seconds: float = 20.0) -> None:
    try:
        async with asyncio.timeout(seconds):
            while not condition():  # noqa: ASYNC110 - the condition depends on a stream
                await asyncio.sleep(0.05)
    except TimeoutError:
        raise TimeoutError(f"no {what} within {seconds} s") from None


async def _assert_refused(request: Any) -> None:
    """Checks that the camera refuses this request."""
    with pytest.raises(CameraError) as refused:
        await request
    assert refused.value._result.result in (
        CameraResult.Result.ACTION_UNSUPPORTED, CameraResult.Result.DENIED, CameraResult.Result.ERROR,
        CameraResult.Result.PROTOCOL_UNSUPPORTED,
    )  # fmt: skip
