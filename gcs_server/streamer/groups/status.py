"""How a group stands, as the API and the events tell it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GroupMember:
    """One vehicle of a group; its stream itself is told by its own topic `offboard`."""

    vehicle: str
    """Its id."""
    ordered_type: str
    """The type of the setpoint that it has in the group."""
    stream: str
    """As `state` of its `offboard`; before the start it is sent the place where it is."""
    mode: str
    """The vehicle's flight mode."""
    held: bool
    """It was stopped, or left: it follows the group no more."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """The two members that are nearest now."""

    vehicles: tuple[str, str]
    """Their ids."""
    distance_m: float
    """By both vehicles' own positions on the earth [m]."""


@dataclass(frozen=True, slots=True)
class GroupFinding:
    """Something that went wrong in a group, and who was stopped for it."""

    unix_s: float
    """When it was found [s since 1970 UTC]."""
    code: str
    """separation, place_unknown, left (a member flies its setpoints no more), late, fault."""
    vehicles: tuple[str, ...]
    """Whom it is about."""
    held: tuple[str, ...]
    """Who was stopped for it."""
    text: str
    """For people."""
    distance_m: float | None
    """With separation: how far apart they were then [m]."""


@dataclass(frozen=True, slots=True)
class GroupStatus:
    """What the calls below `/groups` answer, and what each `group` event carries."""

    id: str
    """How the API calls it."""
    state: str
    """starting (being brought into Offboard), waiting (for the common start), flying, holding, ended."""
    client: str
    """Whose setpoints they are."""
    client_key: str
    """Tells the client from others of its name."""
    minimum_separation_m: float
    """How far apart all are kept, the way of braking included: the true distance, see `margin_m` [m]."""
    margin_m: float | None
    """What the guard adds to it now, at most, for the accuracy and age of the vehicles' positions and the
    wind: it stops two whose positions would come nearer than both together. Null before the first look."""
    others_go_on: bool
    """Whether those whom trouble does not concern fly on; else all hold."""
    created_unix_s: float
    """When it was asked for [s since 1970 UTC]."""
    start_unix_s: float | None
    """The common start [s since 1970 UTC]; null until all were confirmed in Offboard."""
    valid_left_s: float | None
    """Until the setpoints of all expire together [s]."""
    members: tuple[GroupMember, ...]
    """Its vehicles, in the order in which they were named."""
    nearest: Nearest | None
    """Null before the first look, and where fewer than two places are known."""
    findings: tuple[GroupFinding, ...]
    """What went wrong, oldest first."""
    ended: str | None
    """Why it ended; null while it lasts."""
