"""Whether a vehicle is proven to be simulated: its own word and that of its link are needed, because PX4 on a
Linux computer that flies reports the same identity as PX4's simulator."""

from __future__ import annotations

from collections.abc import Callable

from gcs_server.vehicle.vehicle import Vehicle

SendsFrom = Callable[[tuple[str, int] | None], bool]
"""Whether an address is that of a vehicle of the simulator which this server runs."""


def why_not_simulated(vehicle: Vehicle, sends_from: SendsFrom) -> str | None:
    """Why a vehicle is not proven to be simulated, as a sentence; None: it is."""
    identity = vehicle.identity
    if identity.replayed:
        return "It is a recording."
    if identity.simulated is None:
        return "It has not said yet what it is (AUTOPILOT_VERSION)."
    if not identity.simulated:
        return "It says that it is a real vehicle (AUTOPILOT_VERSION)."
    if not vehicle.endpoints:
        return "It is not connected."
    for endpoint in vehicle.endpoints:
        link = endpoint.connection.link
        if not (link.simulated or sends_from(endpoint.peer.address)):
            return (
                f"Link {link.name} may lead to a real vehicle: this server has not started a simulator "
                "there, and the link was not opened with simulated=1."
            )
    return None
