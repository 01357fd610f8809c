"""The API's own reference at /docs: a page of ours over openapi.json, so that nothing leaves the machine.

FastAPI's page would load its program from elsewhere; a ground station in a field has no elsewhere.
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
    """Its program."""
    return FileResponse(FOLDER / "reference.js", media_type="text/javascript", headers=_FRESH)


@router.get("/docs/reference.css")
async def style() -> FileResponse:
    """Its looks."""
    return FileResponse(FOLDER / "reference.css", headers=_FRESH)


@router.get("/docs/")
@router.get("/api/v1/docs")
async def elsewhere() -> RedirectResponse:
    """Where people look for it, too."""
    return RedirectResponse("/docs", status_code=308)
