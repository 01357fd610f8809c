"""Numbers as text, for the labels of the 3D view."""

from __future__ import annotations


def metres_text(length_m: float) -> str:
    """A length with its unit, without "-0.0", which would show estimator noise."""
    return f"{length_m if abs(length_m) >= 0.05 else 0.0:.1f} m".replace("-", "\N{MINUS SIGN}")


def altitude_text(altitude_m: float, *, above_home: bool) -> str:
    """An altitude above home, or else above the local origin."""
    return f"{metres_text(altitude_m)} above {'home' if above_home else 'local origin'}"
