"""The UDP port on which PX4's client looks for its Micro XRCE-DDS Agent, and the one on which an agent
listens, as far as both run on this computer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import psutil

AGENT_PORT: Final = 8888
"""Usual UDP port of the agent."""


@dataclass(frozen=True, slots=True)
class UdpSocket:
    """A UDP socket of this computer."""

    program: str
    """Name of the program; empty: it belongs to another user."""
    port: int
    remote_port: int
    """Port to which it is connected; 0: it is not connected."""
    remote_is_local: bool


def agent_problems(sockets: Sequence[UdpSocket]) -> Iterable[str]:
    """Why no agent carries a PX4 of this computer: PX4 is connected to a port where nobody listens.

    Args:
        sockets: the UDP sockets of this computer; PX4's client connects its own to the agent. Empty: they
            could not be listed, so nothing is known.
    """
    if not sockets:
        return
    listening = {each.port for each in sockets if not each.remote_port}
    agents = sorted(
        {each.port for each in sockets if "xrce" in each.program.lower() and not each.remote_port}
    )
    where = f"; an agent listens on {', '.join(map(str, agents))}" if agents else ""
    missed = {each.remote_port for each in sockets if each.remote_is_local and each.program.startswith("px4")}
    for port in sorted(missed - listening):
        yield (
            f"PX4's client sends to UDP port {port}, where no program listens{where}. Start the agent with "
            f"-p {port}, or PX4's client with the agent's port."
        )
    if not missed and AGENT_PORT not in listening:
        yield f"no program listens on UDP port {AGENT_PORT}, the usual port of PX4's agent{where}."


def local_sockets() -> list[UdpSocket]:
    """The UDP sockets (IPv4) of this computer; none where the system does not let a user list them."""
    found: list[UdpSocket] = []
    with suppress(psutil.Error, OSError):
        for each in psutil.net_connections("udp4"):
            with suppress(psutil.Error):
                program = psutil.Process(each.pid).name() if each.pid else ""
                (_, port), (ip, remote_port) = each.laddr or ("", 0), each.raddr or ("", 0)
                found.append(UdpSocket(program, port, remote_port, ip.startswith("127.")))
    return found
