"""Names of lists and tables in an offboard mission."""

from __future__ import annotations

from collections.abc import Callable

MAX_NAME_LENGTH = 100


def valid_name(text: str, fallback: str) -> str:
    """Makes a valid name from a text: printable, not empty, of limited length."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    return printable.strip()[:MAX_NAME_LENGTH].strip() or fallback


def free_name(wanted: str, is_taken: Callable[[str], bool]) -> str:
    """The wanted name; if it is taken, the name with the first free number: `Tower 2`, `loop 2.csv`."""
    name, number = wanted, 2
    stem, extension = (wanted[:-4], wanted[-4:]) if wanted.lower().endswith(".csv") else (wanted, "")
    while is_taken(name):
        suffix = f" {number}{extension}"
        name, number = f"{stem[: MAX_NAME_LENGTH - len(suffix)]}{suffix}", number + 1
    return name
