"""A rerun with plain values as input and output."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.errors import PlanError
from missions.offboard import reader as mission_reader
from missions.plan import read
from missions.what_if.autopilot import AutopilotChange, AutopilotFlights, Flown, mode_name
from missions.what_if.changed_plan import ItemChange
from missions.what_if.changed_step import StepChange
from missions.what_if.flight import LoggedAutopilot, LoggedFlight, LoggedStream, NotFlyable
from missions.what_if.identified import Identified
from missions.what_if.mission_moment import FlownMission
from missions.what_if.model import BODY, Model, body_parameters, clear_of_ground, identify
from missions.what_if.rerun import ALL_WORK, NOT_MOVED, Change, Rerun, Track
from missions.what_if.wind import wind_along
from vehicle_sim.autopilot.modes import NavState
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
    wind = _wind(flight, parameters)
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
        **_errors(error_m[::every], error_deg[::every]),
        "wind_ned_m_s": _rounded(wind[part].mean(axis=0), 2),
        "source": source,
        "model": {name: asdict(each) for name, each in _found(model).items()},
        "notes": list(flight.notes),
    }


def run_autopilot(
    flight: LoggedFlight,
    logged: LoggedAutopilot,
    plan: Mapping[str, str] | None,
    from_s: float,
    duration_s: float,
    request: Mapping[str, Any],
    stream: LoggedStream | None = None,
) -> dict[str, Any]:
    """Flies on from a time with the simulated PX4, until both vehicles have landed or for a duration.

    Args:
        flight: the logged flight, as far as it goes.
        logged: what its autopilot was doing at the time.
        plan: `kind` and `text` (JSON) of the flown plan; None: not known.
        from_s: the time [s since the log's start].
        duration_s: longest duration.
        request: as for `change_from`, and `battery_percent` (or null), `lost`, `item` (fields of
            `ItemChange`, or null) and `step` (of `StepChange`).
        stream: the setpoints until the time, if the vehicle then flew in Offboard.

    Returns:
        As `run`; each track is as long as its flight, `t_s` as the longest. The tracks have `modes`,
        `warnings` and `steps`, each with a time and a text.

    Raises:
        NotFlyable: the text says why.
    """
    parameters, model, source = _aircraft(flight)
    wind = _wind(flight, parameters)
    percent, item, step = request["battery_percent"], request["item"], request.get("step")
    more = AutopilotChange(
        battery_share=None if percent is None else percent / 100.0,
        lost=frozenset(request["lost"]),
        item=None if item is None else ItemChange(**item),
        step=None if step is None else StepChange(**step),
    )
    waypoints, mission = None, None
    try:
        if plan is not None and plan["kind"] == "waypoint_plan":
            waypoints = read(plan["text"])
        elif plan is not None and stream is not None:
            document = mission_reader.read_json(plan["text"])
            mission = FlownMission(document, stream, flight.parameters, logged.home_alt_amsl_m)
    except PlanError as error:
        raise NotFlyable(str(error), "plan") from error
    flights = AutopilotFlights(
        flight, logged, waypoints, parameters, wind, change_from(request), more, mission
    )
    flown = flights.fly(from_s, duration_s)
    start = flight.first_after(from_s)
    part = slice(start, flight.landing_after(start), round(OUTPUT_S / STEP_S))
    as_logged = Track(flight.position_ned_m[part], flight.velocity_ned_m_s[part], flight.q_ned_frd[part])
    unchanged = flown[0].track
    both = min(len(as_logged.position_ned_m), len(unchanged.position_ned_m))
    error_m = np.linalg.norm(unchanged.position_ned_m[:both] - as_logged.position_ned_m[:both], axis=1)
    error_deg = _angle_deg(unchanged.q_ned_frd[:both], as_logged.q_ned_frd[:both])
    longest = max(len(as_logged.position_ned_m), *(len(each.positions_ned_m) for each in flown))
    began_s = float(flight.t_s[start])
    names = ("unchanged", "changed")
    return {
        "t_s": [round(began_s + OUTPUT_S * n, 3) for n in range(longest)],
        "logged": _track(as_logged, 1),
        **{name: _autopilot_track(each, began_s) for name, each in zip(names, flown, strict=True)},
        **_errors(error_m, error_deg),
        "wind_ned_m_s": _rounded(wind[part].mean(axis=0), 2),
        "source": source,
        "model": {name: asdict(each) for name, each in _found(model).items()},
        "notes": [*flights.notes, *_mode_notes(logged, flown[0])],
    }


def _autopilot_track(flown: Flown, began_s: float) -> dict[str, Any]:
    said = {"modes": flown.modes, "warnings": flown.warnings, "steps": flown.steps}
    return _track(flown.track, 1) | {
        name: [{"t_s": round(began_s + t_s, 2), "text": text} for t_s, text in each]
        for name, each in said.items()
    }


def _mode_notes(logged: LoggedAutopilot, unchanged: Flown) -> list[str]:
    """What the log's flight was told later; an offboard mission switches modes itself."""
    notes: list[str] = []
    if logged.next_target_s is not None and logged.nav_state == NavState.HOLD:
        notes.append(
            f"At {logged.next_target_s:.1f} s it was sent to another position; that is not flown again."
        )
    if logged.switched is not None:
        t_s, nav_state = logged.switched
        name = mode_name(nav_state)
        by_mission = bool(unchanged.steps) and any(mode == name for _, mode in unchanged.modes)
        if not by_mission:
            notes.append(f"At {t_s:.1f} s the vehicle was switched to {name}; that is not flown again.")
    return notes


def _errors(error_m: Values, error_deg: Values) -> dict[str, Any]:
    return {
        "error_m": _rounded(error_m, 3),
        "error_deg": _rounded(error_deg, 2),
        "max_error_m": round(float(error_m.max()), 3),
        "max_error_deg": round(float(error_deg.max()), 2),
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


def _wind(flight: LoggedFlight, parameters: Mapping[str, float]) -> Values:
    """(N, 3) wind in the log, as this body feels it."""
    mass = parameters["SIH_MASS"]
    drag_per_s = parameters["SIH_KDV"] / mass if mass > 0.0 else 0.0
    return wind_along(flight, drag_per_s, clear_of_ground(flight))


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
