"""Parameters: PX4's metadata, and exact types in messages and in the cache."""

import json
import lzma
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.errors import InvalidRequest
from gcs_server.storage.cache import MAX_FILES, Cache
from gcs_server.vehicle import param_document, param_metadata
from gcs_server.vehicle.param_table import MAX_PARAMETERS, Param, ParamReport, ParamTable, read_report

INT32, REAL32, REAL64 = 6, 9, 10
"""MAV_PARAM_TYPE."""


def payload(name, bits, index=0, count=2, kind=REAL32):
    return struct.pack("<4sHH16sB", bits, count, index, name.encode(), kind)


@pytest.fixture(scope="module")
def metadata(reference_data):
    return param_document.parse(lzma.decompress((reference_data / "px4/parameters.json.xz").read_bytes()))


@pytest.fixture(scope="module")
def recorded_parameters(reference_data):
    content = json.loads((reference_data / "px4/parameters-live.json").read_text())
    return content.get("parameters", content)


def test_every_parameter_of_the_recorded_vehicle_is_decoded_and_has_metadata(metadata, recorded_parameters):
    assert len(recorded_parameters) == 929
    table = ParamTable()
    for name, recorded in recorded_parameters.items():
        is_integer = recorded["type"] == "int32"
        bits = struct.pack("<i", recorded["value"]) if is_integer else struct.pack("<f", recorded["value"])
        report = read_report(
            payload(name, bits, recorded["index"], len(recorded_parameters), INT32 if is_integer else REAL32)
        )
        assert report is not None
        assert table.put(report)
        assert report.param == Param(
            name, recorded["value"] if is_integer else struct.unpack("<f", bits)[0], is_integer
        )
        entry = metadata[name]
        assert entry.is_integer == is_integer, name
        assert entry.group, name
        assert entry.title, name
        default = param_metadata.is_default(entry, entry.default)
        assert default is True, name
    assert table.complete
    assert table.missing(5) == []
    loaded = ParamTable.load(put_hash(table, 77).dump(), 77, 929)
    assert loaded.all() == table.all()


def put_hash(table, value):
    table.put(ParamReport(Param("_HASH_CHECK", value, True), 65535, table.count))
    return table


def test_nearly_all_recorded_values_are_within_their_ranges(metadata, recorded_parameters):
    """The server would refuse to set the other values without `force`."""
    out_of_range = set()
    for name, recorded in recorded_parameters.items():
        try:
            metadata[name].check(recorded["value"])
        except InvalidRequest as error:
            out_of_range.add((name, name in str(error), "force" in (error.remedy or "")))
    assert len(out_of_range) < 10, sorted(out_of_range)
    assert all(names_parameter and names_force for _, names_parameter, names_force in out_of_range)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("MPC_XY_VEL_MAX", 500.0, "from 0 to 20 m/s"),
        ("COM_OBL_RC_ACT", 77, "one of"),
        ("COM_RC_OVERRIDE", 64, "a sum of"),
        ("COM_OF_LOSS_T", -1.0, "from 0 to 60 s"),
    ],
)
def test_the_refusal_of_a_value_out_of_range_names_the_range(metadata, name, value, expected):
    with pytest.raises(InvalidRequest, match=expected) as caught:
        metadata[name].check(value)
    assert caught.value.field == "value"
    metadata["MPC_XY_VEL_MAX"].check(20)
    metadata["COM_OF_LOSS_T"].check(struct.unpack("<f", struct.pack("<f", 0.1))[0])


def test_the_error_about_a_range_with_one_limit_names_the_limit():
    minimum_only = param_metadata.ParamMetadata("A", False, "G", "Standard", min=1.5)
    with pytest.raises(InvalidRequest, match=r"at least 1\.5"):
        minimum_only.check(1)
    maximum_only = param_metadata.ParamMetadata("A", False, "G", "Standard", max=2, unit="s")
    with pytest.raises(InvalidRequest, match="at most 2 s"):
        maximum_only.check(3)


@pytest.mark.parametrize("invalid", [b"[]", b'{"version": 2, "parameters": []}', b"x"])
def test_an_invalid_document_is_refused_with_a_reason(invalid):
    with pytest.raises(ValueError, match=r"."):
        param_document.parse(invalid)


@given(st.binary(min_size=4, max_size=4), st.sampled_from([1, 2, 3, 4, 5, 6, 9, 10]))
def test_the_bits_of_a_value_are_unchanged_in_report_and_cache(bits, kind):
    report = read_report(payload("ABCDEFGHIJKLMNOP", bits, kind=kind))
    if kind == REAL64:
        assert report is None  # a double has more than 32 bits
        return
    assert report.param.name == "ABCDEFGHIJKLMNOP"
    assert report.param.is_integer == (kind != REAL32)
    if kind == INT32:
        assert struct.pack("<i", report.param.value) == bits
    table = ParamTable()
    table.put(report)
    table.put(ParamReport(Param("Z", math.inf, False), 1, 2))
    loaded = ParamTable.load(put_hash(table, 5).dump(), 5, 2).get("ABCDEFGHIJKLMNOP")
    assert loaded.is_integer == report.param.is_integer
    assert loaded.value == report.param.value or (math.isnan(loaded.value) and math.isnan(report.param.value))


def test_a_damaged_cache_and_a_cache_of_other_parameters_are_not_used():
    table = ParamTable()
    table.put(ParamReport(Param("A", 1, True), 0, 1))
    content = put_hash(table, 9).dump()
    assert ParamTable.load(content, 9, 1).get("A").value == 1
    assert ParamTable.load(content, 8, 1) is None
    assert ParamTable.load(content, 9, 2) is None
    assert ParamTable.load(content[:-5], 9, 1) is None
    assert ParamTable.load(b"[]", 9, 1) is None


def test_a_parameter_report_with_another_list_length_is_not_stored():
    table = ParamTable()
    assert table.put(ParamReport(Param("A", 1, True), 0, 3))
    assert table.put(ParamReport(Param("B", 1, True), 65535, 4))  # requested by name, so it has no index
    assert table.missing(9) == [1, 2]
    assert not table.put(ParamReport(Param("C", 1, True), 1, 4))


def test_the_cache_keeps_the_newest_files_and_ignores_write_errors(tmp_path):
    cache = Cache(tmp_path / "cache")
    assert cache.read("a.json") is None
    for n in range(MAX_FILES + 5):
        cache.write(f"f{n}", b"x")
    assert cache.read(f"f{MAX_FILES + 4}") == b"x"
    assert len(list((tmp_path / "cache").iterdir())) == MAX_FILES
    cache.write("big", bytes(9_000_000))
    assert cache.read("big") is None
    with pytest.raises(ValueError, match="not a valid name"):
        cache.read("../token")
    (tmp_path / "file").write_text("a file instead of the folder")
    Cache(tmp_path / "file").write("a", b"x")


def test_the_refusal_of_a_value_lists_a_limited_number_of_choices():
    choices = tuple(param_metadata.Choice(n, "x" * 300) for n in range(256))
    for metadata in (
        param_metadata.ParamMetadata("A", True, "G", "Standard", choices=choices),
        param_metadata.ParamMetadata("A", True, "G", "Standard", bits=choices[:31]),
    ):
        with pytest.raises(InvalidRequest, match=r"and \d+ more") as caught:
            metadata.check(-1)
        assert len(str(caught.value)) < 2000


def test_a_checksum_that_is_not_a_finite_number_is_ignored():
    table = ParamTable()
    for value in (math.nan, math.inf, -math.inf):
        assert table.put(ParamReport(Param("_HASH_CHECK", value, False), 65535, 3))
        assert table.hash is None


def test_parameters_with_invalid_names_are_counted_and_do_not_keep_the_list_incomplete():
    table = ParamTable()
    for index, name in enumerate(("GOOD", "\ufffd\ufffd", "A B", "", "A\nB", "A.B")):
        table.put(ParamReport(Param(name, 1, True), index, 6))
    assert table.complete
    assert [p.name for p in table.all()] == ["A.B", "GOOD"]
    assert table.omitted_count == 4


def test_the_table_keeps_a_limited_number_of_parameters():
    table = ParamTable()
    for n in range(MAX_PARAMETERS + 500):
        table.put(ParamReport(Param(f"P{n}", n, True), 65535, 3))
    assert len(table) == MAX_PARAMETERS


@pytest.mark.parametrize(
    "content", [b"[]", b"3", b"[" * 100_000, b'{"version":1,"hash":1,"count":1}', b"\xff"]
)
def test_a_damaged_table_in_the_cache_is_not_used(content):
    assert ParamTable.load(content, 1, 1) is None
