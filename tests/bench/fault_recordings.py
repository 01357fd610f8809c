"""Recordings of a real PX4 with a fault, two runs of each fault: stimulus, reports and true motion."""

from __future__ import annotations

import gzip
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FAULTS = Path(__file__).resolve().parents[3] / "shared" / "px4" / "faults"
REDUCED_FILE = Path(__file__).resolve().parents[1] / "data" / "faults.json"
"""Some recordings, reduced to the values that `load` returns."""

TIMES_S = (1.0, 2.0, 3.0, 5.0, 8.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0)
"""Times after the fault at which errors are compared."""
MAX_TIME_S = 65.0
"""After this time all vehicles are on the ground."""
FLAGS = {
    "estimator_status_flags": (
        "cs_gnss_pos", "cs_gnss_vel", "cs_gps_hgt", "cs_baro_hgt", "cs_baro_fault", "cs_fake_hgt",
        "cs_valid_fake_pos", "cs_mag", "cs_mag_3d", "cs_mag_aligned_in_flight", "cs_mag_heading_consistent",
        "cs_mag_field_disturbed", "cs_inertial_dead_reckoning", "cs_vehicle_at_rest", "cs_in_air",
        "fs_bad_acc_vertical",
    ),
    "vehicle_local_position_flags": ("xy_valid", "z_valid", "heading_reset_counter", "xy_reset_counter",
                                     "z_reset_counter", "heading_good_for_control"),
    "vehicle_status": ("nav_state", "arming_state", "failsafe"),
    "vehicle_land_detected": ("landed", "ground_contact"),
    "failsafe_flags": ("battery_warning",),
}  # fmt: skip
"""The compared flags; the recordings have the time of each change."""
TEXT_CHARS = 50
"""Compared length of a STATUSTEXT's first part."""
MAX_REPEATS = 4
"""Number of compared changes of a flag to the same value, and of resets of a kind."""
EVENTS = (
    "check_estimator_gnss_fusion_stopped", "check_estimator_gnss_fusion_started",
    "commander_landing_detected", "commander_disarmed_by", "commander_armed_by",
    "commander_arm_denied_resolve_failures", "commander_failsafe_enter_autopilot_disengaged",
    "commander_failsafe_enter", "commander_failsafe_enter_hold", "commander_failsafe_enter_low_bat",
    "commander_failsafe_enter_crit_bat_warn", "commander_failsafe_enter_crit_low_bat_warn",
    "commander_failsafe_enter_generic_warn", "commander_low_bat_shutdown_failed",
    "sensor_failover_baro", "sensor_failover_mag", "check_baro_no_data",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FaultFlight:
    """Reports and errors of one flight after a fault; the keys are the names in the recordings."""

    moments_s: dict[str, float]
    """Time of each flag change ("xy_valid=0"; "xy_valid=0 (2)" the second time), event and text."""
    errors_at: dict[float, dict[str, float]]
    """Errors, accuracies, tilt and speed by time [s]; the keys are those of the recordings' summary."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A fault, its stimulus, and PX4's two runs."""

    name: str
    parameters: dict[str, Any]
    stimulus: list[dict[str, Any]]
    flies: bool
    after_boot_s: float
    """Time from boot to the fault; the mean of the runs."""
    ends_s: float
    """Last compared time after the fault."""
    runs: tuple[FaultFlight, ...]


def load(name: str, folder: Path = FAULTS) -> Scenario:
    """Reads the recordings of a fault."""
    runs = [_read(path) for path in sorted((folder / "data").glob(f"{name}.run*.json.gz"))]
    first = runs[0]
    first_row = next(row for row in first["rows"] if row[0] >= 0.0)
    return Scenario(
        name,
        first["header"]["boot_parameters"],
        first["stimulus"],
        bool(first_row[first["columns"].index("armed")]),
        sum(run["header"]["time_boot_s_at_t0"] for run in runs) / len(runs),
        min(MAX_TIME_S, *(float(run["rows"][-1][0]) for run in runs)),
        tuple(map(_flight, runs)),
    )


def load_reduced(name: str) -> Scenario:
    """Reads a fault from the reduced recordings in `tests/data`."""
    reduced = json.loads(REDUCED_FILE.read_text(encoding="utf-8"))[name]
    runs = [
        FaultFlight(run["moments_s"], {float(at): values for at, values in run["at"].items()})
        for run in reduced.pop("runs")
    ]
    return Scenario(**reduced, runs=tuple(runs))


def names(folder: Path = FAULTS) -> list[str]:
    """Names of all recorded faults."""
    return sorted({path.name.split(".")[0] for path in (folder / "data").glob("*.json.gz")})


def record_change(moments: dict[str, float], change: str, t_s: float) -> None:
    """Adds the time of a change of a flag; the key of a repeated change has a number."""
    for count in range(1, MAX_REPEATS + 1):
        key = change if count == 1 else f"{change} ({count})"
        if key not in moments:
            moments[key] = t_s
            return


def is_compared(text: str) -> bool:
    """Whether a text is compared. Texts about the ground station are not compared, because its messages had
    gaps in the recordings."""
    return not any(word in text.lower() for word in ("ground", "gcs"))


def compared_text(text: str) -> str:
    """The compared part of a text: its beginning, without heights."""
    return re.sub(r"\d+ m\b", "… m", text[:TEXT_CHARS]).strip()


def _read(path: Path) -> dict[str, Any]:
    return json.loads(gzip.decompress(path.read_bytes()))


def _flight(run: dict[str, Any]) -> FaultFlight:
    moments: dict[str, float] = {}
    for table, fields in FLAGS.items():
        for t_s, field, value in run["onboard"].get(table, {"changes": []})["changes"]:
            if field in fields and t_s is not None and t_s >= 0.0:
                record_change(
                    moments, f"{field}+" if field.endswith("_counter") else f"{field}={value:g}", t_s
                )
    for message in run["messages"]:
        if message["t_s"] < 0.0:
            continue
        if message["message"] == "EVENT" and message["name"] in EVENTS:
            moments.setdefault("event:" + message["name"], message["t_s"])
        elif message["message"] == "STATUSTEXT" and not message["chunk"] and is_compared(message["text"]):
            moments.setdefault("text:" + compared_text(message["text"]), message["t_s"])
    keys = run["summary"]["columns"]
    at = {float(row[0]): dict(zip(keys[1:], row[1:], strict=True)) for row in run["summary"]["rows"]}
    for values in at.values():
        # The sign of the heading error is random.
        values["yaw_error_deg"] = abs(values["yaw_error_deg"])
    return FaultFlight(moments, {t_s: values for t_s, values in at.items() if t_s in TIMES_S})
