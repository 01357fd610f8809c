"""Findings of the battery: sag, internal resistance, charge at the end."""

from __future__ import annotations

import numpy as np

from gcs_server.logbook.findings.model import (
    Finding,
    Flight,
    NotJudged,
    Signal,
    longest,
    spans,
    total_s,
)

RESISTANCE_PER_CELL_OHM = 0.020
"""PX4 assumes 5 mΩ a cell until it has measured ("Battery Estimation Tuning"); four times as much is a worn
battery."""
MIN_CURRENT_RANGE_A = 3.0
MIN_SAMPLES = 30
SAG_S = 2.0


def measured_voltage(flight: Flight) -> Signal:
    """Voltage of the pack [V]. Raises NotJudged."""
    voltage = flight.signal("battery_status/voltage_v", "SYS_STATUS/voltage_battery")
    return _scaled(voltage, 0.001) if flight.is_tlog else voltage


def measured_current(flight: Flight) -> Signal:
    """Current of the pack [A]; negative: not measured. Raises NotJudged."""
    current = flight.signal("battery_status/current_a", "SYS_STATUS/current_battery")
    return _scaled(current, 0.01) if flight.is_tlog else current


def _scaled(signal: Signal, factor: float) -> Signal:
    return Signal(signal.field, signal.times_s, signal.values * factor)


def _voltage(flight: Flight) -> tuple[Signal, int]:
    """Voltage of the pack, and its number of cells; 0: not known."""
    voltage = measured_voltage(flight)
    cells = flight.optional("battery_status/cell_count")
    known = 0.0 if cells is None else float(np.median(cells.values))
    known = known or flight.parameter("BAT1_N_CELLS", 0)
    return voltage, int(known) if 0 < known <= 48 else 0


def sag(flight: Flight) -> list[Finding]:
    """Voltage under load, beside the voltage of an empty cell (BAT1_V_EMPTY)."""
    voltage, cells = _voltage(flight)
    if not cells:
        raise NotJudged("The number of cells of the battery is not known (BAT1_N_CELLS).")
    empty_v = flight.parameter("BAT1_V_EMPTY", 3.6)
    mask = (voltage.values < empty_v * cells) & (voltage.values > 1.0) & flight.in_air(voltage.times_s)
    low = spans(voltage.times_s, mask, float(voltage.times_s[-1]), SAG_S)
    if not low:
        return []
    span = longest(low)
    least = float(np.min(voltage.between(span.begin_s, span.end_s).values)) / cells
    current = flight.optional("battery_status/current_a", "SYS_STATUS/current_battery")
    return [
        Finding(
            "warning", span.begin_s, span.end_s,
            f"The battery sagged to {least:.2f} V a cell in the air; it was too low for {total_s(low):.0f} "
            "s.",
            f"At least {empty_v:.2f} V a cell (BAT1_V_EMPTY).",
            "Land earlier, fly lighter, or use a larger or newer battery; check plugs and cables for heat.",
            [[voltage.field], *([[current.field]] if current is not None else [])],
        )
    ]  # fmt: skip


def resistance(flight: Flight) -> list[Finding]:
    """Internal resistance: how far the voltage falls with the current, beside the slow fall of the charge.

    Least squares of `voltage = a + b · charge − resistance · current` over the samples armed, with the
    integral of the current as charge.
    """
    voltage, cells = _voltage(flight)
    current = measured_current(flight)
    amperes = current.at(voltage.times_s)
    usable = flight.armed(voltage.times_s) & (amperes >= 0.0) & (voltage.values > 1.0)
    if not np.any(amperes > 0.0):
        raise NotJudged("The current of the battery is not measured.")
    if np.count_nonzero(usable) < MIN_SAMPLES or not cells:
        return []
    x, y, t_s = amperes[usable], voltage.values[usable], voltage.times_s[usable]
    if float(np.subtract(*np.percentile(x, [95, 5]))) < MIN_CURRENT_RANGE_A:
        return []
    used = np.concatenate(([0.0], np.cumsum(x[1:] * np.clip(np.diff(t_s), 0.0, 5.0))))
    design = np.stack((np.ones_like(x), used / max(float(used[-1]), 1.0), x), axis=1)
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    per_cell_ohm = -float(solution[2]) / cells
    if per_cell_ohm < RESISTANCE_PER_CELL_OHM:
        return []
    return [
        Finding(
            "caution", float(t_s[0]), float(t_s[-1]),
            f"The battery's internal resistance is {1000 * per_cell_ohm:.0f} mΩ a cell: at "
            f"{float(np.max(x)):.0f} A it lost {-float(solution[2]) * float(np.max(x)):.1f} V.",
            f"Below {1000 * RESISTANCE_PER_CELL_OHM:.0f} mΩ a cell (PX4, “Battery Estimation Tuning”: about "
            "5 mΩ; the limit is this station's).",
            "Use the battery no more for long or fast flights; check plugs and cables, which count too.",
            [[voltage.field], [current.field]],
        )
    ]  # fmt: skip


def charge(flight: Flight) -> list[Finding]:
    """Charge at the end of the flight, beside the level of the vehicle's own warning (BAT_CRIT_THR)."""
    remaining = flight.signal("battery_status/remaining", "SYS_STATUS/battery_remaining")
    share = remaining.values / (100.0 if flight.is_tlog else 1.0)
    limit = flight.parameter("BAT_CRIT_THR", 0.07)
    mask = (share <= limit) & (share >= 0.0) & flight.in_air(remaining.times_s)
    low = spans(remaining.times_s, mask, float(remaining.times_s[-1]), 1.0)
    if not low:
        return []
    least = float(np.min(share[mask]))
    return [
        Finding(
            "warning", low[0].begin_s, low[-1].end_s,
            f"The vehicle still flew with {100 * least:.0f} % of the battery.",
            f"Land before {100 * limit:.0f} % (BAT_CRIT_THR).",
            "Plan shorter flights or a larger reserve.",
            [[remaining.field], [_voltage(flight)[0].field]],
        )
    ]  # fmt: skip
