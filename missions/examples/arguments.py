"""The two flags every example has."""

from __future__ import annotations

import argparse


def parse(description: str) -> argparse.Namespace:
    """`--server` and `--vehicle`."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--server", default="http://localhost:8080", help="address of the ground station")
    parser.add_argument("--vehicle", help="id of the vehicle; the first one heard where none is given")
    return parser.parse_args()
