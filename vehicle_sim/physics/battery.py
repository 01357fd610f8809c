"""Batteries that drain linearly while armed, as in PX4's battery simulator.

A full battery would be empty after SIM_BAT_DRAIN seconds, but the charge stops at SIM_BAT_MIN_PCT. Disarming
restores full charge. While armed, the charge rises if SIM_BAT_MIN_PCT is set above the charge. The voltage is
linear in the charge, from BAT1_V_EMPTY to BAT1_V_CHARGED per cell. The autopilot's estimate follows the
charge with a lag of about a second. The current is not measured (-1), so consumption is not counted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.masks import any_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import BatteryState

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]

_CURRENT_NOT_MEASURED_A = -1.0
FULL_CURRENT_A = 60.0
"""Current of four motors at full signal, for batteries with a resistance: a quadrotor of one kilogram that
hovers at half thrust needs about 15 A. PX4's simulation has no current."""
ESTIMATE_LAG_S = 1.0
"""Time constant of the estimate. The recorded estimate fell from 0.314 to 0.173 and 0.095 in steps of 0.6 s,
after the battery was set to empty."""


class Batteries:
    """The batteries of N vehicles.

    Args:
        count: N.
        dt_s: step.
    """

    def __init__(self, count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self.state = BatteryState(
            voltage_v=np.zeros(count),
            current_a=np.full(count, _CURRENT_NOT_MEASURED_A),
            remaining=np.ones(count),
            consumed_mah=np.zeros(count),
            cell_count=np.ones(count, dtype=np.int64),
        )
        self._charge = np.ones(count)
        """(N,) true charge, 0..1; `state.remaining` is the autopilot's estimate."""
        self._forced_empty = np.zeros(count, dtype=np.bool_)
        """(N,) batteries set to empty: they have the voltage of an empty battery at any charge."""
        self._charge_was_set = np.zeros(count, dtype=np.bool_)
        """(N,) batteries whose charge was set with `set_remaining`; the charge may be below the minimum."""
        self._estimate_gain = dt_s / (dt_s + ESTIMATE_LAG_S)
        self._drain_per_s = np.zeros(count)
        self._min_charge = np.zeros(count)
        self._empty_v = np.zeros(count)
        self._voltage_range_v = np.zeros(count)
        self._resistance_ohm = np.zeros(count)
        """(N,) internal resistance of batteries whose current is measured; 0: not measured."""
        self._was_armed = np.zeros(count, dtype=np.bool_)
        self._charge_of_voltage = self._charge
        """(N,) charge that corresponds to the voltage; 0 for a battery set to empty."""

    def configure(self, i: int, parameters: Parameters) -> None:
        """Reads SIM_BAT_* and BAT1_* of vehicle `i`."""
        cells = max(1, int(parameters.get("BAT1_N_CELLS")))
        cell_empty_v = parameters.finite_value("BAT1_V_EMPTY")
        cell_charged_v = parameters.finite_value("BAT1_V_CHARGED")
        drain_s = parameters.finite_value("SIM_BAT_DRAIN")
        drains = parameters.get("SIM_BAT_ENABLE") != 0 and drain_s > 0.0
        self.state.cell_count[i] = cells
        self._drain_per_s[i] = 1.0 / drain_s if drains else 0.0
        self._min_charge[i] = min(1.0, max(0.0, parameters.finite_value("SIM_BAT_MIN_PCT") / 100.0))
        self._empty_v[i] = cell_empty_v * cells
        self._voltage_range_v[i] = (cell_charged_v - cell_empty_v) * cells
        self._update_voltage()

    def set_empty(self, i: int, empty: bool) -> None:
        """Gives the battery of vehicle `i` the voltage of an empty battery, or of its charge again."""
        self._forced_empty[i] = empty
        self._update_voltage()

    def set_remaining(self, i: int, remaining: float) -> None:
        """Sets the charge of vehicle `i` and its estimate; a charge below SIM_BAT_MIN_PCT stays constant.

        Raises:
            ValueError: `remaining` is not within 0..1.
        """
        if not 0.0 <= remaining <= 1.0:
            raise ValueError(f"remaining is {remaining}; a battery's charge lies within 0..1")
        self._charge[i] = self.state.remaining[i] = remaining
        self._charge_was_set[i] = True
        self._update_voltage()

    def set_resistance(self, i: int, ohm: float) -> None:
        """Gives the battery of vehicle `i` an internal resistance and a measured current; 0: neither."""
        self._resistance_ohm[i] = ohm
        self.state.current_a[i] = 0.0 if ohm > 0.0 else _CURRENT_NOT_MEASURED_A

    def step(self, armed: BoolArray, motor_signal: FloatArray) -> None:
        """Drains the batteries of armed vehicles by one step; refills the batteries of vehicles that were
        just disarmed. `motor_signal` (N, 4), 0..1, makes the current of batteries with a resistance."""
        charge, remaining = self._charge, self.state.remaining
        if any_of(armed):
            lowest = np.where(self._charge_was_set, np.minimum(self._min_charge, charge), self._min_charge)
            drained = np.maximum(charge - self._drain_per_s * self._dt_s, lowest)
            np.copyto(charge, drained, where=armed)
        if any_of(self._was_armed):
            disarmed = self._was_armed & ~armed
            if any_of(disarmed):
                charge[disarmed] = 1.0
                self._charge_was_set[disarmed] = False
        self._was_armed[:] = armed
        measured = self._resistance_ohm > 0.0
        if any_of(measured):
            state, current_a = self.state, FULL_CURRENT_A / 4.0 * np.sum(motor_signal**2, axis=1)
            np.copyto(state.current_a, current_a, where=measured)
            state.consumed_mah += np.where(measured, current_a * self._dt_s / 3.6, 0.0)
        self._update_voltage()
        remaining += self._estimate_gain * (self._charge_of_voltage - remaining)

    def _update_voltage(self) -> None:
        self._charge_of_voltage = np.where(self._forced_empty, 0.0, self._charge)
        np.multiply(self._charge_of_voltage, self._voltage_range_v, out=self.state.voltage_v)
        self.state.voltage_v += self._empty_v
        if any_of(self._resistance_ohm > 0.0):
            self.state.voltage_v -= self._resistance_ohm * np.maximum(self.state.current_a, 0.0)
