/** The figures of a pattern as texts. Pure functions. */

import { durationText, fixed, metres } from '../../../ui/format';
import type { GeneratedPattern } from '../api';

export interface Figure {
  readonly label: string;
  readonly value: string;
}

/** An area in m²; from 10,000 m² in hectares, from 1,000,000 m² in km². */
export function areaText(area_m2: number): string {
  if (area_m2 >= 1e6) return `${fixed(area_m2 / 1e6, 2)} km²`;
  return area_m2 >= 1e4 ? `${fixed(area_m2 / 1e4, 2)} ha` : `${fixed(area_m2, 0)} m²`;
}

/**
 * The figures of a pattern, without those that do not apply, such as the resolution of a pattern without photos.
 * @param spacingLabel name of the distance between lines or rounds.
 */
export function figuresOf(figures: GeneratedPattern['figures'], spacingLabel: string): Figure[] {
  const length = metres(figures.length_m);
  const allFigures: (Figure | null)[] = [
    { label: 'Length', value: `${length.text} ${length.unit}` },
    { label: 'Time', value: durationText(figures.time_s) },
    figures.photos > 0 ? { label: 'Photos', value: fixed(figures.photos, 0) } : null,
    figures.resolution_m_px === null ? null : { label: 'Resolution', value: `${fixed(figures.resolution_m_px * 100, 2)} cm/px` },
    figures.area_m2 === null ? null : { label: 'Area', value: areaText(figures.area_m2) },
    figures.trigger_m > 0 ? { label: 'Photo every', value: `${fixed(figures.trigger_m, 1)} m` } : null,
    figures.spacing_m > 0 ? { label: spacingLabel, value: `${fixed(figures.spacing_m, 1)} m` } : null,
    figures.heading_deg === null ? null : { label: 'Line heading', value: `${fixed(figures.heading_deg, 0)}°` },
  ];
  return allFigures.filter((figure) => figure !== null);
}
