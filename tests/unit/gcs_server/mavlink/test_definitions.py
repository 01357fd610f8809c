"""Compares both compiled dialects with the definitions that PX4 v1.16 is built with."""

import tarfile
import xml.etree.ElementTree as ET

import fastcrc
import pytest

from gcs_server.mavlink import dialect
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.vehicle import decoders
from gcs_server.vehicle.instances import INSTANCE_OFFSET
from vehicle_sim.mavlink import generated_dialect as sim_dialect

SIZES = {
    "uint64_t": 8,
    "int64_t": 8,
    "double": 8,
    "uint32_t": 4,
    "int32_t": 4,
    "float": 4,
    "uint16_t": 2,
    "int16_t": 2,
    "uint8_t": 1,
    "int8_t": 1,
    "char": 1,
}


NOT_IN_PX4 = {
    "BATTERY_STATUS_V2",
    "CELLULAR_CONFIG",
    "COMMAND_CANCEL",
    "CONTROL_STATUS",
    "FUEL_STATUS",
    "GROUP_END",
    "GROUP_START",
    "ILLUMINATOR_STATUS",
    "TARGET_ABSOLUTE",
    "TARGET_RELATIVE",
    "WIFI_CONFIG_AP",
}
"""Messages that PX4 v1.16 neither sends nor reads, so the simulator does not need them."""


def px4_definitions(shared):
    """{id: (name, fields in wire order [(type, name, length)], crc_extra)}, computed as MAVLink's guide
    describes it."""
    definitions = {}
    with tarfile.open(shared / "px4" / "mavlink-definitions.tar.xz") as archive:
        for member in archive.getmembers():
            if not member.name.endswith(".xml"):
                continue
            for message in ET.parse(archive.extractfile(member)).iter("message"):
                base_fields, extension_fields, in_extensions = [], [], False
                for element in message:
                    if element.tag == "extensions":
                        in_extensions = True
                    elif element.tag == "field":
                        field_type, _, length = element.get("type").replace("]", "").partition("[")
                        field_type = "uint8_t" if field_type == "uint8_t_mavlink_version" else field_type
                        (extension_fields if in_extensions else base_fields).append(
                            (field_type, element.get("name"), int(length or 0))
                        )
                base_fields.sort(key=lambda f: -SIZES[f[0]])
                name = message.get("name")
                crc = fastcrc.crc16.mcrf4xx(f"{name} ".encode())
                for field_type, field, length in base_fields:
                    crc = fastcrc.crc16.mcrf4xx(f"{field_type} {field} ".encode(), crc)
                    if length:
                        crc = fastcrc.crc16.mcrf4xx(bytes([length]), crc)
                definitions[int(message.get("id"))] = (
                    name,
                    base_fields + extension_fields,
                    (crc & 0xFF) ^ (crc >> 8),
                )
    return definitions


@pytest.mark.parametrize("module", [dialect, sim_dialect], ids=["gcs_server", "vehicle_sim"])
def test_every_message_of_px4_has_the_layout_of_its_definition(reference_data, module):
    definitions = px4_definitions(reference_data)
    assert len(definitions) > 200
    differences = []
    for msg_id, (name, fields, crc_extra) in definitions.items():
        cls = module.mavlink_map.get(msg_id)
        if module is sim_dialect and name in NOT_IN_PX4:
            continue
        if cls is None:
            differences.append(f"{name} is missing")
            continue
        types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
        compiled_fields = [
            ({"uint8_t_mavlink_version": "uint8_t"}.get(types[field], types[field]), field, length)
            for field, length in zip(cls.ordered_fieldnames, cls.array_lengths, strict=True)
        ]
        if (cls.msgname, compiled_fields, cls.crc_extra) != (name, fields, crc_extra):
            differences.append(f"{name}: {compiled_fields} {cls.crc_extra} instead of {fields} {crc_extra}")
    assert differences == []


def test_the_decoders_formats_match_the_dialect():
    for msg_id, decoder_struct in decoders.FORMATS.items():

        def repeat_letters(struct_format):
            """The format with repeated letters instead of counts: "2h" becomes "hh"."""
            repeated_letters, count = "", ""
            for character in struct_format.lstrip("<"):
                if character.isdigit():
                    count += character
                else:
                    repeated_letters += character * int(count or 1)
                    count = ""
            return repeated_letters

        message_class = dialect.mavlink_map[msg_id]
        dialect_format = repeat_letters(message_class.unpacker.format)
        assert dialect_format.startswith(repeat_letters(decoder_struct.format)), message_class.msgname


def test_instance_offsets_match_the_dialect():
    instance_fields = {"BATTERY_STATUS": "id", "SERVO_OUTPUT_RAW": "port", "DISTANCE_SENSOR": "id"}
    for msg_id, offset in INSTANCE_OFFSET.items():
        layout = LAYOUTS[msg_id]
        payload = bytes(offset) + b"\x07" + bytes(layout.unpacker.size - offset - 1)
        values = dict(zip(layout.fields, _values_by_field(layout, payload), strict=True))
        assert values[instance_fields.get(layout.name, "gimbal_device_id")] == 7
        assert sum(value == 7 for value in values.values()) == 1


def _values_by_field(layout, payload):
    flat_values = iter(layout.unpacker.unpack(payload))
    return [
        tuple(next(flat_values) for _ in range(n)) if n > 1 else next(flat_values) for n in layout.lengths
    ]
