"""Command line options of the examples."""

from __future__ import annotations

import argparse


def parse(description: str, **options: str) -> argparse.Namespace:
    """Parses `--server`, `--vehicle`, and one option for each of `options`, whose value is its help text."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--server", default="http://localhost:8080", help="address of the ground station")
    parser.add_argument("--vehicle", help="id of the vehicle; default: the first connected vehicle")
    for name, help_text in options.items():
        parser.add_argument(f"--{name}", action="store_true", help=help_text)
    return parser.parse_args()
