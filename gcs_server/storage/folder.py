"""The server's data folder."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from gcs_server.errors import GcsError

MAX_FILE_NAME_BYTES = 255
"""Maximum length of a file name (Linux: NAME_MAX). For a longer name the system reports an error instead of
"not found"."""


class StorageError(GcsError):
    """The data folder cannot be used."""

    code = "storage"


def default_folder(environment: dict[str, str] | None = None) -> Path:
    """The default data folder: `$XDG_DATA_HOME/gcs`, or else `~/.local/share/gcs`."""
    env = dict(os.environ) if environment is None else environment
    base = env.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "gcs"


@dataclass(frozen=True, slots=True)
class DataFolder:
    """The folder and the paths in it."""

    path: Path

    @property
    def journal(self) -> Path:
        """File of the journal: one JSON object per command."""
        return self.path / "journal.jsonl"

    @property
    def recordings(self) -> Path:
        """Folder of the tlogs."""
        return self.path / "recordings"

    @property
    def token(self) -> Path:
        """File of the access token for other machines; readable by its owner only."""
        return self.path / "token"

    @property
    def agents(self) -> Path:
        """Folder of the agents' tokens; readable by its owner only."""
        return self.path / "agents"

    def agent_token(self, name: str) -> Path:
        """File of an agent's token."""
        return self.agents / f"{name}.token"

    @property
    def signing(self) -> Path:
        """Folder of MAVLink signing keys and timestamps; readable by its owner only."""
        return self.path / "signing"

    @property
    def maps(self) -> Path:
        """Folder of the operator's PMTiles and MBTiles."""
        return self.path / "maps"

    @property
    def map_sources(self) -> Path:
        """Folder of the operator's map sources."""
        return self.path / "map_sources"

    @property
    def elevation_sources(self) -> Path:
        """Folder of the operator's sources of heights."""
        return self.path / "elevation_sources"

    @property
    def user_settings(self) -> Path:
        """Folder of the page's settings, one file per user."""
        return self.path / "settings"

    @property
    def cache(self) -> Path:
        """Folder of data that vehicles would send again; may be deleted at any time."""
        return self.path / "cache"

    @property
    def logs(self) -> Path:
        """Folder of the flight logs that were downloaded from vehicles, or added by people."""
        return self.path / "logs"

    @property
    def after_landing(self) -> Path:
        """Folder with what happens with logs after a landing."""
        return self.path / "after_landing"

    @property
    def vehicle_files(self) -> Path:
        """Folder of other files that were downloaded from vehicles; the newest are kept."""
        return self.path / "vehicle_files"

    @property
    def flight_index(self) -> Path:
        """Index of recordings and logs; made again if it is lost."""
        return self.path / "flights.sqlite"

    @property
    def flight_notes(self) -> Path:
        """Folder of what the server noted of flights."""
        return self.path / "flight_notes"

    @property
    def flight_decisions(self) -> Path:
        """File with the names of flights, and with what people joined or separated."""
        return self.path / "flight_names.json"

    @property
    def elevation(self) -> Path:
        """Folder of the operator's elevation files."""
        return self.path / "elevation"

    @property
    def limits(self) -> Path:
        """Folder of the operator's limits and fences, one file per vehicle."""
        return self.path / "limits"

    @property
    def vehicle_models(self) -> Path:
        """Folder of the models of vehicles that were found in flights, one file per vehicle."""
        return self.path / "vehicle_models"

    @property
    def flights(self) -> Path:
        """Folder with the progress of interrupted plan flights, one file per vehicle."""
        return self.path / "flights"

    @property
    def plans(self) -> Path:
        """Folder of plans: one folder per plan, one file per version."""
        return self.path / "plans"

    @property
    def simulator_log(self) -> Path:
        """The simulator's log; the log of the previous run ends in `.1`."""
        return self.path / "simulator.log"

    @property
    def simulator_pid(self) -> Path:
        """File with the simulator's process id, for a restarted server."""
        return self.path / "simulator.json"

    @property
    def px4_sitl(self) -> Path:
        """Working folders of real PX4s in simulation, one for each instance."""
        return self.path / "px4"

    def prepare(self) -> None:
        """Creates the folders.

        Raises:
            StorageError: a folder cannot be created.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self.recordings.mkdir(exist_ok=True)
            self.maps.mkdir(exist_ok=True)
            self.elevation.mkdir(exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"The data folder {self.path} cannot be created: {error.strerror or error}.",
                remedy="Choose another with --data FOLDER or GCS_DATA.",
            ) from error
