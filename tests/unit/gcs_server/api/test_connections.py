"""At a limit, waiting connections (no allowed request yet) are closed first, and connections of clients in
control of a vehicle last."""

import pytest

from gcs_server.api.connections import WARNING_DURATION_S, ConnectionLimits, Connections


class Clock:
    now_s = 100.0

    def monotonic_s(self):
        return self.now_s


class Socket:
    """A fake socket with this number of unread bytes."""

    def __init__(self, unread=0):
        self.unread, self.ended = unread, False

    def end(self):
        self.ended = True

    def check(self, now_s):
        pass

    def unread_bytes(self):
        return self.unread


LIMITS = ConnectionLimits(
    total=10,
    per_address=8,
    reserve=3,
    waiting_total=6,
    waiting_per_address=4,
    body_bytes=1000,
    unread_bytes=1000,
)


class ConnectionsSetup:
    """Connections with small limits, on a fake clock; the client "pilot" is in control."""

    def __init__(self):
        self.clock = Clock()
        self.connections = Connections(self.clock, LIMITS, lambda key: key == "pilot")

    def connect(self, address="1.1.1.1", key=None, busy=False, unread=0):
        self.clock.now_s += 0.01
        connection = self.connections.open(address)
        if connection is not None:
            connection.socket = Socket(unread)
            if key is not None:
                self.connections.admit(connection, key)
                self.connections.set_busy(connection, True)
                self.connections.set_busy(connection, busy)  # not busy: its request has ended
        return connection


@pytest.fixture
def setup():
    return ConnectionsSetup()


def test_the_oldest_waiting_connection_of_an_address_is_closed_for_a_new_connection(setup):
    waiting = [setup.connect() for _ in range(20)]
    assert [c.closed for c in waiting] == [True] * 16 + [False] * 4
    assert all(c.socket.ended for c in waiting[:16])
    assert not setup.connect("2.2.2.2").closed


def test_the_address_with_most_waiting_connections_is_the_first_to_lose_a_connection(setup):
    at_one_address = [setup.connect("3.3.3.3") for _ in range(4)]
    at_two_addresses = [setup.connect(f"4.4.4.{n}") for n in range(2)]
    newest = setup.connect("5.5.5.5")
    assert [c.closed for c in at_one_address] == [True, False, False, False]
    assert not any(c.closed for c in (*at_two_addresses, newest))


def test_idle_clients_are_closed_before_busy_clients_and_clients_in_control_are_not_closed(setup):
    pilot = setup.connect("9.9.9.9", "pilot")
    idle = setup.connect("8.8.8.8", "idle")
    busy = [setup.connect(f"7.7.7.{n}", f"busy {n}", busy=True) for n in range(8)]
    assert setup.connect("6.6.6.6").refusal_status == 0
    assert idle.closed
    assert not pilot.closed
    assert not any(c.closed for c in busy)


def test_at_the_limit_only_a_client_in_control_is_served(setup):
    for n in range(10):
        setup.connect(f"7.7.7.{n}", f"busy {n}", busy=True)
    not_in_control, pilot = setup.connect("1.1.1.1"), setup.connect("2.2.2.2")
    assert setup.connections.admit(not_in_control, "not_in_control") == 503
    assert setup.connections.admit(pilot, "pilot") == 0


def test_an_address_at_its_limit_gets_status_429_unless_the_client_is_in_control(setup):
    for n in range(8):
        setup.connect("7.7.7.7", f"busy {n}", busy=True)
    assert setup.connections.admit(setup.connect("7.7.7.7"), "not_in_control") == 429
    assert setup.connections.admit(setup.connect("7.7.7.7"), "pilot") == 0
    assert setup.connections.admit(setup.connect("2.2.2.2"), "other") == 0


def test_the_reserved_connections_are_limited_and_used_again_for_new_clients(setup):
    for n in range(10):
        setup.connect(f"7.7.7.{n}", f"busy {n}", busy=True)
    new_connections = [setup.connect(f"2.2.2.{n}") for n in range(5)]
    assert [c.closed for c in new_connections] == [True, True, False, False, False]
    for connection in new_connections[2:]:
        setup.connections.admit(connection, "pilot")
        setup.connections.set_busy(connection, True)
    assert setup.connect("1.1.1.1") is None
    assert len(setup.connections) == 13


def test_the_total_size_of_bodies_is_limited_and_released(setup):
    first, second = setup.connect(), setup.connect()
    assert setup.connections.take_body(first, 900)
    assert not setup.connections.take_body(second, 200)
    setup.connections.remove(second)
    setup.connections.release_body(first)
    assert setup.connections.take_body(first, 1000)


def test_beyond_the_total_of_unread_bytes_even_a_client_in_control_is_closed(setup):
    pilot = setup.connect("9.9.9.9", "pilot", busy=True, unread=2000)
    slow = setup.connect("1.1.1.1", "a", busy=True, unread=700)
    fast = setup.connect("1.1.1.1", "b", busy=True, unread=100)
    setup.connections.check()
    assert slow.closed
    assert fast.closed, "clients without control were not closed first"
    assert pilot.closed, "the client in control alone exceeds the limit"
    assert len(setup.connections) == 0


def test_the_warning_about_refused_clients_lasts_a_minute(setup):
    assert setup.connections.warning() is None
    for _ in range(5):
        setup.connect()
    assert "refuses clients" in setup.connections.warning()
    setup.clock.now_s += WARNING_DURATION_S + 1
    assert setup.connections.warning() is None


def test_few_file_descriptors_reduce_all_limits_except_the_reserve():
    reduced = ConnectionLimits().reduced_to(192)
    assert reduced.total + reduced.reserve == 192
    assert reduced.waiting_per_address < reduced.waiting_total < reduced.per_address < reduced.total
    assert ConnectionLimits().reduced_to(100_000) == ConnectionLimits()
