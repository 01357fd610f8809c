"""Who publishes what in a DDS domain, and why topics are empty or setpoints do nothing: for `gcs doctor ros2`
and the page. Pure functions."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from typing import Final

from gcs_server.ros2.formats import REQUEST, RESPONSE, TopicFormat, VehicleFormats
from gcs_server.ros2.inspection import Announcement, ros_name
from gcs_server.ros2.message_types import VERSIONS
from gcs_server.ros2.topics import VehicleTopic, parse_topic

EXCHANGE: Final = frozenset({REQUEST, RESPONSE})
OFFBOARD: Final = "/fmu/in/offboard_control_mode"
"""Published by programs that fly in Offboard. Programs with a mode of their own publish only setpoints, and
take turns."""


def report(
    endpoints: Iterable[Announcement], formats: Mapping[str, VehicleFormats]
) -> tuple[list[str], list[str]]:
    """Facts and problems of one domain, as texts.

    Args:
        endpoints: the writers and readers of other programs.
        formats: the vehicles' layouts by namespace.
    """
    known = [each for each in endpoints if each.topic is not None]
    participants = {each.participant for each in known}
    facts = [f"{len(participants)} programs, {len(known)} publishers and subscribers"]
    problems: list[str] = []
    for namespace, vehicle in sorted(formats.items()):
        name = f"/{namespace}" if namespace else "without namespace"
        versions = versions_with(vehicle.usable.values())
        facts.append(
            f"vehicle {name}: {len(vehicle.usable)} topics with confirmed layouts"
            + (f", those of PX4 {versions}" if versions else "")
        )
        problems += vehicle.problems()
    return facts, [*problems, *reasons(known, sorted(formats))]


def versions_with(confirmed: Iterable[TopicFormat]) -> str:
    """The versions of PX4 that have all layouts which a vehicle has confirmed; empty: none, or nothing is
    confirmed."""
    layouts = {(each.type, each.message_hash) for each in confirmed}
    matching = [
        version
        for version, types in VERSIONS.items()
        if layouts and all(kind in types and types[kind].hash == value for kind, value in layouts)
    ]
    return " or ".join(version if version == "main" else f"v{version}" for version in sorted(matching))


def reasons(endpoints: Iterable[Announcement], vehicles: list[str]) -> Iterable[str]:
    """Why topics are empty or setpoints do nothing: topics that do not meet, and programs that compete."""
    known = tuple(endpoints)
    return itertools.chain(unmatched(known, vehicles), competing(known))


def competing(endpoints: Iterable[Announcement]) -> Iterable[str]:
    """A text for each vehicle that several programs fly in Offboard; one of them may be this server."""
    programs: dict[str, set[str]] = {}
    for each in endpoints:
        parsed = None if each.topic is None or not each.publishes else parse_topic(each.topic.name)
        if each.topic is not None and parsed is not None and parsed.base == OFFBOARD:
            programs.setdefault(ros_name(each.topic.name), set()).add(each.participant)
    for topic, publishers in sorted(programs.items()):
        if len(publishers) > 1:
            yield (
                f"{len(publishers)} programs publish {topic}: PX4 follows whichever setpoint comes last, so "
                "only one of them may run."
            )


def unmatched(endpoints: Iterable[Announcement], vehicles: list[str]) -> Iterable[str]:
    """A text for each topic that a program uses, and that no vehicle has with this name and type."""
    by_topic: dict[str, dict[bool, set[str]]] = {}
    for each in endpoints:
        if each.topic is not None:
            sides = by_topic.setdefault(each.topic.name, {True: set(), False: set()})
            sides[each.publishes].add(each.topic.type)
    places = ", ".join(f"/{each}" if each else "/" for each in vehicles) or "none"
    for topic, sides in sorted(by_topic.items()):
        parsed = parse_topic(topic)
        if parsed is None or parsed.base in EXCHANGE:
            continue
        to_vehicle = parsed.base.startswith("/fmu/in/")
        program, vehicle = sides[to_vehicle], sides[not to_vehicle]
        does = "publishes" if to_vehicle else "subscribes to"
        if program and not vehicle:
            lacks = "subscribes to" if to_vehicle else "publishes"
            yield (
                f"a program {does} {ros_name(topic)}, but no vehicle {lacks} it"
                f"{_other_name(parsed, by_topic)}. Namespaces of vehicles in this domain: {places}."
            )
        elif program and not program & vehicle:
            types = f"{', '.join(sorted(program))} instead of {', '.join(sorted(vehicle))}"
            yield f"a program {does} {ros_name(topic)} with the type {types}."


def _other_name(topic: VehicleTopic, by_topic: Mapping[str, Mapping[bool, set[str]]]) -> str:
    """The names under which vehicles have the same topic: another namespace or version."""
    is_input = topic.base.startswith("/fmu/in/")
    others = [
        ros_name(name)
        for name, sides in by_topic.items()
        if (parsed := parse_topic(name)) is not None and parsed.base == topic.base and sides[not is_input]
    ]
    return f"; use {' or '.join(sorted(others))}" if others else ""
