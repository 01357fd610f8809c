"""The pipe between the server and the stream process: values arrive complete, equal and in order."""

import pickle
import socket
from dataclasses import dataclass, field
from re import compile as pattern

import pytest

from gcs_server.streamer.process.message_pipe import READ_BYTES, MessagePipe, PipeFull, pickled
from gcs_server.streamer.process.messages import Answer, Call, Update
from gcs_server.streamer.schedule.scheduler import StreamState
from gcs_server.streamer.values.limit_values import Bounds
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.avoidance.scans import Scan
from missions.geodesy import LocalOrigin
from missions.setpoints import Position

SNAPSHOT = Snapshot(
    1.5,
    "offboard",
    (1.0, 2.0, -3.0),
    (0.0, 0.1, 0.2),
    None,
    armed=True,
    q_ned_frd=(1.0, 0.0, 0.0, 0.0),
    bounds=Bounds(speed_m_s=12.0, origin=LocalOrigin(47.4, 8.5, 488.0)),
    scans=(Scan(1.4, ((1.0, 0.0, 0.0),), (None,), 12.0),),
)
REQUEST = StreamRequest(Position((1.0, 2.0, -3.0), 0.5), client="Anna")


@dataclass(frozen=True)
class Rounded:
    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", round(self.value + 0.25))


@dataclass(frozen=True)
class Derived:
    value: int
    double: int = field(init=False, default=0)


@dataclass(frozen=True)
class ByName:
    value: int
    option: int = field(kw_only=True)


@dataclass
class Changing:
    value: int


@pytest.mark.parametrize(
    "value",
    [
        Call(7, "StreamScheduler.change", ("1", REQUEST, SNAPSHOT), {}, ("1",)),
        {"1": pickled(SNAPSHOT)},
        (
            Update(7, 2.0, {"1": StreamState("streaming", REQUEST)}, frozenset({"1"}), {}),
            Answer(7, True, None),
        ),
        Rounded(0.4),
        Derived(2),
        ByName(2, option=3),
        Changing(2),
        pattern("a+"),
        1 + 2j,
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_value_arrives_equal(value: object) -> None:
    assert pickle.loads(pickled(value)) == value


@pytest.fixture
def pipe():
    ours, theirs = socket.socketpair()
    ends = MessagePipe(ours, 10 * READ_BYTES), MessagePipe(theirs, 10 * READ_BYTES)
    yield ends
    for end in ends:
        end.close()


def test_values_larger_than_the_systems_buffer_arrive_complete_and_in_order(pipe) -> None:
    ours, theirs = pipe
    values = [bytes([number]) * size for number, size in enumerate((1, READ_BYTES, 7 * READ_BYTES, 2))]
    for value in values:
        ours.send(value)
    received = []
    while ours.has_unsent_data:
        received += theirs.receive()
        ours.flush()
    received += theirs.receive()
    assert received == values


def test_a_side_that_does_not_read_fills_the_buffer_and_a_closed_side_ends_the_pipe(pipe) -> None:
    ours, theirs = pipe
    with pytest.raises(PipeFull):
        for _ in range(100):
            ours.send(bytes(READ_BYTES))
    theirs.close()
    with pytest.raises(EOFError):
        ours.flush()
    with pytest.raises(EOFError):
        ours.receive()


def test_the_last_values_arrive_before_the_end_of_the_pipe(pipe) -> None:
    ours, theirs = pipe
    ours.send("last")
    ours.close()
    assert theirs.receive() == ["last"]
    with pytest.raises(EOFError):
        theirs.receive()
