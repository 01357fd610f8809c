"""The gains that PX4's autotune found in a logged flight of a multicopter. Pure.

The topic `autotune_attitude_control_status` says in each step the gains of the axis that is identified; the
last ones of the step are those that PX4 takes. It writes them in the parallel form: the rate controller's
common factor becomes 1, its P is `kc`, I and D are `kc` times `ki` and `kd`.

PX4 has renumbered the steps: from v1.18 on, the amplitude is searched before each axis of an aeroplane. Which
numbers a log has is told by the roll step, which every run of a multicopter has.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_server.logbook.findings.model import Flight, NotJudged
from gcs_server.logbook.log import Topic

TOPIC: Final = "autotune_attitude_control_status"
ROTARY_WING: Final = 1
"""vehicle_status_s::VEHICLE_TYPE_ROTARY_WING."""
DIGITS: Final = 6
"""Significant digits of a gain: PX4 stores them as float."""

Axis = Literal["roll", "pitch", "yaw"]
AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True)
class _Steps:
    """Numbers of the steps in `state`."""

    axes: tuple[tuple[int, int], ...]
    """Of each axis the identification and the pause after it."""
    complete: int
    fail: int
    wait_for_disarm: int


_TO_1_17 = _Steps(((2, 3), (4, 5), (6, 7)), complete=11, fail=12, wait_for_disarm=13)
_FROM_1_18 = _Steps(((3, 4), (6, 7), (9, 10)), complete=14, fail=15, wait_for_disarm=16)


@dataclass(frozen=True, slots=True)
class TunedAxis:
    """Gains of one axis."""

    axis: Axis
    parameters: dict[str, float]
    """As PX4 would write them, by the parameter's name."""


@dataclass(frozen=True, slots=True)
class Autotune:
    """The last run of PX4's autotune in a flight."""

    begin_s: float
    """Begin of the run [s since the log's start]."""
    runs: int
    """Number of runs in the flight."""
    axes: list[TunedAxis] = field(default_factory=list[TunedAxis])
    """Roll, pitch, yaw; empty: the run was not completed."""
    note: str | None = None
    """Why there are no gains, as a sentence."""


def autotune(flight: Flight) -> Autotune | None:
    """What autotune found; None: it did not run in this flight."""
    try:
        topic = flight.topic(TOPIC)
    except NotJudged:
        return None
    if "state" not in topic.columns:
        return None
    state = np.asarray(topic.columns["state"]).astype(np.int64)
    steps = _TO_1_17 if np.any(state == _TO_1_17.axes[0][0]) else _FROM_1_18
    rolls = state == steps.axes[0][0]
    begins = np.flatnonzero(rolls & ~np.concatenate(([False], rolls[:-1])))
    if not len(begins):
        return None
    begin = int(begins[-1])
    begin_s = float(topic.times_s[begin])
    try:
        axes = _gains(flight, topic, steps, begin)
    except NotJudged as reason:
        return Autotune(round(begin_s, 3), len(begins), note=str(reason))
    return Autotune(round(begin_s, 3), len(begins), axes)


def _gains(flight: Flight, topic: Topic, steps: _Steps, begin: int) -> list[TunedAxis]:
    """Raises NotJudged: the run has no gains that may be proposed."""
    state = np.asarray(topic.columns["state"]).astype(np.int64)[begin:]
    kind = flight.signal("vehicle_status/vehicle_type")
    if kind.at(topic.times_s[begin : begin + 1])[0] != ROTARY_WING:
        raise NotJudged("Autotune ran on an aeroplane, whose gains are not shown.")
    if not np.any((state == steps.complete) | (state == steps.wait_for_disarm)):
        raise NotJudged(_unfinished(state, steps))
    columns: list[NDArray[np.float64]] = []
    for name in ("kc", "ki", "kd", "att_p"):
        if name not in topic.columns:
            raise NotJudged(f"The log does not have {TOPIC}/{name}.")
        columns.append(np.asarray(topic.columns[name], dtype=np.float64)[begin:])
    axes: list[TunedAxis] = []
    for axis, (identified, _) in zip(AXES, steps.axes, strict=True):
        of_axis = np.flatnonzero(state == identified)
        if not len(of_axis):
            raise NotJudged(f"The log has a gap where autotune moved the {axis} axis.")
        kc, ki, kd, att_p = (float(column[of_axis[-1]]) for column in columns)
        # PX4's own check of the gains lets NaN pass.
        if not np.all(np.isfinite([kc, ki, kd, att_p])) or min(kc, ki, att_p) <= 0.0 or kd < 0.0:
            raise NotJudged(f"Autotune found gains of the {axis} axis that no vehicle can fly.")
        name = axis.upper()
        values = {
            f"MC_{name}RATE_K": 1.0,
            f"MC_{name}RATE_P": kc,
            f"MC_{name}RATE_I": kc * ki,
            f"MC_{name}RATE_D": kc * kd,
            f"MC_{name}_P": att_p,
        }
        axes.append(TunedAxis(axis, {key: float(f"{value:.{DIGITS}g}") for key, value in values.items()}))
    return axes


def _unfinished(state: NDArray[np.int64], steps: _Steps) -> str:
    failed = np.flatnonzero(state == steps.fail)
    before = state[: failed[0]] if len(failed) else state
    last = max(k for k, (identified, _) in enumerate(steps.axes) if identified in before)
    if not len(failed):
        return f"The log ends while autotune moves the {AXES[last]} axis."
    if np.any(before > steps.axes[-1][1]):
        return "Autotune found gains that are out of range or did not pass its test in the air."
    return (
        f"Autotune ended on the {AXES[last]} axis without gains: a stick was moved, the mode changed, or it "
        "found no model within 20 s."
    )
