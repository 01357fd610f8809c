"""Proofs of gains: a vehicle with proposed values, flown many times in simulation before they are written.
The newest results are kept in memory, as the JSON that the process wrote."""

from __future__ import annotations

import sys
from collections import OrderedDict
from collections.abc import Mapping
from fnmatch import fnmatchcase

import msgspec

from gcs_server.errors import ClientHasTooMany, InvalidRequest, Refused, UnknownProof
from gcs_server.flights.vehicle_models import VehicleModels
from gcs_server.operations.operations import ReportProgress
from gcs_server.operations.process import WorkerFailed, run_process
from gcs_server.vehicle.vehicle import Vehicle

MAX_RUNNING = 2
MAX_RESULTS = 10
MAX_RESULT_BYTES = 4 * 1024 * 1024
COMMAND = (sys.executable, "-m", "gcs_server.flights.proof_worker")
USED = ("MC_*", "MPC_*", "IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF")
"""Parameters of the controllers that a proof takes from any vehicle."""
MARK = "MC_ROLLRATE_P"
"""Every multicopter has it."""
USED_OF_SIMULATED = (*USED, "SIH_*", "CA_ROTOR*")
"""Those of a simulated vehicle, which describe its body."""


async def simulated_values(
    vehicle: Vehicle, models: VehicleModels, report: ReportProgress
) -> tuple[dict[str, float], list[str]]:
    """The values with which a vehicle is simulated, and what is assumed of it; reads its parameters if they
    were not read yet.

    Raises:
        InvalidRequest: nothing is known of its body, or it is no multicopter.
        NoReply: it did not send its parameters.
    """
    if vehicle.params.known(MARK) is None:
        report(f"Reading the parameters of vehicle {vehicle.id}.", None)
        await vehicle.params.refresh()
    known = {each.name: float(each.value) for each in vehicle.params.all()}
    if MARK not in known:
        raise InvalidRequest(
            "vehicle",
            "The vehicle has no gains of a multicopter (MC_ROLLRATE_P).",
            remedy="Take a quadrotor with PX4.",
        )
    is_simulated = "SIH_MASS" in known
    patterns = USED_OF_SIMULATED if is_simulated else USED
    values = {
        name: value for name, value in known.items() if any(fnmatchcase(name, each) for each in patterns)
    }
    kept = models.find(vehicle.identity)
    if kept is not None:
        assumed = [f"The body of the vehicle is the one identified in a flight: {kept.text()}."]
        if kept.turns_known is not True:
            assumed.append(
                "The gains may be proved with the turning of another vehicle: log a flight with the motors "
                "at a high rate, and keep its model."
            )
        return values | dict(kept.parameters), assumed
    if not is_simulated:
        raise InvalidRequest(
            "vehicle",
            "Nothing is known of the vehicle’s body: a proof with another body would prove nothing.",
            remedy="Identify its model in a flight (What if), keep it, then prove.",
        )
    return values, ["The body is that of the vehicle’s SIH parameters."]


class Proofs:
    """The proofs of one server; they are lost in a restart."""

    def __init__(self) -> None:
        self._count = 0
        self._running: list[str] = []
        """Keys of the clients whose proofs are running."""
        self._stored: OrderedDict[str, bytes] = OrderedDict()

    def next_id(self, client_key: str) -> str:
        """Id of the next proof of a client. Raises ClientHasTooMany, Refused."""
        self._require_room(client_key)
        self._count += 1
        return str(self._count)

    async def run(
        self, proof_id: str, request: Mapping[str, object], report: ReportProgress, client_key: str
    ) -> dict[str, object]:
        """Flies a proof and stores its result; cancelling this call ends the process.

        Args:
            proof_id: id of the proof.
            request: the rest of the worker's request.
            report: receives progress.
            client_key: identifies the client.

        Raises:
            ClientHasTooMany: a proof of this client is running.
            Refused: a value cannot be proved, or too many proofs are running.
        """
        self._require_room(client_key)
        self._running.append(client_key)
        line = msgspec.json.encode({**request, "id": proof_id})
        try:
            summary, body = await run_process(COMMAND, report, request=line, max_body_bytes=MAX_RESULT_BYTES)
        except WorkerFailed as error:
            raise Refused(
                f"The proof has failed: {error}", remedy="Change the values if the error names one."
            ) from error
        finally:
            self._running.remove(client_key)
        self._stored[proof_id] = body
        while len(self._stored) > MAX_RESULTS:
            self._stored.popitem(last=False)
        return {"proof": proof_id, **summary}

    def body(self, proof_id: str) -> bytes:
        """The result of a proof as JSON. Raises UnknownProof."""
        stored = self._stored.get(proof_id)
        if stored is None:
            raise UnknownProof(
                f"There is no result of a proof {proof_id!r}.",
                remedy=f"Wait for its operation to succeed; the last {MAX_RESULTS} results are kept.",
            )
        return stored

    def _require_room(self, client_key: str) -> None:
        remedy = "Wait until one has ended, or cancel one (DELETE /operations/{id})."
        if client_key in self._running:
            raise ClientHasTooMany("A proof of this client is already running.", remedy=remedy)
        if len(self._running) >= MAX_RUNNING:
            raise Refused(f"{MAX_RUNNING} proofs are already running, which is the limit.", remedy=remedy)
