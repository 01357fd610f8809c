"""The API reference at /docs: this server's own page for openapi.json, so that nothing is loaded from
elsewhere.

FastAPI's page would load its script from the internet, which a ground station in the field may not have.
"""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import FileResponse, RedirectResponse

FOLDER = Path(__file__).resolve().parent / "reference"
_FRESH = {"Cache-Control": "no-cache"}

router = APIRouter(include_in_schema=False)


@router.get("/docs")
async def page() -> FileResponse:
    """The document."""
    return FileResponse(FOLDER / "index.html", headers=_FRESH)


@router.get("/docs/reference.js")
async def program() -> FileResponse:
    """Its script."""
    return FileResponse(FOLDER / "reference.js", media_type="text/javascript", headers=_FRESH)


@router.get("/docs/reference.css")
async def style() -> FileResponse:
    """Its style sheet."""
    return FileResponse(FOLDER / "reference.css", headers=_FRESH)


@router.get("/docs/")
@router.get("/api/v1/docs")
async def elsewhere() -> RedirectResponse:
    """Redirects from another usual address of the reference."""
    return RedirectResponse("/docs", status_code=308)
