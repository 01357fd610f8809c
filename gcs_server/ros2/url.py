"""The URL of a ROS 2 link: `ros2://DOMAIN[/NAMESPACE][?interface=NAME]`, with `guard=` of a guarded one."""

from __future__ import annotations

import importlib.util
import re
from typing import TYPE_CHECKING, Final
from urllib.parse import SplitResult, unquote

from gcs_server.errors import InvalidRequest, LinkError
from gcs_server.links.names import derived_name
from gcs_server.links.url import GUARD_OPTIONS
from gcs_server.ros2.guard_link import Ros2GuardLink, open_relay
from gcs_server.ros2.link import Ros2Link
from gcs_server.ros2.topics import MAX_NAMESPACE, is_namespace

if TYPE_CHECKING:
    from gcs_server.ros2.dds import DdsPort

MAX_DOMAIN: Final = 232
"""Highest domain number whose UDP ports exist (DDSI-RTPS 2.5, 9.6.2)."""
INSTALL: Final = "Install Cyclone DDS with: pip install '.[ros2]'"
REMEDY: Final = "Examples: ros2://0, ros2://0/px4_1, ros2://0?interface=eth0."


def ros2_link(
    url: str, name: str | None, parts: SplitResult, options: dict[str, str], own_system_id: int
) -> Ros2Link | Ros2GuardLink:
    """Creates the link of a `ros2://` URL, without starting it.

    Args:
        url: the whole URL.
        name: name of the link; None: derived from the URL.
        parts: the URL's parts.
        options: the URL's options.
        own_system_id: the server's system id.

    Raises:
        InvalidRequest: the URL is not valid.
        LinkError: Cyclone DDS is not installed.
    """
    guarded = "guard" in options
    for key in options.keys() - ({"interface"} | (GUARD_OPTIONS if guarded else frozenset[str]())):
        raise InvalidRequest("url", f"{url!r}: ros2 links have no option {key!r}.", remedy=REMEDY)
    domain = parts.netloc
    if not re.fullmatch(r"[0-9]{1,3}", domain) or int(domain) > MAX_DOMAIN:
        raise InvalidRequest(
            "url", f"{url!r}: the DDS domain must be a number from 0 to {MAX_DOMAIN}.", remedy=REMEDY
        )
    namespace = unquote(parts.path).strip("/") or None
    if namespace is not None and not is_namespace(namespace):
        raise InvalidRequest(
            "url",
            f"{url!r}: the namespace must have 1 to {MAX_NAMESPACE} letters, digits and '_', and '/' between "
            "its parts; a part does not begin with a digit.",
            remedy=REMEDY,
        )
    interface = options.get("interface")
    if interface is not None and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._:@-]{0,63}", interface):
        raise InvalidRequest(
            "url", f"{url!r}: interface must be the name of a network interface.", remedy=REMEDY
        )
    if importlib.util.find_spec("cyclonedds") is None:
        raise LinkError("A ros2:// link needs Cyclone DDS, which is not installed.", remedy=f"{INSTALL}.")
    name = name or derived_name(f"ros2-{domain}" + (f"-{namespace}" if namespace else ""))
    if guarded:
        return Ros2GuardLink(name, url, int(domain), namespace or "", interface, open_relay)
    return Ros2Link(name, url, int(domain), namespace, interface, _open_port, own_system_id)


def _open_port(domain_id: int, interface: str | None) -> DdsPort:
    from gcs_server.ros2.dds import DdsPort

    return DdsPort(domain_id, interface)
