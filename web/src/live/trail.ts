/**
 * The path that a vehicle has flown, with a limited number of points: when the limit is exceeded, every second point of the
 * older half is removed.
 */

export interface TrailPoint {
  lat_deg: number;
  lon_deg: number;
}

const METRES_PER_DEG = 111_320;
/** A new point must have a minimum distance from this number of recent points, so that a hovering vehicle adds few points. */
const RECENT_POINTS = 24;

export class Trail {
  readonly points: TrailPoint[] = [];
  private readonly spacing_m: number;
  private readonly capacity: number;

  constructor(spacing_m = 0.5, capacity = 4000) {
    this.spacing_m = spacing_m;
    this.capacity = capacity;
  }

  /** @returns false: the point is too close to a recent point and was not added. */
  add(point: TrailPoint): boolean {
    for (let i = this.points.length - 1; i >= Math.max(0, this.points.length - RECENT_POINTS); i--) {
      const other = this.points[i];
      if (other !== undefined && distance_m(other, point) < this.spacing_m) return false;
    }
    this.points.push(point);
    if (this.points.length > this.capacity) this.thin();
    return true;
  }

  /** Inserts older points, oldest first, before the present points. */
  prepend(points: readonly TrailPoint[]): void {
    const presentPoints = this.points.splice(0);
    for (const point of [...points, ...presentPoints]) this.add(point);
  }

  private thin(): void {
    const half = this.points.length >> 1;
    const keptPoints = this.points.filter((_, i) => i >= half || i % 2 === 0);
    this.points.splice(0, this.points.length, ...keptPoints);
  }
}

function distance_m(a: TrailPoint, b: TrailPoint): number {
  const north_m = (b.lat_deg - a.lat_deg) * METRES_PER_DEG;
  const east_m = (b.lon_deg - a.lon_deg) * METRES_PER_DEG * Math.cos((a.lat_deg * Math.PI) / 180);
  return Math.hypot(north_m, east_m);
}
