"""Numbers as text, for the labels of the 3D view."""

from __future__ import annotations


def height_text(height_m: float) -> str:
    """A height or an altitude as text, without "-0.0", which would show estimator noise."""
    return f"{height_m if abs(height_m) >= 0.05 else 0.0:.1f} m".replace("-", "\N{MINUS SIGN}")
