"""Values of a JSON object of another program, with errors that name the field."""

from __future__ import annotations

from typing import Any

from missions.errors import PlanError
from missions.formats.qgc_item import require_list, require_number, require_object
from missions.pattern_settings import MAX_POINTS
from missions.values import Point


class Fields:
    """The fields of an object.

    Args:
        raw: the object.
        subject: its name in errors.
        path: the path of keys to it, with a full stop at the end.
    """

    def __init__(self, raw: dict[str, Any], subject: str, path: str = "") -> None:
        self.raw = raw
        self._subject = subject
        self._path = path

    def place(self, key: str) -> str:
        """The name of a field in errors."""
        return f"{self._subject}, field {self._path}{key}"

    def part(self, key: str) -> Fields:
        """The fields of an object inside this one. Raises PlanError if there is none."""
        return Fields(
            require_object(self.raw.get(key), self.place(key)), self._subject, f"{self._path}{key}."
        )

    def number(self, key: str, low: float = -1e9, high: float = 1e9) -> float:
        """A number between two limits. Raises PlanError if it is none."""
        value = require_number(self.raw.get(key), self.place(key))
        if not low <= value <= high:
            reason = f"{value:g} is not between {low:g} and {high:g}"
            raise PlanError(self.place(key), reason, "Correct this value.")
        return value

    def above_zero(self, key: str) -> float:
        """A number above 0 and below a million. Raises PlanError if it is none."""
        value = require_number(self.raw.get(key), self.place(key))
        if not 0.0 < value < 1e6:
            reason = f"{value:g} is not above 0 and below 1,000,000"
            raise PlanError(self.place(key), reason, "Correct this value.")
        return value

    def flag(self, key: str) -> bool:
        """True or false; a missing key is false. Raises PlanError if it is anything else."""
        value = self.raw.get(key, False)
        if not isinstance(value, bool):
            raise PlanError(self.place(key), "it is neither true nor false", "Write true or false.")
        return value

    def points(self, key: str, least: int) -> tuple[Point, ...]:
        """Positions as lists of latitude and longitude. Raises PlanError if there are too few or many."""
        values = require_list(self.raw.get(key), self.place(key))
        if not least <= len(values) <= MAX_POINTS:
            reason = f"it has {len(values)} points, but {least} to {MAX_POINTS} are needed"
            raise PlanError(self.place(key), reason, "Draw it again.")
        return tuple(self._point(value, f"{key}[{index}]") for index, value in enumerate(values))

    def _point(self, value: Any, key: str) -> Point:
        pair = require_list(value, self.place(key))
        if len(pair) < 2:
            raise PlanError(self.place(key), "it has no two numbers", "Write latitude and longitude.")
        lat, lon = (require_number(each, self.place(key)) for each in pair[:2])
        if abs(lat) > 90.0 or abs(lon) > 180.0:
            reason = f"{lat:g}, {lon:g} is not on the earth"
            raise PlanError(self.place(key), reason, "Write latitude -90 to 90 and longitude -180 to 180.")
        return Point(lat_deg=lat, lon_deg=lon)


def whole(value: float) -> float | int:
    """Whole numbers as int, which QGroundControl writes without a decimal point."""
    return int(value) if float(value).is_integer() else value
