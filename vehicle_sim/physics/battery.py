"""Batteries that drain while armed, as PX4's battery simulator does: linearly, SIM_BAT_DRAIN seconds long.

From full to SIM_BAT_MIN_PCT while armed, full again as soon as disarmed. The voltage is linear in the charge
between BAT1_V_EMPTY and BAT1_V_CHARGED a cell. A current is not measured (-1), so nothing is counted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.masks import any_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import BatteryState

BoolArray = NDArray[np.bool_]

_CURRENT_NOT_MEASURED_A = -1.0


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
        self._drain_per_s = np.zeros(count)
        self._lowest = np.zeros(count)
        self._empty_v = np.zeros(count)
        self._span_v = np.zeros(count)
        self._was_armed = np.zeros(count, dtype=np.bool_)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read SIM_BAT_* and BAT1_* of vehicle `i`."""
        cells = max(1, int(parameters.get("BAT1_N_CELLS")))
        empty, charged = parameters.usable("BAT1_V_EMPTY"), parameters.usable("BAT1_V_CHARGED")
        drain_s = parameters.usable("SIM_BAT_DRAIN")
        drains = parameters.get("SIM_BAT_ENABLE") != 0 and drain_s > 0.0
        self.state.cell_count[i] = cells
        self._drain_per_s[i] = 1.0 / drain_s if drains else 0.0
        self._lowest[i] = min(1.0, max(0.0, parameters.usable("SIM_BAT_MIN_PCT") / 100.0))
        self._empty_v[i] = empty * cells
        self._span_v[i] = (charged - empty) * cells
        self._update_voltage()

    def refill(self, i: int) -> None:
        """Full charge for vehicle `i`."""
        self.set_remaining(i, 1.0)

    def set_remaining(self, i: int, remaining: float) -> None:
        """Set the charge of vehicle `i`.

        Raises:
            ValueError: not within 0..1.
        """
        if not 0.0 <= remaining <= 1.0:
            raise ValueError(f"remaining is {remaining}; a battery's charge lies within 0..1")
        self.state.remaining[i] = remaining
        self._update_voltage()

    def step(self, armed: BoolArray) -> None:
        """Drain the armed ones by one step; fill the one that was just disarmed."""
        state = self.state
        if any_of(armed):
            drained = state.remaining - self._drain_per_s * self._dt_s
            floor = np.minimum(self._lowest, state.remaining)
            np.copyto(state.remaining, np.maximum(drained, floor), where=armed)
            self._update_voltage()
        if any_of(self._was_armed):
            disarmed = self._was_armed & ~armed
            if any_of(disarmed):
                state.remaining[disarmed] = 1.0
                self._update_voltage()
        self._was_armed[:] = armed

    def _update_voltage(self) -> None:
        np.multiply(self.state.remaining, self._span_v, out=self.state.voltage_v)
        self.state.voltage_v += self._empty_v
