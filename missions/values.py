"""The values that every part of a plan is made of: numbers, altitudes, places."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
"""A finite number of a size that can be."""
LatDeg = Annotated[float, Field(ge=-90.0, le=90.0, allow_inf_nan=False)]
LonDeg = Annotated[float, Field(ge=-180.0, le=180.0, allow_inf_nan=False)]
AltitudeM = Annotated[float, Field(ge=-12_000.0, le=100_000.0, allow_inf_nan=False)]
"""Metres, positive up; from the deepest sea to the edge of space."""
Metres = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]

Reference = Literal["home", "amsl", "terrain"]
"""What an altitude counts from: the home position, mean sea level, or the ground below."""


class Model(BaseModel):
    """Frozen, no unknown fields, no silent conversion of types."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Altitude(Model):
    """An altitude with what it counts from; neither means anything alone.

    `resolved_amsl_m` belongs to the reference "terrain": the altitude above mean sea level that
    elevation data gave for it. PX4 flies only that, since it refuses terrain frames.
    """

    value_m: AltitudeM
    reference: Reference
    resolved_amsl_m: AltitudeM | None = None

    def amsl_m(self, home_alt_amsl_m: float | None) -> float | None:
        """Above mean sea level in metres; None where home or terrain is not known."""
        if self.reference == "amsl":
            return self.value_m
        if self.reference == "home":
            return None if home_alt_amsl_m is None else home_alt_amsl_m + self.value_m
        return self.resolved_amsl_m


class Point(Model):
    """A place on the ground, WGS84 degrees."""

    lat_deg: LatDeg
    lon_deg: LonDeg


class HomePosition(Model):
    """Where the flight is planned to start: WGS84 degrees, metres above mean sea level."""

    lat_deg: LatDeg
    lon_deg: LonDeg
    alt_amsl_m: AltitudeM


class RallyPoint(Model):
    """A place to return to instead of home."""

    lat_deg: LatDeg
    lon_deg: LonDeg
    altitude: Altitude


class FenceCircle(Model):
    """A circle that the vehicle must stay in (inclusion) or out of."""

    shape: Literal["circle"] = "circle"
    inclusion: bool
    center: Point
    radius_m: Annotated[float, Field(gt=0.0, le=1e6, allow_inf_nan=False)]
    original: str | None = None
    """JSON text of this zone in the .plan file it was read from."""


class FencePolygon(Model):
    """A polygon that the vehicle must stay in (inclusion) or out of; the last corner joins the first."""

    shape: Literal["polygon"] = "polygon"
    inclusion: bool
    polygon: Annotated[tuple[Point, ...], Field(min_length=3, max_length=1000)]
    original: str | None = None
    """JSON text of this zone in the .plan file it was read from."""


FenceZone = Annotated[FenceCircle | FencePolygon, Field(discriminator="shape")]
