"""Footprint of a photo: a pinhole camera that points perpendicularly at a flat surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from missions.errors import PlanError


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera, with the values of its data sheet."""

    sensor_width_mm: float
    sensor_height_mm: float
    focal_length_mm: float
    image_width_px: int
    image_height_px: int
    landscape: bool = True
    """Whether the photo's width is across the line of flight."""

    def footprint_m(self, distance_m: float) -> tuple[float, float]:
        """Size of the footprint across and along the line of flight [m]: sensor · distance / focal length."""
        width_m = self.sensor_width_mm * distance_m / self.focal_length_mm
        height_m = self.sensor_height_mm * distance_m / self.focal_length_mm
        return (width_m, height_m) if self.landscape else (height_m, width_m)

    def resolution_m_px(self, distance_m: float) -> float:
        """Ground sampling distance in the coarser of the two directions [m per pixel]."""
        across_m = self.sensor_width_mm / self.image_width_px
        along_m = self.sensor_height_mm / self.image_height_px
        return max(across_m, along_m) * distance_m / self.focal_length_mm


@dataclass(frozen=True, slots=True)
class Coverage:
    """Spacing of lines and photos, from the overlaps and the distance to the surface."""

    camera: Camera
    distance_m: float
    """Distance from the camera to the surface."""
    front_overlap: float = 0.75
    """Overlap of successive photos on a line: 0 to 0.95 of the footprint."""
    side_overlap: float = 0.65
    """Overlap of neighbouring lines."""

    def __post_init__(self) -> None:
        for name, value in (("front_overlap", self.front_overlap), ("side_overlap", self.side_overlap)):
            if not 0.0 <= value <= 0.95:
                reason = f"{value:g} is not between 0 and 0.95"
                raise PlanError(f"field {name}", reason, "Correct this value.", field=f"coverage.{name}")
        camera = self.camera
        sizes = (camera.sensor_width_mm, camera.sensor_height_mm, camera.focal_length_mm, self.distance_m)
        if not all(0.0 < size < 1e6 for size in sizes):
            reason = "a size or the distance is not above 0"
            raise PlanError("the camera", reason, "Correct the values.", field="coverage")

    @property
    def spacing_m(self) -> float:
        """Distance between neighbouring lines [m]: footprint · (1 − side overlap)."""
        return self.camera.footprint_m(self.distance_m)[0] * (1.0 - self.side_overlap)

    @property
    def trigger_m(self) -> float:
        """Distance between two photos on a line [m]: footprint · (1 − front overlap)."""
        return self.camera.footprint_m(self.distance_m)[1] * (1.0 - self.front_overlap)

    @property
    def lead_out_m(self) -> float:
        """Extra length of a line [m], so that the last photo shows the end of the line."""
        return max(0.0, self.trigger_m - self.camera.footprint_m(self.distance_m)[1] / 2.0)

    @property
    def across_m(self) -> float:
        """Extent of a photo across the line [m]."""
        return self.camera.footprint_m(self.distance_m)[0]

    @property
    def resolution_m_px(self) -> float | None:
        """Ground sampling distance [m per pixel]."""
        return self.camera.resolution_m_px(self.distance_m)

    def sideways(self) -> Self:
        """The coverage for sideways flight: the width of a landscape photo is along the path."""
        return replace(self, camera=replace(self.camera, landscape=not self.camera.landscape))


@dataclass(frozen=True, slots=True)
class GivenCoverage:
    """Distances between lines and between photos, stated by a pilot or a file instead of a camera."""

    distance_m: float
    """Distance from the camera to the surface."""
    spacing_m: float
    """Distance between neighbouring lines, and the extent of what one line shows."""
    trigger_m: float
    """Distance between two photos on a line; 0: no photos."""
    lead_out_m: float = 0.0
    resolution_m_px: float | None = None

    @property
    def across_m(self) -> float:
        """Extent of what one line shows [m]."""
        return self.spacing_m

    def sideways(self) -> Self:
        """The same distances: they hold for any orientation."""
        return self


AnyCoverage = Coverage | GivenCoverage
