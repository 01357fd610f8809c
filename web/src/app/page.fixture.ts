/** The page with a fake server and a fake clock: tests give commands, answer requests in any order, and change the vehicles. */

import { vi } from 'vitest';

/** A request that the page has sent. */
export interface SentRequest {
  readonly method: string;
  /** Path below `/api/v1`, with its query. */
  readonly path: string;
  readonly body: Readonly<Record<string, unknown>>;
  /** Order of this request among all requests and interruptions. */
  readonly order: number;
  /** Order of its answer; null: it has no answer. */
  answeredAt: number | null;
  readonly answer: (response: Response) => void;
}

/** The browser's globals that the page's modules read when they are loaded. */
export function stubBrowser(): void {
  vi.stubGlobal('location', { protocol: 'http:', host: 'page.test', origin: 'http://page.test', reload: () => undefined });
  vi.stubGlobal('document', { visibilityState: 'visible', hasFocus: () => true, addEventListener: () => undefined, documentElement: { dataset: {} } });
  vi.stubGlobal('window', globalThis);
  vi.stubGlobal('innerWidth', 1280);
  vi.stubGlobal('innerHeight', 800);
}

export class FakeServer {
  requests: SentRequest[] = [];
  private order = 0;

  /** The next number in the order of requests and interruptions. */
  next(): number {
    return ++this.order;
  }

  readonly fetch = (path: string, init: RequestInit): Promise<Response> =>
    new Promise((resolve) => {
      const body = typeof init.body === 'string' ? (JSON.parse(init.body) as Record<string, unknown>) : {};
      const request: SentRequest = {
        method: init.method ?? 'GET',
        path: path.replace('/api/v1', ''),
        body,
        order: this.next(),
        answeredAt: null,
        answer: (response) => {
          request.answeredAt = this.next();
          resolve(response);
        },
      };
      this.requests.push(request);
    });

  get open(): SentRequest[] {
    return this.requests.filter(({ answeredAt }) => answeredAt === null);
  }
}

/** A generator of numbers from 0 to 1 (mulberry32). */
export function seeded(seed: number): () => number {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = state;
    t = Math.imul(t ^ (t >>> 15), t | 1);
    t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
    return ((t ^ (t >>> 14)) >>> 0) / 0x100000000;
  };
}

const position = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 500 };

/** The samples of a vehicle with everything that the page's commands need. */
export function samplesOf(id: string, uid: string, inAir: boolean, received_unix_s: number) {
  const gimbal = { component_id: 154, gimbal_device_id: 1, primary_control: [255, 190], yaw_lock: false, pitch_rad: 0, yaw_frd_rad: 0 };
  const values: Record<string, unknown> = {
    identity: { system_id: Number(id), autopilot: 12, vehicle_type: 2, uid, simulated: true, replayed: false, firmware: null, warnings: [] },
    status: { armed: inAir, mode: 'hold', mode_label: 'Hold', landed_state: inAir ? 'in_air' : 'on_ground', link_lost: false },
    attitude: { roll_rad: 0, pitch_rad: 0, yaw_ned_rad: 0 },
    local_position: { position_ned_m: [0, 0, -10], velocity_ned_m_s: [0, 0, 0] },
    global_position: { ...position, alt_amsl_m: 510, alt_home_m: 10 },
    home: position,
    gimbal: { ...gimbal, gimbals: [gimbal] },
    components: [{ component_id: 100, kind: 'camera', lost: false }],
    mission: { current: 1, count: 4 },
    offboard: { streaming: true, state: 'streaming', setpoint: { type: 'position', position_ned_m: [0, 0, -10], yaw_ned_rad: 0 } },
  };
  return Object.entries(values).map(([topic, value]) => ({ vehicle: id, topic, vehicle_time_boot_s: null, received_unix_s, value }));
}
