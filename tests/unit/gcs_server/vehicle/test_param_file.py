"""QGroundControl's `.params` files: written and read, and what is wrong with a line."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.vehicle import param_file
from gcs_server.vehicle.param_review import review_row, same_value
from gcs_server.vehicle.param_table import Param

NAMES = st.from_regex(r"[A-Z][A-Z0-9_]{0,15}", fullmatch=True)
INTEGERS = st.integers(-(2**31), 2**31 - 1)
FLOATS = st.floats(allow_nan=False, allow_infinity=False, width=32)
PARAMS = st.dictionaries(NAMES, INTEGERS | FLOATS, max_size=30).map(
    lambda values: [Param(name, value, isinstance(value, int)) for name, value in values.items()]
)
WRITTEN_BY_QGROUNDCONTROL = """\
# Onboard parameters for Vehicle 3
#
# Stack: PX4 Pro
# Vehicle: Multi-Rotor
# Version: 1.16.0
# Git Revision: 6ea3539157000000
#
# Vehicle-Id Component-Id Name Value Type
3\t1\tMNT_MODE_IN\t4\t6
3\t1\tMPC_XY_VEL_MAX\t12.000000000000000000\t9
3\t1\tCAL_MAG0_XOFF\t-1.19209e-07\t9
"""


@given(PARAMS, st.integers(1, 255))
def test_what_is_written_is_read_again_bit_for_bit(params: list[Param], system_id: int) -> None:
    file = param_file.read(param_file.write(params, system_id, 1, "1.17.0"), 1)
    assert [row.problem for row in file.rows] == [None] * len(params)
    for param, row in zip(params, file.rows, strict=True):
        assert (row.name, row.is_integer) == (param.name, param.is_integer)
        assert row.value is not None
        assert same_value(param, row.value)
        if not param.is_integer:
            assert struct.pack("<f", row.value) == struct.pack("<f", param.value)
        assert review_row(row, param, None).state == "same"
    assert param_file.notes(file, system_id, "1.17.0") == (() if params else ("The file has no parameters.",))


@given(st.text() | st.lists(st.text(alphabet="1\t 96.-eEAMNT_#", max_size=40)).map("\n".join))
def test_any_text_is_read_and_each_broken_line_is_named(text: str) -> None:
    file = param_file.read(text, 1)
    count = len(text.splitlines())
    for row in file.rows:
        assert row.line is not None
        assert 1 <= row.line <= count
        assert (row.value is None) == (row.problem is not None)
        assert row.value is None or math.isfinite(row.value)


def test_a_file_of_qgroundcontrol_is_read_and_its_origin_is_named() -> None:
    file = param_file.read(WRITTEN_BY_QGROUNDCONTROL, 1)
    assert [(row.name, row.value, row.is_integer, row.line) for row in file.rows] == [
        ("MNT_MODE_IN", 4, True, 9),
        ("MPC_XY_VEL_MAX", 12.0, False, 10),
        ("CAL_MAG0_XOFF", pytest.approx(-1.19209e-07), False, 11),
    ]
    assert param_file.notes(file, 3, "1.16.0") == ()
    texts = param_file.notes(file, 1, "1.17.0")
    assert ["of vehicle 3; this is vehicle 1" in texts[1], "version 1.16.0" in texts[0]] == [True, True]
    other = param_file.read("# Stack: ArduPilot\n1\t1\tA\t1\t6\n", 1)
    assert param_file.notes(other, 1, None) == ("The file is of ArduPilot, not of PX4.",)


def test_each_fault_of_a_line_has_its_words() -> None:
    lines = {
        "1\t1\tMNT_MODE_IN\t4": "Not vehicle, component",
        "1\t1\tNAME WITH SPACE\t4\t6": "is not a parameter name",
        "one\t1\tA\t4\t6": "must be whole numbers",
        "1\t100\tA\t4\t6": "component 100, not of the autopilot",
        "1\t1\tA\t4.5\t6": "not a whole number",
        "1\t1\tA\tnan\t9": "is not a number",
        "1\t1\tA\t1e999\t9": "is not a number",
        "1\t1\tA\t4\t8": "Type 8 is not supported",
        "x" * 500: "…",
    }
    file = param_file.read("\n".join(lines), 1)
    for row, words in zip(file.rows, lines.values(), strict=True):
        assert row.problem is not None
        assert words in row.problem
        assert len(row.problem) < 200
    long_file = param_file.read("1\t1\tA\t4\t6\n" * (param_file.MAX_LINES + 5), 1)
    assert long_file.rows[-1].problem == "The file has more than 10,000 lines."
