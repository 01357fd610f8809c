"""Component metadata that PX4 serves by FTP: the parameter, events and actuators documents.

Names, groups, types, defaults, ranges, units and labels of parameters are PX4's
(`data/parameter_facts.json`); the descriptions of the most used ones are the simulator's own words
(`data/parameter_titles.json`). The message texts of events are the simulator's
(`event_definitions.py`).
Formats: MAVLink's component metadata schemas (general, parameter, events, actuators).
"""

from __future__ import annotations

import json
import lzma
import zlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from vehicle_sim.parameters import load_boot_parameters
from vehicle_sim.px4_version import DATA_FOLDER, DEFAULT, Px4Version
from vehicle_sim.storage.event_definitions import events_document
from vehicle_sim.storage.outputs import actuators_document

FACTS_FILE = DATA_FOLDER / "parameter_facts.json"
TITLES_FILE = DATA_FOLDER / "parameter_titles.json"
FOLDER = "etc/extras"
GENERAL = f"{FOLDER}/component_general.json.xz"
PARAMETERS = f"{FOLDER}/parameters.json.xz"
EVENTS = f"{FOLDER}/all_events.json.xz"
ACTUATORS = f"{FOLDER}/actuators.json.xz"

TYPE_PARAMETERS, TYPE_EVENTS, TYPE_ACTUATORS = 1, 4, 5
"""COMP_METADATA_TYPE of the MAVLink definitions."""


def crc32(data: bytes) -> int:
    """MAVLink's CRC-32: reflected polynomial, initial value 0, no final XOR."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _compressed(content: object) -> bytes:
    text = json.dumps(content, separators=(",", ":"), sort_keys=True)
    return lzma.compress(text.encode(), check=lzma.CHECK_CRC32)


def _parameters_document(px4: Px4Version) -> dict[str, Any]:
    """The content of the parameter document: one entry for each parameter that the vehicle uses."""
    facts: dict[str, dict[str, Any]] = json.loads(FACTS_FILE.read_text(encoding="utf-8"))
    facts |= px4.differences.get("facts", {})
    titles: dict[str, str] = json.loads(TITLES_FILE.read_text(encoding="utf-8"))
    entries: list[dict[str, Any]] = []
    for parameter in load_boot_parameters(px4):
        entry = {"category": "Standard", **facts[parameter.name], "name": parameter.name}
        if parameter.name in titles:
            entry["shortDesc"] = titles[parameter.name]
        entry["type"] = "Int32" if parameter.type == "INT32" else "Float"
        if "values" in entry:
            entry["values"] = [{"value": value, "description": label} for value, label in entry["values"]]
        if "bitmask" in entry:
            entry["bitmask"] = [{"index": bit, "description": label} for bit, label in entry["bitmask"]]
        entries.append(entry)
    return {"version": 1, "parameters": entries}


@lru_cache(maxsize=4)
def _parameters_file(px4: Px4Version) -> bytes:
    return _compressed(_parameters_document(px4))


@lru_cache(maxsize=4)
def _events_file(px4: Px4Version) -> bytes:
    return _compressed(events_document(px4))


@lru_cache(maxsize=1)
def _actuators_file(_: Px4Version) -> bytes:
    return _compressed(actuators_document())


@lru_cache(maxsize=4)
def _general_file(px4: Px4Version) -> bytes:
    documents: tuple[tuple[int, str, Callable[[Px4Version], bytes]], ...] = (
        (TYPE_PARAMETERS, PARAMETERS, _parameters_file),
        (TYPE_EVENTS, EVENTS, _events_file),
        (TYPE_ACTUATORS, ACTUATORS, _actuators_file),
    )
    types = [
        {"type": metadata_type, "uri": f"mftp://{path}", "fileCrc": crc32(create(px4))}
        for metadata_type, path, create in documents
    ]
    document = json.dumps({"version": 1, "metadataTypes": types}).encode()
    return lzma.compress(document, check=lzma.CHECK_CRC32)


def general_crc(file: bytes) -> int:
    """CRC of the uncompressed general document, for COMPONENT_METADATA and COMPONENT_INFORMATION."""
    return crc32(lzma.decompress(file))


DATAMAN_BYTES = 1_208_528
"""Size of PX4's store of missions, fences and rally points."""


def built_in(px4: Px4Version = DEFAULT) -> dict[str, Callable[[], bytes]]:
    """Functions that create the content of the files of every vehicle, by path: the documents, and the store
    of missions, whose records are not simulated (all bytes are zero)."""
    return {
        "dataman": lambda: bytes(DATAMAN_BYTES),
        GENERAL: lambda: _general_file(px4),
        PARAMETERS: lambda: _parameters_file(px4),
        EVENTS: lambda: _events_file(px4),
        ACTUATORS: lambda: _actuators_file(px4),
    }
