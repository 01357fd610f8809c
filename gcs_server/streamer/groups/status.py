"""Status of a group in the API and in events."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GroupMember:
    """One vehicle of a group; the vehicle's topic `offboard` has more about its stream."""

    vehicle: str
    """Id of the vehicle."""
    ordered_type: str
    """Type of the vehicle's setpoint in the group."""
    stream: str
    """State of the stream, as in the topic `offboard`. Before the start, the vehicle's current position is
    streamed."""
    mode: str
    """The vehicle's flight mode."""
    held: bool
    """Whether the vehicle was stopped or has left, so that it no longer follows the group."""


@dataclass(frozen=True, slots=True)
class ClosestPair:
    """The two members that are closest to each other."""

    vehicles: tuple[str, str]
    """Ids of the vehicles."""
    distance_m: float
    """Distance between the vehicles' estimated global positions [m]."""


@dataclass(frozen=True, slots=True)
class GroupFinding:
    """A problem in a group, and the vehicles that were stopped because of it."""

    unix_s: float
    """Time of the finding [s since 1970 UTC]."""
    code: str
    """separation, place_unknown, left (a member no longer follows its setpoints), late (the common start was
    missed), fault (the guard failed)."""
    vehicles: tuple[str, ...]
    """Vehicles concerned."""
    held: tuple[str, ...]
    """Vehicles that were stopped because of the problem."""
    text: str
    """Message for the operator."""
    distance_m: float | None
    """For the code separation: distance between the two vehicles at that time [m]."""


@dataclass(frozen=True, slots=True)
class GroupStatus:
    """Status of a group: the response of the routes below `/groups`, and the content of each `group`
    event."""

    id: str
    """Id of the group in the API."""
    state: str
    """starting (being brought into Offboard), waiting (for the common start), flying, holding, ended."""
    client: str
    """Client that sent the setpoints."""
    client_key: str
    """Distinguishes clients with the same name."""
    minimum_separation_m: float
    """Minimum true distance between members, braking distance included; see `margin_m` [m]."""
    margin_m: float | None
    """Largest current margin of the guard, for the accuracy and age of the positions and for wind [m]. The
    guard stops two vehicles that would come closer than minimum plus margin. Null before the first check."""
    others_go_on: bool
    """Whether members without a problem continue if one has a problem; false: all hold."""
    created_unix_s: float
    """Time of the request [s since 1970 UTC]."""
    start_unix_s: float | None
    """Common start [s since 1970 UTC]; null until all members have confirmed Offboard."""
    valid_left_s: float | None
    """Time until the setpoints of all members expire [s]."""
    members: tuple[GroupMember, ...]
    """Members, in the order of the request."""
    nearest: ClosestPair | None
    """The closest members; null before the first check, and if fewer than two positions are known."""
    findings: tuple[GroupFinding, ...]
    """Problems, oldest first."""
    ended: str | None
    """Reason for the group's end; null while the group exists."""
