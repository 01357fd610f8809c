/** Where this device is: asks the browser for its position about once a second, while somebody needs it. */

export interface DevicePosition {
  readonly lat_deg: number;
  readonly lon_deg: number;
  /** Radius within which the device is [m]. */
  readonly accuracy_m: number;
  /** Null: the device reports no velocity. */
  readonly velocity_ne_m_s: readonly [number, number] | null;
  /** Time at which the device was there [ms, of this computer's clock]. */
  readonly at_ms: number;
}

const PERIOD_MS = 1000;
/** A browser that has no newer position by then is asked again. */
const TIMEOUT_MS = 5000;
/** A faster device is none that a vehicle follows; the server refuses it [m/s]. */
const MAX_SPEED_M_S = 20;
const PERMISSION_DENIED = 1;

/** The browser's positions; null: the page may not have them, because it is not opened by https or on localhost. */
export const browserGeolocation = (): Geolocation | null => (window.isSecureContext && 'geolocation' in navigator ? navigator.geolocation : null);

export function positionOf({ coords, timestamp }: GeolocationPosition): DevicePosition {
  const { latitude, longitude, accuracy, speed, heading } = coords;
  const moves = speed !== null && heading !== null && Number.isFinite(speed) && Number.isFinite(heading) && speed <= MAX_SPEED_M_S;
  const course_rad = moves ? (heading * Math.PI) / 180 : 0;
  return {
    lat_deg: latitude,
    lon_deg: longitude,
    accuracy_m: accuracy,
    velocity_ne_m_s: moves ? [speed * Math.cos(course_rad), speed * Math.sin(course_rad)] : null,
    at_ms: timestamp,
  };
}

export class Locator {
  position = $state.raw<DevicePosition | null>(null);
  /** Why there is no newer position; null: there is one. */
  problem = $state<string | null>(null);
  /** Called with each new position. */
  onPosition: (position: DevicePosition) => void = () => undefined;
  private users = 0;
  private timer: ReturnType<typeof setTimeout> | null = null;
  private isAsking = false;

  constructor(private readonly geolocation: Geolocation | null) {}

  get isPossible(): boolean {
    return this.geolocation !== null;
  }

  /** Locates until the returned function is called. */
  use(): () => void {
    this.users += 1;
    if (this.users === 1) this.ask();
    let used = true;
    return () => {
      if (!used) return;
      used = false;
      this.users -= 1;
      if (this.users > 0) return;
      if (this.timer !== null) clearTimeout(this.timer);
      this.timer = null;
      this.position = null;
      this.problem = null;
    };
  }

  private ask(): void {
    if (this.geolocation === null || this.isAsking) return;
    this.isAsking = true;
    const next = (): void => {
      this.isAsking = false;
      if (this.users > 0) this.timer = setTimeout(() => this.ask(), PERIOD_MS);
    };
    this.geolocation.getCurrentPosition(
      (found) => {
        next();
        if (this.users === 0) return;
        const position = positionOf(found);
        this.problem = null;
        this.position = position;
        this.onPosition(position);
      },
      (error) => {
        next();
        if (this.users === 0) return;
        this.problem =
          error.code === PERMISSION_DENIED
            ? 'The browser does not give this page the position of this device: allow it for this address.'
            : 'This device does not know its position now.';
      },
      { enableHighAccuracy: true, maximumAge: 0, timeout: TIMEOUT_MS },
    );
  }
}
