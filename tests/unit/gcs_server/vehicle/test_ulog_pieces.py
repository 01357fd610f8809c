"""A log that is put together of pieces is that log without loss, and a valid one with any loss."""

import contextlib
import random

import pytest

from gcs_server.logbook.log import UnreadableLog
from gcs_server.logbook.ulog import read_ulog
from gcs_server.vehicle.services.ulog_pieces import UlogPieces
from tests.unit.gcs_server.logbook.generated_ulogs import ulog
from vehicle_sim.logger.stream import UlogStream


def pieces_of(content, definitions_size):
    """Pieces as the simulated vehicle cuts them."""
    stream = UlogStream(content[:definitions_size])
    stream.add(content[definitions_size:])
    pieces, now_us = [], 0
    while due := stream.due(now_us):
        for piece in due:
            pieces.append(piece)
            stream.acknowledge(piece.sequence)
        now_us += 4000
    return pieces


def begin_of_data(content):
    """Where the samples begin."""
    at = 16
    while chr(content[at + 2]) != "D":
        at += 3 + int.from_bytes(content[at : at + 2], "little")
    return at


CONTENT = ulog(steps=300)
PIECES = pieces_of(CONTENT, begin_of_data(CONTENT))


def put_together(pieces, first_s=0.0):
    together = UlogPieces()
    content = b"".join(
        together.add(p.sequence, p.first_message_offset, p.data, first_s + k * 0.01)
        for k, p in enumerate(pieces)
    )
    return content, together


def test_without_loss_it_is_the_same_log():
    content, together = put_together(PIECES)
    assert CONTENT.startswith(content)
    assert len(CONTENT) - len(content) < 249  # the last piece is not full
    assert (together.lost, together.dropouts) == (0, 0)


def test_repeated_and_late_pieces_change_nothing():
    repeated = [piece for p in PIECES for piece in (p, p)]
    assert put_together(repeated)[0] == put_together(PIECES)[0]


def test_what_is_lost_is_a_dropout_of_its_duration(tmp_path):
    begin = next(k for k, p in enumerate(PIECES) if not p.acked) + 5
    kept = PIECES[:begin] + PIECES[begin + 3 :]
    together, content = UlogPieces(), b""
    for k, p in enumerate(kept):
        now_s = k * 0.01 + (1.5 if k >= begin else 0.0)
        content += together.add(p.sequence, p.first_message_offset, p.data, now_s)
    (tmp_path / "a.ulg").write_bytes(content)
    log = read_ulog(tmp_path / "a.ulg")
    assert (together.lost, together.dropouts) == (3, 1)
    assert max(duration_s for _, duration_s in log.dropouts) == pytest.approx(1.51, abs=0.002)
    assert log.problems == []


def test_numbers_go_on_after_65535(tmp_path):
    moved = [type(p)((p.sequence + 65_500) & 0xFFFF, p.first_message_offset, p.data, p.acked) for p in PIECES]
    assert put_together(moved)[0] == put_together(PIECES)[0]


def test_another_begin_is_another_log():
    _, together = put_together(PIECES[:60])
    assert together.add(0, 0, PIECES[0].data, 1.0) == b""
    assert together.begins_again


@pytest.mark.parametrize("loss", [0.05, 0.2, 0.6])
def test_with_any_loss_it_is_a_valid_log(tmp_path, loss):
    for seed in range(10):
        rng = random.Random(f"{loss} {seed}")
        kept = [p for p in PIECES if p.acked or rng.random() >= loss]
        content, together = put_together(kept)
        (tmp_path / "a.ulg").write_bytes(content)
        log = read_ulog(tmp_path / "a.ulg")
        assert log.problems == []
        assert together.lost > 0
        assert len(log.topics) > 2


def test_hostile_pieces_never_break_it(tmp_path):
    for seed in range(300):
        rng = random.Random(seed)
        together, content = UlogPieces(), b""
        for p in PIECES:
            data = rng.randbytes(rng.randrange(250)) if rng.random() < 0.1 else p.data
            sequence = rng.randrange(65_536) if rng.random() < 0.05 else p.sequence
            offset = rng.randrange(256) if rng.random() < 0.1 else p.first_message_offset
            content += together.add(sequence, offset, data, rng.random())
        (tmp_path / "a.ulg").write_bytes(content)
        if seed < 20:
            with contextlib.suppress(UnreadableLog):
                read_ulog(tmp_path / "a.ulg")
