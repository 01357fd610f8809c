"""All connections of the HTTP server: limits their number and selects the connections to close when there are
too many.

A connection is waiting until its first request is allowed (`guard.py`), then busy or idle. If there are too
many connections, waiting connections are closed first, then idle connections. Connections of clients in
control of a vehicle are closed only if they do not read what is sent to them and all other such connections
are closed. If no connection can be closed, the connections of the reserve are used; they serve only requests
of clients in control. This module does no I/O; the sockets are in `http_server/`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from gcs_server.clock import Clock

SCOPE_KEY = "gcs.connection"
"""Key of the connection in the `extensions` of an ASGI scope."""
UNREAD_CHECK_PERIOD_S = 0.05
WARNING_DURATION_S = 60.0


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of the number and the memory of connections."""

    total: int = 512
    per_address: int = 256
    """Limit per address; if it is exceeded, idle connections of this address are closed."""
    reserve: int = 64
    """Extra connections for clients in control of a vehicle."""
    waiting_total: int = 128
    """Limit of connections that have not sent an allowed request yet."""
    waiting_per_address: int = 64
    body_bytes: int = 32 << 20
    """Maximum total size of the bodies of requests that have no response yet [bytes]."""
    unread_bytes: int = 64 << 20
    """Maximum total of `Socket.unread_bytes()` of all connections [bytes]."""

    def reduced_to(self, descriptors: int) -> ConnectionLimits:
        """The limits, reduced to the number of file descriptors that the process may open."""
        total = max(8, min(self.total, descriptors - self.reserve))
        fraction = total / self.total
        return ConnectionLimits(
            total=total,
            per_address=max(4, int(self.per_address * fraction)),
            reserve=self.reserve,
            waiting_total=max(4, int(self.waiting_total * fraction)),
            waiting_per_address=max(2, int(self.waiting_per_address * fraction)),
            body_bytes=self.body_bytes,
            unread_bytes=self.unread_bytes,
        )


class Socket(Protocol):
    """The part of a connection that this module uses."""

    def end(self) -> None:
        """Closes the connection immediately."""
        ...

    def check(self, now_s: float) -> None:
        """Closes the connection if a deadline has passed."""
        ...

    def unread_bytes(self) -> int:
        """Size of written data that the operating system has not accepted yet, because the client does not
        read [bytes]."""
        ...


@dataclass(slots=True, eq=False)
class Connection:
    """One accepted connection."""

    address: str
    opened_s: float
    refusal_status: int = 0
    """Status (429 or 503) for clients that are not in control, if the connection belongs to the reserve;
    otherwise 0."""
    socket: Socket | None = None
    """Set once the transport exists."""
    client_key: str = ""
    admitted: bool = False
    """Whether the guard has allowed a request of the connection."""
    busy: bool = False
    """Whether a request is being served, or a WebSocket is open."""
    body_bytes: int = 0
    closed: bool = False

    def end(self) -> None:
        """Closes the connection immediately."""
        if self.socket is not None:
            self.socket.end()


class Connections:
    """All connections of the server.

    Args:
        clock: the server's clock.
        limits: limits of the connections; default: `ConnectionLimits()`.
        in_control: returns whether the client with a key controls a vehicle.
    """

    def __init__(
        self,
        clock: Clock,
        limits: ConnectionLimits | None = None,
        in_control: Callable[[str], bool] | None = None,
    ) -> None:
        self._clock = clock
        self.limits = limits or ConnectionLimits()
        self._in_control: Callable[[str], bool] = in_control or _no_client_in_control
        self._all: dict[Connection, None] = {}
        self._by_address: Counter[str] = Counter()
        self._waiting: dict[str, dict[Connection, None]] = {}
        self._waiting_count = 0
        self._reserve_count = 0
        """Number of open connections of the reserve, which serve only clients in control."""
        self._body_bytes = 0
        self._last_unread_check_s = float("-inf")
        self._last_refused_s = float("-inf")
        self.refusal_count = 0
        """Number of refused connections and requests, and of connections that a limit closed, since the
        server started."""

    def __len__(self) -> int:
        return len(self._all)

    # --- opening and closing -----------------------------------------------------------------------

    def open(self, address: str) -> Connection | None:
        """Registers a new connection; None if it is refused."""
        waiting = self._waiting.get(address, {})
        if len(waiting) >= self.limits.waiting_per_address:
            self._evict(next(iter(waiting)))
        elif self._waiting_count >= self.limits.waiting_total:
            self._evict(next(iter(max(self._waiting.values(), key=len))))
        refusal_status = self._make_room(address)
        if refusal_status is None:
            self.count_refusal()
            return None
        connection = Connection(address, self._clock.monotonic_s(), refusal_status)
        self._all[connection] = None
        self._by_address[address] += 1
        self._reserve_count += refusal_status > 0
        self._start_waiting(connection)
        return connection

    def remove(self, connection: Connection) -> None:
        """Removes a closed connection; may be called more than once."""
        if connection.closed:
            return
        connection.closed = True
        self.release_body(connection)
        self._stop_waiting(connection)
        self._all.pop(connection, None)
        self._reserve_count -= connection.refusal_status > 0
        self._by_address[connection.address] -= 1
        if not self._by_address[connection.address]:
            del self._by_address[connection.address]

    def set_busy(self, connection: Connection, busy: bool) -> None:
        """Sets whether a request of the connection is being served."""
        connection.busy = busy
        if connection.closed:
            return
        if busy:
            self._stop_waiting(connection)
        elif not connection.admitted:
            self._start_waiting(connection)

    def admit(self, connection: Connection, client_key: str) -> int:
        """Registers that the guard has allowed a request. Returns 429 or 503 if a limit refuses the request,
        otherwise 0."""
        connection.admitted = True
        connection.client_key = client_key
        return (
            0 if not connection.refusal_status or self._in_control(client_key) else connection.refusal_status
        )

    # --- memory ---------------------------------------------------------------------------------

    def take_body(self, connection: Connection, size: int) -> bool:
        """Counts bytes of a request's body; False if all bodies together are too large."""
        if connection.closed:
            return False
        connection.body_bytes += size
        self._body_bytes += size
        return self._body_bytes <= self.limits.body_bytes

    def release_body(self, connection: Connection) -> None:
        """Stops counting the body of a request that has its response or was cancelled."""
        self._body_bytes -= connection.body_bytes
        connection.body_bytes = 0

    def limit_unread_bytes(self) -> None:
        """Closes the connections with the most unread bytes until the total is within the limit."""
        now_s = self._clock.monotonic_s()
        if now_s - self._last_unread_check_s < UNREAD_CHECK_PERIOD_S:
            return
        self._last_unread_check_s = now_s
        unread = [(c.socket.unread_bytes(), c) for c in self._all if c.socket is not None]
        total = sum(size for size, _ in unread)
        if total <= self.limits.unread_bytes:
            return
        for size, connection in sorted(unread, key=lambda each: (self._is_protected(each[1]), -each[0])):
            if total <= self.limits.unread_bytes:
                return
            total -= size
            self._evict(connection)

    def check(self) -> None:
        """Called periodically: lets each connection check its deadlines."""
        now_s = self._clock.monotonic_s()
        for connection in list(self._all):
            if connection.socket is not None:
                connection.socket.check(now_s)
        self.limit_unread_bytes()

    # --- warning --------------------------------------------------------------------------------

    def count_refusal(self) -> None:
        """Counts a refusal."""
        self.refusal_count += 1
        self._last_refused_s = self._clock.monotonic_s()

    def warning(self) -> str | None:
        """Warning text for a minute after the last refusal."""
        if self._clock.monotonic_s() - self._last_refused_s > WARNING_DURATION_S:
            return None
        return (
            f"The server refuses clients: too many connections or requests ({self.refusal_count} since its "
            f"start; {len(self)} connections are open). Clients in control of a vehicle are still served."
        )

    # --- helpers --------------------------------------------------------------------------------

    def _make_room(self, address: str) -> int | None:
        """Closes a connection if a limit is reached. Returns the `refusal_status` of the new connection;
        None: the server refuses the new connection."""
        address_is_full = self._by_address[address] >= self.limits.per_address
        if not address_is_full and len(self._all) - self._reserve_count < self.limits.total:
            return 0
        candidates = [
            c for c in self._all if not c.refusal_status and (not address_is_full or c.address == address)
        ]
        if self._evict_one_of(candidates):
            return 0
        if self._reserve_count >= self.limits.reserve and not self._evict_one_of(
            [c for c in self._all if c.refusal_status]
        ):
            return None
        return 429 if address_is_full else 503

    def _evict_one_of(self, candidates: list[Connection]) -> bool:
        closable = [c for c in candidates if not c.admitted or (not c.busy and not self._is_protected(c))]
        if not closable:
            return False
        self._evict(min(closable, key=lambda c: (c.admitted, -self._by_address[c.address], c.opened_s)))
        return True

    def _is_protected(self, connection: Connection) -> bool:
        return bool(connection.client_key) and self._in_control(connection.client_key)

    def _evict(self, connection: Connection) -> None:
        self.count_refusal()
        self.remove(connection)
        connection.end()

    def _start_waiting(self, connection: Connection) -> None:
        self._waiting.setdefault(connection.address, {})[connection] = None
        self._waiting_count += 1

    def _stop_waiting(self, connection: Connection) -> None:
        waiting = self._waiting.get(connection.address)
        if waiting is None or connection not in waiting:
            return
        del waiting[connection]
        self._waiting_count -= 1
        if not waiting:
            del self._waiting[connection.address]


def _no_client_in_control(_: str) -> bool:
    return False
