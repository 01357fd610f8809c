"""Writes the table of commands into `docs/authority.md`, between its two markers."""

from __future__ import annotations

from pathlib import Path

from gcs_server.control.commands import table

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "authority.md"
BEGIN, END = "<!-- table -->\n", "<!-- end of the table -->"


def main() -> None:
    """Replaces the table in the document."""
    text = DOCUMENT.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    DOCUMENT.write_text(f"{before}{BEGIN}{table()}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
