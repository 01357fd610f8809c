"""The colours of the 3D view, for both themes.

The page's design tokens have the same values. Cyan and the other `vehicle_colours` are for vehicles,
violet is for targets, and grey is for everything else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Theme = Literal["dark", "light"]
Rgb = tuple[int, int, int]


def rgb(colour: str) -> Rgb:
    """`#35d6e6` as three bytes."""
    return (int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16))


@dataclass(frozen=True, slots=True)
class Palette:
    """The colours of one theme."""

    theme: Theme
    vehicle_colours: tuple[str, ...]
    """Colours of the vehicles in their order; they repeat after the last one."""
    target: str
    text: str
    text_2: str
    text_3: str
    panel: str
    line: str
    sky: str
    ground: str
    grid: str
    grid_section: str
    terrain_low: Rgb
    terrain_high: Rgb
    """Colours of the lowest and the highest ground."""
    body: Rgb
    """The airframe's shell: the theme's text colour, so that it contrasts with the ground."""
    dark_part: Rgb
    """Motors, lens and landing gear."""
    lost: Rgb
    shadow_opacity: float
    disc_opacity: float

    def vehicle_colour(self, index: int) -> str:
        """The colour of the vehicle with this index in the fleet."""
        return self.vehicle_colours[index % len(self.vehicle_colours)]


PALETTES: dict[Theme, Palette] = {
    "dark": Palette(
        theme="dark",
        vehicle_colours=("#35d6e6", "#ffd166", "#ff8fab", "#9be564"),
        target="#c08bff",
        text="#e8eef3",
        text_2="#9aa8b5",
        text_3="#667583",
        panel="#131a20",
        line="#26313b",
        sky="#1a222a",
        ground="#10171d",
        grid="#2c3c48",
        grid_section="#41535f",
        terrain_low=(24, 36, 42),
        terrain_high=(74, 84, 84),
        body=(232, 238, 243),
        dark_part=(52, 64, 74),
        lost=(102, 117, 131),
        shadow_opacity=0.45,
        disc_opacity=0.24,
    ),
    "light": Palette(
        theme="light",
        vehicle_colours=("#00788a", "#8a6100", "#b3245a", "#3f7a00"),
        target="#7a2bd6",
        text="#0c1319",
        text_2="#46545f",
        text_3="#6d7b86",
        panel="#ffffff",
        line="#ccd5dc",
        sky="#f3f6f8",
        ground="#e4e9ea",
        grid="#c2cccf",
        grid_section="#9fadb3",
        terrain_low=(176, 192, 180),
        terrain_high=(222, 216, 200),
        body=(38, 48, 57),
        dark_part=(12, 19, 25),
        lost=(109, 123, 134),
        shadow_opacity=0.3,
        disc_opacity=0.22,
    ),
}


def tone_corrected(colour: str, palette: Palette) -> Rgb:
    """The colour to send, so that viser's filmic tone curve displays the given colour.

    The curve desaturates bright colours, so most of the grey is removed beforehand. It hardly changes dark
    colours.
    """
    red, green, blue = rgb(colour)
    if palette.theme == "light":
        return (red, green, blue)
    colourful = max(red, green, blue) - min(red, green, blue) > 60
    grey = min(40.0, 0.75 * min(red, green, blue)) if colourful else 0.0
    return (round(red - grey), round(green - grey), round(blue - grey))
