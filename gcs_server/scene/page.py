"""viser's browser program, adapted to the framing page: no panel, no branding, own ground and labels.

The program is a single file in the installed package; this server inserts a few lines and serves it. Its
content security policy allows connections to this server only.
"""

from __future__ import annotations

import functools
import gzip
import hashlib
import importlib.util
import re
from dataclasses import dataclass
from pathlib import Path

from gcs_server.scene.palette import PALETTES, Palette

_SCRIPT = """
(() => {
  // The framing page gives the settings behind the #, so that the browser caches one page for all of them.
  const query = new URLSearchParams(location.hash.slice(1) || location.search);
  const page = document.documentElement;
  page.dataset.gcsTheme = query.get('theme') === 'light' ? 'light' : 'dark';
  // viser reads the address of its stream from the query; the address includes the settings of the view.
  const stream = location.origin.replace(/^http/, 'ws') + location.pathname;
  const settings = new URLSearchParams();
  for (const key of ['view', 'theme', 'language', 'mode', 'vehicle'])
    if (query.has(key)) settings.set(key, query.get(key));
  query.set('websocket', stream + '?' + settings);
  history.replaceState(null, '', '?' + query);
  // viser reconnects only while its page has the focus; inside the framing page it never has the focus.
  document.hasFocus = () => true;
  // viser's first colour scheme is always light; the later ones come from the server.
  let changes = 0;
  new MutationObserver(() => {
    const scheme = page.getAttribute('data-mantine-color-scheme');
    if (changes++ > 0 && scheme) page.dataset.gcsTheme = scheme;
  }).observe(page, { attributes: true, attributeFilter: ['data-mantine-color-scheme'] });

  // Panels cover parts of the view, so the camera's target is shown in the middle of the free part. The
  // framing page sends this point: its offset to the right and down from the middle, as fractions of the
  // view. While the framing page edits a plan, this view sends clicks to that page and not to the server.
  let middle = [0, 0], editing = false;
  addEventListener('message', (event) => {
    if (event.source !== parent || event.origin !== location.origin) return;
    if (typeof event.data?.gcsEditing === 'boolean') editing = event.data.gcsEditing;
    const point = event.data?.gcsMiddle;
    if (!Array.isArray(point) || point.length !== 2 || !point.every((share) => Math.abs(share) < 0.5)) return;
    middle = point;
    point.forEach((share, i) => page.style.setProperty(['--gcs-x', '--gcs-y'][i], `${50 + 100 * share}%`));
  });
  const centre = (camera) => {
    const [offsetX, offsetY] = middle.map((share) => -share);
    if ((camera.view?.offsetX ?? 0) === offsetX && (camera.view?.offsetY ?? 0) === offsetY) return;
    camera.view = { enabled: true, fullWidth: 1, fullHeight: 1, offsetX, offsetY, width: 1, height: 1 };
    camera.updateProjectionMatrix();
  };

  // Labels: the texts are in viser's hidden panel; each is drawn at the position of its node.
  const tags = new Map();
  const layer = document.createElement('div');
  layer.className = 'gcs-tags';
  const scale = document.createElement('em');
  layer.append(scale);
  addEventListener('DOMContentLoaded', () => document.body.append(layer));
  const apply = (m, [x, y, z, w]) =>
    [0, 1, 2, 3].map((r) => m[r] * x + m[r + 4] * y + m[r + 8] * z + m[r + 12] * w);
  const sync = () => {
    const present = new Set();
    const view = document.querySelector('[data-gcs-mode]');
    if (view && view.textContent !== scale.textContent) scale.textContent = view.textContent;
    if (view && view.dataset.gcsMode !== layer.dataset.mode) layer.dataset.mode = view.dataset.gcsMode;
    const origin = view?.dataset.gcsOrigin ?? '';
    if (origin !== page.dataset.gcsOrigin) page.dataset.gcsOrigin = origin;
    for (const source of document.querySelectorAll('[data-gcs-tag]')) {
      const name = source.dataset.gcsTag;
      present.add(name);
      let tag = tags.get(name);
      if (!tag) {
        tag = document.createElement('span');
        tag.append(document.createElement('b'), document.createElement('small'));
        tags.set(name, tag);
        layer.append(tag);
      }
      const [text, note] = tag.children;
      if (text.textContent !== source.textContent) text.textContent = source.textContent;
      if (note.textContent !== source.dataset.gcsNote) note.textContent = source.dataset.gcsNote;
      tag.style.setProperty('--c', source.dataset.gcsColour);
      tag.dataset.side = source.dataset.gcsSide;
    }
    for (const [name, tag] of tags) if (!present.has(name)) { tag.remove(); tags.delete(name); }
  };
  let next = 0;
  const draw = (now) => {
    requestAnimationFrame(draw);
    if (now >= next) { next = now + 100; sync(); }
    const viser = window.__viserMutable;
    if (!viser || !viser.camera) return;
    centre(viser.camera);
    const { matrixWorldInverse, projectionMatrix } = viser.camera;
    for (const [name, tag] of tags) {
      const node = viser.nodeRefFromName[name];
      const at = node && apply(matrixWorldInverse.elements, [...node.matrixWorld.elements.slice(12, 15), 1]);
      const inFront = at && at[2] < -0.1;
      if (inFront) {
        const [x, y, , w] = apply(projectionMatrix.elements, at);
        const left = ((x / w + 1) / 2) * innerWidth, top = ((1 - y / w) / 2) * innerHeight;
        const up = { above: -190, below: 90, sign: -100 }[tag.dataset.side];
        const place = `translate(${left.toFixed(1)}px, ${top.toFixed(1)}px) translate(-50%, ${up}%)`;
        if (tag.style.transform !== place) tag.style.transform = place;
      }
      const visibility = inFront ? 'visible' : 'hidden';
      if (tag.style.visibility !== visibility) tag.style.visibility = visibility;
    }
  };
  requestAnimationFrame(draw);

  // A click (not a drag) is sent with its ray, in the frame of the world as it is drawn now.
  const token = query.get('view');
  let down = null;
  const turned = (m, [x, y, z]) => [0, 1, 2].map((c) => m[c * 4] * x + m[c * 4 + 1] * y + m[c * 4 + 2] * z);
  const sendClick = (event) => {
    if (editing) return parent.postMessage({ gcsClick: [event.clientX, event.clientY] }, location.origin);
    const viser = window.__viserMutable;
    const world = viser && viser.nodeRefFromName['/world'];
    if (!token || !viser.camera || !world) return;
    const camera = viser.camera, frame = event.target.getBoundingClientRect();
    const x = (event.clientX - frame.left) / frame.width, y = (event.clientY - frame.top) / frame.height;
    const local = apply(camera.projectionMatrixInverse.elements, [2 * x - 1, 1 - 2 * y, 0.5, 1]);
    const clicked = [...local.slice(0, 3).map((c) => c / local[3]), 1];
    const eye = camera.matrixWorld.elements, ground = world.matrixWorld.elements;
    const from = [0, 1, 2].map((i) => eye[12 + i]), to = apply(eye, clicked);
    const inWorld = (v) => turned(ground, v);
    fetch(location.pathname + 'view/' + encodeURIComponent(token) + '/click', {
      method: 'POST', headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify({
        eye_enu_m: inWorld(from.map((c, i) => c - ground[12 + i])),
        ray_enu: inWorld(from.map((c, i) => (to[i] - c) / Math.hypot(...from.map((o, j) => to[j] - o)))),
        view_x: x, view_y: y,
      }),
    }).catch(() => {});
  };
  addEventListener('pointerdown', (event) => {
    const alone = event.isPrimary && event.button === 0 && event.target instanceof HTMLCanvasElement;
    down = alone ? { x: event.clientX, y: event.clientY, at: event.timeStamp } : null;
  }, true);
  addEventListener('pointerup', (event) => {
    const pressed = down;
    down = null;
    if (!pressed || !event.isPrimary || !(event.target instanceof HTMLCanvasElement)) return;
    const movedPx = Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y);
    if (movedPx <= 5 && event.timeStamp - pressed.at <= 500) sendClick(event);
  }, true);
})();
"""

_STYLE = """
html, body { margin: 0; height: 100%; overflow: hidden; }
canvas { outline: none; }
html[data-gcs-cursor="point"] canvas { cursor: grab; }
html[data-gcs-cursor="height"] canvas { cursor: ns-resize; }
.mantine-Paper-root, .mantine-Notifications-root, .mantine-Modal-root, .mantine-Spotlight-root {
  display: none !important;
}
.gcs-tags { position: fixed; inset: 0; z-index: 5; overflow: hidden; pointer-events: none; }
.gcs-tags span {
  position: absolute; left: 0; top: 0; display: flex; gap: 6px; white-space: nowrap; visibility: hidden;
  font: 600 11px/18px Inter, system-ui, "Segoe UI", sans-serif; font-variant-numeric: tabular-nums;
  padding: 0 8px; border-radius: 10px; border: 1px solid var(--c); will-change: transform;
}
.gcs-tags b { font-weight: 600; }
.gcs-tags small { font-size: 11px; font-weight: 400; }
.gcs-tags span[data-side="sign"] { border: 0; font-weight: 500; z-index: -1; }
.gcs-tags em {
  position: absolute; right: 10px; bottom: 8px; font: 500 11px/16px Inter, system-ui, "Segoe UI", sans-serif;
  font-variant-numeric: tabular-nums; max-width: calc(100% - 20px); text-align: right;
}
.gcs-tags[data-mode="gimbal"]::before {
  content: ""; position: absolute; left: var(--gcs-x, 50%); top: var(--gcs-y, 50%);
  width: 44px; height: 44px; translate: -50% -50%;
  --bar: linear-gradient(var(--mark), var(--mark));
  background: var(--bar) 0 50% / 14px 1.5px, var(--bar) 100% 50% / 14px 1.5px, var(--bar) 50% 0 / 1.5px 14px,
    var(--bar) 50% 100% / 1.5px 14px, radial-gradient(var(--mark) 1.5px, #0000 2px);
  background-repeat: no-repeat; opacity: 0.85;
}
.gcs-tags small:empty { display: none; }
"""


_HOST = re.compile(r"[A-Za-z0-9.-]+(:[0-9]+)?|\[[0-9A-Fa-f:.]+\](:[0-9]+)?")


@dataclass(frozen=True, slots=True)
class Page:
    """The document and its compressed form, ready to be sent."""

    plain: bytes
    gzipped: bytes
    etag: str


@functools.cache
def page() -> Page:
    """The page; it is built at the first request."""
    package = importlib.util.find_spec("viser")  # found without importing it, which takes a second
    if package is None or package.origin is None:
        raise ValueError("viser is not installed")
    build = Path(package.origin).parent / "client" / "build" / "index.html"
    html = build.read_text(encoding="utf-8")
    style = _STYLE + "".join(_theme_style(p) for p in PALETTES.values())
    inserted = f"<style>{style}</style><script>{_SCRIPT}</script>"
    # Before viser's first script, after the declaration of the character set.
    head, title, rest = html.partition("<title>Viser</title>")
    if not title:
        raise ValueError("viser's page has no title where it is expected: is this viser 1.1?")
    plain = f"{head}<title>3D</title>{inserted}{rest}".encode()
    return Page(plain, gzip.compress(plain, 9), f'"{hashlib.sha256(plain).hexdigest()[:24]}"')


def content_policy(host: str, *, secure: bool) -> str:
    """Content security policy: allows only the document's own content and the stream from this server."""
    # Not every browser applies 'self' to WebSockets.
    websocket_source = f"{'wss' if secure else 'ws'}://{host}" if _HOST.fullmatch(host) else ""
    return (
        "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob: data:; "
        "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; worker-src blob: data:; "
        f"connect-src 'self' {websocket_source} data: blob:; "
        "frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
    )


def _theme_style(p: Palette) -> str:
    root = f'html[data-gcs-theme="{p.theme}"]'
    return (
        f"{root}, {root} body {{ background: {p.ground}; color-scheme: {p.theme}; }}"
        f"{root} canvas[data-engine] {{ background: linear-gradient({p.sky}, {p.ground} 47%); }}"
        f"{root} .gcs-tags span {{ background: {p.panel}; color: {p.text}; }}"
        f"{root} .gcs-tags small, {root} .gcs-tags em {{ color: {p.text_2}; }}"
        f"{root} .gcs-tags {{ --mark: {p.vehicle_colours[0]}; }}"
        f'{root} .gcs-tags span[data-side="sign"] {{ background: none; color: {p.text_2}; }}'
    )
