"""The flights on the server: `gcs.flights().export(flight, "flight.mcap")`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol
from urllib.parse import quote, urlencode

from gcs_server.client.control import VehicleApi
from gcs_server.client.plans import GcsApi, Operations
from gcs_server.client.setpoints import Body

PROOF_TIMEOUT_S = 900.0
QueryValue = str | float | int | Sequence[str] | None


class FlightsApi(GcsApi, Protocol):
    """The part of `Gcs` that this module uses."""

    async def download(self, path: str, file: Path) -> int: ...


class Flights:
    """The recordings and logs of flights on the server; `flight` is the id of a file of `all()`."""

    def __init__(self, gcs: FlightsApi) -> None:
        self._gcs = gcs

    async def all(self) -> dict[str, Any]:
        """`flights`, joined of their files, and `files`, each the newest first."""
        return await self._gcs.request("GET", "/flights")

    async def after_landing(self, choice: str | None = None) -> dict[str, Any]:
        """What happens with a vehicle's log after its flight: `choice` (`never`, `offer`, `download`), which
        an argument sets, and `landed`, by vehicle id the log of its newest flight."""
        body: Body | None = None if choice is None else {"choice": choice}
        return await self._gcs.request("GET" if body is None else "POST", "/logs_after_landing", body)

    async def download_landed(self, vehicle: str) -> dict[str, Any]:
        """Downloads the log of a vehicle's newest flight; returns the operation, whose `result` has the
        `flight`.

        Raises:
            Refused: the server has seen no flight of it, or it is armed.
        """
        return await self._gcs.request("POST", f"/vehicles/{quote(vehicle, safe='')}/logs/after_landing")

    async def overview(self, flight: str) -> dict[str, Any]:
        """What a log has: `topics`, `vehicles` with their modes, `parameters`, `messages`. The first call
        reads the log, which may take seconds: create the client with a larger `timeout_s` for large logs."""
        return await self._gcs.request("GET", _path(flight))

    async def findings(self, flight: str) -> dict[str, Any]:
        """What a log means: `findings`, and what was `not_judged`."""
        return await self._gcs.request("GET", _path(flight, "findings"))

    async def loops(
        self, flight: str, *, from_s: float | None = None, to_s: float | None = None
    ) -> list[dict[str, Any]]:
        """How the rate and attitude loops follow their setpoints: for each `loop` and `axis` the `step`
        response (`rise_s`, `overshoot`, `settling_s`), the `frequency` response (`bandwidth_hz`) and `notes`.

        Args:
            flight: id of the file of the vehicle's own log.
            from_s: begin of the time that is used [s since the log's start].
            to_s: end of it.
        """
        query = _query({"from_s": from_s, "to_s": to_s})
        return (await self._gcs.request("GET", _path(flight, "loops", query)))["loops"]

    async def autotuned(self, flight: str) -> dict[str, Any] | None:
        """What PX4's autotune found in a flight: `axes` with their `parameters`, or a `note` that says why
        there are none; None: it did not run."""
        return (await self._gcs.request("GET", _path(flight, "loops")))["autotune"]

    async def what_if(
        self, log: str, *, from_s: float, duration_s: float = 20.0, **change: Any
    ) -> dict[str, Any]:
        """Flies a part of a vehicle's own log again in simulation, `unchanged` and `changed`; their distance
        from `logged` (`max_error_m`) says how far to trust it. No vehicle is commanded.

        Args:
            log: id of the file of the log.
            from_s: begin of the part [s since the log's start]; the vehicle is in the air then.
            duration_s: its duration.
            change: what is different, such as `parameters={"MPC_XY_P": 0.7}`, `wind_ned_m_s`; with
                `flown_by="autopilot"` also `lost`, `battery_percent`, `item` of a plan, or a `step` of an
                offboard mission: `{"place": "step 3", "moved_ned_m": [5, 0, 0]}`.

        Raises:
            Invalid: this part cannot be flown, or the change has no effect on it.
        """
        body: Body = {"from_s": from_s, "duration_s": duration_s, **change}
        return await self._gcs.request("POST", _path(log, "rerun"), body)

    async def prove(
        self, vehicle: str, parameters: Mapping[str, float], *, runs: int = 100, seed: int = 0
    ) -> dict[str, Any]:
        """Flies new gains in simulation, in varied conditions, beside the vehicle's present ones; returns
        whether they `passed`, and each run's `failures`. Nothing is written.

        Args:
            vehicle: id of the connected vehicle.
            parameters: the proposed values (MC_*, MPC_*).
            runs: number of conditions.
            seed: equal seeds give equal proofs.

        Raises:
            Invalid: nothing is known of the vehicle's body.
            Refused: a value cannot be proved.
            Timeout: it goes on without this program.
        """
        body: Body = {"vehicle": vehicle, "parameters": dict(parameters), "runs": runs, "seed": seed}
        operation = await self._gcs.request("POST", "/proofs", body)
        operation = await Operations(self._gcs).wait(operation["id"], timeout_s=PROOF_TIMEOUT_S)
        return await self._gcs.request("GET", f"/proofs/{operation['result']['proof']}")

    async def beside(
        self,
        flight: str,
        other: str,
        *,
        align: Literal["arming", "takeoff", "fit", "offset"] = "arming",
        offset_s: float = 0.0,
    ) -> dict[str, Any]:
        """Two flights over each other: `distance_m` over `t_s`, `first` and `second` (duration, distance,
        energy), and the `offset_s` that brings their times together.

        Args:
            flight: id of a flight or of a file.
            other: id of the second one.
            align: by arming, take-off, the best fit of the tracks, or the given offset.
            offset_s: with `offset`, what is added to times of the second log [s].

        Raises:
            Invalid: they cannot be compared like this.
        """
        query = _query({"other": other, "align": align, "offset_s": offset_s})
        return await self._gcs.request("GET", _path(flight, "beside", query))

    async def model(self, flight: str, *, mass_kg: float | None = None) -> dict[str, Any]:
        """What a flight says of its aircraft: thrust and drag by mass, with standard errors.

        Args:
            flight: id of a flight with the vehicle's own log.
            mass_kg: its take-off mass, if it is known.

        Raises:
            Invalid: the flight says too little.
        """
        return await self._gcs.request("GET", _path(flight, "model", _query({"mass_kg": mass_kg})))

    async def kept_model(self, vehicle: str) -> dict[str, Any] | None:
        """The model with which dry runs of a vehicle fly; None: none is kept."""
        return (await self._gcs.request("GET", _model_path(vehicle)))["model"]

    async def keep_model(self, vehicle: str, flight: str, *, mass_kg: float | None = None) -> dict[str, Any]:
        """Identifies the model of a vehicle in one of its flights, and keeps it for its dry runs.

        Args:
            vehicle: id of the connected vehicle.
            flight: id of a flight of this vehicle.
            mass_kg: its take-off mass in that flight, if it is known.

        Raises:
            Invalid: the flight says too little, or is of another vehicle.
        """
        body: Body = {"flight": flight, "mass_kg": mass_kg}
        return (await self._gcs.request("PUT", _model_path(vehicle), body))["model"]

    async def forget_model(self, vehicle: str) -> None:
        """Forgets the kept model of a vehicle."""
        await self._gcs.request("DELETE", _model_path(vehicle))

    async def table(
        self, flight: str, topic: str, *, from_row: int = 0, at_s: float | None = None, rows: int = 100
    ) -> dict[str, Any]:
        """Some `rows` of a topic with their times `t_s` [s since the log's start] and `columns`.

        Args:
            flight: id of the file.
            topic: id of the topic, such as `vehicle_attitude:0`.
            from_row: number of the first row.
            at_s: begins at this time instead.
            rows: maximum number of rows.
        """
        query = _query({"topic": topic, "from_row": from_row, "at_s": at_s, "rows": rows})
        return await self._gcs.request("GET", _path(flight, "table", query))

    async def export(
        self,
        flight: str,
        file: str | os.PathLike[str],
        *,
        format: str | None = None,
        topics: Sequence[str] = (),
        fields: Sequence[str] = (),
        rate_hz: float | None = None,
        from_s: float | None = None,
        to_s: float | None = None,
    ) -> int:
        """Writes a log, or a part of it, to a file of this computer; returns its size [bytes].

        Args:
            flight: id of the file on the server.
            file: the file; it appears when it is complete.
            format: csv, parquet, geojson, kml or mcap; default: by the file's suffix.
            topics: ids of topics: exactly one for csv and parquet, unless there are fields.
            fields: fields or expressions at common times, for csv and parquet.
            rate_hz: rows a second of fields; default: a row at each sample of the first field.
            from_s: begin of the window [s since the log's start].
            to_s: end of the window.

        Raises:
            Invalid: the log has not what is asked for.
            Refused: the log cannot be read.
            Unreachable: the file was not completed.
        """
        target = Path(file)
        query = {
            "format": format or target.suffix.removeprefix("."),
            "topic": list(topics),
            "field": list(fields),
            "rate_hz": rate_hz,
            "from_s": from_s,
            "to_s": to_s,
        }
        return await self._gcs.download(_path(flight, "export", _query(query)), target)


class LogStream:
    """The log that one vehicle streams while it writes it: `vehicle.log_stream`."""

    def __init__(self, vehicle: VehicleApi) -> None:
        self._vehicle = vehicle

    async def start(self) -> dict[str, Any]:
        """Starts it, also in flight; returns the operation, whose `text` says size, rate and loss, and whose
        `result` has the `flight`. Needs control.

        Raises:
            NotInControl: this client has no control of the vehicle.
            Refused: the vehicle's links carry no logs.
        """
        return await self._vehicle.request("POST", "/logs/stream")

    async def stop(self) -> None:
        """Stops it, and the operation ends with its result. If this server streams none, the vehicle is told
        to stop the stream of whoever gets it."""
        await self._vehicle.request("DELETE", "/logs/stream")


def _path(flight: str, part: str = "", query: str = "") -> str:
    return f"/flights/{quote(flight, safe='')}{f'/{part}' if part else ''}{f'?{query}' if query else ''}"


def _model_path(vehicle: str) -> str:
    return f"/vehicles/{quote(vehicle, safe='')}/model"


def _query(values: Mapping[str, QueryValue]) -> str:
    return urlencode({name: value for name, value in values.items() if value is not None}, doseq=True)
