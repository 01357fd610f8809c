"""Values for plots: extremes survive the reduction, windows reach their edges, expressions are computed and
nothing else is evaluated."""

import json
import math

import numpy as np
import pytest

from gcs_server.logbook import tasks
from gcs_server.logbook.columns import Columns, UnknownField, write
from gcs_server.logbook.expressions import evaluate
from gcs_server.logbook.log import Log, Topic
from gcs_server.logbook.series import thinned

TIMES_S = np.arange(10_000) / 1000.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    spiked = np.sin(TIMES_S).astype(np.float32)
    spiked[4321] = 50.0
    spiked[7777] = -50.0
    threes = np.full(10_000, 3, np.int32)
    half = math.sqrt(0.5)
    quaternion = {f"q[{i}]": np.full(10_000, value) for i, value in enumerate((half, 0.0, 0.0, half))}
    slow_s = np.arange(0, 10, 0.5)
    log = Log(
        "ulog",
        None,
        10.0,
        [
            Topic(
                "fast",
                "0",
                TIMES_S,
                {"x": spiked, "y": threes, **quaternion},
                {"x": "m"},
            ),
            Topic("slow", "0", slow_s, {"z": slow_s * 2}, {"z": "m/s"}),
            Topic("gaps", "0", TIMES_S, {"v": np.where(TIMES_S < 5, np.nan, 1.0)}, {}),
        ],
        [],
    )
    path = tmp_path_factory.mktemp("columns") / "log"
    write(log, b"{}", path)
    return path


def plot(folder, field, from_s=None, to_s=None, points=500):
    (found,) = json.loads(tasks.plot(str(folder), [field], from_s, to_s, points))["series"]
    return found


def test_peaks_are_kept_at_their_times(folder):
    found = plot(folder, "fast:0/x", points=200)
    assert len(found["values"]) <= 200
    peaks = dict(zip(found["values"], found["t_s"], strict=True))
    assert (peaks[50.0], peaks[-50.0]) == (4.321, 7.777)
    assert (found["t_s"][0], found["t_s"][-1], found["unit"], found["samples"]) == (0.0, 9.999, "m", 10_000)


@pytest.mark.parametrize("count", [1, 2, 3, 199, 200, 201, 399, 400, 401, 1000])
def test_the_number_of_points_is_bounded_and_times_ascend(count):
    values = np.random.default_rng(count).normal(size=count)
    kept = thinned(values, 200)
    assert len(kept) <= 200
    assert np.all(np.diff(kept) > 0)
    assert {int(values.argmin()), int(values.argmax()), 0, count - 1} <= set(kept.tolist())


def test_a_small_window_has_all_samples_and_one_beyond_each_edge(folder):
    found = plot(folder, "slow:0/z", 2.1, 3.1)
    assert found["t_s"] == [2.0, 2.5, 3.0, 3.5]
    assert found["values"] == [4.0, 5.0, 6.0, 7.0]
    assert plot(folder, "slow:0/z", 50, 60)["t_s"] == [9.5]


def test_missing_values_are_gaps(folder):
    found = plot(folder, "gaps:0/v", points=50)
    assert found["values"][0] is None
    assert found["values"][-1] == 1.0


@pytest.mark.parametrize(
    ("expression", "value", "unit"),
    [
        ("norm({fast:0/y}, 4)", 5.0, None),
        ("{fast:0/y} - {slow:0/z}", 3 - 2 * 4.0, None),
        ("derivative({slow:0/z})", 2.0, "m/s/s"),
        ("degrees({fast:0/y})", math.degrees(3), "°"),
        ("yaw({fast:0/q[0]}, {fast:0/q[1]}, {fast:0/q[2]}, {fast:0/q[3]})", 90.0, "°"),
        ("({fast:0/y} > 2) * 7", 7.0, None),
        ("-{fast:0/y} ** 2", -9.0, None),
        ("{fast:0/y} / 0", None, None),
        ("sqrt(0 - {fast:0/y})", None, None),
    ],
)
def test_expressions(folder, expression, value, unit):
    found = plot(folder, expression, points=10_000)
    at = found["t_s"].index(4.0)
    assert found["values"][at] == (None if value is None else pytest.approx(value))
    assert found["unit"] == unit


@pytest.mark.parametrize(
    "expression",
    [
        "__import__('os').system('true') + {fast:0/x}",
        "{fast:0/x}.real",
        "{fast:0/x}[0]",
        "(lambda: {fast:0/x})()",
        "[{fast:0/x} for _ in (1,)]",
        "open({fast:0/x})",
        "'a' * {fast:0/x}",
        "norm(*[{fast:0/x}])",
        "norm({fast:0/x}, x=1)",
        "{fast:0/x} if 1 else 2",
        "True + {fast:0/x}",
        "field_1 + {fast:0/x}",
        "atan2({fast:0/x})",
        "{fast:0/x} +",
        "{}",
        "{fast:0/x",
        "{fast:0/x} " + "+ 1 " * 200,
        "(" * 100 + "{fast:0/x}" + ")" * 100 + " + 1" * 60,
        "{fast:0/none} + 1",
        "{fast:9/x}",
        "fast:0",
        "fast:0/none",
        "",
        "../../etc/passwd",
    ],
)
def test_what_is_no_expression_or_field_is_refused(folder, expression):
    with pytest.raises(UnknownField):
        tasks.plot(str(folder), [expression], None, None, 100)


def test_a_huge_power_is_only_a_number(folder):
    assert plot(folder, "{fast:0/y} + 9 ** 9 ** 9 ** 9", points=10)["values"][0] is None


def test_columns_that_were_removed_are_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        Columns(tmp_path / "none")


def test_evaluate_reads_each_field_once():
    read = []

    def values(name):
        read.append(name)
        return TIMES_S[:5], np.arange(5.0), None

    times_s, result, _ = evaluate("{a:0/x} * {a:0/x} + {b:0/y}", values)
    assert read == ["a:0/x", "b:0/y"]
    assert result.tolist() == [0, 2, 6, 12, 20]
    assert len(times_s) == 5
