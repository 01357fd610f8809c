/** Places of the tags (names of vehicles, texts of targets) beside their symbols on the map. */

import type { Pixel } from '../../vehicle/geo';

/** The rectangle of a tag [px]; `x` and `y` are its upper left corner. */
export interface TagBox extends Pixel {
  width: number;
}

export const TAG_HEIGHT_PX = 20;
/** Distance of a tag from the middle of its symbol: beside it, and below or above it [px]. */
const BESIDE_PX = 24;
const BELOW_PX = 10;
/** Distance from a tag to the next tag below it [px]. */
const ROW_PX = TAG_HEIGHT_PX + 3;
const MAX_ROWS = 4;

function overlap(a: TagBox, b: TagBox): boolean {
  return a.x < b.x + b.width && b.x < a.x + a.width && Math.abs(a.y - b.y) < TAG_HEIGHT_PX;
}

/** The first place for a tag where it covers none of the `placed` tags; if there is none, the usual place. */
export function tagBox(at: Pixel, width: number, placed: readonly TagBox[]): TagBox {
  const [right, left] = [at.x + BESIDE_PX, at.x - BESIDE_PX - width];
  const [below, above] = [at.y + BELOW_PX, at.y - BELOW_PX - TAG_HEIGHT_PX];
  const usual = { x: right, y: below, width };
  const others = [
    { x: right, y: above, width },
    { x: left, y: below, width },
    { x: left, y: above, width },
    ...Array.from({ length: MAX_ROWS }, (_, row) => ({ x: right, y: below + (row + 1) * ROW_PX, width })),
  ];
  return [usual, ...others].find((box) => !placed.some((other) => overlap(box, other))) ?? usual;
}
