"""Texts of the labels of the 3D view, which are written in English and shown in the browser's language."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from gcs_server.language import LANGUAGES

GERMAN: Final[Mapping[str, str]] = {
    "above home": "über Home",
    "above local origin": "über dem lokalen Ursprung",
    "above the start": "über dem Start",
    "target": "Ziel",
    "velocity setpoint": "Geschwindigkeits-Sollwert",
    "dry run": "Probelauf",
    "connection lost": "Verbindung verloren",
    "no position": "keine Position",
    "simulated": "simuliert",
    "may be real": "vielleicht echt",
    "replayed": "Wiedergabe",
    "not sent": "nicht gesendet",
    "away": "entfernt",
    "yaw": "Yaw",
    "grid": "Raster",
    "terrain": "Gelände",
    "lines": "Linien",
    "home is": "Home ist",
    "above the ground of the elevation data": "über dem Boden der Höhendaten",
    "below the ground of the elevation data": "unter dem Boden der Höhendaten",
}
"""All words of the labels; the compass has its letters in every language."""
_WORDS = re.compile("|".join(rf"(?<!\w){words}(?!\w)" for words in sorted(GERMAN, key=len, reverse=True)))


def in_language(text: str, language: str) -> str:
    """A label's text in a language of `LANGUAGES`."""
    return text if language == LANGUAGES[0] else _WORDS.sub(lambda found: GERMAN[found[0]], text)


def metres_text(length_m: float) -> str:
    """A length with its unit, without "-0.0", which would show estimator noise."""
    return f"{length_m if abs(length_m) >= 0.05 else 0.0:.1f} m".replace("-", "\N{MINUS SIGN}")


def altitude_text(altitude_m: float, *, above_home: bool) -> str:
    """An altitude above home, or else above the local origin."""
    return f"{metres_text(altitude_m)} above {'home' if above_home else 'local origin'}"
