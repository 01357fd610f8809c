"""Compiled missions as bytes: equal after the way through a process, and an error for any wrong bytes."""

import asyncio
import dataclasses
import json
import pickle
import random

import msgspec
import numpy as np
import pytest

from gcs_server.errors import Refused
from gcs_server.flights.mission_start import CompiledMission, compiled_missions
from gcs_server.plans import tasks, typed_values
from gcs_server.plans.tasks import Answer
from missions.offboard.state import OperatorArea

STEPS = [
    {"step": "take_off", "height_m": 5},
    {"step": "fly", "points": [{"offset_ned_m": [20, 0, -8]}, {"offset_ned_m": [20, 9, -9]}]},
    {"step": "photo"},
    {"step": "table", "file": "a.csv"},
    {"step": "branch", "condition": {"value": "battery_share", "above": 0.5}, "then": [{"step": "land"}]},
]
TABLE = "t_s,north_m,east_m,down_m\n0,20,9,-9\n5,22,9,-9\n10,24,9,-9\n"
MISSION = {"format": "offboard-gcs-mission", "name": "Mast", "steps": STEPS, "tables": {"a.csv": TABLE}}


def compiled():
    vehicle = {
        "parameters": {},
        "reported": None,
        "operator": OperatorArea().to_json(),
        "start": {
            "position_ned_m": [0.0, 0.0, 0.0],
            "yaw_ned_rad": 0.0,
            "origin": {"lat_deg": 47.0, "lon_deg": 8.0, "alt_amsl_m": 400.0},
            "home_alt_amsl_m": 400.0,
            "in_air": False,
        },
    }
    arguments = {"plan": json.dumps(MISSION).encode(), "vehicles": [[None, vehicle]], "elevation": []}
    return tasks.run("compile", arguments)


def assert_equal(first, second):
    """Compares values with arrays."""
    assert type(first) is type(second)
    if isinstance(first, np.ndarray):
        assert first.dtype == second.dtype
        np.testing.assert_array_equal(first, second)
    elif isinstance(first, tuple):
        assert len(first) == len(second)
        for pair in zip(first, second, strict=True):
            assert_equal(*pair)
    elif dataclasses.is_dataclass(first):
        for each in dataclasses.fields(first):
            if each.init:
                assert_equal(getattr(first, each.name), getattr(second, each.name))
    else:
        assert first == second


def test_a_compiled_mission_is_equal_after_its_way_from_the_process():
    answer = compiled()
    assert answer.fault is None, answer.fault
    first = asyncio.run(compiled_missions(answer))[None]
    again = typed_values.from_bytes(typed_values.to_bytes(first), CompiledMission)
    assert len(first[0].segments) >= 4
    assert_equal(first, again)
    assert_equal(first[0].at(3.0), again[0].at(3.0))


class Attack:
    def __reduce__(self):
        raise AssertionError("executed")


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        pickle.dumps((1, 2)),
        msgspec.msgpack.encode(["Timeline"]),
        msgspec.msgpack.encode([["os.system", "true"], []]),
        msgspec.msgpack.encode([[]] * 3),
    ],
)
def test_other_bytes_are_refused(data):
    with pytest.raises(Refused, match="cannot be read"):
        asyncio.run(compiled_missions(Answer({}, data)))


def test_changed_values_are_refused_or_of_the_expected_types():
    """Replaces single values anywhere in the bytes by values of other types."""
    rng = random.Random(3)
    [[_, value]] = msgspec.msgpack.decode(compiled().body)
    refused = 0
    for _ in range(300):
        changed = json_copy(value)
        parent, index = random_place(rng, changed)
        parent[index] = rng.choice([None, -1, 1e300, "x", [], [["Timeline"]], b"1", {"a": 1}, True])
        try:
            timeline, motion = typed_values.from_bytes(msgspec.msgpack.encode(changed), CompiledMission)
        except typed_values.WrongValue:
            refused += 1
        else:
            assert type(timeline).__name__ == "Timeline"
            assert all(type(each) is float for each in timeline.starts_s)
            assert type(motion.speed_m_s) is float
    assert refused > 200


def json_copy(value):
    return [json_copy(each) for each in value] if isinstance(value, list) else value


def random_place(rng, value):
    while True:
        index = rng.randrange(len(value))
        if not isinstance(value[index], list) or not value[index] or rng.random() < 0.1:
            return value, index
        value = value[index]
