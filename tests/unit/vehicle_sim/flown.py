"""Vehicles on the ground or in hover: each is flown there once, and every test gets a copy."""

from typing import Any, TypeVar

from tests.support.snapshot import snapshot
from tests.unit.vehicle_sim.sim_station import Station

S = TypeVar("S", bound=Station)
_FLOWN: dict[tuple[Any, ...], Any] = {}


def standing(kind: type[S], run_s: float = 12.0, **fleet: Any) -> S:
    """A station whose vehicle has been on the ground for that long and can be armed.

    Args:
        kind: of the station.
        run_s: since boot.
        fleet: of the station, before boot.
    """
    key = (kind, f"standing {run_s}", repr(sorted(fleet.items())))
    if key not in _FLOWN:
        _FLOWN[key] = kind(**fleet)
        _FLOWN[key].run(run_s)
    return snapshot(_FLOWN[key])


def flown(kind: type[S], height_m: float, parameters: dict[str, float] | None = None, **fleet: Any) -> S:
    """A station whose vehicle hovers in Hold.

    Args:
        kind: of the station.
        height_m: above home.
        parameters: set once it hovers.
        fleet: of the station, before boot.
    """
    key = (kind, height_m, repr(sorted(fleet.items())))
    if key not in _FLOWN:
        station = _FLOWN[key] = kind(**fleet)
        station.run_until(lambda: station.ready, 15)
        station.run(1.0)
        station.fly_to(height_m)
    copy = snapshot(_FLOWN[key])
    for name, value in (parameters or {}).items():
        copy.sim.simulation.parameters[0].set(name, value)
    return copy
