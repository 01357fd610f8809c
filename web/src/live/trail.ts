/**
 * The path that a vehicle has flown, with a limited number of points: when full, every second point of the older half
 * is removed.
 */

export interface TrailPoint {
  lat_deg: number;
  lon_deg: number;
}

const METRES_PER_DEG = 111_320;
/** Number of recent points from which a new point must have a minimum distance, so that a hover adds few points. */
const RECENT_POINTS = 24;

export class Trail {
  readonly points: TrailPoint[] = [];
  private readonly spacing_m: number;
  private readonly capacity: number;

  constructor(spacing_m = 0.5, capacity = 4000) {
    this.spacing_m = spacing_m;
    this.capacity = capacity;
  }

  add(point: TrailPoint): boolean {
    for (let i = this.points.length - 1; i >= Math.max(0, this.points.length - RECENT_POINTS); i--) {
      const other = this.points[i];
      if (other !== undefined && distance_m(other, point) < this.spacing_m) return false;
    }
    this.points.push(point);
    if (this.points.length > this.capacity) this.thin();
    return true;
  }

  /** Inserts older points, oldest first, before the present ones. */
  prepend(points: readonly TrailPoint[]): void {
    const now = this.points.splice(0);
    for (const point of [...points, ...now]) this.add(point);
  }

  private thin(): void {
    const half = this.points.length >> 1;
    const kept = this.points.filter((_, i) => i >= half || i % 2 === 0);
    this.points.splice(0, this.points.length, ...kept);
  }
}

function distance_m(a: TrailPoint, b: TrailPoint): number {
  const north = (b.lat_deg - a.lat_deg) * METRES_PER_DEG;
  const east = (b.lon_deg - a.lon_deg) * METRES_PER_DEG * Math.cos((a.lat_deg * Math.PI) / 180);
  return Math.hypot(north, east);
}
