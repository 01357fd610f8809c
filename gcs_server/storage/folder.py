"""Where the server keeps what it must remember: one folder, made when needed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from gcs_server.errors import GcsError

MAX_FILE_NAME_BYTES = 255
"""Longest file name of file systems (Linux: NAME_MAX); for longer ones the system reports an error instead of
"not found"."""


class StorageError(GcsError):
    """The data folder cannot be used."""

    code = "storage"


def default_folder(environment: dict[str, str] | None = None) -> Path:
    """`$XDG_DATA_HOME/gcs`, else `~/.local/share/gcs`."""
    env = dict(os.environ) if environment is None else environment
    base = env.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "gcs"


@dataclass(frozen=True, slots=True)
class DataFolder:
    """The folder and what lies where in it."""

    path: Path

    @property
    def journal(self) -> Path:
        """One JSON object a line and command."""
        return self.path / "journal.jsonl"

    @property
    def recordings(self) -> Path:
        """The tlogs."""
        return self.path / "recordings"

    @property
    def token(self) -> Path:
        """File of the access token for other machines; readable by its owner only."""
        return self.path / "token"

    @property
    def signing(self) -> Path:
        """MAVLink signing: a file for each key, and the timestamps used; its owner's alone to read."""
        return self.path / "signing"

    @property
    def maps(self) -> Path:
        """The operator's own PMTiles and MBTiles."""
        return self.path / "maps"

    @property
    def cache(self) -> Path:
        """Folder of data that vehicles would send again; may be deleted at any time."""
        return self.path / "cache"

    @property
    def limits(self) -> Path:
        """The operator's limits and fences, a file a vehicle."""
        return self.path / "limits"

    @property
    def plans(self) -> Path:
        """Waypoint plans, a folder for each, a file for each version."""
        return self.path / "plans"

    @property
    def simulator_log(self) -> Path:
        """The simulator's log; the one of the run before ends in `.1`."""
        return self.path / "simulator.log"

    @property
    def simulator_pid(self) -> Path:
        """File with the simulator's process id, for a restarted server."""
        return self.path / "simulator.json"

    def prepare(self) -> None:
        """Makes the folders.

        Raises:
            StorageError: not possible; says where and why.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self.recordings.mkdir(exist_ok=True)
            self.maps.mkdir(exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"The data folder {self.path} cannot be made: {error.strerror or error}.",
                remedy="Choose another with --data FOLDER or GCS_DATA.",
            ) from error
