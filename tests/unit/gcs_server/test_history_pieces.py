"""A vehicle's history is encoded in pieces, so that the event loop runs in between."""

import json
import logging
import math
from types import SimpleNamespace

import pytest

from gcs_server.api.responses import SAMPLES_PER_PIECE, history_pieces, history_view, json_response
from gcs_server.clock import SystemClock
from gcs_server.faults import Isolation
from gcs_server.vehicle.samples import Sample


def vehicle():
    return SimpleNamespace(id="1", isolation=Isolation(SystemClock(), logging.getLogger("test"), "Vehicle 1"))


def sample(n, value=None):
    return Sample("local_position", None, float(n), float(n), value or {"n": n})


class Unencodable:
    """A value that can be converted neither to JSON nor to text."""

    def __str__(self):
        raise ValueError


def samples_of(pieces):
    return json.loads(json_response(history_view(pieces)).body)["samples"]


@pytest.mark.parametrize("count", [0, 1, SAMPLES_PER_PIECE, 3 * SAMPLES_PER_PIECE + 7])
def test_a_long_history_is_encoded_in_pieces(count):
    pieces = list(history_pieces(vehicle(), [sample(n) for n in range(count)]))
    assert len(pieces) == math.ceil(count / SAMPLES_PER_PIECE)
    assert [each["value"]["n"] for each in samples_of(pieces)] == list(range(count))


def test_a_sample_that_cannot_be_encoded_is_omitted():
    samples = [sample(0), sample(1, value=Unencodable()), sample(2)]
    assert [each["value"]["n"] for each in samples_of(list(history_pieces(vehicle(), samples)))] == [0, 2]
