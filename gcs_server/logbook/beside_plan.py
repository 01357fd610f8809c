"""A flight beside its plan and its dry run: distance, time, battery, corridor; what is a finding. Pure.

The values are those that the server compared while it flew (`missions/runner/flown.py`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from gcs_server.logbook.findings.model import Finding

PREDICTED = "predicted_battery_used_share"
"""Name in the notes: what the dry run used of the battery."""
DEVIATION_LIMIT_M = 5.0
"""Above it the path is drawn in red in Fly; PX4 turns within NAV_ACC_RAD, by default 2 m, before an item."""
LONGER_SHARE, LONGER_S = 0.2, 15.0
"""So much longer than planned is a finding."""
MORE_BATTERY_SHARE = 0.1
"""So much more of the battery than in the dry run is a finding."""
JOIN_S = 3.0
"""Samples are 0.5 s apart, or more in a long flight; excursions with shorter gaps are one."""
MAX_EXCURSIONS = 50


@dataclass(frozen=True, slots=True)
class Excursion:
    """A time outside the dry run's corridor, or beyond the limit of distance."""

    begin_s: float
    """Begin [s since the start of the main log]."""
    end_s: float
    """End."""
    max_m: float
    """Largest distance [m]."""
    place: str | None
    """Step or item at the largest distance."""


@dataclass(frozen=True, slots=True)
class BesidePlan:
    """A flight beside its plan and its dry run."""

    deviation_max_m: float | None
    """Largest distance from the planned position; null: not known."""
    deviation_rms_m: float | None
    """Root of the mean square of these distances."""
    deviation_max_s: float | None
    """When it was largest [s since the start of the main log]."""
    deviation_max_place: str | None
    """In which step or item."""
    far_from_path: tuple[Excursion, ...]
    """Times more than 5 m from the planned position."""
    duration_s: float
    """Flown time, as in `flown`."""
    planned_duration_s: float | None
    """Planned value of it; null: not known."""
    battery_used_share: float | None
    """Used charge, 0 to 1; null: not reported."""
    predicted_battery_used_share: float | None
    """The same in the dry run with which the flight was compared; null: none, or it did not tell."""
    has_corridor: bool
    """Whether the corridor of a dry run with varied flights was monitored."""
    outside_corridor: tuple[Excursion, ...]
    """Times outside it."""


def beside_plan(plan: Mapping[str, Any], begin_s: float) -> BesidePlan | None:
    """The comparison; None: the flight was not compared.

    Args:
        plan: the noted plan, with `flown` (`FlownMission` as plain values).
        begin_s: time of the comparison's start on the main log [s].
    """
    flown = plan["flown"]
    if flown is None:
        return None
    samples: list[dict[str, Any]] = flown["samples"]
    compared = [each for each in samples if each["deviation_m"] is not None]
    worst = max(compared, key=lambda each: each["deviation_m"], default=None)
    square_m2 = [each["deviation_m"] ** 2 for each in compared]
    start, end = flown["battery_start_share"], flown["battery_end_share"]
    return BesidePlan(
        deviation_max_m=None if worst is None else worst["deviation_m"],
        deviation_rms_m=round(math.sqrt(sum(square_m2) / len(square_m2)), 2) if square_m2 else None,
        deviation_max_s=None if worst is None else begin_s + worst["t_s"],
        deviation_max_place=None if worst is None else worst["place"],
        far_from_path=_excursions(samples, "deviation_m", DEVIATION_LIMIT_M, begin_s),
        duration_s=flown["duration_s"],
        planned_duration_s=flown["planned_duration_s"],
        battery_used_share=None if start is None or end is None else round(start - end, 3),
        predicted_battery_used_share=plan.get(PREDICTED),
        has_corridor=any(each["outside_corridor_m"] is not None for each in samples),
        outside_corridor=_excursions(samples, "outside_corridor_m", 0.0, begin_s),
    )


def plan_findings(compared: BesidePlan, vehicle: str, begin_s: float) -> list[dict[str, Any]]:
    """What of a comparison is a finding, in the form of the findings of logs.

    Args:
        compared: the comparison.
        vehicle: MAVLink system id.
        begin_s: time of its start on the main log [s].
    """
    end_s = begin_s + compared.duration_s
    found = [
        ("corridor", "Corridor of the dry run", _left_corridor(each)) for each in compared.outside_corridor
    ]
    found += [("deviation", "Distance from the plan", _far(each)) for each in compared.far_from_path]
    planned_s = compared.planned_duration_s
    if planned_s is not None and compared.duration_s > max(
        planned_s * (1 + LONGER_SHARE), planned_s + LONGER_S
    ):
        late = Finding(
            "caution",
            begin_s,
            end_s,
            f"The flight took {compared.duration_s:.0f} s; {planned_s:.0f} s were planned.",
            f"The plan or its dry run, and {LONGER_SHARE:.0%} more.",
            "Look for waiting, head wind and a speed limit; the battery must last as long as that.",
        )
        found.append(("duration", "Time beside the plan", late))
    used, predicted = compared.battery_used_share, compared.predicted_battery_used_share
    if used is not None and predicted is not None and used > predicted + MORE_BATTERY_SHARE:
        more = Finding(
            "caution",
            begin_s,
            end_s,
            f"The flight used {used:.0%} of the battery; the dry run used {predicted:.0%}.",
            f"The dry run, and {MORE_BATTERY_SHARE:.0%} more.",
            "Compare wind, payload and the battery's age; make the next dry run with them.",
        )
        found.append(("energy", "Battery beside the dry run", more))
    return [{"kind": kind, "title": title, "vehicle": vehicle, **asdict(each)} for kind, title, each in found]


def _left_corridor(each: Excursion) -> Finding:
    return Finding(
        "warning",
        each.begin_s,
        each.end_s,
        f"The vehicle was up to {each.max_m:.1f} m outside the corridor of its dry run{_at(each.place)}.",
        "The corridor has the paths of the dry run's varied flights: wind, mass, battery.",
        "Compare wind and parameters with those of the dry run; what is near the path must be further away.",
    )


def _far(each: Excursion) -> Finding:
    return Finding(
        "caution",
        each.begin_s,
        each.end_s,
        f"The vehicle was up to {each.max_m:.1f} m from the planned path{_at(each.place)}.",
        f"{DEVIATION_LIMIT_M:.0f} m; PX4 turns within NAV_ACC_RAD, by default 2 m, before an item.",
        "Look at position and velocity there: wind, a speed that it cannot fly, or gains.",
    )


def _at(place: str | None) -> str:
    return "" if place is None else f", at {place}"


def _excursions(
    samples: Sequence[Mapping[str, Any]], name: str, limit: float, begin_s: float
) -> tuple[Excursion, ...]:
    found: list[Excursion] = []
    for sample in samples:
        value = sample[name]
        if value is None or value <= limit:
            continue
        t_s = begin_s + sample["t_s"]
        new = Excursion(t_s, t_s, value, sample["place"])
        if found and t_s - found[-1].end_s <= JOIN_S:
            last = found.pop()
            worst = max(last, new, key=lambda each: each.max_m)
            new = Excursion(last.begin_s, t_s, worst.max_m, worst.place)
        found.append(new)
    return tuple(found[:MAX_EXCURSIONS])
