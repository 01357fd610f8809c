"""The report of flown scenarios as one HTML page, with track and plots as SVG; it needs no server."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from gcs_server.scenarios.flown import VehicleFlight
from gcs_server.scenarios.results import FlightResult

Array = NDArray[np.float64]
MAX_POINTS = 300
"""Points of a drawn line; a flight of minutes has thousands."""
MAP_PX, PLOT_WIDTH_PX, PLOT_HEIGHT_PX = 260, 420, 78
COLOURS = ("var(--a)", "var(--b)", "var(--c)", "var(--d)")
"""One colour for each vehicle, in turn."""
STYLE = """
:root { color-scheme: light dark; --text: #1b1f24; --soft: #59636e; --line: #d1d9e0; --bad: #b3261e;
  --good: #1a7f37; --a: #0b62c4; --b: #a15c00; --c: #7a3fb5; --d: #007a6c; --back: #fff; }
@media (prefers-color-scheme: dark) { :root { --text: #e6edf3; --soft: #9aa5b1; --line: #3a424b;
  --bad: #ff8a80; --good: #56d364; --a: #6cb2ff; --b: #f0a64a; --c: #c79bff; --d: #4fd1c0;
  --back: #11161c; } }
body { font: 15px/1.45 system-ui, sans-serif; color: var(--text); background: var(--back);
  margin: 0 auto; padding: 1rem; max-width: 62rem; overflow-wrap: anywhere; }
h1 { font-size: 1.4rem; } h2 { font-size: 1.1rem; margin: 2rem 0 .3rem; } h3 { font-size: 1rem; }
table { border-collapse: collapse; width: 100%; } th, td { text-align: left; padding: .2rem .6rem .2rem 0;
  border-bottom: 1px solid var(--line); vertical-align: top; } .wide { overflow-x: auto; }
a { color: var(--a); } .bad { color: var(--bad); } .good { color: var(--good); } .soft { color: var(--soft); }
section { border-top: 2px solid var(--line); padding-top: .2rem; }
.drawings { display: flex; flex-wrap: wrap; gap: 1rem; } svg { max-width: 100%; height: auto; }
svg text { font: 10px system-ui, sans-serif; fill: var(--soft); }
"""


def page(results: Sequence[FlightResult], files: Callable[[FlightResult], Sequence[str]]) -> str:
    """The page.

    Args:
        results: all flights.
        files: names of the files of a flight, which are beside the page.
    """
    failed = [(number, each) for number, each in enumerate(results) if not each.passed]
    outcome = (
        f'<span class="bad">{len(failed)} of {len(results)} flights failed</span>'
        if failed
        else f'<span class="good">all {len(results)} flights passed</span>'
    )
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Flights as tests</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{STYLE}</style></head><body><h1>Flights as tests: {outcome}</h1>",
        *_summary(results),
        *(part for number, each in failed for part in _failed(number, each, files(each))),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _summary(results: Sequence[FlightResult]) -> Iterator[str]:
    yield '<div class="wide"><table><tr><th>scenario</th><th>wind</th><th>faults</th><th>PX4</th>'
    yield "<th>seed</th><th>flight</th><th>result</th></tr>"
    for number, each in enumerate(results):
        cell = each.cell
        result = (
            '<span class="good">passed</span>'
            if each.passed
            else f'<a class="bad" href="#flight-{number}">failed</a>'
        )
        is_new = number == 0 or results[number - 1].scenario != each.scenario
        name = escape(each.scenario) if is_new else ""
        values = (
            name,
            escape(cell.wind),
            escape(cell.faults),
            cell.px4,
            str(cell.seed),
            f"{each.duration_s:.0f} s",
        )
        yield f"<tr>{''.join(f'<td>{value}</td>' for value in values)}<td>{result}</td></tr>"
    yield "</table></div>"


def _failed(number: int, result: FlightResult, files: Sequence[str]) -> Iterator[str]:
    yield f'<section id="flight-{number}"><h2>{escape(result.scenario)}</h2>'
    yield f'<div class="soft">{escape(result.cell.text)}</div><ul>'
    for check in result.checks:
        for broken in check.broken:
            when = "" if broken.t_s is None else f' <span class="soft">at {broken.t_s:.1f} s</span>'
            name = f"{broken.vehicle}: " if len(result.vehicles) > 1 else ""
            why = escape(f"{name}{broken.why}")
            yield f'<li><span class="bad">{escape(check.title)}</span>: {why}{when}</li>'
        if not check.broken:
            yield f'<li class="soft">{escape(check.title)}: held</li>'
    yield '</ul><div class="drawings">'
    yield _map(result)
    yield f"<div>{''.join(_plots(result))}</div></div>"
    for flight in result.vehicles:
        modes = ", ".join(f"{mode} {t_s:.1f} s" for t_s, mode in flight.modes)
        yield f'<p class="soft">{escape(flight.name)}, modes: {escape(modes) or "never armed"}'
        if flight.warnings:
            yield f"<br>messages: {escape('; '.join(flight.warnings[:12]))}"
        yield "</p>"
    links = " · ".join(f'<a href="{escape(each)}">{escape(each)}</a>' for each in files)
    yield f"<p>{links}</p></section>" if files else "</section>"


def _thinned(values: Array) -> Array:
    count = len(values)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MAX_POINTS)).round().astype(int))
    return values[chosen]


def _points(x: Array, y: Array) -> str:
    return " ".join(f"{px:.1f},{py:.1f}" for px, py in zip(x.tolist(), y.tolist(), strict=True))


def _map(result: FlightResult) -> str:
    """The flown paths from above, north up, with obstacles and fence, and where a check broke."""
    flown = [each for each in result.vehicles if len(each.t_s)]
    if not flown:
        return ""
    marks = [
        b.position_ned_m for check in result.checks for b in check.broken if b.position_ned_m is not None
    ]
    paths = [_thinned(each.position_ned_m)[:, :2] for each in flown]
    # Distant corners of a fence or obstacle do not make the path a dot.
    corners = np.concatenate([*paths, np.zeros((1, 2)), np.array([m[:2] for m in marks]).reshape(-1, 2)])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    half_m = max(5.0, float((corners.max(axis=0) - corners.min(axis=0)).max()) / 2 * 1.15)
    scale = MAP_PX / (2 * half_m)

    def drawn(north_east: Array) -> str:
        x, y = (
            (north_east[:, 1] - middle[1] + half_m) * scale,
            (middle[0] - north_east[:, 0] + half_m) * scale,
        )
        return _points(x, y)

    def dot(north_m: float, east_m: float, attributes: str) -> str:
        x, y = drawn(np.array([[north_m, east_m]])).split(",")
        return f'<circle cx="{x}" cy="{y}" {attributes}/>'

    parts = [
        f'<svg viewBox="0 0 {MAP_PX} {MAP_PX}" width="{MAP_PX}" height="{MAP_PX}" role="img">',
        f"<title>Flown path from above, north up, {2 * half_m:.0f} m wide</title>",
        f'<rect width="{MAP_PX}" height="{MAP_PX}" fill="none" stroke="var(--line)"/>',
    ]
    for line in result.outlines:
        parts.append(f'<polyline points="{drawn(np.array(line))}" fill="none" stroke="var(--soft)"/>')
    for number, path in enumerate(paths):
        colour = COLOURS[number % len(COLOURS)]
        parts.append(f'<polyline points="{drawn(path)}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
    parts.append(dot(0.0, 0.0, 'r="3" fill="var(--text)"'))
    parts += [dot(m[0], m[1], 'r="6" fill="none" stroke="var(--bad)" stroke-width="2"') for m in marks]
    parts.append(f'<text x="4" y="{MAP_PX - 5}">{2 * half_m:.0f} m, north up, dot: home</text></svg>')
    return "".join(parts)


def _plots(result: FlightResult) -> Iterator[str]:
    flown = [each for each in result.vehicles if len(each.t_s)]
    if not flown:
        return
    marks = [b.t_s for check in result.checks for b in check.broken if b.t_s is not None]
    plots: list[tuple[str, Callable[[VehicleFlight], Array]]] = [
        ("height above home [m]", lambda each: -each.position_ned_m[:, 2]),
        ("speed [m/s]", lambda each: each.speed_m_s),
        ("age of the setpoint [s]", lambda each: each.setpoint_age_s),
        ("battery [%]", lambda each: 100.0 * each.battery_share),
    ]
    end_s = max(1.0, max(float(each.t_s[-1]) for each in flown))
    for title, values in plots:
        lines = [(_thinned(each.t_s), _thinned(values(each))) for each in flown]
        if not all(np.isnan(y).all() for _, y in lines):
            yield _plot(title, lines, end_s, marks)


def _plot(title: str, lines: Sequence[tuple[Array, Array]], end_s: float, marks: Sequence[float]) -> str:
    low = min(0.0, *(float(np.nanmin(y)) for _, y in lines if not np.isnan(y).all()))
    high = max(low + 0.1, *(float(np.nanmax(y)) for _, y in lines if not np.isnan(y).all()))
    left, width, height = 34, PLOT_WIDTH_PX - 34, PLOT_HEIGHT_PX - 26
    parts = [
        f'<svg viewBox="0 0 {PLOT_WIDTH_PX} {PLOT_HEIGHT_PX}" width="{PLOT_WIDTH_PX}" role="img">',
        f"<title>{title}</title>",
        f'<rect x="{left}" y="13" width="{width}" height="{height}" fill="none" stroke="var(--line)"/>',
        f'<text x="{left}" y="10">{title}</text>',
        f'<text x="{left - 4}" y="21" text-anchor="end">{high:.3g}</text>',
        f'<text x="{left - 4}" y="{13 + height}" text-anchor="end">{low:.3g}</text>',
        f'<text x="{PLOT_WIDTH_PX}" y="{PLOT_HEIGHT_PX - 2}" text-anchor="end">{end_s:.0f} s</text>',
    ]
    for mark_s in marks:
        x = left + width * min(max(mark_s / end_s, 0.0), 1.0)
        parts.append(f'<path d="M{x:.1f} 13v{height}" stroke="var(--bad)" stroke-dasharray="3 2"/>')
    for number, (t_s, y) in enumerate(lines):
        known = ~np.isnan(y)
        x_px = left + width * np.clip(t_s[known] / end_s, 0.0, 1.0)
        y_px = 13 + height * (1.0 - (y[known] - low) / (high - low))
        colour = COLOURS[number % len(COLOURS)]
        parts.append(f'<polyline points="{_points(x_px, y_px)}" fill="none" stroke="{colour}"/>')
    return "".join([*parts, "</svg><br>"])
