"""Command line flags of the examples."""

from __future__ import annotations

import argparse


def parse(description: str, **switches: str) -> argparse.Namespace:
    """Parses `--server`, `--vehicle`, and one flag for each of `switches`, whose value is its help text."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--server", default="http://localhost:8080", help="address of the ground station")
    parser.add_argument("--vehicle", help="id of the vehicle; default: the first connected vehicle")
    for name, what in switches.items():
        parser.add_argument(f"--{name}", action="store_true", help=what)
    return parser.parse_args()
