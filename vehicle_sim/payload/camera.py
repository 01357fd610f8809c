"""A camera on the gimbal: draws pictures, stores them in the vehicle's files, and lists the captures.

The camera is a separate component (id 100), as in PX4's other simulations. The recorded PX4 vehicle had
no camera, so this camera is optional.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from vehicle_sim.frames import Quaternion, euler_of, quaternion_of
from vehicle_sim.home import Home
from vehicle_sim.payload.gimbal import Gimbal
from vehicle_sim.payload.picture import HEIGHT, WIDTH, ExifPosition, Painter, jpeg
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.vehicle_view import VehicleView

FOLDER = "camera"
FOCAL_LENGTH_MM = 4.5
SENSOR_WIDTH_MM, SENSOR_HEIGHT_MM = 5.2, 3.9
"""Without zoom the field of view is 60 by 47 degrees."""
ZOOM_MAX = 4.0
CAPACITY_BYTES = 32 * 1024**3
MIN_INTERVAL_S = 0.5
MAX_PICTURES = 9999
CAMERA_ABOVE_VEHICLE_M = 0.15
"""Distance of the camera above the vehicle's position, which is at the landing gear."""


class CameraMode(IntEnum):
    """CAMERA_MODE; the camera records no video."""

    IMAGE = 0
    SURVEY = 2


@dataclass(frozen=True, slots=True)
class Capture:
    """One entry in the list of captures."""

    index: int
    """Index from 0."""
    time_boot_ms: int
    time_utc_us: int
    position: ExifPosition | None
    """None: the vehicle had no position estimate."""
    alt_home_m: float
    """Altitude above home; NaN: unknown."""
    q_ned_camera: Quaternion
    path: str
    """Path in the vehicle's files; empty if the picture could not be written."""


class Camera:
    """The camera of one vehicle.

    Args:
        view: the vehicle's state, for position and clock.
        gimbal: the gimbal that carries the camera.
        home: the home position, for altitudes above home.
        files: the vehicle's files, where the camera stores the pictures.
    """

    def __init__(self, view: VehicleView, gimbal: Gimbal, home: Home, files: VehicleFiles) -> None:
        self._view, self._gimbal, self._home, self._files = view, gimbal, home, files
        self._painter = Painter(view.simulation.world)
        self.mode = CameraMode.IMAGE
        self.zoom_percent = 0.0
        self.captures: list[Capture] = []
        self.used_bytes = 0
        self.interval_s = 0.0
        """Interval of the running image sequence; 0 for a single picture or without a sequence."""
        self._remaining_pictures = 0
        self._next_picture_at_s = math.inf

    # --- settings --------------------------------------------------------------------------------------

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view at the current zoom."""
        return 2.0 * math.atan(0.5 * SENSOR_WIDTH_MM / (FOCAL_LENGTH_MM * self.zoom))

    @property
    def vfov_rad(self) -> float:
        """Vertical field of view at the current zoom."""
        return 2.0 * math.atan(math.tan(0.5 * self.hfov_rad) * HEIGHT / WIDTH)

    @property
    def zoom(self) -> float:
        """Zoom factor, 1 to ZOOM_MAX."""
        return 1.0 + (ZOOM_MAX - 1.0) * self.zoom_percent / 100.0

    @property
    def free_bytes(self) -> int:
        """Free space of the camera's storage."""
        return max(0, CAPACITY_BYTES - self.used_bytes)

    def reset_settings(self) -> None:
        """Restores the initial settings."""
        self.mode, self.zoom_percent = CameraMode.IMAGE, 0.0

    def format_storage(self) -> None:
        """Deletes all pictures and the list of captures."""
        with contextlib.suppress(OSError):
            self._files.delete_tree(FOLDER)
        self.captures.clear()
        self.used_bytes = 0

    # --- pictures --------------------------------------------------------------------------------------

    @property
    def sequence_runs(self) -> bool:
        """Whether an image sequence is running."""
        return self._next_picture_at_s < math.inf

    def start(self, interval_s: float, count: int) -> None:
        """Starts an image sequence with a picture in the next step; with count 0 it runs until `stop`."""
        self.interval_s = 0.0 if count == 1 else max(MIN_INTERVAL_S, interval_s)
        self._remaining_pictures = count if count > 0 else MAX_PICTURES
        self._next_picture_at_s = self._view.time_s

    def stop(self) -> None:
        """Ends the image sequence."""
        self._next_picture_at_s, self.interval_s, self._remaining_pictures = math.inf, 0.0, 0

    def step(self) -> Capture | None:
        """Takes the picture that is due; None: no picture is due."""
        if self._view.time_s < self._next_picture_at_s - 1e-9:
            return None
        self._remaining_pictures -= 1
        self._next_picture_at_s += self.interval_s
        capture = self._take_picture()
        if self._remaining_pictures <= 0 or len(self.captures) >= MAX_PICTURES:
            self.stop()
        return capture

    def orientation(self) -> Quaternion:
        """Attitude of the camera relative to NED, from the vehicle's estimate."""
        if not self._gimbal.running:
            return self._view.estimate.q_ned_frd
        actual = self._gimbal.actual
        return quaternion_of(actual.roll_rad, actual.pitch_rad, self._gimbal.yaw_ned_rad)

    def position(self) -> ExifPosition | None:
        """The vehicle's estimated position; None: unknown."""
        estimate = self._view.estimate
        if not math.isfinite(estimate.lat_deg):
            return None
        return ExifPosition(estimate.lat_deg, estimate.lon_deg, estimate.alt_amsl_m)

    def _take_picture(self) -> Capture:
        view, position, index = self._view, self.position(), len(self.captures)
        path = f"{FOLDER}/IMG_{index + 1:04d}.JPG"
        pixels = self._painter.draw(*self._true_pose(), self.hfov_rad)
        data = jpeg(pixels, position, view.time_unix_us() * 1e-6)
        try:
            self._files.host_path(path).write_bytes(data)
            self.used_bytes += len(data)
        except OSError:
            path = ""
        home_alt_amsl_m = self._home.alt_amsl_m if self._home.valid else math.nan
        capture = Capture(
            index, view.time_boot_ms(), view.time_unix_us(), position,
            position.alt_amsl_m - home_alt_amsl_m if position is not None else math.nan, self.orientation(),
            path,
        )  # fmt: skip
        self.captures.append(capture)
        return capture

    def _true_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """True position [m, NED] and attitude of the camera, from which the picture is drawn.

        The gimbal's roll and pitch count as relative to the horizon, its yaw as relative to the vehicle.
        """
        truth, row = self._view.simulation.truth, self._view.row
        q = truth.q_ned_frd[row]
        if self._gimbal.running:
            actual, yaw = self._gimbal.actual, float(euler_of(q[None, :])[0, 2])
            q = np.array(quaternion_of(actual.roll_rad, actual.pitch_rad, yaw + actual.yaw_rad))
        position_ned_m = truth.position_ned_m[row] - np.array([0.0, 0.0, CAMERA_ABOVE_VEHICLE_M])
        return position_ned_m, q
