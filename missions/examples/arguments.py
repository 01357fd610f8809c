"""The flags that every example has, and a few that some have."""

from __future__ import annotations

import argparse


def parse(description: str, **switches: str) -> argparse.Namespace:
    """`--server`, `--vehicle`, and for each of `switches` a flag with what it does."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--server", default="http://localhost:8080", help="address of the ground station")
    parser.add_argument("--vehicle", help="id of the vehicle; the first one heard where none is given")
    for name, what in switches.items():
        parser.add_argument(f"--{name}", action="store_true", help=what)
    return parser.parse_args()
