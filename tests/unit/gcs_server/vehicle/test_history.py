"""The history of the last minutes as raw frames: the newest frame of each message at each time."""

from __future__ import annotations

import struct

from gcs_server.mavlink.codec import Frame, encode_frame
from gcs_server.vehicle.state import HISTORY_S, PURGE_EVERY_S, History

ATTITUDE, HEARTBEAT = 30, 0


def frame(msg_id: int, at_s: float) -> Frame:
    raw = encode_frame(msg_id, struct.pack("<I", int(at_s * 1000) + 1), 7, 1, 2)
    return Frame(msg_id, 1, 2, 7, raw, at_s)


def test_a_frame_is_stored_once_and_returned_unchanged():
    history = History([ATTITUDE])
    attitude = frame(ATTITUDE, 1.0)
    history.store({ATTITUDE: attitude, HEARTBEAT: frame(HEARTBEAT, 1.0)}, 1.1)
    history.store({ATTITUDE: attitude}, 1.35)
    ((stored_s, (stored,)),) = history.frames((ATTITUDE,))
    assert stored_s == 1.1
    assert stored is not None
    assert (stored.raw, stored.payload, stored.received_monotonic_s) == (attitude.raw, attitude.payload, 1.0)
    assert (stored.system_id, stored.component_id, stored.seq) == (1, 2, 7)


def test_a_frame_is_repeated_at_each_time_until_the_message_is_received_again():
    history = History([ATTITUDE, HEARTBEAT])
    heartbeat = frame(HEARTBEAT, 1.0)
    for step in range(4):
        history.store({HEARTBEAT: heartbeat, ATTITUDE: frame(ATTITUDE, 1.0 + step)}, 1.0 + step)
    history_frames = list(history.frames((HEARTBEAT, ATTITUDE)))
    assert [stored_s for stored_s, _ in history_frames] == [1.0, 2.0, 3.0, 4.0]
    assert all(frames[0] is not None and frames[0].raw == heartbeat.raw for _, frames in history_frames)
    assert [f[1].received_monotonic_s for _, f in history_frames if f[1] is not None] == [1.0, 2.0, 3.0, 4.0]


def test_the_history_has_a_limited_length():
    history = History([ATTITUDE])
    steps = 2 * int(HISTORY_S)
    for step in range(steps):
        history.store({ATTITUDE: frame(ATTITUDE, float(step))}, float(step))
    times = [stored_s for stored_s, _ in history.frames((ATTITUDE,))]
    assert HISTORY_S <= len(times) <= HISTORY_S + PURGE_EVERY_S + 2
    assert times[-1] == steps - 1
