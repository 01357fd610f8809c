"""A ROS 2 recording of PX4's topics as a log: topics and instances as in a ULog, one time for all, and the
states of each vehicle."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.log import MAX_DURATION_S, Column, Log, Topic, VehicleStates, usable_name
from gcs_server.logbook.states import ulog_states
from gcs_server.logbook.units import ulog_unit

CLOCKS_APART_S = 1.0
"""A sample's own time is used while it stays this close to the recorder's, but for a constant."""
KEPT_FRACTION = 0.98
"""So many of all samples must have usable times of their own; otherwise the recorder's are used."""
UNIX_S = (1e9, 4e9)
"""Plausible times of a recorder [s since 1970], 2001 to 2096."""
_PX4 = re.compile(r"^(?P<vehicle>(?:/\w+)*)/fmu/(?P<way>in|out)/(?P<name>\w+?)(?:_v\d+)?$")


@dataclass(frozen=True, slots=True)
class Sampled:
    """The samples of a topic of the recording."""

    path: str
    """Its name, such as `/fmu/out/vehicle_attitude`."""
    times_ns: NDArray[np.int64]
    """When each was recorded [ns]."""
    columns: dict[str, Column]


def px4_log(sampled: Sequence[Sampled]) -> Log:
    """The log of a recording."""
    begin_ns = min(int(each.times_ns.min()) for each in sampled)
    boot_s = _boot_s([each for each in sampled if _PX4.match(each.path)], begin_ns)
    matches = {each.path: _PX4.match(each.path) for each in sampled}
    spaces = sorted({match["vehicle"] for match in matches.values() if match is not None})
    several = len(spaces) > 1
    topics: dict[str, list[Topic]] = {space: [] for space in ["", *spaces]}
    ids: dict[str, str] = {}
    for each in sampled:
        match = matches[each.path]
        name = each.path.strip("/").replace("/", ".").replace(":", "_") if match is None else match["name"]
        topic = _topic(name, each, begin_ns, boot_s)
        if topic is None:
            continue
        topics["" if match is None else match["vehicle"]].append(topic)
        if name == "vehicle_status" and match is not None and "system_id" in topic.columns:
            ids[match["vehicle"]] = str(int(topic.columns["system_id"][0]))
    if len(set(ids.values())) < len(ids):  # ids that two vehicles share name neither
        ids = {}
    vehicles: list[VehicleStates] = []
    everything = [topic for own in topics.values() for topic in own]
    duration_s = max([0.0, *(float(topic.times_s[-1]) for topic in everything)])
    for space in spaces or [""]:
        vehicle = ids.get(space, space.strip("/").replace("/", ".") if several else "")
        if several:
            for topic in topics[space]:
                topic.instance = vehicle
        vehicles.append(ulog_states(topics[space], vehicle, duration_s))
    start_unix_s = begin_ns / 1e9
    return Log(
        kind="mcap",
        start_unix_s=start_unix_s if UNIX_S[0] < start_unix_s < UNIX_S[1] else None,
        duration_s=duration_s,
        topics=_distinct(everything),
        vehicles=vehicles,
        start_boot_s=boot_s if boot_s is not None and boot_s < UNIX_S[0] else None,
    )


def _topic(name: str, sampled: Sampled, begin_ns: int, boot_s: float | None) -> Topic | None:
    """A topic with its times; None: it has no usable name, time or value."""
    times_s = (sampled.times_ns - begin_ns) / 1e9
    stamps = sampled.columns.get("timestamp")
    columns = {each: values for each, values in sampled.columns.items() if usable_name(each)}
    if stamps is not None:
        if boot_s is not None:
            own_s = stamps.astype(np.float64) / 1e6 - boot_s
            times_s = np.where(np.abs(own_s - times_s) <= CLOCKS_APART_S, own_s, times_s)
        columns.pop("timestamp", None)
    usable = times_s <= MAX_DURATION_S
    if not usable_name(name) or not columns or not np.any(usable):
        return None
    order = np.argsort(times_s[usable], kind="stable")
    columns = {each: values[usable][order] for each, values in columns.items()}
    units = {each: unit for each in columns if (unit := ulog_unit(name, each)) is not None}
    return Topic(name, "0", times_s[usable][order], columns, units)


def _boot_s(px4: Sequence[Sampled], begin_ns: int) -> float | None:
    """What the vehicle's clock says at the begin of the recording [s]; None: its times are not usable."""
    apart: list[NDArray[np.float64]] = []
    for each in px4:
        stamps = each.columns.get("timestamp")
        if stamps is not None and stamps.dtype.kind in "iu":
            apart.append(stamps.astype(np.float64) / 1e6 - (each.times_ns - begin_ns) / 1e9)
    if not apart:
        return None
    differences = np.concatenate(apart)
    middle = float(np.median(differences))
    close = np.abs(differences - middle) <= CLOCKS_APART_S
    return middle if np.count_nonzero(close) >= KEPT_FRACTION * len(close) else None


def _distinct(topics: Sequence[Topic]) -> list[Topic]:
    """A topic may be recorded on its way in and out, or twice: the others get a number."""
    found: dict[str, int] = {}
    for topic in sorted(topics, key=lambda each: -len(each.times_s)):
        number = found.get(topic.id, 0)
        found[topic.id] = number + 1
        if number:
            topic.instance = f"{topic.instance}-{number + 1}"
    return sorted(topics, key=lambda topic: topic.id)
