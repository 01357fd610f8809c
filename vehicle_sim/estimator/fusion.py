"""What each estimator fuses, refuses and has reset: the flags and counters that PX4's EKF2 reports."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HEIGHT_TIMEOUT_S = 5.0
"""A height source that was refused for so long is given up or believed (hgt_fusion_timeout_max)."""
RESET_TIMEOUT_S = 7.0
"""A source of position, velocity or heading that was refused for so long (reset_timeout_max)."""
HORIZON_S = 0.12
"""PX4 fuses what is so old (its delayed time horizon), and so notices that late what is missing."""
BAD_ACCEL_RESETS_AFTER_S = 0.5
_BAD_ACCEL_LASTS_S = 3.0
_COUNTERS = ("vxy_reset_counter", "vz_reset_counter", "xy_reset_counter", "z_reset_counter")
_FAILS, _CONFIRMS = 3.0, 1.0
"""Innovations over their sigma: one source fails, another of another kind bears it out."""


@dataclass(slots=True)
class Fusion:
    """Flags (N,) by the names of estimator_status_flags, counters (N,) by those of vehicle_local_position."""

    gnss_pos: BoolArray
    gnss_vel: BoolArray
    gps_hgt: BoolArray
    baro_hgt: BoolArray
    baro_fault: BoolArray
    fake_hgt: BoolArray
    valid_fake_pos: BoolArray
    gravity_vector: BoolArray
    mag: BoolArray
    mag_3d: BoolArray
    mag_hdg: BoolArray
    mag_dec: BoolArray
    mag_aligned_in_flight: BoolArray
    mag_heading_consistent: BoolArray
    mag_field_disturbed: BoolArray
    vehicle_at_rest: BoolArray
    in_air: BoolArray
    aided_once: BoolArray
    """GNSS has aided it since the start: what takes its place later is a reset."""
    vision_hgt: BoolArray
    dead_reckoning: BoolArray
    bad_acc_vertical: BoolArray
    heading_good_for_control: BoolArray
    gps_quality_bad: BoolArray
    """The newest fix does not meet EKF2_REQ_*."""
    gps_heard: BoolArray
    """Fixes arrive."""
    resets: IntArray
    """(4, N) the next four."""
    vxy_reset_counter: IntArray
    vz_reset_counter: IntArray
    xy_reset_counter: IntArray
    z_reset_counter: IntArray
    heading_reset_counter: IntArray
    height_fused_at_s: FloatArray
    """(N,) when any height was taken last."""
    accel_good_at_s: FloatArray
    """(N,) when vertical innovations last spoke for the accelerometer."""
    accel_bad_at_s: FloatArray
    height_shift_m: FloatArray
    """(N,) how far resets have moved the estimate down since the barometer was asked last."""

    def height_reset_due(self, now_s: float) -> BoolArray:
        """(N,) who has flown by inertia in height for too long, or by a bad accelerometer."""
        silent = now_s - self.height_fused_at_s > HEIGHT_TIMEOUT_S
        return silent | (now_s - self.accel_good_at_s > BAD_ACCEL_RESETS_AFTER_S)

    def judge_accelerometer(self, now_s: float, pressure: FloatArray, satellites: FloatArray) -> None:
        """Two kinds of height sources that both find the estimate falling speak against the accelerometer.

        Args:
            now_s: since boot.
            pressure: (N,) how far below the barometer's height it is, over the innovation's sigma.
            satellites: (N,) the same of GNSS height or velocity, whichever is greater.
        """
        worse, other = np.maximum(pressure, satellites), np.minimum(pressure, satellites)
        bad = (worse > _FAILS) & (other > _CONFIRMS)
        self.accel_bad_at_s[bad] = now_s
        self.accel_good_at_s[~bad] = now_s
        lasting = self.bad_acc_vertical & (now_s - self.accel_bad_at_s < _BAD_ACCEL_LASTS_S)
        np.copyto(self.bad_acc_vertical, bad | lasting)


def blank_fusion(count: int) -> Fusion:
    """Nothing is fused yet."""
    made: dict[str, np.ndarray] = {"resets": np.zeros((len(_COUNTERS), count), dtype=np.int64)}
    made |= {name: made["resets"][k] for k, name in enumerate(_COUNTERS)}
    made["heading_reset_counter"] = np.zeros(count, dtype=np.int64)
    for field in fields(Fusion):
        if field.name not in made:
            real = field.name.endswith(("_at_s", "_m"))
            made[field.name] = np.zeros(count, dtype=np.float64 if real else np.bool_)
    return Fusion(**made)


def forget(fusion: Fusion, i: int, now_s: float) -> None:
    """Vehicle `i` starts anew."""
    for field in fields(Fusion):
        getattr(fusion, field.name)[..., i] = now_s if field.name.endswith("_at_s") else 0
