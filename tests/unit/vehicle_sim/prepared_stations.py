"""Ground stations whose vehicle is on the ground or hovers: each is prepared once; every test gets a copy."""

from typing import Any, TypeVar

from tests.support.snapshot import snapshot
from tests.unit.vehicle_sim.sim_station import Station

S = TypeVar("S", bound=Station)
_PREPARED: dict[tuple[Any, ...], Any] = {}


def station_on_ground(station_class: type[S], run_s: float = 12.0, **fleet: Any) -> S:
    """A station whose vehicle is on the ground and can be armed.

    Args:
        station_class: class of the station.
        run_s: time since boot.
        fleet: arguments of the station.
    """
    key = (station_class, f"on ground {run_s}", repr(sorted(fleet.items())))
    if key not in _PREPARED:
        _PREPARED[key] = station_class(**fleet)
        _PREPARED[key].run(run_s)
    return snapshot(_PREPARED[key])


def station_in_hover(
    station_class: type[S], height_m: float, parameters: dict[str, float] | None = None, **fleet: Any
) -> S:
    """A station whose vehicle hovers in Hold.

    Args:
        station_class: class of the station.
        height_m: height above home.
        parameters: parameters that are set while the vehicle hovers.
        fleet: arguments of the station.
    """
    key = (station_class, height_m, repr(sorted(fleet.items())))
    if key not in _PREPARED:
        station = _PREPARED[key] = station_class(**fleet)
        station.run_until(lambda: station.can_be_armed, 15)
        station.run(1.0)
        station.take_off_and_hover(height_m)
    copy = snapshot(_PREPARED[key])
    for name, value in (parameters or {}).items():
        copy.sim.simulation.parameters[0].set(name, value)
    return copy
