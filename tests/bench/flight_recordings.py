"""The reference flights of a real PX4, read into columns: the stimulus, and the vehicle's motion."""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FLIGHTS = Path(__file__).resolve().parents[3] / "shared" / "px4" / "flights"

SETPOINT_FIELDS = (
    "coordinate_frame", "type_mask", "x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Spread:
    """Difference of a second real flight with the same stimulus from the first; NaN: not measured."""

    position_m: float
    velocity_m_s: float
    attitude_deg: float
    rise_s: float
    comparable: bool
    """False: the flight's initial state cannot be reproduced with messages."""


@dataclass(frozen=True, slots=True)
class Recording:
    """One flight; times from the first message of the stimulus."""

    name: str
    description: str
    parameters: dict[str, float]
    stimulus: list[dict[str, Any]]
    t_s: FloatArray
    columns: dict[str, FloatArray]
    spread: Spread
    control_change_s: float = math.nan
    """Time at which the controllers received a new kind of setpoint, if a message shows it."""

    def at(self, column: str, t_s: float) -> float:
        """A column's value at a time (the nearest earlier row)."""
        k = max(0, int(np.searchsorted(self.t_s, t_s, side="right")) - 1)
        return float(self.columns[column][k])

    def messages(self) -> Iterator[tuple[float, str, dict[str, Any]]]:
        """Every message of the stimulus at its time, with streams expanded."""
        for entry in self.stimulus:
            name, start_s = entry["message"], float(entry["t_s"])
            if "setpoints" in entry:
                # The sender's clock ran 0.5 % faster than the vehicle's; each row has the vehicle's time.
                columns, first_ms = entry["setpoint_columns"], entry["setpoints"][0][-1]
                for row in entry["setpoints"]:
                    setpoint = dict(zip(columns, row, strict=True))
                    at_s = start_s + 0.001 * (setpoint["time_boot_ms"] - first_ms)
                    yield at_s, name, {key: setpoint[key] for key in SETPOINT_FIELDS}
            elif "streamed_hz" in entry:
                for k in range(math.ceil(entry["duration_s"] * entry["streamed_hz"])):
                    yield start_s + k / entry["streamed_hz"], name, entry["fields"]
            elif "fields" in entry:
                yield start_s, name, entry["fields"]

    @property
    def mission(self) -> list[dict[str, Any]]:
        """The items uploaded before the start; empty without a mission."""
        return next((entry["items"] for entry in self.stimulus if "items" in entry), [])


def load(name: str, folder: Path = FLIGHTS) -> Recording:
    """Reads one recording."""
    raw = json.loads(gzip.decompress((folder / f"{name}.json.gz").read_bytes()))
    table = np.array([[math.nan if v is None else v for v in row] for row in raw["rows"]], dtype=float)
    columns = {column: table[:, k] for k, column in enumerate(raw["columns"])}
    return Recording(
        name,
        raw["header"]["description"],
        raw["header"]["parameters"],
        raw["stimulus"],
        columns["t_s"],
        columns,
        spread_of(name, folder),
    )


def spread_of(name: str, folder: Path = FLIGHTS) -> Spread:
    """Difference of PX4's second flight with the same stimulus from the first."""
    raw = json.loads((folder / "spread.json").read_text())[name]
    keys = ("pos_rms_m", "vel_rms_m_s", "att_rms_deg", "rise_diff_s")
    position, velocity, attitude, rise = (float(raw.get(key, math.nan)) for key in keys)
    return Spread(position, velocity, attitude, rise, raw["comparable"])


def names(folder: Path = FLIGHTS) -> list[str]:
    """All recorded flights."""
    return sorted(path.name.removesuffix(".json.gz") for path in folder.glob("*.json.gz"))
