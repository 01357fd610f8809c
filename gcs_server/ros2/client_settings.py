"""Why a vehicle that is connected over MAVLink does not appear on a ROS 2 link: what its PX4 is set to.

PX4's client of ROS 2 has its domain, namespace and agent in parameters. While a ROS 2 link finds no vehicle,
the server reads them over MAVLink and names those that do not fit the link.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Final

from gcs_server.clock import Clock
from gcs_server.errors import GcsError
from gcs_server.mavlink.connection import Connection
from gcs_server.ros2.link import Ros2Link
from gcs_server.vehicle.endpoint import MAVLINK
from gcs_server.vehicle.vehicle import Vehicle

OFF, DOMAIN, NAMESPACE = "UXRCE_DDS_CFG", "UXRCE_DDS_DOM_ID", "UXRCE_DDS_NS_IDX"
AGENT_IP, AGENT_PORT, PARTICIPANT = "UXRCE_DDS_AG_IP", "UXRCE_DDS_PRT", "UXRCE_DDS_PTCFG"
NAMES: Final = (OFF, DOMAIN, NAMESPACE, AGENT_IP, AGENT_PORT, PARTICIPANT)
LOCALHOST_ONLY: Final = 1
"""Value of UXRCE_DDS_PTCFG with which the agent keeps the topics on its own computer."""
EMPTY_FOR_S: Final = 8.0
"""Time after which a link without a vehicle is explained [s]; PX4 publishes 6.4 s after its boot."""
CHECK_PERIOD_S: Final = 2.0
READ_AGAIN_S: Final = 60.0
MAX_VEHICLES: Final = 5
"""Maximum number of vehicles that are asked."""


@dataclass(slots=True)
class _Read:
    values: Mapping[str, int]
    at_s: float


class ClientSettings:
    """The settings of the vehicles' ROS 2 clients, read while a ROS 2 link finds no vehicle.

    Args:
        clock: clock of the server.
        vehicles: the current vehicles.
        connections: the current links.
    """

    def __init__(
        self,
        clock: Clock,
        vehicles: Callable[[], Sequence[Vehicle]],
        connections: Callable[[], Sequence[Connection]],
    ) -> None:
        self._clock, self._vehicles, self._connections = clock, vehicles, connections
        self._empty_since_s: dict[str, float] = {}
        """By name of a link that is open and has no vehicle."""
        self._read: dict[str, _Read] = {}
        """By vehicle."""

    async def run(self) -> None:
        """Reads settings while there is a link to explain."""
        while True:
            await self.update()
            await self._clock.sleep(CHECK_PERIOD_S)

    async def update(self) -> None:
        """Reads the settings of the vehicles that no ROS 2 link has found, if that is unknown or old."""
        now_s = self._clock.monotonic_s()
        infos = [each.info() for each in self._links()]
        empty = [each.name for each in infos if each.state == "open" and not each.peers]
        self._empty_since_s = {name: self._empty_since_s.get(name, now_s) for name in empty}
        asked = [each.id for each in self._unfound()]
        self._read = {name: each for name, each in self._read.items() if name in asked}
        for vehicle in self._unfound():
            known = self._read.get(vehicle.id)
            if known is None or now_s - known.at_s > READ_AGAIN_S:
                self._read[vehicle.id] = _Read(await _read(vehicle), now_s)

    def warnings(self) -> list[str]:
        """A text for each vehicle that no ROS 2 link has found."""
        links, unfound = self._explained(), [each.id for each in self._unfound()]
        texts = [(each, explain(self._read[each].values, links)) for each in unfound if each in self._read]
        return [f"Vehicle {each} is on no ROS 2 link: {text}" for each, text in texts if text]

    def _links(self) -> list[Ros2Link]:
        return [each.link for each in self._connections() if isinstance(each.link, Ros2Link)]

    def _explained(self) -> list[Ros2Link]:
        now_s = self._clock.monotonic_s()
        return [
            each for each in self._links() if now_s - self._empty_since_s.get(each.name, now_s) >= EMPTY_FOR_S
        ]

    def _unfound(self) -> list[Vehicle]:
        if not self._explained():
            return []
        return [
            each
            for each in self._vehicles()
            if each.reach.protocols == (MAVLINK,) and each.identity.commandable and not each.status.link_lost
        ][:MAX_VEHICLES]


async def _read(vehicle: Vehicle) -> Mapping[str, int]:
    """The client's parameters; those that PX4 does not have are missing."""

    async def read(name: str) -> int | None:
        with suppress(GcsError):
            return int((await vehicle.params.get(name)).value)
        return None

    values = await asyncio.gather(*map(read, NAMES))
    return {name: value for name, value in zip(NAMES, values, strict=True) if value is not None}


def explain(values: Mapping[str, int], links: Sequence[Ros2Link]) -> str:
    """What keeps a PX4 from the links, as sentences; empty: it has reported no domain.

    Args:
        values: the client's parameters by name, as far as PX4 has them.
        links: the ROS 2 links on which it was not found.
    """
    domain = values.get(DOMAIN)
    if domain is None:
        return ""
    causes: list[str] = []
    if values.get(OFF) == 0:
        causes.append(f"its ROS 2 client is off ({OFF} is 0).")
    here = [each for each in links if each.domain_id == domain]
    index = values.get(NAMESPACE, -1)
    if not here:
        causes.append(
            f"it publishes in DDS domain {domain} ({DOMAIN}), which no link reads; add ros2://{domain}."
        )
    elif index >= 0 and all(each.namespace not in (None, f"uav_{index}") for each in here):
        causes.append(f"its namespace is /uav_{index} ({NAMESPACE}), which no link reads.")
    elif values.get(PARTICIPANT) == LOCALHOST_ONLY and all(each.interface for each in here):
        causes.append(
            f"its topics stay on the agent's computer ({PARTICIPANT} is 1); open the link without interface."
        )
    if causes:
        return " ".join(causes)
    return (
        f"its domain {domain} is that of the link, so its client does not reach an agent"
        f"{_agent_text(values)}. Start one (MicroXRCEAgent udp4 -p 8888); `uxrce_dds_client status` in PX4's "
        "console shows where PX4 looks for it."
    )


def _agent_text(values: Mapping[str, int]) -> str:
    ip, port = values.get(AGENT_IP), values.get(AGENT_PORT)
    if ip is None or port is None:
        return ""
    return f" at {IPv4Address(ip % 2**32)}, UDP port {port} ({AGENT_IP}, {AGENT_PORT})"
