"""Proofs of gains over HTTP: an operation whose result says what passed; bad requests are refused."""

import asyncio
import contextlib
import sys
from types import SimpleNamespace

import pytest

from gcs_server.errors import GcsError, InvalidRequest, UnknownProof
from gcs_server.flights import proofs
from gcs_server.flights.vehicle_models import VehicleModels
from tests.support.api_client import api_client


@pytest.fixture
def client(tmp_path):
    with api_client(tmp_path, path="/api/v1/") as client:
        yield client


class Parameters:
    """Those of a vehicle; they are known once they were read."""

    def __init__(self, values):
        self._values, self._known = values, {}

    def known(self, name):
        return self._known.get(name)

    def all(self):
        return [SimpleNamespace(name=name, value=value) for name, value in self._known.items()]

    async def refresh(self):
        self._known = self._values


def vehicle(**parameters):
    identity = SimpleNamespace(uid=None, system_id=1, component_id=1)
    return SimpleNamespace(id="1", params=Parameters(parameters), identity=identity)


def values_of(vehicle, models):
    said = []
    return asyncio.run(proofs.simulated_values(vehicle, models, lambda *each: said.append(each)))


SIMULATED = vehicle(MC_ROLLRATE_P=0.15, SIH_MASS=1.0, SIH_T_MAX=5.0, COM_DISARM_LAND=2.0)


class NoModels(VehicleModels):
    def find(self, identity):
        return None


@pytest.fixture
def proving(client, monkeypatch):
    flights = client.app.state.station.flights
    monkeypatch.setattr(flights.fleet, "get", lambda _: SIMULATED)
    monkeypatch.setattr(flights, "models", NoModels())
    return client


def run_to_end(client, body):
    started = client.post("proofs", json=body)
    assert started.status_code == 202, started.text
    operation = started.json()
    assert started.headers["location"] == f"/api/v1/operations/{operation['id']}"
    with contextlib.suppress(GcsError):
        client.portal.call(client.app.state.station.operations.wait, operation["id"])
    return client.get(f"operations/{operation['id']}").json()


def test_values_are_proved_in_a_process_and_the_result_is_kept(proving):
    body = {"vehicle": "1", "parameters": {"MC_ROLLRATE_P": 0.17}, "runs": 4}
    operation = run_to_end(proving, body)
    assert operation["state"] == "succeeded", operation
    assert operation["result"] == {"proof": "1", "passed": True, "stable": 4, "runs": 4}
    answer = proving.get("proofs/1").json()
    assert (answer["vehicle"], answer["parameters"]) == ("1", {"MC_ROLLRATE_P": 0.17})
    assert answer["present"]["MC_ROLLRATE_P"] == pytest.approx(0.15)
    assert len(answer["pairs"]) == 4
    assert answer["assumed"] == ["The body is that of the vehicle’s SIH parameters."]


def test_a_value_that_cannot_be_proved_fails_in_words(proving):
    operation = run_to_end(proving, {"vehicle": "1", "parameters": {"COM_DISARM_LAND": 0}, "runs": 1})
    assert operation["state"] == "failed"
    assert "COM_DISARM_LAND is no gain or limit" in operation["error"]["detail"]


def test_a_running_proof_is_cancelled(proving, monkeypatch):
    monkeypatch.setattr(proofs, "COMMAND", (sys.executable, "-c", "import time; time.sleep(60)"))
    body = {"vehicle": "1", "parameters": {"MC_ROLLRATE_P": 0.17}}
    operation = proving.post("proofs", json=body).json()
    assert proving.delete(f"operations/{operation['id']}").status_code in (200, 202, 204)
    with contextlib.suppress(GcsError):
        proving.portal.call(proving.app.state.station.operations.wait, operation["id"])
    assert proving.get(f"operations/{operation['id']}").json()["state"] == "cancelled"


def test_a_proof_needs_a_known_vehicle_its_parameters_and_its_body(client):
    body = {"vehicle": "9", "parameters": {"MC_ROLLRATE_P": 0.17}}
    assert client.post("proofs", json=body).json()["code"] == "unknown_vehicle"
    assert client.get("proofs/77").json()["code"] == UnknownProof.code
    for bad in ({"vehicle": "1", "parameters": {}}, {**body, "runs": 0}, {**body, "parameters": {"x": 1}}):
        assert client.post("proofs", json=bad).status_code == 422
    with pytest.raises(InvalidRequest, match="no gains of a multicopter"):
        values_of(vehicle(), NoModels())
    with pytest.raises(InvalidRequest, match="Nothing is known of the vehicle’s body"):
        values_of(vehicle(MC_ROLLRATE_P=0.15), NoModels())


def test_a_kept_model_is_the_body_of_a_real_vehicle():
    kept = SimpleNamespace(
        parameters={"SIH_MASS": 1.0, "SIH_T_MAX": 6.0}, text=lambda: "thrust 24 m/s²", turns_known=False
    )
    models = SimpleNamespace(find=lambda _: kept)
    values, assumed = values_of(vehicle(MC_ROLLRATE_P=0.2, CA_ROTOR0_PX=9.0), models)
    assert values == {"MC_ROLLRATE_P": 0.2, "SIH_MASS": 1.0, "SIH_T_MAX": 6.0}
    assert "thrust 24 m/s²" in assumed[0]
    assert "turning of another vehicle" in assumed[1]
    kept.turns_known = True
    assert len(values_of(vehicle(MC_ROLLRATE_P=0.2), models)[1]) == 1
