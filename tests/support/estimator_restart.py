"""Restarts the estimators of a simulation, for tests that change the world in no simulated time."""

from __future__ import annotations

import numpy as np

from vehicle_sim.estimator.estimator import Estimator
from vehicle_sim.simulation import STEP_S, Simulation


def restart_estimator(simulation: Simulation) -> None:
    """Gives the estimators the state that they had at boot. Their arrays stay the same, because other parts
    have references to them."""
    fresh = Estimator(simulation.count, STEP_S)
    for row, parameters in enumerate(simulation.parameters):
        fresh.configure(row, parameters)
    _copy_arrays(simulation._estimator, fresh)


def _copy_arrays(target: object, source: object) -> None:
    names = getattr(target, "__slots__", None) or vars(target)
    for name in names:
        old, new = getattr(target, name), getattr(source, name)
        if isinstance(old, np.ndarray):
            old[...] = new
        elif type(old).__module__.startswith("vehicle_sim.estimator"):
            _copy_arrays(old, new)
