"""Encoding of FTP packets, and assembly of pieces of a file."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_server.vehicle.services import ftp_codec as codec
from gcs_server.vehicle.services.ftp_pieces import MAX_MISSING_PARTS, PartialFile
from tests.executed_lines import count_executed_lines

packets = st.builds(
    lambda data, **more: codec.Packet(data=data, size=len(data), **more),
    data=st.binary(max_size=codec.DATA_BYTES),
    sequence=st.integers(0, 65535),
    opcode=st.integers(0, 255),
    session=st.integers(0, 255),
    request_opcode=st.integers(0, 255),
    burst_complete=st.booleans(),
    offset=st.integers(0, 2**32 - 1),
)


@given(packets)
def test_a_packet_is_unchanged_after_encoding_and_decoding(packet):
    payload = codec.encode(packet)
    assert len(payload) == codec.PAYLOAD_BYTES
    assert codec.decode(payload) == packet


@given(st.binary(max_size=300))
def test_any_bytes_are_decoded_or_ignored(payload):
    packet = codec.decode(payload)
    assert packet is None or len(packet.data) <= codec.DATA_BYTES
    if packet is not None:
        codec.parse_listing(packet.data)
        assert str(codec.refusal(packet, "a", "Reading"))


def test_every_error_code_has_a_text():
    for error in codec.FtpError:
        text = str(codec.refusal(codec.Packet(0, codec.Opcode.NAK, data=bytes((error, 21))), "x", "Opening"))
        assert "error" not in text
        assert text.startswith("Opening x: ")


@given(st.integers(0, 1000), st.lists(st.tuples(st.integers(-5, 1100), st.integers(0, 300)), max_size=30))
def test_pieces_in_any_order_are_joined_to_the_file(size, spans):
    content = bytes(i * 7 % 251 for i in range(size))
    file, covered = PartialFile(size), set()
    for offset, length in spans:
        data = content[max(offset, 0) : max(offset, 0) + length] if offset >= 0 else bytes(length)
        fits_into_file = bool(data) and offset >= 0 and offset + len(data) <= size
        adds_bytes = fits_into_file and not set(range(offset, offset + len(data))) <= covered
        assert file.put(offset, data) == adds_bytes
        covered |= set(range(offset, offset + len(data))) if fits_into_file else set()
        assert file.received == len(covered)
    while (part := file.first_missing) is not None:
        assert not covered & set(range(*part))
        file.put(part[0], content[part[0] : part[1]])
    assert file.complete
    assert file.content == content


def test_the_recorded_listings_and_refusals_are_read(reference_data):
    lines = (reference_data / "px4/dialogues/ftp.jsonl").read_text().splitlines()
    dialogues = {d["id"]: d for d in map(json.loads, lines)}

    def reply(name):
        fields = dialogues[name]["received"][0]["fields"]["payload"]
        data = bytes.fromhex(fields["data_hex"])
        header = {"sequence": fields["seq_number"], "request_opcode": fields["req_opcode"]}
        return codec.Packet(opcode=fields["opcode"], size=len(data), data=data, **header)

    entries, count = codec.parse_listing(reply("ftp_list_dot").data)
    assert count == 9
    assert [e.name for e in entries] == [
        "log",
        "dataman",
        "parameters_backup.bson",
        "parameters.bson",
        "eeprom",
    ]
    assert entries[0].bytes is None
    assert entries[1].bytes == 1208528
    extras, _ = codec.parse_listing(reply("ftp_list_etc_extras").data)
    assert {"parameters.json.xz", "component_general.json.xz"} <= {e.name for e in extras}
    for name, expected in (
        ("ftp_open_missing", "no such file"),
        ("ftp_unknown_opcode", "does not support this request"),
        ("ftp_open_no_session_free_slash", "another file is open"),
        ("ftp_rmdir_not_empty", "not empty"),
    ):
        assert expected in str(codec.refusal(reply(name), "p", "Doing")), name


@pytest.mark.parametrize("path", ["x" * 239, "a\0b"])
def test_a_path_that_does_not_fit_into_a_packet_is_refused(path):
    with pytest.raises(codec.FtpFailed, match="not a valid path"):
        codec.request(codec.Opcode.OPEN_FILE_RO, 0, path=path)


def put_every_second_byte(file):
    for offset in range(0, file.size, 2):
        file.put(offset, b"x")


def test_the_work_for_a_piece_does_not_grow_with_the_number_of_earlier_pieces():
    few_lines, many_lines = (
        count_executed_lines(lambda n=n: put_every_second_byte(PartialFile(n))) for n in (1_000, 4_000)
    )
    assert many_lines < 5 * few_lines


def test_the_number_of_missing_parts_is_limited():
    file = PartialFile(100_000)
    put_every_second_byte(file)
    assert file.missing_count <= MAX_MISSING_PARTS
    assert file.received == MAX_MISSING_PARTS
    while (part := file.first_missing) is not None:
        assert file.put(part[0], bytes(part[1] - part[0]))
    assert file.received == file.size


def test_an_implausible_file_size_is_ignored():
    entries, _ = codec.parse_listing(b"Fa\t" + b"9" * 200 + b"\0Fb\t4294967295")
    assert [e.bytes for e in entries] == [0, 4294967295]
