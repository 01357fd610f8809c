"""Detects resets of one vehicle's estimate; flight tasks shift their trajectories by each reset."""

from __future__ import annotations

from typing import NamedTuple

from vehicle_sim.autopilot.setpoint_writer import float_view
from vehicle_sim.frames import wrap_angle
from vehicle_sim.state import FloatArray
from vehicle_sim.vehicle_view import VehicleView


class Reset(NamedTuple):
    """The quantities that the estimator has reset since the last call of `EstimateResets.take`."""

    horizontal_velocity: bool
    vertical_velocity: bool
    horizontal_position: bool
    height: bool
    heading_rad: float
    """Change of the heading; 0 without a reset."""


class EstimateResets:
    """Compares the estimator's reset counters from one tick to the next.

    Args:
        view: the vehicle.
        heading_rad: (1,) array that stores the estimated heading of the last tick.
    """

    def __init__(self, view: VehicleView, heading_rad: FloatArray) -> None:
        self._view = view
        self._counts = self._counters()
        self._heading_rad = float_view(heading_rad)

    def _counters(self) -> list[int]:
        """Counters of horizontal velocity, vertical velocity, horizontal position, height, heading."""
        fusion, i = self._view.simulation.fusion, self._view.row
        return [*fusion.resets[:, i].tolist(), int(fusion.heading_reset_counter[i])]

    @property
    def counts(self) -> list[int]:
        """The counters at the last check."""
        return self._counts

    def discard(self) -> None:
        """Ignores all resets so far."""
        self._counts, self._heading_rad[0] = self._counters(), self._view.estimate.yaw_ned_rad

    def take(self) -> Reset | None:
        """The resets since the last call; None: no reset. Call it once per tick."""
        previous, self._counts = self._counts, self._counters()
        old_rad = self._heading_rad[0]
        new_rad = self._heading_rad[0] = self._view.estimate.yaw_ned_rad
        if self._counts == previous:
            return None
        changed = [new != old for new, old in zip(self._counts, previous, strict=True)]
        turned_rad = wrap_angle(new_rad - old_rad) if changed[4] else 0.0
        return Reset(changed[0], changed[1], changed[2], changed[3], turned_rad)
