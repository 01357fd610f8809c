"""Ground stations whose vehicle is on the ground or hovers: each is prepared once; every test gets a copy."""

from typing import Any, TypeVar

from tests.support.snapshot import snapshot
from tests.unit.vehicle_sim.sim_station import Station

S = TypeVar("S", bound=Station)
_PREPARED: dict[tuple[Any, ...], Any] = {}


def on_ground(kind: type[S], run_s: float = 12.0, **fleet: Any) -> S:
    """A station whose vehicle is on the ground and can be armed.

    Args:
        kind: class of the station.
        run_s: time since boot.
        fleet: arguments of the station.
    """
    key = (kind, f"on ground {run_s}", repr(sorted(fleet.items())))
    if key not in _PREPARED:
        _PREPARED[key] = kind(**fleet)
        _PREPARED[key].run(run_s)
    return snapshot(_PREPARED[key])


def hovering(kind: type[S], height_m: float, parameters: dict[str, float] | None = None, **fleet: Any) -> S:
    """A station whose vehicle hovers in Hold.

    Args:
        kind: class of the station.
        height_m: height above home.
        parameters: parameters that are set while the vehicle hovers.
        fleet: arguments of the station.
    """
    key = (kind, height_m, repr(sorted(fleet.items())))
    if key not in _PREPARED:
        station = _PREPARED[key] = kind(**fleet)
        station.run_until(lambda: station.ready, 15)
        station.run(1.0)
        station.take_off_and_hover(height_m)
    copy = snapshot(_PREPARED[key])
    for name, value in (parameters or {}).items():
        copy.sim.simulation.parameters[0].set(name, value)
    return copy
