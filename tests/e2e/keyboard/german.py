"""What a German page shows: its texts, the English words in them, and texts that have no room."""

from __future__ import annotations

import re
from collections.abc import Collection
from functools import cache
from pathlib import Path

from playwright.sync_api import Page

from tools.build_server_texts import read_catalog

WEB = Path(__file__).resolve().parents[3] / "web"

ENGLISH = re.compile(
    r"\b(the|and|of|is|are|with|from|to|for|no|by|at|this|that|it|its|has|have|if|or|be|not|when|which|what|why|"
    r"vehicles?|speed|altitude|height|heading|above|below|battery|take|hold|return|armed|disarmed|connection|lost|"
    r"set|add|remove|delete|save|open|close|cancel|write|read|choose|show|hide|line|area|point|start|stop|all|none|"
    r"up|down|left|right|north|east|south|west|forward|ready|unknown|known|mode|yes|values?|messages?|search|"
    r"readiness|waypoints?|setpoints?|steps?|items?|files?|names?|size|time|each|new|now|until|after|before)\b",
    re.IGNORECASE,
)
ALLOWED = re.compile(
    r"(?<=^Verlauf von )\w+$|"
    r"\bStart(s|et|en)?\b|\bName\b|\bStopp?\b|\bHome(-Position)?\b|Offboard GCS|\bWest\b|^\.waypoints$"
)
"""Fields whose values are plotted, words that are the same in German, and names."""
FIELD = re.compile(r"\b([a-z]+_\w+|[A-Z][A-Z_]+)(:[\d.]+)?[ /]\w+")
"""A field of a topic or message."""

SHOWN_TEXTS = """
() => {
  const silent = 'script, style, code, pre, kbd, [translate="no"], [lang="en"], .mono, .maplibregl-ctrl';
  const seen = (one) => one.checkVisibility({ visibilityProperty: true }) && one.closest(silent) === null;
  const texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.data.trim();
    if (text !== '' && seen(walker.currentNode.parentElement)) texts.push(text);
  }
  for (const name of ['aria-label', 'title', 'placeholder', 'aria-description', 'aria-valuetext', 'alt'])
    for (const one of document.querySelectorAll(`[${name}]`))
      if (seen(one)) texts.push(one.getAttribute(name));
  return [...new Set(texts)];
}
"""
# What is one pixel wide is for screen readers.
CLIPPED_TEXTS = """
() => [...document.querySelectorAll('body *')].filter((one) => {
  const seen = one.checkVisibility({ visibilityProperty: true }) && one.clientWidth > 1;
  if (!seen || one.closest('[translate="no"], .maplibregl-ctrl, svg') !== null) return false;
  if (![...one.childNodes].some((node) => node.nodeType === 3 && node.data.trim() !== '')) return false;
  const isCut = ['hidden', 'clip'].includes(getComputedStyle(one).overflowX);
  const isControl = one.matches('button, a, .btn, [role="radio"], [role="tab"]');
  return one.scrollWidth > one.clientWidth + 1 && (isControl || isCut);
}).map((one) => `${one.tagName.toLowerCase()}.${one.className}`)
"""


@cache
def _words() -> dict[str, str]:
    catalogs = (WEB / "locales" / "de").glob("*.po")
    return {text: words for file in catalogs for text, words in read_catalog(file.read_text("utf-8")).items()}


def german(text: str) -> str:
    """A text of the page in German; of the beginning of a text, its beginning up to `.`, `:` or a value."""
    if text in _words():
        return _words()[text]
    longer = next((words for english, words in _words().items() if words and english.startswith(text)), text)
    return re.split(r"[.:{]", longer)[0].strip()


def choose_german(page: Page) -> None:
    """Loads the page in German."""
    page.evaluate("() => { document.cookie = 'gcs-language=de; Path=/'; }")
    page.reload()
    assert page.evaluate("() => document.documentElement.lang") == "de"


def english_texts(page: Page, own_words: Collection[str] = ()) -> list[str]:
    """The shown texts that have an English word, apart from what a person wrote: names of
    steps, lists and roles."""
    own = re.compile(
        "|".join(rf"\b{re.escape(word)}(?!\w)" for word in sorted(own_words, key=len)[::-1]) or "(?!)"
    )
    texts = page.evaluate(SHOWN_TEXTS)
    return [text for text in texts if ENGLISH.search(ALLOWED.sub("", FIELD.sub("", own.sub("", text))))]


def clipped_texts(page: Page) -> list[str]:
    """The elements whose text has no room, by name and class."""
    return page.evaluate(CLIPPED_TEXTS)
