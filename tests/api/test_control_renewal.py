"""Each request of a client keeps its control while it is answered."""

from contextlib import contextmanager

from tests.support.api_client import api_client


def test_every_request_is_marked_as_being_answered_until_its_answer(tmp_path, monkeypatch):
    with api_client(tmp_path) as client:
        authority = client.app.state.station.authority
        marks, counts = [], []

        @contextmanager
        def answering(principal, original=authority.answering):
            with original(principal):
                marks.append(principal.name)
                yield
                counts.append(sum(authority._answered.values()))

        monkeypatch.setattr(authority, "answering", answering)
        assert client.get("/api/v1/me", headers={"X-Client": "anna"}).status_code == 200
        assert client.get("/api/v1/vehicles/9").status_code == 404
        assert (len(marks), counts) == (2, [1])
        assert not authority._answered
