/** A survey of a drawn area, as the server makes it. */

import type { Place } from '../../vehicle/geo';
import type { Pattern } from './api';

/** A common 20-megapixel camera with a one-inch sensor; overlaps as photogrammetry programs ask for. */
export const SURVEY = {
  height_m: 40,
  front_percent: 75,
  side_percent: 65,
  focal_length_mm: 8.8,
  sensor_width_mm: 13.2,
  sensor_height_mm: 8.8,
  turnaround_m: 0,
  follows_ground: false,
};
/** Of a survey above the ground: its lines stay this near to their height [m]. */
export const GROUND_TOLERANCE_M = 5;
const IMAGE_WIDTH_PX = 5472;

/** Unless it follows the ground, the ground is taken as level with home: the camera's distance to it is the altitude above home. */
export function surveyOf(outer: readonly Place[], values: typeof SURVEY): Pattern {
  const { height_m, sensor_width_mm, sensor_height_mm, focal_length_mm } = values;
  const image_height_px = Math.round((IMAGE_WIDTH_PX * sensor_height_mm) / sensor_width_mm);
  const camera = { sensor_width_mm, sensor_height_mm, focal_length_mm, image_width_px: IMAGE_WIDTH_PX, image_height_px };
  return {
    kind: 'survey',
    outer,
    altitude: { value_m: height_m, reference: values.follows_ground ? 'terrain' : 'home' },
    coverage: { camera, distance_m: height_m, front_overlap: values.front_percent / 100, side_overlap: values.side_percent / 100 },
    turnaround_m: values.turnaround_m,
  };
}
