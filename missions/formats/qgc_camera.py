"""QGroundControl's camera of a pattern (CameraCalc): footprints, overlaps, distance to the surface."""

from __future__ import annotations

from typing import Any, Final

from missions.errors import PlanError
from missions.formats.qgc_fields import Fields, whole
from missions.pattern_settings import CameraModel, PhotoCoverage
from missions.values import Altitude, Reference

MANUAL_CAMERA: Final = "Manual (no camera specs)"
CUSTOM_CAMERA: Final = "Custom Camera"
CAMERA_DATA: Final = ("SensorWidth", "SensorHeight", "FocalLength", "ImageWidth", "ImageHeight")
"""The keys that describe a camera; a known camera's name stands for their values."""
MAX_OVERLAP_PERCENT = 95.0
_REFERENCES: Final[dict[float, Reference]] = {1.0: "home", 2.0: "amsl", 3.0: "terrain", 4.0: "terrain"}
"""QGroundControl's altitude modes: relative, absolute, calculated above terrain, terrain frame."""
_MODES: Final[dict[Reference, int]] = {"home": 1, "amsl": 2, "terrain": 3}


def reference_of(camera: Fields) -> Reference:
    """The reference of the altitude of the flight.

    Raises:
        PlanError: The altitude mode is missing or unknown.
    """
    if "DistanceMode" not in camera.raw and "DistanceToSurfaceRelative" in camera.raw:  # version 1
        return "home" if camera.flag("DistanceToSurfaceRelative") else "amsl"
    reference = _REFERENCES.get(camera.number("DistanceMode"))
    if reference is None:
        raise PlanError(camera.place("DistanceMode"), "it is not 1, 2, 3 or 4", "Write 1 for above home.")
    return reference


def read_coverage(camera: Fields, *, sideways: bool = False) -> PhotoCoverage:
    """The overlaps and the camera, or the distances between lines and photos of a manual camera.

    Args:
        camera: the object `CameraCalc`.
        sideways: whether the camera looks at the side of a structure: QGroundControl's frontal direction is
            then vertical.

    Raises:
        PlanError: A value is missing or wrong.
    """
    name = camera.raw.get("CameraName")
    if not isinstance(name, str):
        raise PlanError(camera.place("CameraName"), "it is missing or not a text", "Write the camera's name.")
    along, across = ("Side", "Frontal") if sideways else ("Frontal", "Side")
    distance_m = camera.above_zero("DistanceToSurface")
    if name == MANUAL_CAMERA:
        across_m = camera.number(f"AdjustedFootprint{across}", 0.0, 1e6)
        along_m = camera.number(f"AdjustedFootprint{along}", 0.0, 1e6)
        return PhotoCoverage(distance_m=distance_m, spacing_m=max(across_m, 1e-6), trigger_m=along_m)
    width_px, height_px = (camera.number(key, 1.0, 1_000_000.0) for key in ("ImageWidth", "ImageHeight"))
    return PhotoCoverage(
        camera=CameraModel(
            sensor_width_mm=camera.above_zero("SensorWidth"),
            sensor_height_mm=camera.above_zero("SensorHeight"),
            focal_length_mm=camera.above_zero("FocalLength"),
            image_width_px=round(width_px),
            image_height_px=round(height_px),
            landscape=camera.flag("Landscape"),
        ),
        distance_m=distance_m,
        front_overlap=camera.number(f"{along}Overlap", 0, MAX_OVERLAP_PERCENT) / 100,
        side_overlap=camera.number(f"{across}Overlap", 0, MAX_OVERLAP_PERCENT) / 100,
    )


def camera_keys(settings: PhotoCoverage, altitude: Altitude | None) -> dict[str, Any]:
    """The keys of `CameraCalc` for a coverage.

    QGroundControl flies at the distance to the surface. Where a pattern's camera has another distance, the
    overlaps are those at the altitude of the flight, so that lines and photos stay where they are; without
    such overlaps, the distances between lines and photos are written.

    Args:
        settings: the coverage.
        altitude: altitude of the flight; None: a structure scan, whose distance is to the sides.
    """
    from missions.patterns.document import coverage_of  # shapely, 0.2 s to import

    coverage = coverage_of(settings)
    sideways = altitude is None
    along, across = ("Side", "Frontal") if sideways else ("Frontal", "Side")
    values = coverage.sideways() if sideways else coverage
    distance_m = settings.distance_m if altitude is None else altitude.value_m
    mode: dict[str, Any] = {"DistanceMode": 1 if altitude is None else _MODES[altitude.reference]}
    keys: dict[str, Any] = {
        **mode,
        "DistanceToSurface": whole(distance_m),
        f"AdjustedFootprint{across}": whole(values.spacing_m),
        f"AdjustedFootprint{along}": whole(values.trigger_m),
    }
    overlaps = _overlaps_percent(settings, distance_m, sideways=sideways)
    if settings.camera is None or overlaps is None:
        return {"CameraName": MANUAL_CAMERA, **keys}
    camera = settings.camera
    width_mm_px = camera.sensor_width_mm / camera.image_width_px
    return {
        **keys,
        "SensorWidth": whole(camera.sensor_width_mm),
        "SensorHeight": whole(camera.sensor_height_mm),
        "FocalLength": whole(camera.focal_length_mm),
        "ImageWidth": camera.image_width_px,
        "ImageHeight": camera.image_height_px,
        "Landscape": camera.landscape,
        f"{along}Overlap": overlaps[0],
        f"{across}Overlap": overlaps[1],
        "FixedOrientation": False,
        "MinTriggerInterval": 0,
        "ValueSetIsDistance": True,
        "ImageDensity": whole(width_mm_px * distance_m * 100.0 / camera.focal_length_mm),
    }


def _overlaps_percent(
    settings: PhotoCoverage, distance_m: float, *, sideways: bool
) -> tuple[float, float] | None:
    """Overlap of photos on a line and of neighbouring lines [%] at this distance with the same spacings;
    None: there are no such overlaps."""
    if settings.distance_m == distance_m:
        fractions = (settings.front_overlap, settings.side_overlap)
    elif distance_m <= 0.0:
        return None
    else:
        scale = settings.distance_m / distance_m
        fractions = (1 - scale * (1 - settings.front_overlap), 1 - scale * (1 - settings.side_overlap))
    front, side = (whole(round(100.0 * each, 6)) for each in fractions)
    return (front, side) if min(front, side) >= 0 and max(front, side) <= MAX_OVERLAP_PERCENT else None
