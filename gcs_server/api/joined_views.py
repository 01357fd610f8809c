"""Answers about joined flights."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import msgspec

from gcs_server.logbook.beside_plan import PREDICTED, beside_plan, plan_findings
from gcs_server.logbook.joined_flights import Flight
from gcs_server.logbook.notes import NotesHead, NotesStore


def joined_view(flight: Flight) -> dict[str, Any]:
    """A row of the list of flights."""
    best, joined = flight.best, flight.joined
    return {
        "id": flight.id,
        "name": flight.name,
        "vehicle": best.vehicle,
        "start_unix_s": best.begin_unix_s,
        "duration_s": best.duration_s,
        "distance_m": best.distance_m,
        "height_m": best.height_m,
        "modes": best.modes,
        "failsafes": best.failsafes,
        "ended": best.ended,
        "plan": next((head.plan for head in flight.notes if head.plan is not None), None),
        "parts": [
            {
                "id": part.id,
                "file": part.file if part.file in flight.files else None,
                "source": part.source,
                "offset_s": joined.offset_s(part),
                "begin_s": part.flight.begin_s,
                "end_s": part.flight.end_s,
                "why": joined.why.get(part.id),
            }
            for part in joined.parts
        ],
        "unsure": [{"part": part, "why": why} for part, why in joined.unsure],
    }


def record_view(flight: Flight, store: NotesStore) -> dict[str, Any]:
    """A flight with the details of its notes; blocks."""
    view: dict[str, Any] = {
        "flight": joined_view(flight),
        "plan": None,
        "findings": [],
        "commands": [],
        "parameters": [],
    }
    for head in flight.notes:
        body = store.details(head.id)
        if body is not None:
            details: dict[str, Any] = msgspec.json.decode(body)
            _add(view, flight, head, details)
    view["commands"].sort(key=itemgetter("unix_s"))
    return view


def _add(view: dict[str, Any], flight: Flight, head: NotesHead, details: dict[str, Any]) -> None:
    """Adds the details of one file of notes; a flight has several if the server was restarted in it."""
    part = next(part for part in flight.joined.parts if part.file == head.id)
    offset_s = flight.joined.offset_s(part) - (head.flight.begin_unix_s or 0.0)
    if details["plan"]["kind"] is not None and view["plan"] is None:
        flown = details["plan"]["flown"]
        started_unix_s = head.flight.begin_unix_s if flown is None else flown["started_unix_s"]
        begin_s = (started_unix_s or 0.0) + offset_s
        compared = beside_plan(details["plan"], begin_s)
        noted = {name: value for name, value in details["plan"].items() if name != PREDICTED}
        view["plan"] = {**noted, "begin_s": begin_s, "compared": compared}
        if compared is not None:
            view["findings"] = plan_findings(compared, flight.best.vehicle, begin_s)
    known = {(each["unix_s"], each["command"]) for each in view["commands"]}
    view["commands"] += [
        {
            "t_s": each["unix_s"] + offset_s,
            **{name: each[name] for name in ("unix_s", "client", "command", "result", "detail")},
        }
        for each in details["commands"]
        if (each["unix_s"], each["command"]) not in known
    ]
    if not view["parameters"]:
        parameters = sorted(details["parameters"].items())
        view["parameters"] = [{"name": name, "value": value} for name, value in parameters]
