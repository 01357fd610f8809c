"""Batteries that drain while armed, as PX4's battery simulator does: linearly, SIM_BAT_DRAIN seconds long.

From full to SIM_BAT_MIN_PCT while armed, full again as soon as disarmed; a floor that rises lifts the charge.
The voltage is linear in the charge between BAT1_V_EMPTY and BAT1_V_CHARGED a cell; the autopilot's estimate
of what remains follows it within a second. A current is not measured (-1), so nothing is counted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.masks import any_of
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import BatteryState

BoolArray = NDArray[np.bool_]

_CURRENT_NOT_MEASURED_A = -1.0
ESTIMATE_LAG_S = 1.0
"""Time constant of the estimate (recorded: 0.314, 0.173, 0.095 of an empty battery every 0.6 s)."""


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
        """(N,) 0..1, what the batteries hold; `state.remaining` is the estimate of it."""
        self._empty = np.zeros(count, dtype=np.bool_)
        """Whose battery shows the voltage of an empty one, whatever it holds."""
        self._by_hand = np.zeros(count, dtype=np.bool_)
        """Whose charge was set, and may lie below the floor."""
        self._follow = dt_s / (dt_s + ESTIMATE_LAG_S)
        self._drain_per_s = np.zeros(count)
        self._lowest = np.zeros(count)
        self._empty_v = np.zeros(count)
        self._span_v = np.zeros(count)
        self._was_armed = np.zeros(count, dtype=np.bool_)
        self._shown = self._charge
        """(N,) what the voltage says of the charge."""

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
        self._by_hand[i] = False

    def set_empty(self, i: int, empty: bool) -> None:
        """Let the battery of vehicle `i` show the voltage of an empty one, or its own again."""
        self._empty[i] = empty
        self._update_voltage()

    def set_remaining(self, i: int, remaining: float) -> None:
        """Set the charge of vehicle `i`, and the estimate of it; below SIM_BAT_MIN_PCT it stays there.

        Raises:
            ValueError: not within 0..1.
        """
        if not 0.0 <= remaining <= 1.0:
            raise ValueError(f"remaining is {remaining}; a battery's charge lies within 0..1")
        self._charge[i] = self.state.remaining[i] = remaining
        self._by_hand[i] = True
        self._update_voltage()

    def step(self, armed: BoolArray) -> None:
        """Drain the armed ones by one step; fill the one that was just disarmed."""
        charge, remaining = self._charge, self.state.remaining
        if any_of(armed):
            floor = np.where(self._by_hand, np.minimum(self._lowest, charge), self._lowest)
            drained = np.maximum(charge - self._drain_per_s * self._dt_s, floor)
            np.copyto(charge, drained, where=armed)
        if any_of(self._was_armed):
            disarmed = self._was_armed & ~armed
            if any_of(disarmed):
                charge[disarmed] = 1.0
                self._by_hand[disarmed] = False
        self._was_armed[:] = armed
        self._update_voltage()
        remaining += self._follow * (self._shown - remaining)

    def _update_voltage(self) -> None:
        self._shown = np.where(self._empty, 0.0, self._charge)
        np.multiply(self._shown, self._span_v, out=self.state.voltage_v)
        self.state.voltage_v += self._empty_v
