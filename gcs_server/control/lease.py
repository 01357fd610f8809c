"""Control of a vehicle: one client at a time, for as long as it stays connected. No I/O; the clock is
injected.

A client takes control explicitly, or by commanding a vehicle that no client controls; it is then the holder.
The lease lasts `lease_s` from the holder's last request. It does not expire while the holder's telemetry
socket is open, or one of its requests is being answered. Other clients request control; the holder grants or
denies each request. A client may take control by force if its request was denied, if it got no answer within
`answer_s`, or if the holder cannot be asked. A client without an id (such as a call from a shell) that took
control only by a command does not keep it: the next client that sends a command takes control.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from gcs_server.clock import Clock
from gcs_server.control.principal import Principal
from gcs_server.errors import NotInControl, Refused

MAX_REQUESTS = 20
"""Maximum number of clients that request control of one vehicle."""
MAX_REQUESTS_PER_ADDRESS = 10
REQUEST_LIFETIME_S = 120.0
"""Lifetime of a request, and of the right to take control by force after a denial [s]."""


@dataclass(slots=True)
class PendingRequest:
    """A client's request for control of a vehicle."""

    client: Principal
    reason: str | None
    since_unix_s: float
    holder_asked_s: float
    """Time when the current holder was asked [s, monotonic]."""
    lifetime_start_s: float
    """Start of the request's lifetime: its arrival, or its denial."""
    denied: bool = False


def remove_oldest_denied(pending: dict[str, PendingRequest], client: Principal, vehicle_id: str) -> None:
    """Removes the oldest denied request if a limit of requests is reached.

    Raises:
        Refused: a limit is reached, and no request is denied.
    """
    from_address = [request for request in pending.values() if request.client.address == client.address]
    if client.address and len(from_address) >= MAX_REQUESTS_PER_ADDRESS:
        counted, location_text = from_address, " at your address"
    elif len(pending) >= MAX_REQUESTS:
        counted, location_text = list(pending.values()), ""
    else:
        return
    denied = next((request for request in counted if request.denied), None)
    if denied is None:
        raise Refused(
            f"{len(counted)} clients{location_text} already request control of vehicle {vehicle_id}.",
            remedy="Wait until the client in control has answered some of them (control/grant, "
            f"control/deny); a request expires after {REQUEST_LIFETIME_S:g} s. Hold, Land now and Stop "
            "motors need no control.",
        )
    del pending[denied.client.key]


OnControlLost = Literal["nothing", "hold", "land", "rtl"]
"""Command sent to a flying vehicle when its holder's control expires."""


@dataclass(frozen=True, slots=True)
class LeaseTimes:
    """Durations of leases and answers; the operator's settings."""

    lease_s: float = 30.0
    """Duration of control after the last request of the holder [s]."""
    answer_s: float = 15.0
    """Time to answer a request before control may be taken by force [s]."""


@dataclass(frozen=True, slots=True)
class ControlChange:
    """A change of control, published to all clients."""

    action: str
    """taken, requested, granted, denied, withdrawn, forced, released, expired, intervened."""
    client: Principal
    """The client that acted, or whose control expired."""
    text: str
    holder: Principal | None
    """The holder after the change."""
    previous: Principal | None = None
    """The previous holder, if it changed."""
    reason: str | None = None
    on_expiry: OnControlLost = "nothing"
    requester: Principal | None = None
    """The client whose request was denied."""


@dataclass(frozen=True, slots=True)
class ControlRequest:
    """A client that requests control."""

    client: str
    """Name of the client."""
    key: str
    """Distinguishes clients with the same name; `GET /me` returns the caller's own key."""
    reason: str | None
    """The reason that the client gave."""
    since_unix_s: float
    answer_left_s: float
    """Time left for the holder to answer before control may be taken by force [s]."""


@dataclass(slots=True)
class _ActiveLease:
    client: Principal
    since_unix_s: float
    last_request_s: float
    on_expiry: OnControlLost
    taken_explicitly: bool
    """Whether control was taken explicitly, not by a command alone."""


@dataclass(slots=True)
class Lease:
    """The lease of one vehicle.

    Args:
        vehicle_id: id for messages.
        times: durations of leases and answers.
        is_connected: whether a client has an open telemetry socket, so that it can be asked.
        is_answered: whether a request of a client is being answered.
        on_change: called with each change.
    """

    clock: Clock
    vehicle_id: str
    times: LeaseTimes
    is_connected: Callable[[Principal], bool]
    is_answered: Callable[[Principal], bool]
    on_change: Callable[[ControlChange], None]
    _active: _ActiveLease | None = None
    _requests: dict[str, PendingRequest] = field(default_factory=dict[str, PendingRequest])

    # --- state ----------------------------------------------------------------------------------

    @property
    def holder(self) -> Principal | None:
        """The client in control; None: no client (the next client that sends a command takes control)."""
        self.expire_due()
        return None if self._active is None else self._active.client

    @property
    def since_unix_s(self) -> float | None:
        """Time when the holder got control [s since 1970 UTC]."""
        return None if self._active is None else self._active.since_unix_s

    @property
    def on_expiry(self) -> OnControlLost | None:
        """Command sent to the vehicle when the holder's control expires."""
        return None if self._active is None else self._active.on_expiry

    @property
    def expires_in_s(self) -> float | None:
        """Time until control ends if the holder sends no request [s]."""
        if self._active is None:
            return None
        return max(0.0, self._active.last_request_s + self.times.lease_s - self.clock.monotonic_s())

    @property
    def can_be_asked(self) -> bool:
        """Whether the holder can see a request."""
        return self._active is not None and self.is_connected(self._active.client)

    @property
    def has_max_requests(self) -> bool:
        """Whether the maximum number of control requests is reached."""
        return len(self._requests) >= MAX_REQUESTS

    def requests(self) -> tuple[ControlRequest, ...]:
        """Clients that wait for an answer, the earliest first."""
        return tuple(
            ControlRequest(str(r.client), r.client.key, r.reason, r.since_unix_s, self._answer_left_s(r))
            for r in self._requests.values()
            if not r.denied
        )

    # --- the holder -----------------------------------------------------------------------------

    def admit(self, client: Principal) -> None:
        """Called before each command: the client must have control, or takes it if no client has it.

        Raises:
            NotInControl: another client has control.
        """
        self.expire_due()
        if self._active is None:
            self._set_holder(
                client, "taken", client, f"{client} commands vehicle {self.vehicle_id} and has control."
            )
        elif self._active.client.key == client.key:
            self.renew(client)
        elif self._is_replaceable(self._active):
            previous = self._active.client
            text = f"{client} commands vehicle {self.vehicle_id} and has taken control from {previous}."
            self._set_holder(client, "taken", client, text)
        else:
            raise self._not_in_control(self._active)

    def refusal(self, client: Principal) -> NotInControl | None:
        """The error for a command of this client; None: allowed. Changes nothing."""
        self.expire_due()
        active = self._active
        if active is None or active.client.key == client.key or self._is_replaceable(active):
            return None
        return self._not_in_control(active)

    def renew(self, client: Principal) -> None:
        """Called with each request of a client; renews the lease if the client is the holder."""
        if self._active is not None and self._active.client.key == client.key:
            self._active.last_request_s = self.clock.monotonic_s()

    def take(self, client: Principal, *, force: bool = False, on_expiry: OnControlLost | None = None) -> None:
        """Takes control if no client has it, or by force from the holder.

        Args:
            client: the caller.
            force: take control from the holder; if the holder can be asked, it must be asked first.
            on_expiry: command sent to the vehicle when the holder's control expires; default "nothing".

        Raises:
            NotInControl: another client has control, and `force` is false.
            Refused: `force` is true, but the holder can be asked, and was not asked yet or still has time to
                answer.
        """
        self.expire_due()
        active = self._active
        if active is None:
            self._set_holder(
                client, "taken", client, f"{client} has taken control of vehicle {self.vehicle_id}."
            )
        elif active.client.key != client.key:
            if not force and not self._is_replaceable(active):
                raise self._not_in_control(active)
            if self._is_replaceable(active):
                text = f"{client} has taken control of vehicle {self.vehicle_id} from {active.client}."
                self._set_holder(client, "taken", client, text)
            else:
                self._check_force(client, active)
                text = (
                    f"{client} has taken control of vehicle {self.vehicle_id} from {active.client} by force."
                )
                self._set_holder(client, "forced", client, text)
        self.renew(client)
        assert self._active is not None
        self._active.taken_explicitly = True
        if on_expiry is not None:
            self._active.on_expiry = on_expiry

    def grant(self, client: Principal, requester: str) -> None:
        """Gives control to a client that requested it.

        Args:
            client: the holder.
            requester: key or name of the requesting client.

        Raises:
            NotInControl: `client` does not have control.
            Refused: no client of that name has requested control.
        """
        active = self._require_holder(client)
        pending = self._find_request(requester)
        text = f"{active.client} has given control of vehicle {self.vehicle_id} to {pending.client}."
        self._set_holder(pending.client, "granted", client, text)

    def deny(self, client: Principal, requester: str, reason: str | None = None) -> None:
        """Denies a request; the requesting client may then take control by force. Raises the same errors as
        `grant`."""
        active = self._require_holder(client)
        pending = self._find_request(requester)
        pending.denied, pending.lifetime_start_s = True, self.clock.monotonic_s()
        reason_text = f": {reason}" if reason else ""
        text = (
            f"{active.client} has denied the request of {pending.client} for control of vehicle "
            f"{self.vehicle_id}{reason_text}."
        )
        self.on_change(
            ControlChange("denied", client, text, active.client, reason=reason, requester=pending.client)
        )

    def release(self, client: Principal) -> None:
        """Releases control (the first requesting client gets it), or withdraws the client's request. Does
        nothing if the client has neither control nor a request."""
        self.expire_due()
        pending = self._requests.pop(client.key, None)
        active = self._active
        if active is not None and active.client.key == client.key:
            text = f"{client} has released control of vehicle {self.vehicle_id}."
            self._end(ControlChange("released", client, text, None, previous=client))
        elif pending is not None and not pending.denied:
            text = f"{client} has withdrawn the request for control of vehicle {self.vehicle_id}."
            self.on_change(ControlChange("withdrawn", client, text, self.holder))

    # --- other clients --------------------------------------------------------------------------

    def request(self, client: Principal, reason: str | None = None) -> None:
        """Requests control from the holder; takes it immediately if no client has it."""
        self.expire_due()
        active = self._active
        if active is None or (self._is_replaceable(active) and active.client.key != client.key):
            self.take(client)
            return
        if active.client.key == client.key:
            self.renew(client)
            return
        now_s = self.clock.monotonic_s()
        earlier = self._requests.get(client.key)
        if earlier is not None and not earlier.denied:
            earlier.reason = reason or earlier.reason
            return
        remove_oldest_denied(self._requests, client, self.vehicle_id)
        self._requests[client.key] = PendingRequest(client, reason, self.clock.unix_s(), now_s, now_s)
        reason_text = f": {reason}" if reason else ""
        text = f"{client} requests control from {active.client} of vehicle {self.vehicle_id}{reason_text}."
        self.on_change(ControlChange("requested", client, text, active.client, reason=reason))

    def report_intervention(self, client: Principal, command_label: str) -> None:
        """Reports to the holder that another client has sent a command that needs no control."""
        self.expire_due()
        active = self._active
        if active is None or active.client.key == client.key:
            return
        text = (
            f"{client} commanded {command_label} of vehicle {self.vehicle_id}; "
            f"{active.client} still has control."
        )
        self.on_change(ControlChange("intervened", client, text, active.client))

    def expire_due(self) -> None:
        """Ends the expired lease and expired requests. Called before each use and periodically."""
        now_s = self.clock.monotonic_s()
        for key, pending in list(self._requests.items()):
            if now_s - pending.lifetime_start_s > REQUEST_LIFETIME_S:
                del self._requests[key]
        active = self._active
        if active is None:
            return
        if self.is_connected(active.client) or self.is_answered(active.client):
            active.last_request_s = now_s
        elif now_s - active.last_request_s > self.times.lease_s:
            text = (
                f"{active.client} sent nothing for {self.times.lease_s:g} s: "
                f"its control of vehicle {self.vehicle_id} has ended."
            )
            self._end(
                ControlChange("expired", active.client, text, None, active.client, on_expiry=active.on_expiry)
            )

    # --- internal -------------------------------------------------------------------------------

    def _set_holder(self, client: Principal, action: str, actor: Principal, text: str) -> None:
        previous = None if self._active is None else self._active.client
        now_s = self.clock.monotonic_s()
        self._active = _ActiveLease(
            client, self.clock.unix_s(), now_s, "nothing", taken_explicitly=action != "taken"
        )
        self._requests.pop(client.key, None)
        for key, pending in list(self._requests.items()):  # the new holder gets the remaining requests
            if pending.denied:
                del self._requests[key]
            pending.holder_asked_s = now_s
        self.on_change(ControlChange(action, actor, text, client, previous))

    def _end(self, change: ControlChange) -> None:
        self._active = None
        self.on_change(change)
        waiting = next((request for request in self._requests.values() if not request.denied), None)
        if waiting is not None:
            text = f"{waiting.client} requested control of vehicle {self.vehicle_id} and has it now."
            self._set_holder(waiting.client, "taken", waiting.client, text)

    def _is_replaceable(self, active: _ActiveLease) -> bool:
        """Whether the next command of another client takes control: the holder has no client id, and took
        control only by a command."""
        return not (active.taken_explicitly or active.client.identified or self.is_connected(active.client))

    def _require_holder(self, client: Principal) -> _ActiveLease:
        self.expire_due()
        if self._active is None:
            raise Refused(f"Nobody controls vehicle {self.vehicle_id}.", remedy="Take control of it first.")
        if self._active.client.key != client.key:
            raise self._not_in_control(self._active)
        self.renew(client)
        return self._active

    def _find_request(self, requester: str) -> PendingRequest:
        open_requests = [request for request in self._requests.values() if not request.denied]
        with_key = [request for request in open_requests if request.client.key == requester]
        matching = with_key or [request for request in open_requests if str(request.client) == requester]
        if len(matching) == 1:
            return matching[0]
        if matching:
            keys = ", ".join(request.client.key for request in matching)
            raise Refused(
                f"{len(matching)} clients named {requester!r} request control.",
                remedy=f"Give the key of one: {keys}.",
            )
        names = ", ".join(f"{r.client} ({r.client.key})" for r in open_requests) or "nobody"
        raise Refused(
            f"{requester!r} has not requested control of vehicle {self.vehicle_id}.",
            remedy=f"Requests: {names}.",
        )

    def _answer_left_s(self, pending: PendingRequest) -> float:
        if not self.can_be_asked:
            return 0.0
        return max(0.0, pending.holder_asked_s + self.times.answer_s - self.clock.monotonic_s())

    def _check_force(self, client: Principal, active: _ActiveLease) -> None:
        if not self.can_be_asked:
            return
        pending = self._requests.get(client.key)
        if pending is None:
            raise Refused(
                f"{active.client} has control of vehicle {self.vehicle_id} and has not been asked for it.",
                remedy="Request control first (control/request); a denial, or "
                f"{self.times.answer_s:g} s without an answer, lets you force it. Hold, Land now and Stop "
                "motors need no control.",
            )
        left_s = self._answer_left_s(pending)
        if not pending.denied and left_s > 0:
            raise Refused(
                f"{active.client} has {left_s:.0f} s left to answer.",
                remedy="Wait for the answer. Hold, Land now and Stop motors need no control.",
            )

    def _not_in_control(self, active: _ActiveLease) -> NotInControl:
        return NotInControl(
            self.vehicle_id,
            holder=str(active.client),
            holder_key=active.client.key,
            can_be_asked=self.is_connected(active.client),
        )
