"""The page's settings of each user, stored by the server, so that each browser of a user has the same.

There are no accounts: a user is a name that a person has given, or no name, for all who have given none.
Names are not protected; the settings hold nothing secret and nothing that acts on a vehicle.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from hashlib import sha256

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.storage.folder import StorageError
from gcs_server.storage.records import MAX_BYTES, Records, Unreadable

KIND = "gcs-settings"
VERSION = 1
MAX_USERS = 500
MAX_NAME_LENGTH = 64
UPGRADES: dict[int, Callable[[dict[str, object]], dict[str, object]]] = {}
"""By version, what makes the settings of the next version of them. Values that are only added need none."""

Check = Callable[[Mapping[str, object]], dict[str, object]]
"""Returns the settings with their types and bounds checked; raises InvalidRequest, which names the field."""


def user_name(name: str) -> str:
    """The name of a user as it is kept; upper and lower case are the same user."""
    return "".join(c for c in name if c.isprintable()).strip()[:MAX_NAME_LENGTH]


def current_settings(kind: object, version: object, settings: Mapping[str, object]) -> dict[str, object]:
    """The settings of a file of any version as those of the present version; not checked.

    Raises:
        InvalidRequest: it is another kind of file, or of a newer version.
    """
    if kind != KIND:
        raise InvalidRequest("kind", f"This is not a file of settings: `kind` is not {KIND!r}.")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise InvalidRequest("version", "The version of the file is not a number from 1.")
    if version > VERSION:
        raise InvalidRequest(
            "version",
            f"The file was written by a newer version of this server ({version}; this one knows {VERSION}).",
            remedy="Update this server, or export the settings there from a page of this version.",
        )
    current = dict(settings)
    for step in range(version, VERSION):
        current = UPGRADES[step](current)
    return current


class UserSettings:
    """The settings of all users.

    Args:
        records: where they are stored, one file for each user.
        check: checks settings, from a file or a request.
    """

    def __init__(self, records: Records, check: Check) -> None:
        self._records = records
        self._check = check
        self._settings: dict[str, dict[str, object] | Unreadable] = {}
        self._problem: str | None = None
        self._writing = asyncio.Lock()

    def load(self) -> None:
        """Reads the stored settings; blocks. A file that cannot be read is kept; its user gets the reason."""
        try:
            records = self._records.read_all()
        except OSError as error:
            reason = error.strerror or str(error)
            self._problem = f"The settings in {self._records.folder} cannot be read: {reason}."
            return
        for name, record in records.items():
            self._settings[name] = record if isinstance(record, Unreadable) else self._read(record)

    def warnings(self) -> list[str]:
        """Which stored settings cannot be used, and why."""
        texts = [] if self._problem is None else [self._problem]
        return texts + [
            self._unreadable_text(name, each)
            for name, each in self._settings.items()
            if isinstance(each, Unreadable)
        ]

    def get(self, user: str) -> dict[str, object]:
        """What a user has set; missing values are the page's defaults. Raises Refused: it cannot be read."""
        stored = self._settings.get(_record_name(user), {})
        if isinstance(stored, Unreadable):
            raise _cannot_be_used(self._unreadable_text(_record_name(user), stored))
        return stored

    async def change(self, user: str, changes: Mapping[str, object]) -> None:
        """Sets some values; None: the default again. Returns once they are on disk.

        Raises:
            InvalidRequest: a value is wrong.
            Refused: there are too many users, or the stored settings cannot be read.
            StorageError: the file cannot be written; nothing has changed.
        """
        async with self._writing:
            merged = {k: v for k, v in {**self.get(user), **changes}.items() if v is not None}
            await self._store(user, merged)

    async def replace(self, user: str, settings: Mapping[str, object]) -> None:
        """Sets all values. Raises as `change`."""
        async with self._writing:
            self.get(user)
            await self._store(user, settings)

    async def _store(self, user: str, settings: Mapping[str, object]) -> None:
        checked = self._check(settings)
        name = _record_name(user)
        if self._problem is not None:
            raise _cannot_be_used(self._problem)
        if name not in self._settings and len(self._settings) >= MAX_USERS:
            raise Refused(
                f"There are settings of {MAX_USERS} users.",
                remedy=f"Remove files in {self._records.folder}, and start the server again.",
            )
        record = {"kind": KIND, "version": VERSION, "user": user, "settings": checked}
        if len(json.dumps(record, indent=1)) >= MAX_BYTES:
            raise InvalidRequest("settings", f"The settings are larger than {MAX_BYTES} bytes.")
        before = self._settings.get(name)
        self._settings[name] = checked
        try:
            await asyncio.shield(asyncio.wrap_future(self._records.write(name, record)))
        except OSError as error:
            if before is None:
                del self._settings[name]
            else:
                self._settings[name] = before
            reason = error.strerror or str(error)
            raise StorageError(f"The settings cannot be stored: {reason}. Nothing has changed.") from error

    def _read(self, record: Mapping[str, object]) -> dict[str, object] | Unreadable:
        settings = record.get("settings")
        if not isinstance(settings, dict):
            return Unreadable("it has no settings")
        try:
            return self._check(current_settings(record.get("kind"), record.get("version"), settings))  # pyright: ignore[reportUnknownArgumentType] json's keys are text
        except InvalidRequest as error:
            return Unreadable(f"{error.field}: {error}")

    def _unreadable_text(self, name: str, reason: Unreadable) -> str:
        return f"The settings in {self._records.folder / f'{name}.json'} cannot be read: {reason}"

    def close(self) -> None:
        """Waits for pending writes."""
        self._records.close()


def _cannot_be_used(problem: str) -> Refused:
    return Refused(problem, remedy="Mend or remove that file, and start the server again.")


def _record_name(user: str) -> str:
    return f"user_{sha256(user.casefold().encode()).hexdigest()[:24]}" if user else "shared"
