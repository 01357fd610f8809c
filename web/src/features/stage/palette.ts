/** The colours of the current theme for the canvas and the map's style. */

import { theme } from '../../app/theme.svelte';
import type { Palette } from './map-draw';

export function paletteNow(): Palette {
  const dark = theme.shown === 'dark';
  const style = getComputedStyle(document.documentElement);
  const of = (name: string): string => style.getPropertyValue(name).trim();
  return {
    map: of('--map'),
    line: of('--map-line'),
    line2: of('--map-line-2'),
    text: of('--text'),
    text2: of('--text-2'),
    text3: of('--text-3'),
    panel: of('--panel'),
    target: of('--target'),
    accent: of('--accent'),
    dark,
    stroke: dark ? 2.4 : 3,
    of,
  };
}
