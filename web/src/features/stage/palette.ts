/** The colours of the current theme for the canvas and the map's style. */

import { theme } from '../../app/theme.svelte';
import type { Palette } from './map-draw';

export function currentPalette(): Palette {
  const dark = theme.shown === 'dark';
  const colour = theme.variables();
  return {
    map: colour('--map'),
    line: colour('--map-line'),
    line2: colour('--map-line-2'),
    text: colour('--text'),
    text2: colour('--text-2'),
    text3: colour('--text-3'),
    panel: colour('--panel'),
    target: colour('--target'),
    accent: colour('--accent'),
    dark,
    stroke: dark ? 2.4 : 3,
    colour,
  };
}
