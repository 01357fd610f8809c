"""Compares both compiled dialects with the definitions that PX4 v1.16 is built with."""

import tarfile
import xml.etree.ElementTree as ET

import fastcrc
import pytest

from gcs_server.mavlink import dialect
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.vehicle import decoders
from gcs_server.vehicle.instances import INSTANCE_OFFSET
from vehicle_sim.mavlink import generated_dialect as sim

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
"""Neither sent nor read by PX4 v1.16, so the simulator need not have them."""


def px4_definitions(shared):
    """{id: (name, fields in wire order [(type, name, length)], crc_extra)}, computed as MAVLink's guide
    describes it."""
    found = {}
    with tarfile.open(shared / "px4" / "mavlink-definitions.tar.xz") as archive:
        for member in archive.getmembers():
            if not member.name.endswith(".xml"):
                continue
            for message in ET.parse(archive.extractfile(member)).iter("message"):
                base, extended, extension = [], [], False
                for element in message:
                    if element.tag == "extensions":
                        extension = True
                    elif element.tag == "field":
                        kind, _, length = element.get("type").replace("]", "").partition("[")
                        kind = "uint8_t" if kind == "uint8_t_mavlink_version" else kind
                        (extended if extension else base).append(
                            (kind, element.get("name"), int(length or 0))
                        )
                base.sort(key=lambda f: -SIZES[f[0]])
                name = message.get("name")
                crc = fastcrc.crc16.mcrf4xx(f"{name} ".encode())
                for kind, field, length in base:
                    crc = fastcrc.crc16.mcrf4xx(f"{kind} {field} ".encode(), crc)
                    if length:
                        crc = fastcrc.crc16.mcrf4xx(bytes([length]), crc)
                found[int(message.get("id"))] = (name, base + extended, (crc & 0xFF) ^ (crc >> 8))
    return found


@pytest.mark.parametrize("module", [dialect, sim], ids=["gcs_server", "vehicle_sim"])
def test_every_message_of_px4_has_the_layout_of_its_definition(shared, module):
    definitions = px4_definitions(shared)
    assert len(definitions) > 200
    wrong = []
    for msg_id, (name, fields, crc_extra) in definitions.items():
        cls = module.mavlink_map.get(msg_id)
        if module is sim and name in NOT_IN_PX4:
            continue
        if cls is None:
            wrong.append(f"{name} is missing")
            continue
        kinds = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
        compiled = [
            ({"uint8_t_mavlink_version": "uint8_t"}.get(kinds[field], kinds[field]), field, length)
            for field, length in zip(cls.ordered_fieldnames, cls.array_lengths, strict=True)
        ]
        if (cls.msgname, compiled, cls.crc_extra) != (name, fields, crc_extra):
            wrong.append(f"{name}: {compiled} {cls.crc_extra} instead of {fields} {crc_extra}")
    assert wrong == []


def test_the_decoders_formats_match_the_dialect():
    for msg_id, compiled in decoders.FORMATS.items():

        def expanded(struct_format):
            """The format with repeated letters instead of counts: "2h" becomes "hh"."""
            out, count = "", ""
            for character in struct_format.lstrip("<"):
                if character.isdigit():
                    count += character
                else:
                    out += character * int(count or 1)
                    count = ""
            return out

        dialect_format = expanded(dialect.mavlink_map[msg_id].unpacker.format)
        assert dialect_format.startswith(expanded(compiled.format)), dialect.mavlink_map[msg_id].msgname


def test_instance_offsets_match_the_dialect():
    fields = {"BATTERY_STATUS": "id", "SERVO_OUTPUT_RAW": "port", "DISTANCE_SENSOR": "id"}
    for msg_id, offset in INSTANCE_OFFSET.items():
        layout = LAYOUTS[msg_id]
        payload = bytes(offset) + b"\x07" + bytes(layout.unpacker.size - offset - 1)
        values = dict(zip(layout.fields, _by_field(layout, payload), strict=True))
        assert values[fields.get(layout.name, "gimbal_device_id")] == 7
        assert sum(value == 7 for value in values.values()) == 1


def _by_field(layout, payload):
    flat = iter(layout.unpacker.unpack(payload))
    return [tuple(next(flat) for _ in range(n)) if n > 1 else next(flat) for n in layout.lengths]
