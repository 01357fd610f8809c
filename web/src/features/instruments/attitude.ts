/** Geometry of the artificial horizon and the heading tape. */

import { toDeg } from '../../ui/format';
import type { VehicleFacts } from '../../vehicle/facts';

/** Pixels of the instrument per degree of pitch. */
export const PX_PER_DEG = 1.7;

/** SVG transform of the horizon behind the fixed aircraft symbol: rotated by -roll, moved down by pitch. */
export function horizonTransform(roll_rad: number, pitch_rad: number, cx: number, cy: number): string {
  const roll = toDeg(roll_rad) ?? 0;
  const pitch = Math.min(90, Math.max(-90, toDeg(pitch_rad) ?? 0));
  return `rotate(${(-roll).toFixed(2)} ${cx} ${cy}) translate(0 ${(pitch * PX_PER_DEG).toFixed(2)})`;
}

/** Heading [deg] from the attitude message; if there is none, from the position message. */
export function headingDeg(facts: Pick<VehicleFacts, 'attitude' | 'globalPosition'>): number | null {
  return toDeg(facts.attitude?.value.yaw_ned_rad ?? null) ?? facts.globalPosition?.value.heading_deg ?? null;
}

export interface Tick {
  x: number;
  label: string;
  major: boolean;
}

const COMPASS_POINTS: Readonly<Record<number, string>> = { 0: 'N', 45: 'NE', 90: 'E', 135: 'SE', 180: 'S', 225: 'SW', 270: 'W', 315: 'NW' };

/** Visible marks of the heading tape: every 15°, labelled every 45°. */
export function tapeTicks(heading_deg: number, width: number, px_per_deg: number): Tick[] {
  const halfWidth_deg = width / 2 / px_per_deg;
  const ticks: Tick[] = [];
  for (let mark_deg = Math.ceil((heading_deg - halfWidth_deg) / 15) * 15; mark_deg <= heading_deg + halfWidth_deg; mark_deg += 15) {
    const compass_deg = ((mark_deg % 360) + 360) % 360;
    ticks.push({ x: width / 2 + (mark_deg - heading_deg) * px_per_deg, label: COMPASS_POINTS[compass_deg] ?? '', major: compass_deg % 45 === 0 });
  }
  return ticks;
}
