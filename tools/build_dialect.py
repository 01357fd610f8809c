"""Compiles a package's `px4.xml` into its MAVLink dialect module.

The message definitions of PyPI's pymavlink are older than those of PX4 v1.16: some messages and extension
fields are missing. A package's `px4.xml` has the missing and different messages. This tool replaces messages
of the pymavlink wheel by those of `px4.xml`, and pymavlink's generator writes the module.

The build hook (`hatch_build.py`) and `make` run this tool; nothing imports it at run time.
"""

from __future__ import annotations

import contextlib
import io
import shutil
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

from pymavlink.dialects import v20
from pymavlink.generator import mavgen, mavparse

PACKAGES = ("gcs_server", "vehicle_sim")
BASE_DEFINITIONS = ("minimal.xml", "standard.xml", "common.xml", "development.xml")


def compile_dialect(overlay: Path, target: Path) -> None:
    """Generates the Python dialect of `overlay` merged with pymavlink's definitions.

    Args:
        overlay: the package's definitions, including `development.xml`.
        target: the module to write.

    Raises:
        RuntimeError: pymavlink's generator refused the definitions.
    """
    overlaid = {message.get("id") for message in ET.parse(overlay).iter("message")}
    bundled = Path(v20.__path__[0])
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name in BASE_DEFINITIONS:
            _copy_without(bundled / name, folder / name, overlaid)
        shutil.copy(overlay, folder / "px4.xml")
        options = mavgen.Opts(
            output=str(folder / "dialect"),
            wire_protocol=mavparse.PROTOCOL_2_0,
            language="Python3",
            validate=False,
            strict_units=False,
        )
        generator_output = io.StringIO()
        with contextlib.redirect_stdout(generator_output):
            compiled = mavgen.mavgen(options, [str(folder / "px4.xml")])
        if not compiled:
            raise RuntimeError(f"pymavlink could not compile {overlay}:\n{generator_output.getvalue()}")
        text = (folder / "dialect.py").read_text(encoding="utf-8")
    target.write_text("# Generated from px4.xml by tools/build_dialect.py; not kept in git.\n" + text)


def _copy_without(source: Path, target: Path, ids: set[str | None]) -> None:
    tree = ET.parse(source)
    messages = tree.find("messages")
    if messages is not None:
        for message in messages.findall("message"):
            if message.get("id") in ids:
                messages.remove(message)
    tree.write(target, encoding="utf-8", xml_declaration=True)


def build_all(root: Path, *, force: bool = False) -> None:
    """Compiles each package's dialect whose sources are newer than the module."""
    for package in PACKAGES:
        overlay = root / package / "mavlink" / "px4.xml"
        target = root / package / "mavlink" / "generated_dialect.py"
        newest_source = max(overlay.stat().st_mtime, Path(__file__).stat().st_mtime)
        if force or not target.exists() or target.stat().st_mtime < newest_source:
            print(f"compiling the MAVLink dialect of {package} …", file=sys.stderr)
            compile_dialect(overlay, target)


if __name__ == "__main__":
    build_all(Path(__file__).resolve().parent.parent, force="--force" in sys.argv)
