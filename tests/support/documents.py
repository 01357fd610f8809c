"""Plans as plan work has read them."""

import json

from gcs_server.plans.tasks import ReadDocument
from missions import documents


def read_document(value):
    """A document, given as JSON values."""
    return ReadDocument.of(documents.read(json.dumps(value)))
