"""Keeps a group's vehicles apart while they fly, and lets them start together: pure, run by the scheduler.

    waiting ── the instant ──► flying ── setpoints ──┐
       │                         │ ▲                 │
       └── trouble ──► over ◄────┘ └─────────────────┘

It knows no clock, thread or socket: `look` is handed the time and what is known of each member, and says
what to begin and whom to stop. Trouble is: two come too near (with the way of braking ahead), a member's
place is not known, or a member flies its setpoints no more. Before the instant any trouble stops all; none
has moved then.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gcs_server.streamer.separation.distance import (
    TURNED_AFTER_S,
    UNKNOWN_ACCURACY_M,
    UNSTEERED_SHARE,
    Moving,
    SpeedTrend,
    brakes_m_s2,
    closest_m,
    margin_m,
    stopping_m,
)
from gcs_server.streamer.values.order import Order
from gcs_server.streamer.values.snapshot import Snapshot
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.runner.script import Script
from missions.setpoints import Acceleration, Attitude, Rates, Setpoint

LOOK_PERIOD_S = 0.05
LATE_S = 1.0
"""Woken later than this after the instant, nobody begins."""
EXPIRY_WITHIN_S = 0.1
"""Members whose setpoints end so near to the group's end have expired with it."""
FOLLOWS_ORDER = ("starting", "streaming")


@dataclass(frozen=True, slots=True)
class Seen:
    """What the streams know of one member."""

    phase: str
    """Of its stream."""
    order: Order | None
    snapshot: Snapshot
    ended: str | None
    """Why its stream ended; None while it runs."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that went wrong in a group."""

    at_s: float
    code: str
    """separation, place_unknown, left, late, fault."""
    vehicles: tuple[str, ...]
    """Whom it is about."""
    held: tuple[str, ...]
    """Who was stopped for it."""
    text: str
    distance_m: float | None = None


@dataclass(slots=True)
class Actions:
    """What the streams shall do now."""

    take: dict[str, Order] = field(default_factory=dict[str, Order])
    hold: dict[str, str] = field(default_factory=dict[str, str])
    """Whom to stop, and why."""
    code: str = "group"


@dataclass(frozen=True, slots=True)
class GuardState:
    """How a guard stands, read in one moment."""

    phase: str
    """waiting, flying, over."""
    until_s: float
    """When all setpoints expire together, monotonic."""
    held: frozenset[str] = frozenset()
    """Who follows the group's orders no more."""
    nearest: tuple[str, str, float] | None = None
    """The two that are nearest now, and how near [m]."""
    margin_m: float | None = None
    """The largest that is added to the minimum for any two now."""


class GroupGuard:
    """See the module's drawing.

    Args:
        name: the group's.
        waits: what each member is sent until the instant.
        orders: what each begins with then.
        minimum_m: how far apart all are kept.
        start_s: the instant, monotonic.
        lasts_s: from the instant until all setpoints expire together.
        others_go_on: whom trouble does not concern flies on.
    """

    def __init__(
        self,
        name: str,
        waits: Mapping[str, Order],
        orders: Mapping[str, Order],
        *,
        minimum_m: float,
        start_s: float,
        lasts_s: float,
        others_go_on: bool = False,
    ) -> None:
        self.name = name
        self.phase = "waiting"
        self.minimum_m = minimum_m
        self.start_s = start_s
        self.until_s = start_s + lasts_s
        self.held: set[str] = set()
        """Who follows the group's orders no more."""
        self.nearest: tuple[str, str, float] | None = None
        """The two that are nearest now, and how near."""
        self.margin_m: float | None = None
        """The largest of any two now."""
        self.findings: deque[Finding] = deque(maxlen=50)
        self._waits = dict(waits)
        self._orders = dict(orders)
        self._others_go_on = others_go_on
        self._next_look_s = -math.inf
        self._trends = {vehicle: SpeedTrend() for vehicle in orders}

    @property
    def members(self) -> tuple[str, ...]:
        """In the order in which they were named."""
        return tuple(self._orders)

    @property
    def due_s(self) -> float:
        """When `look` wants to be called next."""
        if self.phase == "over":
            return math.inf
        return min(self._next_look_s, self.start_s) if self.phase == "waiting" else self._next_look_s

    def state(self) -> GuardState:
        """As others are to know it."""
        return GuardState(self.phase, self.until_s, frozenset(self.held), self.nearest, self.margin_m)

    def order_to_come(self, vehicle: str) -> Order | None:
        """What a member begins with at the instant; None once it has."""
        return self._orders[vehicle] if self.phase == "waiting" else None

    def renewed(self, until_s: float) -> None:
        """New setpoints were taken: all expire together then."""
        self.until_s = until_s

    def disable_guard(self) -> None:
        """Somebody stops all: nothing begins any more, and what ends now is no finding."""
        self.held.update(self.members)
        if self.phase == "waiting":
            self.phase = "flying"

    def look(self, now_s: float, seen: Mapping[str, Seen]) -> Actions:
        """What to do now.

        Args:
            now_s: monotonic.
            seen: each member, newest.
        """
        if now_s < self.due_s:
            return Actions()
        self._next_look_s = now_s + LOOK_PERIOD_S
        flying = [v for v in self.members if v not in self.held]
        if self._gone_together(now_s, flying, seen):
            return Actions()
        actions = Actions()
        for vehicle in flying:
            why = self._gone(vehicle, seen[vehicle])
            if why is not None:
                self._stop(now_s, actions, "left", (vehicle,), why)
        known = self._places(now_s, seen)
        for vehicle in flying:
            if vehicle not in self.held and vehicle not in known:
                why = f"The place of vehicle {vehicle} is not known (not heard for 1 s, or no estimate)"
                self._stop(now_s, actions, "place_unknown", (vehicle,), why)
        self._keep_apart(now_s, actions, known)
        if self.phase == "waiting" and now_s >= self.start_s:
            self._begin(now_s, actions)
        return actions

    def look_later(self, now_s: float) -> None:
        """A look failed: the next is due when it would have been."""
        self._next_look_s = now_s + LOOK_PERIOD_S

    def fault(self, now_s: float, why: str) -> Actions:
        """Something unforeseen: all stop."""
        actions = Actions()
        self._others_go_on = False
        self._stop(now_s, actions, "fault", self.members, why)
        return actions

    # --- inside -----------------------------------------------------------------------------------

    def _gone_together(self, now_s: float, flying: list[str], seen: Mapping[str, Seen]) -> bool:
        """Whether nobody flies the group's orders any more, or all expire just now: nothing to stop."""
        if self.phase == "over":
            return True
        going = [v for v in flying if seen[v].phase in FOLLOWS_ORDER]
        if not going and all(seen[v].phase == "idle" for v in self.members):
            self.phase = "over"
            return True
        return self.phase == "flying" and now_s >= self.until_s - EXPIRY_WITHIN_S and len(going) < len(flying)

    def _gone(self, vehicle: str, seen: Seen) -> str | None:
        """Why a member follows its order no more; None while it does."""
        if seen.phase not in FOLLOWS_ORDER:
            return f"Vehicle {vehicle} flies the group's setpoints no more{': ' if seen.ended else ''}" + (
                (seen.ended or "").rstrip(".")
            )
        if self.phase == "waiting" and seen.order != self._waits[vehicle]:
            return f"Vehicle {vehicle} was given another setpoint before the common start"
        return None

    def _places(self, now_s: float, seen: Mapping[str, Seen]) -> dict[str, Moving]:
        """In the frame of the first who knows its own; by members whose place is known."""
        common: LocalOrigin | None = None
        known: dict[str, Moving] = {}
        for vehicle in self.members:
            snapshot = seen[vehicle].snapshot
            place, origin = snapshot.position_at(now_s), snapshot.bounds.origin
            if place is None or origin is None or snapshot.lost:
                continue
            common = common or origin
            order = seen[vehicle].order
            setpoint = None if order is None or isinstance(order.setpoint, Script) else order.setpoint
            one = moving(snapshot, now_s, origin.to_frame_of(common, place), setpoint)
            self._trends[vehicle].add(snapshot.heard_s, one.velocity_ned_m_s)
            if not is_steered(setpoint):
                faster = self._trends[vehicle].faster_ned_m_s(one.age_s + TURNED_AFTER_S)
                one = replace(one, velocity_ned_m_s=faster)
            known[vehicle] = one
        return known

    def _keep_apart(self, now_s: float, actions: Actions, known: Mapping[str, Moving]) -> None:
        self.nearest = self.margin_m = None
        pairs: list[tuple[str, str, float, float]] = []
        for a, b in itertools.combinations(known, 2):
            one, other = known[a], known[b]
            apart_m, margin = math.dist(one.place_ned_m, other.place_ned_m), margin_m(one, other)
            if self.nearest is None or apart_m < self.nearest[2]:
                self.nearest = (a, b, apart_m)
            self.margin_m = max(self.margin_m or 0.0, margin)
            reach_m = sum(stopping_m(math.hypot(*m.velocity_ned_m_s), m.brakes_m_s2) for m in (one, other))
            if apart_m - reach_m < self.minimum_m + margin and not (a in self.held and b in self.held):
                pairs.append((a, b, apart_m, margin))
        if not pairs:
            return
        first, second = [known[a] for a, *_ in pairs], [known[b] for _, b, *_ in pairs]
        kept_m = closest_m(
            np.array([m.place_ned_m for m in first]),
            np.array([m.velocity_ned_m_s for m in first]),
            np.array([m.place_ned_m for m in second]),
            np.array([m.velocity_ned_m_s for m in second]),
            np.array([m.brakes_m_s2 for m in first]),
            np.array([m.brakes_m_s2 for m in second]),
        )
        for (a, b, apart_m, margin), left_m in zip(pairs, kept_m, strict=True):
            if left_m < self.minimum_m + margin:
                why = (
                    f"Vehicles {a} and {b} are {apart_m:.1f} m apart, and stopping both now leaves "
                    f"{left_m:.1f} m (at least {self.minimum_m:g} m are to be kept, and {margin:.1f} m of "
                    "margin for what is not known exactly)"
                )
                self._stop(now_s, actions, "separation", (a, b), why, apart_m)

    def _begin(self, now_s: float, actions: Actions) -> None:
        late_s = now_s - self.start_s
        if late_s > LATE_S:
            why = f"The common start was missed by {late_s:.1f} s (the server stood still)"
            self._stop(now_s, actions, "late", self.members, why)
            return
        self.phase = "flying"
        actions.take = dict(self._orders)

    def _stop(
        self,
        now_s: float,
        actions: Actions,
        code: str,
        vehicles: tuple[str, ...],
        why: str,
        distance_m: float | None = None,
    ) -> None:
        everybody = not self._others_go_on or self.phase == "waiting"
        stopped = [v for v in (self.members if everybody else vehicles) if v not in self.held]
        if not stopped:
            return
        self.held.update(stopped)
        actions.code = "separation" if code == "separation" else "group"
        actions.hold |= dict.fromkeys(stopped, why)
        if self.phase == "waiting":
            self.phase = "flying"  # nothing begins any more: it ends when all stand
        self.findings.append(Finding(now_s, code, vehicles, tuple(stopped), f"{why}.", distance_m))


def is_steered(setpoint: Setpoint | None) -> bool:
    """Whether the vehicle's controllers of speed and place are at work; else wind and tilt accelerate it."""
    return not isinstance(setpoint, Acceleration | Attitude | Rates)


def moving(snapshot: Snapshot, now_s: float, place: Vector3, setpoint: Setpoint | None) -> Moving:
    """A vehicle as it is kept apart.

    Args:
        snapshot: with a position.
        now_s: monotonic.
        place: where it is now by that, in the common frame [m].
        setpoint: what it flies.
    """
    accuracy_m = snapshot.accuracy_m
    return Moving(
        place,
        snapshot.velocity_ned_m_s or (0.0, 0.0, 0.0),
        UNKNOWN_ACCURACY_M if accuracy_m is None else accuracy_m,
        max(0.0, now_s - snapshot.heard_s),
        brakes_m_s2(snapshot.bounds.tilt_rad) * (1.0 if is_steered(setpoint) else UNSTEERED_SHARE),
    )
