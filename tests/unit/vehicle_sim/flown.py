"""Hovering vehicles for tests that begin in the air: each is flown up once, and every test gets a copy."""

from typing import Any, TypeVar

from tests.support.snapshot import snapshot
from tests.unit.vehicle_sim.sim_station import Station

S = TypeVar("S", bound=Station)
_FLOWN: dict[tuple[Any, ...], Any] = {}


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
