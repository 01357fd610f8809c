"""The send queue of a slow link with a fake clock: order, expiry, and no starvation."""

import random

import pytest

from gcs_server.links.base import Peer
from gcs_server.links.send_queue import (
    CLASS_LIMIT,
    CLASSES,
    LEAST_URGENT,
    LEAST_URGENT_LIMIT_BYTES,
    MAX_PASSED_OVER,
    MOST_URGENT,
    Packet,
    SendCounts,
    SendQueue,
)

PEER, OTHER_PEER = Peer("a"), Peer("b")
LONGEST_WAIT_PACKETS = MAX_PASSED_OVER + 2 * (CLASSES - 2)
"""Largest number of packets of other classes (except class 0) that are sent before a waiting packet."""


def packet(name, priority, *, expires_s=1e9, key=None, group=None, peer=PEER, size=40):
    """A packet; priority 0: stop motors, 1: mode, 2: other command, 3: setpoint, 4: other message."""
    return Packet(
        peer, size, lambda: name.encode(), priority=priority, expires_s=expires_s, key=key, group=group
    )


def take_names(queue, now_s=0.0):
    names = []
    while (taken_packet := queue.take(now_s)) is not None:
        names.append(taken_packet.finish().decode())
    return names


def test_the_most_urgent_packet_is_sent_first_and_packets_of_equal_priority_keep_their_order():
    queue = SendQueue(SendCounts())
    for name, priority in (("p", 4), ("s", 3), ("c1", 2), ("stop", 0), ("c2", 2), ("mode", 1)):
        assert queue.put(packet(name, priority), 0.0)
    assert take_names(queue) == ["stop", "mode", "c1", "c2", "s", "p"]


def test_a_setpoint_replaces_the_waiting_setpoint_of_its_vehicle_and_vehicles_take_turns():
    counts = SendCounts()
    queue = SendQueue(counts)
    queue.put(packet("1 old", 3, key="1"), 0.0)
    queue.put(packet("2", 3, key="2"), 0.0)
    queue.put(packet("1 new", 3, key="1"), 0.0)
    queue.put(packet("1 of another peer", 3, key="1", peer=OTHER_PEER), 0.0)
    assert take_names(queue) == ["1 new", "2", "1 of another peer"]
    assert counts.frames_replaced == 1


def test_expired_packets_are_never_sent():
    counts = SendCounts()
    queue = SendQueue(counts)
    queue.put(packet("late", 3, expires_s=0.1), 0.0)
    queue.put(packet("in time", 4, expires_s=0.3), 0.0)
    assert take_names(queue, 0.2) == ["in time"]
    assert counts.frames_expired == 1


def test_a_newer_flight_command_removes_waiting_commands_of_its_vehicle_but_not_stop_motors():
    queue = SendQueue(SendCounts())
    queue.put(packet("arm", 2, group="1"), 0.0)
    queue.put(packet("arm 2", 2, group="2"), 0.0)
    queue.put(packet("hold", 1, group="1"), 0.0)  # the vehicle must not arm after a later Hold command
    queue.put(packet("stop", 0, key="s", group="1"), 0.0)
    queue.put(packet("terminate", 0, key="t", group="1"), 0.0)
    queue.put(packet("land", 1, group="1"), 0.0)
    assert take_names(queue) == ["stop", "terminate", "land", "arm 2"]


def test_packets_beyond_the_limit_are_dropped_but_not_stop_motors():
    counts = SendCounts()
    queue = SendQueue(counts)
    accepted = [queue.put(packet(f"r{n}", LEAST_URGENT, size=1000), 0.0) for n in range(100)]
    assert accepted.count(True) == LEAST_URGENT_LIMIT_BYTES // 1000
    assert [queue.put(packet(f"c{n}", 2), 0.0) for n in range(600)].count(True) == CLASS_LIMIT
    assert all(queue.put(packet(f"s{n}", MOST_URGENT), 0.0) for n in range(1000))
    assert counts.frames_dropped == (100 - LEAST_URGENT_LIMIT_BYTES // 1000) + (600 - CLASS_LIMIT)
    full_queue = SendQueue(SendCounts())
    assert all(
        full_queue.put(packet(f"r{n}", LEAST_URGENT, size=1000, expires_s=1.0), 0.0) for n in range(64)
    )
    assert full_queue.put(packet("new", LEAST_URGENT, size=1000), 2.0), (
        "expired packets were not removed for a new one"
    )


@pytest.mark.parametrize("seed", range(20))
def test_under_any_load_stop_motors_is_first_setpoints_expire_and_no_class_starves(seed):
    rng = random.Random(seed)
    counts = SendCounts()
    queue = SendQueue(counts)
    submitted, sent_numbers, now_s, last_number = {}, set(), 0.0, 0
    passed_over = [0] * CLASSES
    waiting_stops = set()
    for _ in range(4000):
        now_s += rng.choice((0.0, 0.002, 0.02))
        for _ in range(rng.choice((0, 1, 1, 2, 5))):
            priority = rng.choices(range(CLASSES), (0.02, 0.1, 0.3, 1.0, 1.0))[0]
            last_number += 1
            lifetime_s = 1e9 if priority == MOST_URGENT else (0.5, 0.5, 0.1, 3.0)[priority - 1]
            key = {3: f"sp{rng.randrange(4)}", 0: f"stop{last_number}"}.get(priority)
            group = f"v{rng.randrange(4)}" if priority < 3 and rng.random() < 0.5 else None
            submitted[last_number] = (priority, now_s + lifetime_s)
            if queue.put(
                packet(str(last_number), priority, expires_s=now_s + lifetime_s, key=key, group=group), now_s
            ):
                if priority == MOST_URGENT:
                    waiting_stops.add(last_number)
            else:
                assert priority != MOST_URGENT
        for _ in range(rng.choice((0, 0, 1, 1, 2))):
            was_waiting = [bool(w) for w in queue._waiting]
            sent_packet = queue.take(now_s)
            if sent_packet is None:
                assert not waiting_stops
                continue
            number = int(sent_packet.finish())
            priority, expires_s = submitted[number]
            assert number not in sent_numbers
            sent_numbers.add(number)
            assert expires_s >= now_s, "an expired packet was sent"
            assert priority == MOST_URGENT or not waiting_stops, "stop motors was not first"
            waiting_stops.discard(number)
            for other_class in range(1, CLASSES):
                still_waiting = (
                    was_waiting[other_class] and bool(queue._waiting[other_class]) and other_class != priority
                )
                passed_over[other_class] = (
                    passed_over[other_class] + (priority != MOST_URGENT) if still_waiting else 0
                )
                assert passed_over[other_class] <= LONGEST_WAIT_PACKETS, f"class {other_class} starves"
    queue.purge(now_s)
    assert len(sent_numbers) + counts.frames_expired + counts.frames_replaced + counts.frames_dropped + len(
        queue
    ) == len(submitted)
    assert waiting_stops == {int(p.finish()) for p in queue._waiting[MOST_URGENT].values()}, (
        "a stop motors command was lost"
    )
