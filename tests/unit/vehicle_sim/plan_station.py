"""A ground station that uploads plans: missions, fences and rally points around the vehicle's home."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tests.unit.vehicle_sim.sim_station import NAN, Station
from vehicle_sim.geodesy import to_global

MISSION_MODE, TERMINATION_MODE = 0x4040000, 0x0A0000
"""Custom modes."""
MISSION_START = 300
"""MAV_CMD_MISSION_START."""


class PlanStation(Station):
    """A `Station` that uploads plans on one link; positions are metres north and east of home."""

    def __init__(self, **station: Any) -> None:
        super().__init__(links=(("gcs", "gcs"),), **station)

    def wait_until_ready_to_arm(self) -> None:
        """Waits until the vehicle can be armed."""
        self.run_until(lambda: self.can_be_armed, 15)
        self.run(1.0)

    def item(
        self,
        command: int,
        north_m: float = 0.0,
        east_m: float = 0.0,
        alt_home_m: float = 10.0,
        *,
        parameters: Sequence[float] = (0.0, 0.0, 0.0, NAN),
        frame: int = 6,
    ) -> dict[str, Any]:
        home = self.sim.autopilots[0].home
        lat, lon = to_global(north_m, east_m, home.lat_deg, home.lon_deg)  # type: ignore[arg-type]
        x, y = (0, 0) if frame == 2 else (round(float(lat) * 1e7), round(float(lon) * 1e7))
        z = 0.0 if frame == 2 else alt_home_m
        return {
            "command": command, "frame": frame, "x": x, "y": y, "z": z, "autocontinue": 1, "current": 0,
            **{f"param{n}": value for n, value in enumerate(parameters, start=1)},
        }  # fmt: skip

    def command_item(self, command: int, *parameters: float) -> dict[str, Any]:
        """An item without a position."""
        return self.item(command, parameters=(*parameters, 0.0, 0.0, 0.0, 0.0)[:4], frame=2)

    def upload(self, items: Sequence[dict[str, Any]], kind: int = 0) -> int:
        """Uploads a plan whose first item is marked as current; returns the type of MISSION_ACK."""
        begin_s = self.now_s
        self.send("MISSION_COUNT", target_system=1, target_component=1, count=len(items), mission_type=kind)
        for seq, item in enumerate(items):
            self.send(
                "MISSION_ITEM_INT", target_system=1, target_component=1, seq=seq, mission_type=kind,
                **item | {"current": int(seq == 0)},
            )  # fmt: skip
        self.run(0.1)
        return self.received("MISSION_ACK", since_s=begin_s)[-1].type

    def start_mission(self) -> None:
        self.command(MISSION_START)
        self.run(0.1)
        assert self.acks(MISSION_START)[-1] == 0
        assert self.active_mode == MISSION_MODE

    @property
    def mission(self) -> Any:
        return self.sim.autopilots[0].navigator.mission

    def reached_items(self) -> list[int]:
        """Reached items in order, each once."""
        items: list[int] = []
        for message in self.received("MISSION_ITEM_REACHED"):
            if not items or items[-1] != message.seq:
                items.append(message.seq)
        return items

    @property
    def position_ne_m(self) -> tuple[float, float]:
        north, east, _ = self.sim.simulation.truth.position_ned_m[0].tolist()
        return north, east
