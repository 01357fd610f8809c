/** Spectra and spectrograms: their columns for uPlot, their picture, and what was computed as a sentence. Pure functions. */

import type { components } from '../api/schema';
import type { Window } from './plot-view.svelte';

export type Spectrum = components['schemas']['FlightSpectrum'];

/** Colours of a spectrogram from the weakest to the strongest, readable in both themes and without telling red from green. */
const STOPS: readonly (readonly [number, number, number])[] = [
  [30, 20, 70],
  [60, 80, 140],
  [33, 145, 140],
  [120, 200, 80],
  [253, 231, 37],
];
/** The darkest colour is this far below the strongest [dB]. */
const RANGE_DB = 60;
/** Irregular steps of fewer than this part are not worth a word. */
const WORTH_SAYING = 0.05;

/** The frequency with the most power, above the first two, which are drift; null: there is none. */
export function strongest_hz({ frequencies_hz, density }: Spectrum): number | null {
  let best = 2;
  for (let i = 3; i < density.length; i += 1) if ((density[i] ?? 0) > (density[best] ?? 0)) best = i;
  return (density[best] ?? 0) > 0 ? (frequencies_hz[best] ?? null) : null;
}

/** How it was computed, and what weakens it. */
export function methodText({ rate_hz, segment_s, segments, gaps, irregular }: Spectrum): string {
  const parts = [
    `${segments} segments of ${Number(segment_s.toPrecision(3))} s (Hann, half overlap; Welch), ${Number(rate_hz.toPrecision(3))} samples a second, resolution ${Number((1 / segment_s).toPrecision(2))} Hz.`,
  ];
  if (gaps > 0) parts.push(`${gaps} gaps in the samples are left out.`);
  if (irregular > WORTH_SAYING) parts.push(`${Math.round(100 * irregular)} % of the samples are uneven in time: the highest frequencies are shown too weak.`);
  return parts.join(' ');
}

/** The pixels (RGBA) of a spectrogram over a window, frequencies upward; transparent where there are no values. */
export function pixels({ t_s, decibels, segment_s }: Spectrum, { from_s, to_s }: Window, width: number, height: number): Uint8ClampedArray<ArrayBuffer> {
  const image = new Uint8ClampedArray(4 * width * height);
  const strongest = decibels.reduce((most, column) => Math.max(most, ...column.slice(1)), -Infinity);
  const steps = t_s.slice(1).map((t, i) => t - (t_s[i] ?? t));
  const half_s = Math.max(segment_s / 4, Math.min(...steps, Infinity) / 2 === Infinity ? segment_s / 2 : Math.min(...steps) / 2) * 1.01;
  let next = 0;
  for (let x = 0; x < width; x += 1) {
    const at_s = from_s + ((x + 0.5) / width) * (to_s - from_s);
    while (next < t_s.length - 1 && Math.abs((t_s[next + 1] ?? 0) - at_s) <= Math.abs((t_s[next] ?? 0) - at_s)) next += 1;
    const column = decibels[next];
    if (column === undefined || Math.abs((t_s[next] ?? 0) - at_s) > half_s) continue;
    for (let y = 0; y < height; y += 1) {
      const bin = Math.min(column.length - 1, Math.floor(((height - 1 - y) / height) * column.length));
      const colour = colourAt(1 - (strongest - (column[bin] ?? -300)) / RANGE_DB);
      image.set([...colour, 255], 4 * (y * width + x));
    }
  }
  return image;
}

function colourAt(part: number): readonly [number, number, number] {
  const place = Math.min(1, Math.max(0, part)) * (STOPS.length - 1);
  const first = Math.min(STOPS.length - 2, Math.floor(place));
  const [from, to] = [STOPS[first] ?? [0, 0, 0], STOPS[first + 1] ?? [0, 0, 0]];
  const mix = (i: 0 | 1 | 2): number => Math.round(from[i] + (to[i] - from[i]) * (place - first));
  return [mix(0), mix(1), mix(2)];
}
