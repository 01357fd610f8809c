"""The command `gcs key`: creates, adds, lists and removes signing keys. A key is never passed as an
argument."""

from __future__ import annotations

import argparse
import getpass
import sys
from pathlib import Path
from typing import TextIO

from gcs_server.errors import InvalidRequest
from gcs_server.links.names import checked_key_name
from gcs_server.mavlink.key_store import KeyStore, key_of_passphrase, parse_key, random_key
from gcs_server.settings import load
from gcs_server.storage.folder import DataFolder

MAX_LINE_LENGTH = 4096

_EPILOG = """\
A link signs with a key that its URL names: gcs serve --link 'udpin://0.0.0.0:14550?key=field'. The vehicle
needs the same key; docs/links.md says how. Keys are stored in the data folder (signing/NAME.key), readable by
their owner only. `add` reads the key from the standard input, because all users of a machine can see
arguments:

  gcs key new field                     a random key
  gcs key add field < field.txt         64 hexadecimal digits, or base64 of 32 bytes
  gcs key add field --passphrase        SHA-256 of a line of text, as MAVProxy makes its keys
"""


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags of the command."""
    parser.description = "Manages the keys with which links sign MAVLink frames and check received ones."
    parser.epilog = _EPILOG
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("action", choices=("new", "add", "list", "remove"))
    parser.add_argument("name", nargs="?", metavar="NAME")
    parser.add_argument(
        "--passphrase", action="store_true", help="with add: a line of text instead of the key"
    )
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="data folder")
    parser.add_argument("--config", type=Path, metavar="FILE", help="TOML file with settings")


def run(options: argparse.Namespace, source: TextIO | None = None) -> int:
    """Runs the command; returns the exit code.

    Args:
        options: parsed flags of `add_flags`.
        source: input of `add`; default: the standard input.

    Raises:
        GcsError: the command failed; the text never shows a key.
    """
    settings = load({} if options.data is None else {"data": options.data}, config=options.config)
    folder = DataFolder(settings.data)
    store = KeyStore(folder.signing)
    if options.action == "list":
        print("\n".join(store.names()) or "no signing keys")
        return 0
    if options.name is None:
        raise InvalidRequest("name", f"gcs key {options.action} needs the key's name.")
    checked_key_name(options.name)
    if options.action == "remove":
        store.remove(options.name)
        print(f"removed signing key {options.name}; links that are open use it until they are closed")
        return 0
    if options.action == "new":
        key = random_key()
    else:
        try:
            line = _read_key_line(source or sys.stdin, options.name)
            key = key_of_passphrase(line) if options.passphrase else parse_key(line)
        except ValueError as error:
            raise InvalidRequest("key", f"Not added: {error}.", remedy="See gcs key --help.") from None
    folder.prepare()
    store.add(options.name, key)
    print(f"added signing key {options.name}: {folder.signing / options.name}.key")
    return 0


def _read_key_line(source: TextIO, name: str) -> str:
    if source.isatty():
        return getpass.getpass(f"signing key {name}: ")
    return source.readline(MAX_LINE_LENGTH).rstrip("\r\n")
