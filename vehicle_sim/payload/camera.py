"""A camera on the gimbal: takes real pictures into the vehicle's files and remembers each one.

It is a component of its own (id 100), as the camera of PX4's other simulations is; the recorded vehicle had
none, so it is there only when it is asked for.
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
from vehicle_sim.payload.picture import HEIGHT, WIDTH, Painter, Place, jpeg
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.vehicle_view import VehicleView

FOLDER = "camera"
FOCAL_LENGTH_MM = 4.5
SENSOR_WIDTH_MM, SENSOR_HEIGHT_MM = 5.2, 3.9
"""60 by 47 degrees without zoom."""
ZOOM_MAX = 4.0
CAPACITY_BYTES = 32 * 1024**3
SHORTEST_INTERVAL_S = 0.5
MAX_PICTURES = 9999
EYE_ABOVE_GROUND_M = 0.15
"""The vehicle's height stands for its feet."""


class CameraMode(IntEnum):
    """CAMERA_MODE; there is no video."""

    IMAGE = 0
    SURVEY = 2


@dataclass(frozen=True, slots=True)
class Capture:
    """One picture of the log."""

    index: int
    """From 0."""
    time_boot_ms: int
    time_utc_us: int
    place: Place | None
    """None: the vehicle did not know where it was."""
    alt_home_m: float
    q_ned_camera: Quaternion
    path: str
    """Among the vehicle's files; empty where it could not be written."""


class Camera:
    """The camera of one vehicle.

    Args:
        body: whose position and clock the log carries.
        gimbal: what it hangs on.
        home: for heights above it.
        files: where the pictures go.
    """

    def __init__(self, view: VehicleView, gimbal: Gimbal, home: Home, files: VehicleFiles) -> None:
        self._view, self._gimbal, self._home, self._files = view, gimbal, home, files
        self._painter = Painter(view.simulation.world)
        self.mode = CameraMode.IMAGE
        self.zoom_percent = 0.0
        self.captures: list[Capture] = []
        self.used_bytes = 0
        self.interval_s = 0.0
        """Of the series that runs; 0: none."""
        self._left = 0
        self._next_at_s = math.inf

    # --- settings --------------------------------------------------------------------------------------

    @property
    def width_rad(self) -> float:
        """Horizontal field of view, zoom included."""
        return 2.0 * math.atan(0.5 * SENSOR_WIDTH_MM / (FOCAL_LENGTH_MM * self.zoom))

    @property
    def height_rad(self) -> float:
        """Vertical field of view."""
        return 2.0 * math.atan(math.tan(0.5 * self.width_rad) * HEIGHT / WIDTH)

    @property
    def zoom(self) -> float:
        """1 to ZOOM_MAX."""
        return 1.0 + (ZOOM_MAX - 1.0) * self.zoom_percent / 100.0

    @property
    def free_bytes(self) -> int:
        """Left on the card."""
        return max(0, CAPACITY_BYTES - self.used_bytes)

    def reset_settings(self) -> None:
        """As it came."""
        self.mode, self.zoom_percent = CameraMode.IMAGE, 0.0

    def format_storage(self) -> None:
        """Delete all pictures, and what is known of them."""
        with contextlib.suppress(OSError):
            self._files.forget(FOLDER)
        self.captures.clear()
        self.used_bytes = 0

    # --- pictures --------------------------------------------------------------------------------------

    @property
    def series_runs(self) -> bool:
        """Whether pictures follow by themselves."""
        return self._next_at_s < math.inf

    def start(self, interval_s: float, count: int) -> None:
        """A series, the first picture now; count 0: until it is stopped."""
        self.interval_s = 0.0 if count == 1 else max(SHORTEST_INTERVAL_S, interval_s)
        self._left = count if count > 0 else MAX_PICTURES
        self._next_at_s = self._view.time_s

    def stop(self) -> None:
        """End the series."""
        self._next_at_s, self.interval_s, self._left = math.inf, 0.0, 0

    def step(self) -> Capture | None:
        """The picture that is due, taken."""
        if self._view.time_s < self._next_at_s - 1e-9:
            return None
        self._left -= 1
        self._next_at_s += self.interval_s
        capture = self._take()
        if self._left <= 0 or len(self.captures) >= MAX_PICTURES:
            self.stop()
        return capture

    def orientation(self) -> Quaternion:
        """Of the camera against north and the horizon, as the vehicle believes it."""
        if not self._gimbal.enabled:
            return self._view.estimate.q_ned_frd
        actual = self._gimbal.actual
        return quaternion_of(actual.roll_rad, actual.pitch_rad, self._gimbal.yaw_ned_rad)

    def place(self) -> Place | None:
        """Where the vehicle believes to be."""
        estimate = self._view.estimate
        if not math.isfinite(estimate.lat_deg):
            return None
        return Place(estimate.lat_deg, estimate.lon_deg, estimate.alt_amsl_m)

    def _take(self) -> Capture:
        view, place, index = self._view, self.place(), len(self.captures)
        path = f"{FOLDER}/IMG_{index + 1:04d}.JPG"
        pixels = self._painter.draw(*self._true_pose(), self.width_rad)
        data = jpeg(pixels, place, view.time_unix_us() * 1e-6)
        try:
            self._files.host_path(path).write_bytes(data)
            self.used_bytes += len(data)
        except OSError:
            path = ""
        home_m = self._home.alt_amsl_m if self._home.valid else math.nan
        capture = Capture(
            index, view.time_boot_ms(), view.time_unix_us(), place,
            place.alt_amsl_m - home_m if place is not None else math.nan, self.orientation(), path,
        )  # fmt: skip
        self.captures.append(capture)
        return capture

    def _true_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Light goes by what is, not by what is believed; the gimbal holds the horizon."""
        truth, row = self._view.simulation.truth, self._view.row
        q = truth.q_ned_frd[row]
        if self._gimbal.enabled:
            actual, yaw = self._gimbal.actual, float(euler_of(q[None, :])[0, 2])
            q = np.array(quaternion_of(actual.roll_rad, actual.pitch_rad, yaw + actual.yaw_rad))
        eye = truth.position_ned_m[row] - np.array([0.0, 0.0, EYE_ABOVE_GROUND_M])
        return eye, q
