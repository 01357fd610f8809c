"""What a rerun of a flight is worth: the unchanged rerun beside the recordings of a real PX4, and how well an
aircraft is identified in logs of simulated ones."""

from __future__ import annotations

import gzip
import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook import columns as log_columns
from gcs_server.logbook import overview
from gcs_server.logbook.flown import flown
from gcs_server.logbook.ulog import read_ulog
from missions.what_if.flight import LoggedFlight, NotFlyable
from missions.what_if.task import OUTPUT_S, change_from, run
from missions.what_if.vehicle_model import vehicle_model
from tests.support.flown_log import flown_log
from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.simulation import STEP_S

from . import what_if_px4
from .fault_recordings import FAULTS
from .flight_recordings import FLIGHTS

FloatArray = NDArray[np.float64]

STATED_M, WINDOW_S = 1.0, 8.0
"""What docs/flights.md states of an unchanged rerun, and for how long."""
SETTLED_S = 1.0
"""A rerun begins so long after the first sample in the air."""
ON_GROUND = 1  # MAV_LANDED_STATE_ON_GROUND
UNCHANGED = change_from({"parameters": {}, "wind_ned_m_s": None, "motor_health": None})
BODIES: tuple[Mapping[str, float], ...] = (
    {},
    {"SIH_MASS": 1.2},
    {"SIH_MASS": 0.8, "SIH_KDV": 0.6},
    {"SIH_T_MAX": 6.0, "SIH_KDV": 1.4},
    {"SIH_MASS": 1.5, "SIH_T_MAX": 7.0, "SIH_KDV": 0.9},
)
WIND = (1.0, 3.0, 0.0)
GAINS: tuple[Mapping[str, float], ...] = (
    {"MPC_XY_P": 0.5},
    {"MPC_XY_VEL_P_ACC": 3.0},
    {"MPC_XY_P": 0.4, "MPC_XY_VEL_MAX": 3.0},
    {"MPC_XY_VEL_MAX": 2.0},
)
STEP_PART_S = 7.0


@dataclass(frozen=True, slots=True)
class Rerun:
    """The unchanged rerun of one recording."""

    name: str
    error_m: float
    """Largest distance from the recorded estimate; NaN: not flown."""
    drift_m: float = 0.0
    """Largest distance of the recorded position from where the recorded velocity leads: an error of the
    vehicle's estimator."""
    why_not: str = ""


@dataclass(frozen=True, slots=True)
class Found:
    """Relative errors of what was identified in one simulated log."""

    body: str
    thrust: float
    """Of the thrust by mass, which is that of the mass if the thrust is known, and of the thrust if the mass
    is."""
    drag: float
    drag_known: bool
    thrust_sigma: float
    """The error in stated standard errors."""


def recorded_flight(raw: Mapping[str, Any]) -> LoggedFlight:
    """A recording at the steps of the simulation; accelerometer and integrals were not recorded."""
    table = np.array([[np.nan if v is None else v for v in row] for row in raw["rows"]], dtype=float)
    names = {name: table[:, k] for k, name in enumerate(raw["columns"])}
    rows_s = names["t_s"]
    t_s = np.arange(rows_s[0], rows_s[-1], STEP_S)
    held_at = np.clip(np.searchsorted(rows_s, t_s, side="right") - 1, 0, len(rows_s) - 1)

    def held(*wanted: str) -> FloatArray:
        missing = np.full(len(rows_s), np.nan)
        return np.column_stack([names.get(name, missing)[held_at] for name in wanted])

    def smooth(*wanted: str) -> FloatArray:
        return np.column_stack([np.interp(t_s, rows_s, names[name]) for name in wanted])

    q = smooth("qw", "qx", "qy", "qz")
    rates = smooth("p", "q", "r")
    parameters = {name: float(value) for name, value in raw["header"]["parameters"].items()}
    position, target = smooth("x", "y", "z"), held("sx", "sy", "sz")
    velocity = held("svx", "svy", "svz")
    # The reported velocity has the position controller's part, which the rerun's own adds again.
    gain = np.array([parameters.get(name, default) for name, default in _POSITION_GAINS])
    velocity = np.where(np.isfinite(target), velocity - gain * (target - position), velocity)
    landed = held("landed_state")[:, 0] == ON_GROUND
    level = _levels(raw["header"]["name"], t_s, held("armed")[:, 0] > 0)
    nothing = np.full((len(t_s), 3), np.nan)
    return LoggedFlight(
        t_s=t_s,
        position_ned_m=position,
        velocity_ned_m_s=smooth("vx", "vy", "vz"),
        q_ned_frd=q / np.linalg.norm(q, axis=1, keepdims=True),
        rates_frd_rad_s=rates,
        angular_acceleration_frd_rad_s2=np.gradient(rates, STEP_S, axis=0),
        force_frd_m_s2=nothing,
        motors=np.clip((smooth("m1_us", "m2_us", "m3_us", "m4_us") - 1000.0) / 1000.0, 0.0, 1.0),
        level=level,
        landed=landed,
        target_position_ned_m=target,
        target_velocity_ned_m_s=velocity,
        target_acceleration_ned_m_s2=nothing,
        target_yaw_ned_rad=held("syaw")[:, 0],
        target_yaw_rate_ned_rad_s=held("syawrate")[:, 0],
        commanded_acceleration_ned_m_s2=held("sax", "say", "saz"),
        target_q_ned_frd=held("tqw", "tqx", "tqy", "tqz"),
        target_rates_frd_rad_s=held("tp", "tq", "tr"),
        thrust=held("thrust")[:, 0],
        rate_integral=nothing,
        hover_thrust=np.full(len(t_s), np.nan),
        parameters=parameters,
    )


_POSITION_GAINS = (("MPC_XY_P", 0.95), ("MPC_XY_P", 0.95), ("MPC_Z_P", 1.0))


def _levels(name: str, t_s: FloatArray, armed: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Which controller got the setpoint: the stimulus says it by the recording's name."""
    kinds = {"att": ControlLevel.ATTITUDE, "rate": ControlLevel.RATES}
    stimulated = kinds.get(name.split("_")[0], ControlLevel.TRAJECTORY)
    level = np.where(t_s >= 0.0, int(stimulated), int(ControlLevel.TRAJECTORY))
    return np.where(armed, level, int(ControlLevel.DISARMED)).astype(np.int64)


def rerun(path: Path) -> Rerun:
    """Flies a recording again, unchanged, for some seconds from its begin in the air."""
    name = path.name.removesuffix(".json.gz")
    flight = recorded_flight(json.loads(gzip.decompress(path.read_bytes())))
    air = np.flatnonzero(~flight.landed & (flight.level != ControlLevel.DISARMED))
    if not len(air):
        return Rerun(name, np.nan, why_not="never in the air")
    from_s = float(flight.t_s[air[0]]) + SETTLED_S
    try:
        result = run(_until(flight, from_s + WINDOW_S), from_s, UNCHANGED)
    except NotFlyable as error:
        return Rerun(name, np.nan, why_not=str(error))
    return Rerun(name, result["max_error_m"], _drift_m(result["logged"]))


def _drift_m(track: Mapping[str, Any]) -> float:
    position, velocity = np.array(track["position_ned_m"]), np.array(track["velocity_ned_m_s"])
    moved = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * OUTPUT_S, axis=0)
    return float(np.linalg.norm(moved - (position[1:] - position[0]), axis=1).max())


def _until(flight: LoggedFlight, to_s: float) -> LoggedFlight:
    end = flight.first_after(to_s)
    arrays: dict[str, Any] = {
        field.name: value[:end]
        for field in fields(flight)
        if isinstance(value := getattr(flight, field.name), np.ndarray)
    }
    return replace(flight, **arrays)


def identified(body: Mapping[str, float], folder: Path) -> Found:
    """Identifies an aircraft in the log of a simulated flight in wind, without its SIH parameters."""
    path, _ = flown_log(folder, WIND, body)
    log = read_ulog(path)
    log_columns.write(log, overview.encode(log), folder / "columns")
    logged = flown(log_columns.Columns(folder / "columns"), {}, 0.0, 1e6)
    found = vehicle_model(logged, None)
    own = {name: float(value) for name, value in log.parameters.items()}
    thrust, drag = 4 * own["SIH_T_MAX"] / own["SIH_MASS"], own["SIH_KDV"] / own["SIH_MASS"]
    text = ", ".join(f"{name} {value:g}" for name, value in body.items()) or "as PX4's SIH"
    return Found(
        text,
        found.thrust_m_s2.value / thrust - 1.0,
        found.drag_per_s.value / drag - 1.0,
        found.drag_known,
        (found.thrust_m_s2.value - thrust) / found.thrust_m_s2.error,
    )


def _logged(folder: Path, parameters: Mapping[str, float]) -> tuple[LoggedFlight, float]:
    """A simulated flight with a step, and the time of its step."""
    path, step_s = flown_log(folder, WIND, parameters)
    log = read_ulog(path)
    log_columns.write(log, overview.encode(log), folder / "columns")
    values = {name: float(value) for name, value in log.parameters.items()}
    columns = log_columns.Columns(folder / "columns")
    return flown(columns, values, step_s - 0.5, step_s - 0.5 + STEP_PART_S), step_s - 0.5


def changed(gains: Mapping[str, float], folder: Path) -> tuple[float, float]:
    """What a change makes along the step, changed beside unchanged rerun, beside what it makes of the flight
    itself: their largest difference, and how much the change makes [m]."""
    flight, from_s = _logged(folder / "usual", {})
    true, true_from_s = _logged(folder / "changed", gains)
    change = change_from({"parameters": dict(gains), "wind_ned_m_s": None, "motor_health": None})
    foretold = run(flight, from_s, change)
    flew = run(true, true_from_s, UNCHANGED)["logged"]
    count = min(len(foretold["t_s"]), len(flew["position_ned_m"]))
    changed_m, unchanged_m, usual_m, flew_m = (
        np.array(each["position_ned_m"])[:count, 0]
        for each in (foretold["changed"], foretold["unchanged"], foretold["logged"], flew)
    )
    makes_m = flew_m - usual_m
    return float(np.abs(changed_m - unchanged_m - makes_m).max()), float(np.abs(makes_m).max())


def table() -> Iterator[str]:
    """Rows of Markdown."""
    for title, paths in (
        ("reference flights", sorted(FLIGHTS.glob("*.json.gz"))),
        ("fault flights", sorted((FAULTS / "data").glob("*.run1.json.gz"))),
    ):
        if not paths:
            yield f"The recordings of {title} are not beside this checkout."
            continue
        yield from rerun_rows(title, [rerun(path) for path in paths])
    yield ""
    yield "| changed gain | what it makes of the flight | error of what the rerun says it makes |"
    yield "|---|---|---|"
    for gains in GAINS:
        with tempfile.TemporaryDirectory() as folder:
            apart_m, made_m = changed(gains, Path(folder))
        text = ", ".join(f"{name} {value:g}" for name, value in gains.items())
        yield f"| {text} | {made_m:.2f} m | {apart_m:.2f} m |"
    yield ""
    yield "| simulated aircraft | thrust by mass | drag by mass | error in standard errors |"
    yield "|---|---|---|---|"
    for body in BODIES:
        with tempfile.TemporaryDirectory() as folder:
            found = identified(body, Path(folder))
        drag = f"{found.drag:+.1%}" if found.drag_known else f"not known ({found.drag:+.0%})"
        yield f"| {found.body} | {found.thrust:+.1%} | {drag} | {found.thrust_sigma:+.1f} |"
    yield ""
    yield from what_if_px4.table()


def rerun_rows(title: str, reruns: list[Rerun]) -> Iterator[str]:
    """How many stay within the stated error, and each that does not."""
    flew = [each for each in reruns if np.isfinite(each.error_m)]
    within = [each for each in flew if each.error_m <= STATED_M]
    explained = [each for each in flew if each.error_m <= STATED_M + each.drift_m]
    median_m = float(np.median([each.error_m for each in flew])) if flew else np.nan
    yield ""
    yield (
        f"{title}: {len(within)} of {len(flew)} flown again stay within {STATED_M:.0f} m for {WINDOW_S:.0f} "
        f"s (median {median_m:.2f} m), {len(explained)} within that and what their estimates drift; "
        f"{len(reruns) - len(flew)} were not flown."
    )
    for each in sorted(flew, key=lambda one: -one.error_m):
        if each.error_m > STATED_M:
            yield f"- {each.name}: {each.error_m:.1f} m (its estimate drifts {each.drift_m:.1f} m)"
    for each in reruns:
        if each.why_not:
            yield f"- {each.name}: {each.why_not}"
