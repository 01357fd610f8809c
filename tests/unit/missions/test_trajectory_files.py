"""Trajectories from files: CSV and NumPy arrays become tables of a mission; hostile files are refused."""

from __future__ import annotations

import contextlib
import io
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import PlanError
from missions.offboard.tables import COLUMNS, MAX_ROWS, import_file, read_rows

ROWS = [[0, 0, 0, -10, 0], [4, 20, 0.125, -10, 0.5], [8, 20, 20, -12.5, 1.25]]
CSV = b"t_s,north_m,east_m,down_m\r\n0,0,0,-10\r\n10,20,0,-10\r\n"


def npy_file(values: Any, **options: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, values, **options)
    return file.getvalue()


def npy_start(header: str) -> bytes:
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def import_error(data: bytes, filename: str = "loop.npy") -> PlanError:
    with pytest.raises(PlanError) as raised:
        import_file(data, filename)
    return raised.value


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "<f2"])
def test_a_numpy_array_becomes_csv_with_the_same_numbers(dtype: str, order: Any) -> None:
    table = import_file(npy_file(np.array(ROWS, dtype=dtype, order=order)), "flights/loop.npy")
    assert (table.name, table.rows, table.duration_s, table.has_yaw) == ("flights/loop.csv", 3, 8.0, True)
    assert table.text.splitlines()[:3] == [",".join(COLUMNS), "0,0,0,-10,0", "4,20,0.125,-10,0.5"]
    assert read_rows(table.text.encode()) == ROWS


def test_single_precision_values_are_written_with_their_shortest_decimals() -> None:
    table = import_file(npy_file(np.array([[0, 0, 0, 0], [0.1, 1.3, 0, 0]], dtype="<f4")), "a.npy")
    assert table.text.splitlines()[2] == "0.1,1.3,0,0"


def test_an_array_of_whole_numbers_without_yaw_becomes_csv() -> None:
    table = import_file(npy_file(np.array(ROWS)[:, :4].astype(int)), "a.npy")
    assert (table.has_yaw, table.text.splitlines()[0]) == (False, "t_s,north_m,east_m,down_m")


@given(st.lists(st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3), min_size=2, max_size=20))
@settings(deadline=None, max_examples=15)
def test_every_double_is_kept_exactly(positions: list[list[float]]) -> None:
    rows = [[float(t), *position] for t, position in enumerate(positions)]
    assert read_rows(import_file(npy_file(np.array(rows)), "a.npy").text.encode()) == rows


def test_csv_text_is_kept_without_its_byte_order_mark() -> None:
    table = import_file(b"\xef\xbb\xbf" + CSV, "loop.CSV")
    assert (table.name, table.text, table.rows) == ("loop.csv", CSV.decode(), 2)


@pytest.mark.parametrize(
    ("filename", "name"),
    [("", "path.csv"), (".csv", "path.csv"), ("a\x00\nb", "a  b.csv"), ("x" * 300, "x" * 96 + ".csv")],
)
def test_the_table_gets_a_valid_name(filename: str, name: str) -> None:
    assert import_file(CSV, filename).name == name


@pytest.mark.parametrize(
    ("data", "reason", "fix"),
    [
        (npy_file(np.array([[{}] * 4] * 3, dtype=object), allow_pickle=True), "type object", "astype(float)"),
        (npy_file(np.array([["0"] * 4] * 3)), "not numbers", "astype(float)"),
        (npy_file(np.zeros((3, 4), dtype=complex)), "complex128", "astype(float)"),
        (npy_file(np.zeros((3, 4), dtype=[("a", float)])), "not numbers", "astype(float)"),
        (npy_file(np.zeros(20)), "shape is (20,)", "(N, 4) or (N, 5)"),
        (npy_file(np.zeros((2, 2, 4))), "shape is (2, 2, 4)", "(N, 4) or (N, 5)"),
        (npy_file(np.zeros((5, 300))), "shape is (5, 300)", "array.T"),
        (npy_file(np.zeros((0, 5))), "0 rows", "number of rows"),
        (npy_file(np.array(ROWS))[:-1], "ends before", "again"),
        (npy_file(np.array(ROWS, dtype=float) * np.nan), "not finite", "this row"),
        (npy_file(np.full((2, 4), 1e300, dtype=np.longdouble) ** 4), "not finite", "this row"),
        (npy_file(np.array(ROWS)[::-1]), "times must increase", "Sort"),
        (b"PK\x03\x04 and more", "an archive of arrays", "numpy.save"),
        (b"t_s,north_m", "not a NumPy array", "numpy.save"),
        (b"\x93NUMPY", "not a NumPy array", "numpy.save"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}", "version 1.0", "numpy.save"),
        (npy_start("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 5)}"), "ends before", ""),
        (npy_start("{'descr': '<f8', 'fortran_order': False, 'shape': (-3, 5)}"), "ends before", ""),
        (npy_start("{'descr': '<f8', 'fortran_order': False, 'shape': (2**70, 5)}"), "not a NumPy array", ""),
        (npy_start("{'descr': 'V99999999999', 'fortran_order': False, 'shape': (1, 5)}"), "not ", ""),
        (npy_start("(" * 110), "not a NumPy array", "numpy.save"),
        (npy_start("'''"), "not a NumPy array", "numpy.save"),
        (npy_start("{'descr': ['<f8'], 'shape': 3, 'fortran_order': False}"),
         "not a NumPy array", "numpy.save"),
        (b"\x93NUMPY" + bytes(5_000_000), "too large", "fewer rows"),
    ],
)  # fmt: skip
def test_a_hostile_array_is_refused_with_a_fix(data: bytes, reason: str, fix: str) -> None:
    tracemalloc.start()
    error = import_error(data)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert reason in error.reason
    assert fix in error.fix
    assert peak_bytes < 1_000_000


def test_csv_with_too_many_rows_or_characters_is_refused() -> None:
    line = b"\n0,0,0,0"
    assert f"the maximum is {MAX_ROWS} rows" in import_error(b"t_s" + line * 20_500, "a.csv").reason
    long_table = np.arange(80_000).reshape(20_000, 4) / 3.0
    assert "the maximum is 1000000" in import_error(npy_file(long_table)).reason
    assert "numpy.round" in import_error(npy_file(long_table)).fix
    assert import_file(npy_file(np.round(long_table, 2)), "a.npy").rows == 20_000


@given(st.binary(max_size=200), st.integers(0, 120))
@settings(deadline=None, max_examples=60)
def test_a_damaged_array_is_read_or_refused(noise: bytes, start: int) -> None:
    valid = npy_file(np.array(ROWS))
    damaged = valid[:start] + noise + valid[start + len(noise) :]
    with contextlib.suppress(PlanError):
        assert 2 <= import_file(damaged, "a.npy").rows <= len(ROWS)
