"""Values that all plan documents use: numbers, altitudes, positions, fence zones."""

from __future__ import annotations

import unicodedata
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator

Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
"""A finite number of plausible size."""
LatDeg = Annotated[float, Field(ge=-90.0, le=90.0, allow_inf_nan=False)]
LonDeg = Annotated[float, Field(ge=-180.0, le=180.0, allow_inf_nan=False)]
AltitudeM = Annotated[float, Field(ge=-12_000.0, le=100_000.0, allow_inf_nan=False)]
"""Metres, positive up; wide enough for any flight."""
Metres = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]


def hidden_character(text: str) -> str | None:
    """The first character of a name that is invisible or changes how the text around it is shown: a control
    character, the end of a line, or a change of the direction of writing; None: there is none."""
    return next(
        (each for each in text if each in _HIDDEN or unicodedata.category(each) in _HIDDEN_KINDS), None
    )


_HIDDEN_KINDS = ("Cc", "Cs", "Zl", "Zp")
_HIDDEN = "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
"""Marks, embeddings, overrides and isolates of the bidirectional algorithm."""


def _check_shown(text: str) -> str:
    hidden = hidden_character(text)
    if hidden is not None:
        raise ValueError(f"it contains the invisible character U+{ord(hidden):04X}: remove it")
    return text


DisplayText = Annotated[str, AfterValidator(_check_shown)]
"""A name that people read, for everything that has a name."""

Reference = Literal["home", "amsl", "terrain"]
"""Reference of an altitude: the home position, mean sea level, or the ground below."""


class Model(BaseModel):
    """Base class of documents: immutable, no unknown fields, no type conversion."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Altitude(Model):
    """An altitude with its reference.

    `resolved_amsl_m` belongs to the reference "terrain": the altitude above mean sea level computed from
    elevation data. This altitude is uploaded, because PX4 refuses terrain frames.
    """

    value_m: AltitudeM
    reference: Reference
    resolved_amsl_m: AltitudeM | None = None

    def amsl_m(self, home_alt_amsl_m: float | None) -> float | None:
        """Altitude above mean sea level [m]; None: home or terrain is unknown."""
        if self.reference == "amsl":
            return self.value_m
        if self.reference == "home":
            return None if home_alt_amsl_m is None else home_alt_amsl_m + self.value_m
        return self.resolved_amsl_m


class Point(Model):
    """A position on the ground, WGS84 degrees."""

    lat_deg: LatDeg
    lon_deg: LonDeg


class HomePosition(Model):
    """Planned home position: WGS84 degrees, metres above mean sea level."""

    lat_deg: LatDeg
    lon_deg: LonDeg
    alt_amsl_m: AltitudeM


class RallyPoint(Model):
    """A position to return to instead of home."""

    lat_deg: LatDeg
    lon_deg: LonDeg
    altitude: Altitude


class FenceCircle(Model):
    """A circle: the vehicle must stay inside (`inclusion` true) or outside (false)."""

    shape: Literal["circle"] = "circle"
    inclusion: bool
    center: Point
    radius_m: Annotated[float, Field(gt=0.0, le=1e6, allow_inf_nan=False)]
    original: str | None = None
    """JSON text of this zone in the .plan file that the zone was read from."""


class FencePolygon(Model):
    """A polygon: the vehicle must stay inside (`inclusion` true) or outside (false). The last corner joins
    the first."""

    shape: Literal["polygon"] = "polygon"
    inclusion: bool
    polygon: Annotated[tuple[Point, ...], Field(min_length=3, max_length=1000)]
    original: str | None = None
    """JSON text of this zone in the .plan file that the zone was read from."""


FenceZone = Annotated[FenceCircle | FencePolygon, Field(discriminator="shape")]


class Obstacle(Model):
    """A building, a tree or a mast: upright, from the ground to its top. The last corner joins the first."""

    name: Annotated[DisplayText, Field(max_length=60)] = ""
    """Name in findings; empty: findings use the number of the obstacle."""
    polygon: Annotated[tuple[Point, ...], Field(min_length=3, max_length=100)]
    top: Altitude
    """Altitude of the top, above home or mean sea level."""

    @field_validator("top")
    @classmethod
    def _has_known_reference(cls, top: Altitude) -> Altitude:
        if top.reference == "terrain":
            raise ValueError("give the top of an obstacle above home or AMSL")
        return top


MAX_OBSTACLES = 100
Obstacles = Annotated[tuple[Obstacle, ...], Field(max_length=MAX_OBSTACLES)]
