"""The gimbal program of a user's document, and what it does."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any


def gimbal_program(reference_data: Path, folder: Path, tcp_port: int) -> Path | None:
    """Writes the program for a vehicle at this port of this machine; None: the document is not beside this
    checkout."""
    documents = sorted((reference_data / "seeds").glob("000*.txt"))
    if not documents:
        return None
    text = documents[0].read_text(encoding="utf-8")
    program = text[text.rindex("#!/usr/bin/env python3") :]
    program, replaced = re.subn(r"tcpout://[\d.]+:5760", f"tcpout://127.0.0.1:{tcp_port}", program)
    assert replaced == 1
    path = folder / "program.py"
    path.write_text(program, encoding="utf-8")
    return path


def has_reached(values: list[dict[str, Any]], roll_deg: float, pitch_deg: float) -> bool:
    """Whether the gimbal ever reached these angles within 3°; straight up and down, roll is undefined."""
    is_steep = abs(pitch_deg) > 85
    return any(
        abs(math.degrees(value["pitch_rad"]) - pitch_deg) < 3
        and (is_steep or abs(math.degrees(value["roll_rad"]) - roll_deg) < 3)
        for value in values
    )
