"""Faults that a real PX4 was recorded under, twice each: stimulus, what it reported, and the truth."""

from __future__ import annotations

import gzip
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FAULTS = Path(__file__).resolve().parents[3] / "shared" / "px4" / "faults"
THIN = Path(__file__).resolve().parents[1] / "data" / "faults.json"
"""Outlines of some recordings, as `load` reads them."""

TIMES_S = (1.0, 2.0, 3.0, 5.0, 8.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0)
"""Where errors are compared, seconds after the fault."""
LONGEST_S = 65.0
"""Nothing comes after that but vehicles that lie on the ground."""
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
"""What is compared of the flags that the recordings hold as changes."""
TEXT_CHARS = 50
"""Of a STATUSTEXT's first part."""
OFTEN = 4
"""So many changes of a flag to a value are compared, so many resets of a kind."""
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
class Course:
    """What happened in one flight after a fault, in the words of the recordings."""

    moments_s: dict[str, float]
    """When a flag took a value ("xy_valid=0", "xy_valid=0 (2)" the second time), an event or a text came."""
    at: dict[float, dict[str, float]]
    """By time [s]: errors, accuracies, tilt and speed; keys as in the recordings' summary."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A fault and PX4's two runs."""

    name: str
    parameters: dict[str, Any]
    stimulus: list[dict[str, Any]]
    flies: bool
    after_boot_s: float
    """When the fault came; the mean of the runs."""
    ends_s: float
    runs: tuple[Course, ...]


def load(name: str, folder: Path = FAULTS) -> Scenario:
    """Read the recordings of a fault."""
    runs = [_read(path) for path in sorted((folder / "data").glob(f"{name}.run*.json.gz"))]
    first = runs[0]
    now = next(row for row in first["rows"] if row[0] >= 0.0)
    return Scenario(
        name,
        first["header"]["boot_parameters"],
        first["stimulus"],
        bool(now[first["columns"].index("armed")]),
        sum(run["header"]["time_boot_s_at_t0"] for run in runs) / len(runs),
        min(LONGEST_S, *(float(run["rows"][-1][0]) for run in runs)),
        tuple(map(_course, runs)),
    )


def load_thin(name: str) -> Scenario:
    """A fault of those whose outline is kept beside the tests."""
    kept = json.loads(THIN.read_text(encoding="utf-8"))[name]
    runs = [
        Course(run["moments_s"], {float(at): values for at, values in run["at"].items()})
        for run in kept.pop("runs")
    ]
    return Scenario(**kept, runs=tuple(runs))


def names(folder: Path = FAULTS) -> list[str]:
    """All faults recorded."""
    return sorted({path.name.split(".")[0] for path in (folder / "data").glob("*.json.gz")})


def note(moments: dict[str, float], what: str, t_s: float) -> None:
    """Enter a change of a flag, as the first, second … of its kind."""
    for count in range(1, OFTEN + 1):
        key = what if count == 1 else f"{what} ({count})"
        if key not in moments:
            moments[key] = t_s
            return


def tells(text: str) -> bool:
    """Whether a text is compared: the recordings' ground station had pauses of its own."""
    return not any(word in text.lower() for word in ("ground", "gcs"))


def words(text: str) -> str:
    """What is compared of a text: its first part, without heights."""
    return re.sub(r"\d+ m\b", "… m", text[:TEXT_CHARS]).strip()


def _read(path: Path) -> dict[str, Any]:
    return json.loads(gzip.decompress(path.read_bytes()))


def _course(run: dict[str, Any]) -> Course:
    moments: dict[str, float] = {}
    for table, fields in FLAGS.items():
        for t_s, field, value in run["onboard"].get(table, {"changes": []})["changes"]:
            if field in fields and t_s is not None and t_s >= 0.0:
                note(moments, f"{field}+" if field.endswith("_counter") else f"{field}={value:g}", t_s)
    for message in run["messages"]:
        if message["t_s"] < 0.0:
            continue
        if message["message"] == "EVENT" and message["name"] in EVENTS:
            moments.setdefault("event:" + message["name"], message["t_s"])
        elif message["message"] == "STATUSTEXT" and not message["chunk"] and tells(message["text"]):
            moments.setdefault("text:" + words(message["text"]), message["t_s"])
    keys = run["summary"]["columns"]
    at = {float(row[0]): dict(zip(keys[1:], row[1:], strict=True)) for row in run["summary"]["rows"]}
    for values in at.values():
        # Which way the heading is off is chance.
        values["yaw_error_deg"] = abs(values["yaw_error_deg"])
    return Course(moments, {t_s: values for t_s, values in at.items() if t_s in TIMES_S})
