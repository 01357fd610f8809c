"""A rerun with plain values as input and output."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.what_if.flight import LoggedFlight, NotFlyable
from missions.what_if.identified import Identified
from missions.what_if.model import BODY, Model, body_parameters, identify
from missions.what_if.rerun import ALL_WORK, NOT_MOVED, Change, Rerun, Track
from vehicle_sim.frames import euler_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.simulation import STEP_S

Values = NDArray[np.float64]

OUTPUT_S = 0.1
"""Time between two samples of the result."""


def run(flight: LoggedFlight, from_s: float, change: Change) -> dict[str, Any]:
    """Flies from a time to the landing, or to the end of `flight`.

    Returns:
        `t_s`; `logged`, `unchanged` and `changed`, each with `position_ned_m`, `velocity_ned_m_s` and
        `attitude_deg` (roll, pitch, yaw); `error_m` and `error_deg` of the unchanged flight beside the logged
        one, and their extremes; `model` (what was found, with standard errors) and its `source`; `notes`.

    Raises:
        NotFlyable: the text says why.
    """
    parameters, model, source = _aircraft(flight)
    wind = _wind(model)
    tracks = Rerun(flight, parameters, wind, change).fly(from_s)
    start = flight.first_after(from_s)
    part = slice(start, flight.landing_after(start))
    logged = Track(flight.position_ned_m[part], flight.velocity_ned_m_s[part], flight.q_ned_frd[part])
    error_m = np.linalg.norm(tracks[0].position_ned_m - logged.position_ned_m, axis=1)
    error_deg = _angle_deg(tracks[0].q_ned_frd, logged.q_ned_frd)
    every = round(OUTPUT_S / STEP_S)
    return {
        "t_s": _rounded(flight.t_s[part][::every], 3),
        "logged": _track(logged, every),
        "unchanged": _track(tracks[0], every),
        "changed": _track(tracks[1], every),
        "error_m": _rounded(error_m[::every], 3),
        "error_deg": _rounded(error_deg[::every], 2),
        "max_error_m": round(float(error_m.max()), 3),
        "max_error_deg": round(float(error_deg.max()), 2),
        "wind_ned_m_s": [round(each, 2) for each in wind],
        "source": source,
        "model": {name: asdict(each) for name, each in _found(model).items()},
        "notes": list(flight.notes),
    }


def _aircraft(flight: LoggedFlight) -> tuple[dict[str, float], Model | None, str]:
    """Parameters with a body, what the flight says of it, and where the body is from."""
    own = {name: float(value) for name, value in Parameters().items()} | dict(flight.parameters)
    if all(name in flight.parameters for name in BODY):
        try:
            drag_per_s = own["SIH_KDV"] / own["SIH_MASS"] if own["SIH_MASS"] > 0.0 else None
            model = identify(flight, own["SIH_T_TAU"], drag_per_s)
        except NotFlyable:
            model = None  # short, but the body is known; of the wind nothing is
        return own, model, "parameters"
    model = identify(flight, own["SIH_T_TAU"])
    return own | body_parameters(model, own), model, "flight"


def _wind(model: Model | None) -> tuple[float, float, float]:
    if model is None:
        return 0.0, 0.0, 0.0
    north, east = (each.value if each.known else 0.0 for each in (model.wind_north_m_s, model.wind_east_m_s))
    return north, east, 0.0


def _found(model: Model | None) -> dict[str, Identified]:
    return {} if model is None else {name: getattr(model, name) for name in Model.__dataclass_fields__}


def _track(track: Track, every: int) -> dict[str, Any]:
    attitude_deg = np.degrees(euler_of(track.q_ned_frd[::every]))
    return {
        "position_ned_m": _rounded(track.position_ned_m[::every], 3),
        "velocity_ned_m_s": _rounded(track.velocity_ned_m_s[::every], 3),
        "attitude_deg": _rounded(attitude_deg, 2),
    }


def _angle_deg(first: Values, second: Values) -> Values:
    """(N,) angles between attitudes (N, 4)."""
    cosine = np.abs(np.sum(first * second, axis=1))
    return np.degrees(2.0 * np.arccos(np.clip(cosine, 0.0, 1.0)))


def _rounded(values: Values, digits: int) -> list[Any]:
    """Lists without NaN or infinity, which JSON does not have."""
    return _finite(np.round(values, digits).tolist())


def _finite(value: Any) -> Any:
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return value if math.isfinite(value) else None


def change_from(request: Mapping[str, Any]) -> Change:
    """The change of a request: `parameters`, `wind_ned_m_s` (or null), `motor_health` (or null), and
    `moved_ned_m` (or null, or absent)."""
    wind, health = request["wind_ned_m_s"], request["motor_health"]
    moved = request.get("moved_ned_m")
    return Change(
        parameters={name: float(value) for name, value in request["parameters"].items()},
        wind_ned_m_s=None if wind is None else (wind[0], wind[1], wind[2]),
        moved_ned_m=NOT_MOVED if moved is None else (moved[0], moved[1], moved[2]),
        motor_health=ALL_WORK if health is None else (health[0], health[1], health[2], health[3]),
    )
