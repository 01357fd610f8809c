"""Tickets of accepted commands, so that what was true when a command was accepted is still true when it acts.

Between the acceptance of a command and its last frame, seconds may pass: a plan is compiled, a vehicle is
asked for its parameters, a lost frame is sent again. Each accepted command therefore holds a ticket of the
vehicle. Whatever ends the permission of the command cancels the ticket: a later command, the end of its
client's control, the end of its client's connection, the removal of the vehicle. The ticket is looked at
(`require`) directly before each frame that arms, changes the mode or begins a stream; between the look and
the frame stands no `await`.
"""

from __future__ import annotations

from collections.abc import Callable

from gcs_server.errors import Interrupted


class Ticket:
    """One accepted command; created by `Tickets.open`.

    Attributes:
        label: the command, for messages: "take off".
        client_key: key of the client whose control the command needs; None: it needs no control.
        yields: whether the command is one of a running flight, which must not replace a command of a client.
        reason: why the ticket was cancelled, as a sentence; None: it is valid.
    """

    __slots__ = ("_conditions", "_on_cancel", "_tickets", "client_key", "label", "number", "reason", "yields")

    def __init__(
        self, tickets: Tickets, number: int, label: str, client_key: str | None, yields: bool
    ) -> None:
        self._tickets = tickets
        self.number, self.label, self.client_key, self.yields = number, label, client_key, yields
        self.reason: str | None = None
        self._conditions: list[Callable[[], str | None]] = []
        self._on_cancel: list[Callable[[Interrupted], None]] = []

    def require(self) -> None:
        """Called directly before a frame is sent.

        Raises:
            Interrupted: the command must not act any more.
        """
        for condition in self._conditions:
            if self.reason is None and (reason := condition()) is not None:
                self.cancel(reason)
        if self.reason is not None:
            raise Interrupted(self.reason)

    def add_condition(self, condition: Callable[[], str | None]) -> None:
        """Adds what must be true at each look; the condition returns why it is not, as a sentence."""
        self._conditions.append(condition)

    def on_cancel(self, callback: Callable[[Interrupted], None]) -> None:
        """Calls back once the ticket is cancelled, so that work which waits ends at once."""
        self._on_cancel.append(callback)

    def claim(self) -> tuple[Ticket, ...]:
        """Makes the vehicle follow this command: cancels the tickets of all commands that were accepted
        earlier, and returns them. Called before the command first waits or sends.

        Raises:
            Interrupted: a later command was accepted meanwhile.
        """
        self.require()
        return self._tickets.cancel_earlier(self)

    def cancel(self, reason: str) -> None:
        """Ends the permission to act; does nothing if it has ended."""
        if self.reason is not None:
            return
        self.reason = reason
        self._tickets.drop(self)
        for callback in self._on_cancel:
            callback(Interrupted(reason))

    def close(self) -> None:
        """Called when the command has been answered: it acts no more, and nothing needs to cancel it."""
        self._on_cancel.clear()
        self.cancel(f"“{self.label}” has ended.")


class Tickets:
    """The tickets of one vehicle; attribute `tickets` of the vehicle."""

    def __init__(self) -> None:
        self._valid: list[Ticket] = []
        """In the order of acceptance."""
        self._count = 0
        self.newest_claimed: Ticket | None = None
        """The command that the vehicle was last made to follow, other than those of a running flight; it may
        have ended since."""

    def open(self, label: str, client_key: str | None = None, *, yields: bool = False) -> Ticket:
        """The ticket of a command that is accepted now. Later commands cancel it from now on; it cancels
        earlier commands with `claim`."""
        self._count += 1
        ticket = Ticket(self, self._count, label, client_key, yields)
        self._valid.append(ticket)
        return ticket

    def commanding(self, *, but: Ticket | None = None) -> Ticket | None:
        """A command that is being executed, other than those of a running flight; None: no such command."""
        return next((each for each in self._valid if not each.yields and each is not but), None)

    def cancel_earlier(self, ticket: Ticket) -> tuple[Ticket, ...]:
        """See `Ticket.claim`."""
        if not ticket.yields:
            self.newest_claimed = ticket
        earlier = tuple(each for each in self._valid if each.number < ticket.number)
        for each in earlier:
            each.cancel(f"Interrupted by “{ticket.label}”.")
        return earlier

    def end_of_control(self, client_key: str, reason: str) -> None:
        """Cancels the tickets of a client that no longer controls the vehicle."""
        for ticket in tuple(self._valid):
            if ticket.client_key == client_key:
                ticket.cancel(reason)

    def cancel_all(self, reason: str) -> None:
        """Cancels all tickets, because the vehicle was removed."""
        for ticket in tuple(self._valid):
            ticket.cancel(reason)

    def drop(self, ticket: Ticket) -> None:
        """Forgets a ticket that is no longer valid."""
        if ticket in self._valid:
            self._valid.remove(ticket)
