"""Hostile metadata of a vehicle: invalid entries are omitted with the reason, the rest is used."""

import contextlib
import json
import lzma
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.storage.cache import Cache
from gcs_server.vehicle import event_document, metadata_files, param_document
from gcs_server.vehicle.event_definitions import MAX_TEXT_LENGTH
from gcs_server.vehicle.metadata_files import EVENTS, PARAMETERS, Damaged
from tests.executed_lines import count_executed_lines

GOOD_ENTRY = {"name": "GOOD", "type": "Float", "max": 3.0}
EVENT_ID = 1 << 24 | 7
"""Component 1, event 7."""


def parameters_json(*entries):
    return json.dumps({"version": 1, "parameters": [*entries, GOOD_ENTRY]}).encode()


def events_json(enums=None, **event):
    groups = {"arming_check": {"events": {"7": {"name": "bad", **event}, "8": {"name": "good"}}}}
    component = {"namespace": "px4", "event_groups": groups, "enums": enums or {}}
    return json.dumps({"version": 2, "components": {"1": component}}).encode()


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"bitmask": [{"index": 8_000_000_000}]}, "<= 31"),
        ({"bitmask": [{"index": -1}]}, ">= 0"),
        ({"values": [{"value": v} for v in range(1000)]}, "length <= 256"),
        ({"values": {"1": 2}}, "Expected `array`"),
        ({"decimalPlaces": -5}, ">= 0"),
        ({"decimalPlaces": 99_999_999}, "<= 15"),
        ({"max": 1e300}, "<= 3.5e+38"),
        ({"min": -(10**40)}, "of range|-4294967296"),  # one of the two texts
        ({"name": "A\0B"}, "regex"),
        ({"name": 3}, "Expected `str`"),
        ({"shortDesc": ["deep"]}, "Expected `str"),
    ],
)
def test_invalid_metadata_of_a_parameter_is_omitted_with_the_reason(entry, expected):
    parsed = param_document.parse(parameters_json({"name": "BAD", "type": "Int32", **entry}))
    assert list(parsed) == ["GOOD"]
    assert any(text in parsed.omission_text for text in expected.split("|")), parsed.omission_text
    assert "Left out 1 parameter" in parsed.omission_text


def test_the_text_about_many_invalid_parameters_is_short_and_counts_them():
    content = b'{"version":1,"parameters":[' + b"{}," * 100_000 + b"{}]}"
    parsed = param_document.parse(content)
    assert not parsed
    assert "100,001 parameters" in parsed.omission_text
    assert len(parsed.omission_text) < 700


def test_long_texts_of_parameters_are_cut():
    entry = {
        "name": "A",
        "type": "Float",
        "shortDesc": "t" * 9999,
        "longDesc": "d" * 99_999,
        "units": "u" * 999,
    }
    metadata = param_document.parse(parameters_json(entry))["A"]
    assert (len(metadata.title), len(metadata.details), len(metadata.unit)) == (300, 3000, 60)
    assert metadata.title.endswith("…")


@pytest.mark.parametrize(
    "text", ["<a " * 30_000, " " * 100_000, "{1:.99999999}" * 9000, "\\" * 100_001, "{" * 99_999]
)
def test_the_work_and_the_length_of_an_event_text_are_limited(text):
    def lines_run(times):
        return count_executed_lines(lambda: event_document.parse_template(text * times, 500).fill([]))

    assert lines_run(4) == lines_run(1) < 5_000
    assert len(event_document.parse_template(text, 500).fill([])) <= 500


def test_the_text_of_an_event_has_a_limited_length():
    labels = {str(1 << bit): {"name": "x" * 500} for bit in range(64)}
    enums = {"e": {"type": "uint64_t", "is_bitfield": True, "entries": labels}}
    definitions = event_document.parse(
        events_json(enums, message="{1}" * 150, arguments=[{"name": "a", "type": "e"}])
    )
    definition = definitions[EVENT_ID]
    text = definition.text(b"\xff" * 40)
    assert len(text) == MAX_TEXT_LENGTH
    assert count_executed_lines(lambda: definition.text(b"\xff" * 40)) < 10_000


def test_the_number_of_decimals_in_an_event_text_is_limited():
    definitions = event_document.parse(
        events_json(message="{1:.999} {1:.2}", arguments=[{"name": "a", "type": "float"}])
    )
    assert definitions[EVENT_ID].text(struct.pack("<f", 0.5)) == "0.500000000 0.50"


@pytest.mark.parametrize(
    "invalid",
    [
        {"arguments": [{"type": "float"}] * 1000},
        {"arguments": 3},
        {"message": {"deep": 1}},
        {"name": None},
    ],
)
def test_an_invalid_event_is_omitted_with_the_reason(invalid):
    parsed = event_document.parse(events_json(**invalid))
    assert [d.name for d in parsed.values()] == ["good"]
    assert "Left out 1 entry: event 7" in parsed.omission_text


def test_only_the_labels_of_a_too_long_enum_are_omitted():
    enums = {"e": {"type": "uint8_t", "entries": {str(n): {"name": "x"} for n in range(100_000)}}}
    parsed = event_document.parse(events_json(enums, message="{1}", arguments=[{"name": "a", "type": "e"}]))
    assert parsed[EVENT_ID].text(b"\1") == "–"
    assert "enum e" in parsed.omission_text


@pytest.mark.parametrize(
    "invalid",
    [{"type": "matrix", "entries": {}}, {"type": "uint8_t", "entries": {"x": {}}}, 3, {"type": "uint8_t"}],
)
def test_an_invalid_enum_is_omitted_with_the_reason(invalid):
    assert "enum e" in event_document.parse(events_json({"e": invalid})).omission_text


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(
                    ["version", "parameters", "name", "components", "enums", "event_groups", "1"]
                ),
                inner,
                max_size=4,
            )
        ),
        max_leaves=20,
    )
)
def test_any_json_is_parsed_or_refused_with_an_error_text(value):
    problems = []
    for content in (json.dumps(value).encode(), json.dumps({"version": 1, "parameters": value}).encode()):
        for kind in (PARAMETERS, EVENTS):
            try:
                metadata_files.decode_document(kind, metadata_files.encode_document(kind, content, 0))
            except ValueError as error:
                problems.append(str(error))
        with contextlib.suppress(ValueError):
            metadata_files.read_general(content, 0)
    assert all(0 < len(problem) <= metadata_files.MAX_PROBLEM_LENGTH for problem in problems)


def test_an_incomplete_file_and_a_wrong_checksum_are_reported_as_damaged():
    packed = lzma.compress(parameters_json())
    for data, crc in ((packed[:-20], 0), (packed, 1234)):
        with pytest.raises(Damaged):
            metadata_files.unpacked(data, crc)
    assert metadata_files.unpacked(packed, metadata_files.crc32(packed)) == parameters_json()


def test_valid_entries_of_the_general_metadata_file_are_used():
    entries = [
        3,
        {"type": "1", "uri": "a"},
        {"type": 1, "uri": "b", "fileCrc": "x"},
        {"type": 1, "uri": "c" * 999},
        {"type": 4, "uri": "mftp://x", "fileCrc": -1},
    ]
    parsed = metadata_files.read_general(json.dumps({"metadataTypes": entries}).encode(), 0)
    assert [(e.kind, e.uri, e.crc) for e in parsed] == [(4, "mftp://x", 0xFFFFFFFF)]
    with pytest.raises(ValueError, match="more than 64,000"):
        metadata_files.read_general(lzma.compress(b" " * 1_000_000), 0)


def test_the_total_size_of_the_cache_is_limited(tmp_path):
    cache = Cache(tmp_path, max_total_bytes=1000)
    for n in range(20):
        cache.write(f"f{n}", bytes(300))
    assert sum(p.stat().st_size for p in tmp_path.iterdir()) <= 1000
    assert cache.read("f19") is not None


@pytest.mark.parametrize("name", ["uavcan.pubp-pres", "gnss.dyn_model", "COM_OF_LOSS_T"])
def test_parameter_names_with_dots_hyphens_and_lower_case_are_accepted(name):
    assert name in param_document.parse(parameters_json({"name": name, "type": "Int32"}))


def test_the_files_of_a_real_px4_are_read_completely(reference_data):
    for kind, name, count in ((PARAMETERS, "parameters", 1821), (EVENTS, "events", 370)):
        packed = (reference_data / f"px4/{name}.json.xz").read_bytes()
        parsed = metadata_files.decode_document(kind, metadata_files.encode_document(kind, packed, 0))
        assert (len(parsed), parsed.omission_text) == (count, None)
