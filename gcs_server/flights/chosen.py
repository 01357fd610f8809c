"""Chooses the plan of a request: a plan in the store, or the document in the request itself."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_server.errors import InvalidRequest
from gcs_server.plans.store import PlanStore
from gcs_server.plans.work import UnreadDocument
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.documents import PlanKind

WRONG_KIND: dict[PlanKind, tuple[str, str]] = {
    "waypoint_plan": (
        "an offboard mission, which cannot be uploaded: the server flies it.",
        "Start it as an offboard mission, or name a waypoint plan.",
    ),
    "offboard_mission": (
        "a waypoint plan, which the vehicle flies itself.",
        "Upload it and start it (…/mission/start), or convert it to an offboard mission "
        "(POST /plans/convert).",
    ),
}
"""What a stored plan is that does not have this kind, and the remedy."""


@dataclass(frozen=True, slots=True)
class PlanSource:
    """A stored plan, or a document; either `plan_id` or `document` is None."""

    plan_id: str | None
    version: int | None
    """None: the newest version."""
    document: UnreadDocument | None
    field: str
    """The field of the request with the document, for errors."""


@dataclass(frozen=True, slots=True)
class ChosenPlan:
    """A plan that has not been read."""

    reference: PlanReference
    document: UnreadDocument
    field: str
    """The field of the request that names it, for errors."""


async def choose(store: PlanStore, source: PlanSource, kind: PlanKind | None = None) -> ChosenPlan:
    """The plan of a source. The kind of a document in the request is checked when it is read.

    Raises:
        InvalidRequest: the stored plan does not have this kind.
        UnknownPlan, StorageError: the store does not have the plan, or cannot read it.
    """
    if source.document is not None:
        return ChosenPlan(PlanReference(None, None, None), source.document, source.field)
    assert source.plan_id is not None
    stored, text = await store.get(source.plan_id, source.version)
    if kind is not None and stored.kind != kind:
        is_text, remedy = WRONG_KIND[kind]
        raise InvalidRequest("plan_id", f"{stored.name!r} is {is_text}", remedy=remedy)
    reference = PlanReference(stored.id, stored.version, stored.name)
    return ChosenPlan(reference, UnreadDocument(text, kind), "plan_id")
