"""Request bodies for control of a vehicle and for Land now."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from gcs_server.api.strict_body import StrictBody
from gcs_server.control.lease import OnControlLost


class LandNowRequest(StrictBody):
    """Confirmation of Land now."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"confirm": "vehicle 1 lands now"}]})

    confirm: str = Field(max_length=100)
    """Exactly `vehicle {id} lands now`, with the vehicle's id."""


class TakeControl(StrictBody):
    """Options for taking control."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"on_expiry": "hold"}]})

    force: bool = False
    """Take control from another client. Allowed after that client has denied a request, after `answer_s`
    without an answer, or if that client cannot answer requests."""
    on_expiry: OnControlLost | None = None
    """Command sent once to the flying vehicle if this client sends nothing for `lease_s`: `nothing` (the
    vehicle continues; the default), `hold`, `land` or `rtl`. Never sent while another party controls the
    vehicle."""


class RequestControl(StrictBody):
    """Reason of a request for control."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"reason": "I see it better from here"}]})

    reason: str | None = Field(default=None, max_length=200)
    """Shown to the client in control."""


class AnswerControl(StrictBody):
    """The client that gets control."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"client": "bob"}]})

    client: str = Field(min_length=1, max_length=64)
    """Key or name of the requesting client."""


class DenyControl(AnswerControl):
    """The denied client, and the reason."""

    reason: str | None = Field(default=None, max_length=200)
    """Shown to the requesting client."""
