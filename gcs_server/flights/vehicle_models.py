"""Models of vehicles that were identified in flights and kept by a person: their dry runs fly with them."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import asdict, dataclass
from typing import Annotated

from pydantic import Field

from gcs_server.errors import Refused
from gcs_server.storage.files import StoredTime, typed
from gcs_server.storage.records import MAX_RECORDS, Records, Unreadable
from gcs_server.streamer.offboard.limit_store import key_of
from gcs_server.vehicle.identity import Identity

log = logging.getLogger(__name__)

FORMAT = 1
Finite = Annotated[float, Field(allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=300)]
BodyParameter = Annotated[str, Field(pattern=r"^(SIH_[A-Z_]{1,12}|MPC_THR_HOVER)$")]


@dataclass(frozen=True, slots=True)
class KeptModel:
    """The model of one vehicle."""

    flight: Text
    """Id of the flight in which it was identified."""
    log: Text
    """Name of that flight, or of its log: the flight may be deleted later."""
    kept_unix_s: StoredTime
    """When it was kept [s since 1970 UTC]."""
    kept_by: Text
    """Client that kept it."""
    mass_kg: Finite | None
    """The known mass that was given; null: only ratios to the mass are known."""
    thrust_m_s2: Finite
    """Thrust of all motors at full signal, divided by the mass [m/s²]."""
    thrust_error_m_s2: Finite
    """Its standard error."""
    drag_per_s: Finite | None
    """Drag per speed, divided by the mass [1/s]; null: the flight did not say enough of it."""
    drag_error_per_s: Finite | None
    """Its standard error."""
    parameters: Annotated[dict[BodyParameter, Finite], Field(max_length=40)]
    """The body of the simulation (SIH_*, MPC_THR_HOVER)."""
    turns_known: bool | None = None
    """Whether the flight said enough of the turning about all axes; false: where it did not, the simulated
    quadrotor's is used; null: kept before this was recorded."""

    def text(self) -> str:
        """The model in words: `thrust 20.1 m/s² by mass (±0.3), …, from "a.ulg"`."""
        drag = (
            "drag not known, so the simulated quadrotor’s"
            if self.drag_per_s is None
            else f"drag {self.drag_per_s:.2f} 1/s (±{self.drag_error_per_s or 0.0:.2f})"
        )
        turning = {
            True: "turning as in the flight",
            False: "turning not known about all axes (there the simulated quadrotor’s)",
            None: "whether the turning was known is not recorded (keep it again)",
        }[self.turns_known]
        day = time.strftime("%Y-%m-%d", time.gmtime(self.kept_unix_s))
        thrust = f"thrust by mass {self.thrust_m_s2:.1f} m/s² (±{self.thrust_error_m_s2:.1f})"
        return f"{thrust}, {drag}, {turning}, from “{self.log}”, kept on {day}"


class VehicleModels:
    """The kept models of all vehicles.

    Args:
        records: storage; None: nothing is stored for the next start of the server.
    """

    def __init__(self, records: Records | None = None) -> None:
        self._records = records
        self._models: dict[str, KeptModel] = {}
        self._problems: dict[str, str] = {}

    async def load(self) -> None:
        """Reads the records; unreadable records become warnings."""
        if self._records is None:
            return
        try:
            records = await asyncio.to_thread(self._records.read_all)
        except OSError as error:
            self._add_problem(
                "", f"The folder {self._records.folder} cannot be read: {error.strerror or error}."
            )
            return
        for name, content in records.items():
            try:
                if isinstance(content, Unreadable):
                    raise ValueError(content)
                values = dict(content)
                if values.pop("format", None) != FORMAT:
                    raise ValueError("its format is not known")
                self._models[name] = typed(KeptModel, values)
            except ValueError as error:
                reason = (str(error).splitlines() or ["it is damaged"])[0]
                self._add_problem(name, f"The file {self._file(name)} cannot be read: {reason}.")

    def find(self, identity: Identity) -> KeptModel | None:
        """The model of a vehicle; None: none is kept, or the vehicle is not identified yet."""
        key = key_of(identity)
        return None if key is None else self._models.get(key.name)

    async def keep(self, identity: Identity, model: KeptModel | None) -> None:
        """Replaces the model of a vehicle, or forgets it (None). Done once it is on disk.

        Raises:
            Refused: the vehicle is not identified, or the file cannot be written; nothing has changed.
        """
        key = key_of(identity)
        if key is None:
            raise Refused(
                "The vehicle has not said who it is (AUTOPILOT_VERSION), or is a replay.",
                remedy="Wait for its identity, then try again.",
            )
        if model is not None and key.name not in self._models and len(self._models) >= MAX_RECORDS:
            raise Refused(f"Models of {MAX_RECORDS} vehicles are kept already.", remedy="Forget one of them.")
        if self._records is not None:
            content = None if model is None else {"format": FORMAT, **asdict(model)}
            try:
                await asyncio.shield(asyncio.wrap_future(self._records.write(key.name, content)))
            except OSError as error:
                raise Refused(
                    f"The file {self._file(key.name)} cannot be written: {error.strerror or error}.",
                    remedy="Make room on the server's disk, then try again.",
                ) from error
        self._problems.pop(key.name, None)
        if model is None:
            self._models.pop(key.name, None)
        else:
            self._models[key.name] = model

    def warnings(self) -> list[str]:
        """Messages about records that cannot be read."""
        return list(self._problems.values())

    def close(self) -> None:
        """Waits for pending writes."""
        if self._records is not None:
            self._records.close()

    def _add_problem(self, name: str, text: str) -> None:
        self._problems[name] = f"{text} Dry runs of its vehicle fly with the simulated quadrotor's body."
        log.warning(text)

    def _file(self, name: str) -> str:
        return "" if self._records is None else str(self._records.folder / f"{name}.json")
