import { describe, expect, it } from 'vitest';
import { vehicleFacts } from '../vehicle/facts';
import { ageText, updatedPeriod, staleAfterS } from './age';
import { updatedClock, NO_FLIGHT } from './flight-time';
import { TelemetryStore } from './store';
import type { Status } from './topics';
import { Trail } from './trail';
import { severityNumber } from './vehicle-state';
import { parseFrame, type Replay, type WireSample } from './wire';

const status = (more: Partial<Status> = {}): Status => ({
  armed: false,
  mode: 'hold',
  mode_label: 'Hold',
  custom_mode: 1,
  intended_custom_mode: null,
  landed_state: 'on_ground',
  system_status: 3,
  link_lost: false,
  last_heartbeat_age_s: 0,
  ...more,
});
const sample = (topic: string, value: unknown, received_unix_s: number, vehicle = '1'): WireSample => ({
  vehicle,
  topic,
  value,
  received_unix_s,
  vehicle_time_boot_s: null,
});

const replay = (vehicles: string[], position_unix_s: number): Replay =>
  ({
    name: 'replay-1',
    recording: 'a.tlog',
    vehicles,
    position_unix_s,
    begin_unix_s: position_unix_s - 10,
    end_unix_s: position_unix_s + 60,
    playing: true,
    speed: 1,
    detail: '',
  }) as unknown as Replay;

describe('age', () => {
  it('is stale after three measured periods, but not before 1 s', () => {
    expect(staleAfterS('battery', 2)).toBe(6);
    expect(staleAfterS('battery', null)).toBe(6);
    expect(staleAfterS('attitude', 0.02)).toBe(1);
  });
  it('updates the measured period, and ignores a long gap', () => {
    const period_s = [1, 1, 1, 60].reduce<number | null>(updatedPeriod, null);
    expect(period_s).toBe(1);
    expect(updatedPeriod(1, 2)).toBeCloseTo(1.2);
  });
  it('formats an age', () => {
    expect(ageText(4.02)).toBe('4.0 s');
    expect(ageText(75)).toBe('75 s');
    expect(ageText(600)).toBe('10 min');
    expect(ageText(NaN)).toBe('–');
  });
});

describe('flight time', () => {
  it('runs from take-off to landing, and keeps the duration of the last flight', () => {
    let clock = updatedClock(NO_FLIGHT, status(), 10);
    clock = updatedClock(clock, status({ armed: true, landed_state: 'taking_off' }), 20);
    clock = updatedClock(clock, status({ armed: true, landed_state: 'in_air' }), 50);
    expect(clock).toMatchObject({ airborneSince_unix_s: 20, exact: true });
    clock = updatedClock(clock, status({ armed: true, landed_state: 'on_ground' }), 82);
    expect(clock).toMatchObject({ airborneSince_unix_s: null, lastFlight_s: 62 });
  });
  it('is a lower bound if the page connected during the flight', () => {
    expect(updatedClock(NO_FLIGHT, status({ armed: true, landed_state: 'in_air' }), 5).exact).toBe(false);
  });
});

describe('store', () => {
  it('computes ages with the server’s clock', () => {
    const store = new TelemetryStore(() => 1000);
    store.apply({ type: 'hello', schema_version: 1, server_time_unix_s: 5000 });
    store.apply({ type: 'samples', samples: [sample('status', status(), 4998)] });
    expect(store.vehicle('1').read('status', store.nowUnixS())?.age_s).toBeCloseTo(2);
  });
  it('corrects its estimate of the server’s clock if a sample has a later time', () => {
    const store = new TelemetryStore(() => 1000);
    store.apply({ type: 'samples', samples: [sample('identity', { replayed: false }, 1000), sample('status', status(), 1003)] });
    expect(store.nowUnixS()).toBe(1003);
  });
  it('forgets one wrong time of a sample, and follows a server’s clock that was set back', () => {
    let local_s = 1000;
    const store = new TelemetryStore(() => local_s);
    store.apply({ type: 'hello', schema_version: 1, server_time_unix_s: 5000 });
    const live = (offset_s: number) =>
      store.apply({ type: 'samples', samples: [sample('identity', { replayed: false }, local_s + offset_s), sample('status', status(), local_s + offset_s)] });
    const fly = (seconds: number, offset_s: number) => {
      for (let i = 0; i < seconds * 2; i++) {
        local_s += 0.5;
        live(offset_s);
      }
    };
    fly(5, 4000);
    live(4100); // one wrong time
    expect(store.nowUnixS() - local_s).toBe(4100);
    store.vehicles.clear();
    fly(130, 4000);
    expect(store.nowUnixS() - local_s).toBe(4000);
    store.vehicles.clear();
    fly(130, 3990);
    expect(store.nowUnixS() - local_s).toBe(3990);
  });
  it('does not take the time of stored samples for the present, however often they are sent again', () => {
    let local_s = 1000;
    const store = new TelemetryStore(() => local_s);
    store.apply({ type: 'hello', schema_version: 1, server_time_unix_s: 5000 });
    store.apply({ type: 'samples', samples: [sample('identity', { replayed: false }, 4900), sample('status', status(), 4900)] });
    for (let i = 1; i < 30; i++) {
      local_s += 10;
      store.apply({ type: 'samples', samples: [sample('attitude', {}, 4900 + i / 100), sample('gps', {}, 4900 + i / 100)] });
    }
    expect(store.nowUnixS() - local_s).toBe(4000);
    expect(store.vehicle('1').read('status', store.nowUnixS())?.stale).toBe(true);
  });
  it('never estimates the server’s clock from a replay, not even before the replay is identified', () => {
    const store = new TelemetryStore(() => 1000);
    store.apply({ type: 'hello', schema_version: 1, server_time_unix_s: 1000 });
    store.apply({ type: 'samples', samples: [sample('identity', { replayed: false }, 999), sample('status', status(), 999.5)] });
    const future_s = 4_000_000_000;
    store.apply({ type: 'samples', samples: [sample('status', status(), future_s, '7')] });
    store.apply({ type: 'samples', samples: [sample('identity', { replayed: true }, 1000, '7'), sample('attitude', {}, future_s + 1, '7')] });
    store.apply({ type: 'replays', replays: [replay(['7', '8'], future_s)] });
    // The page may still have the identity of an earlier vehicle with this id.
    store.apply({ type: 'samples', samples: [sample('identity', { replayed: false }, 1000, '8'), sample('status', status(), future_s + 2, '8')] });
    expect(store.nowUnixS()).toBe(1000);
    expect(store.nowUnixS('7')).toBe(future_s);
    expect(store.vehicle('1').read('status', store.nowUnixS('1'))).toMatchObject({ stale: false, age_s: 0.5 });
  });
  it('keeps the newest sample of a topic in any order of arrival', () => {
    const store = new TelemetryStore(() => 100);
    store.apply({ type: 'samples', samples: [sample('status', status({ mode: 'land' }), 90), sample('status', status(), 80)] });
    expect(store.vehicle('1').read('status', 100)?.value.mode).toBe('land');
  });
  it('marks a vehicle as lost or connected only when the server reports it', () => {
    const store = new TelemetryStore(() => 100);
    const vehicle = store.vehicle('1');
    expect(vehicleFacts(vehicle, 100, true).lost).toBe(true); // no sample yet
    store.apply({ type: 'samples', samples: [sample('status', status(), 99.5)] });
    expect(vehicleFacts(vehicle, 100, true).lost).toBe(false);
    expect(vehicleFacts(vehicle, 160, true).lost).toBe(false);
    store.apply({ type: 'samples', samples: [sample('status', status({ link_lost: true }), 161)] });
    expect(vehicleFacts(vehicle, 161, true)).toMatchObject({ lost: true, offline: false });
    store.apply({ type: 'samples', samples: [sample('status', status(), 170)] });
    expect(vehicleFacts(vehicle, 170, true).lost).toBe(false);
    expect(vehicleFacts(vehicle, 170, false)).toMatchObject({ lost: true, offline: true });
  });
  it('marks the value of a topic as stale if no new samples arrive', () => {
    const store = new TelemetryStore(() => 100);
    const hud = { groundspeed_m_s: 1, airspeed_m_s: 0, climb_m_s: 0, throttle_percent: 1 };
    for (const received_unix_s of [97, 97.5, 98]) store.apply({ type: 'samples', samples: [sample('hud', hud, received_unix_s)] });
    expect(store.vehicle('1').read('hud', 99)?.stale).toBe(false);
    expect(store.vehicle('1').read('hud', 100)).toMatchObject({ stale: true, age_s: 2 });
    expect(store.vehicle('1').read('gps', 100)).toBeNull();
  });
  it('removes vehicles and sorts ids as numbers', () => {
    const store = new TelemetryStore(() => 100);
    for (const id of ['10', '2', '1~2']) store.vehicle(id);
    expect(store.ids()).toEqual(['1~2', '2', '10']);
    store.apply({ type: 'event', event: { kind: 'vehicle_removed', vehicle: '2', unix_s: 1, severity: 6, text: 'gone' } });
    expect(store.keepOnly(['10', '3'])).toBe(true);
    expect(store.ids()).toEqual(['3', '10']);
    expect(store.keepOnly(['10', '3'])).toBe(false);
  });
  it('lists each message once, newest first', () => {
    const store = new TelemetryStore(() => 100);
    const statusText = (unix_s: number, text: string) => ({ type: 'event' as const, event: { kind: 'status_text', vehicle: '1', unix_s, severity: 4, text } });
    store.apply(statusText(10, 'a'));
    store.apply(statusText(30, 'c'));
    store.apply(statusText(20, 'b'));
    store.apply(statusText(30, 'c'));
    expect(store.vehicle('1').messages.map((m) => m.text)).toEqual(['c', 'b', 'a']);
    expect([severityNumber('warning'), severityNumber(null), severityNumber(9)]).toEqual([4, 6, 7]);
  });
});

describe('wire', () => {
  it('reads valid frames, and drops invalid samples in them', () => {
    expect(parseFrame('{"type":"hello","schema_version":1,"server_time_unix_s":5}')).toMatchObject({ type: 'hello' });
    expect(parseFrame(JSON.stringify({ type: 'samples', samples: [sample('gps', {}, 1), { bad: 1 }] }))).toMatchObject({ samples: [{ topic: 'gps' }] });
    expect(parseFrame('{"type":"error","detail":"rate_hz: from 0.1 to 100."}')).toEqual({ type: 'error', text: 'rate_hz: from 0.1 to 100.' });
  });
  it('ignores unknown and unreadable frames', () => {
    for (const text of ['', '[]', 'null', '{"type":"later"}', '{"type":"event","event":{}}', '{"type":"hello"}']) expect(parseFrame(text)).toBeNull();
  });
});

describe('trail', () => {
  it('skips points that are closer than the spacing, and limits the number of points', () => {
    const trail = new Trail(0.3, 100);
    expect(trail.add({ lat_deg: 47, lon_deg: 8 })).toBe(true);
    expect(trail.add({ lat_deg: 47.000001, lon_deg: 8 })).toBe(false);
    for (let i = 1; i < 1000; i++) trail.add({ lat_deg: 47 + i * 1e-5, lon_deg: 8 });
    expect(trail.points.length).toBeLessThanOrEqual(100);
    expect(trail.points.at(-1)?.lat_deg).toBeCloseTo(47.00999);
  });
});
