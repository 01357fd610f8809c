"""State of each estimator's fusion: flags and counters as PX4's EKF2 reports them, and times of fusions."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HEIGHT_TIMEOUT_S = 5.0
"""If a height source is rejected for this long, its fusion stops if another source is fused; else the height
is reset to the source (hgt_fusion_timeout_max)."""
RESET_TIMEOUT_S = 7.0
"""If a position, velocity or heading is rejected for this long, the estimate is reset to it
(reset_timeout_max)."""
HORIZON_S = 0.12
"""PX4 fuses samples of this age (its delayed time horizon), so it detects missing samples this much later."""
_BAD_ACCEL_RESET_AFTER_S = 0.5
_BAD_ACCEL_HOLD_S = 3.0
_COUNTERS = ("vxy_reset_counter", "vz_reset_counter", "xy_reset_counter", "z_reset_counter")
_FAULT_SIGMA, _CONFIRMATION_SIGMA = 3.0, 1.0
"""Innovations in standard deviations. Above the first value one height source indicates a fault; above the
second value a source of the other kind (GNSS, barometer) confirms it."""


@dataclass(slots=True)
class Fusion:
    """Flags (N,) with the names of estimator_status_flags; counters (N,) with the names of
    vehicle_local_position; times since boot."""

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
    """GNSS has aided the estimate since boot; before, a reset to the last known position is not counted."""
    vision_hgt: BoolArray
    dead_reckoning: BoolArray
    bad_acc_vertical: BoolArray
    heading_good_for_control: BoolArray
    gps_quality_bad: BoolArray
    """The newest fix does not meet EKF2_REQ_*."""
    gps_receiving: BoolArray
    """The receiver sends fixes."""
    resets: IntArray
    """(4, N) array; its rows are the next four counters."""
    vxy_reset_counter: IntArray
    vz_reset_counter: IntArray
    xy_reset_counter: IntArray
    z_reset_counter: IntArray
    heading_reset_counter: IntArray
    height_fused_at_s: FloatArray
    """(N,) time of the last accepted height of any source."""
    accel_good_at_s: FloatArray
    """(N,) last time when the vertical innovations did not indicate an accelerometer fault."""
    accel_bad_at_s: FloatArray
    height_shift_m: FloatArray
    """(N,) how far resets have moved the estimate down since the last barometer fusion."""

    def height_reset_due(self, now_s: float) -> BoolArray:
        """(N,) vehicles whose height must be reset, because no height was accepted for too long or the
        accelerometer is faulty."""
        no_height = now_s - self.height_fused_at_s > HEIGHT_TIMEOUT_S
        return no_height | (now_s - self.accel_good_at_s > _BAD_ACCEL_RESET_AFTER_S)

    def check_accelerometer(self, now_s: float, baro_below: FloatArray, gnss_below: FloatArray) -> None:
        """Detects a faulty accelerometer, if barometer and GNSS both measure a height above the estimate.

        Args:
            now_s: time since boot.
            baro_below: (N,) how far the estimate is below the barometer's height, in standard deviations of
                the innovation.
            gnss_below: (N,) the same for GNSS height or vertical velocity, the greater of the two.
        """
        largest, smallest = np.maximum(baro_below, gnss_below), np.minimum(baro_below, gnss_below)
        bad = (largest > _FAULT_SIGMA) & (smallest > _CONFIRMATION_SIGMA)
        self.accel_bad_at_s[bad] = now_s
        self.accel_good_at_s[~bad] = now_s
        ongoing = self.bad_acc_vertical & (now_s - self.accel_bad_at_s < _BAD_ACCEL_HOLD_S)
        np.copyto(self.bad_acc_vertical, bad | ongoing)


def blank_fusion(count: int) -> Fusion:
    """Flags and counters before anything is fused."""
    values: dict[str, np.ndarray] = {"resets": np.zeros((len(_COUNTERS), count), dtype=np.int64)}
    values |= {name: values["resets"][k] for k, name in enumerate(_COUNTERS)}
    values["heading_reset_counter"] = np.zeros(count, dtype=np.int64)
    for field in fields(Fusion):
        if field.name not in values:
            is_float = field.name.endswith(("_at_s", "_m"))
            values[field.name] = np.zeros(count, dtype=np.float64 if is_float else np.bool_)
    return Fusion(**values)
