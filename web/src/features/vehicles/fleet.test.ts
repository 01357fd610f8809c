import { describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import { TelemetryStore } from '../../live/store';
import { vehicleFacts, type VehicleFacts } from '../../vehicle/facts';
import { holdText, matchingRows, canRemove, rowOf, stateLabel, rowAfterKey } from './fleet';
import { VehicleList } from './list.svelte';

const vehicleList = new VehicleList();

function facts(id: string, more: Partial<VehicleFacts> = {}, landedState = 'on_ground'): VehicleFacts {
  const store = new TelemetryStore(() => 100);
  const value = { armed: false, mode: 'hold', mode_label: 'Hold', landed_state: landedState, link_lost: false };
  store.apply({ type: 'samples', samples: [{ vehicle: id, topic: 'status', value, received_unix_s: 100, vehicle_time_boot_s: null }] });
  return { ...vehicleFacts(store.vehicle(id), 100, true), ...more };
}

describe('list of vehicles', () => {
  it('shows a lost connection only if the server reports it, not if the server is unreachable', () => {
    expect(stateLabel(facts('1', { lost: true }))).toEqual({ text: 'connection lost', tone: 'danger' });
    expect(stateLabel(facts('1', { lost: true, offline: true }))).toEqual({ text: 'no connection to the server', tone: 'danger' });
    expect(stateLabel(facts('1')).text).toBe('disarmed');
  });

  it('finds vehicles by number, type and state, and filters vehicles that are flying or need attention', () => {
    const rows = [facts('1'), facts('12', { inAir: true }), facts('21', { lost: true })].map(rowOf);
    const ids = (text: string, filter: 'all' | 'flying' | 'attention' = 'all'): string[] => matchingRows(rows, text, filter).map((row) => row.facts.id);
    expect(ids('')).toEqual(['1', '12', '21']);
    expect(ids('12')).toEqual(['12']);
    expect(ids('connection lost')).toEqual(['21']);
    expect(ids('2 disarmed')).toEqual(['12']);
    expect(ids('', 'flying')).toEqual(['12']);
    expect(ids('', 'attention')).toEqual(['21']);
    expect(ids('9')).toEqual([]);
    expect(ids('dis')).toEqual(['1', '12']);
    expect(ids('armed')).toEqual([]); // the text must be the beginning of a word
  });

  it('counts a vehicle that takes off or lands as flying, so that "Hold all flying" includes it', () => {
    const states = ['unknown', 'on_ground', 'taking_off', 'in_air', 'landing'];
    expect(states.filter((state) => rowOf(facts('1', {}, state), 0).flying)).toEqual(['taking_off', 'in_air', 'landing']);
  });

  it('moves the selection with the arrow keys, up to the ends of the list', () => {
    expect([
      rowAfterKey(-1, 3, 'ArrowDown'),
      rowAfterKey(2, 3, 'ArrowDown'),
      rowAfterKey(0, 3, 'ArrowUp'),
      rowAfterKey(1, 3, 'End'),
      rowAfterKey(1, 3, 'Home'),
    ]).toEqual([0, 2, 0, 2, 0]);
    expect(rowAfterKey(0, 3, 'h')).toBeNull();
    expect(rowAfterKey(0, 0, 'ArrowDown')).toBeNull();
  });

  it('switches all vehicles to Hold in one request, and names the vehicles that did not confirm Hold', async () => {
    const requests: { url: string; vehicles: string[] }[] = [];
    const fetch = vi.fn((url: string, init?: RequestInit) => {
      const { vehicles } = JSON.parse(String(init?.body)) as { vehicles: string[] };
      requests.push({ url, vehicles });
      const results = vehicles.map((vehicle) => ({ vehicle, held: vehicle !== '7', problem: vehicle === '7' ? { code: 'no_reply' } : null }));
      return Promise.resolve(new Response(JSON.stringify({ results }), { status: 200 }));
    });
    const vehicles = Array.from({ length: 20 }, (_, i) => ({ id: String(i + 1), name: `Quad ${i + 1}` }));
    await vehicleList.hold(new ApiClient('test', () => undefined, fetch as never), vehicles);
    expect(requests).toEqual([{ url: '/api/v1/hold', vehicles: vehicles.map((vehicle) => vehicle.id) }]);
    expect(vehicleList.result).toEqual({ text: '19 of 20 vehicles switched to Hold. Not confirmed: Quad 7.', refused: true });
    expect(vehicleList.isHoldWaiting([{ id: '1' }])).toBe(false);
    expect(holdText(3, [])).toBe('All 3 vehicles switched to Hold.');
  });

  it('shows why the Hold request failed', async () => {
    const refusal = { title: 'Signed out', code: 'token', detail: 'The token is not valid.', remedy: 'Sign in again.' };
    const fetch = vi.fn(() => Promise.resolve(new Response(JSON.stringify(refusal), { status: 401 })));
    await vehicleList.hold(new ApiClient('test', () => undefined, fetch as never), [{ id: '1', name: 'Quad 1' }]);
    expect(vehicleList.result).toEqual({ text: 'The token is not valid. Sign in again.', refused: true });
    expect(vehicleList.isHoldWaiting([{ id: '1' }])).toBe(false);
  });

  it('removes a lost vehicle, and shows why a removal failed', async () => {
    const requests: [string, string | undefined][] = [];
    const fetch = vi.fn((url: string, init?: RequestInit) => {
      requests.push([url, init?.method]);
      const refusal = { title: 'Not sent', code: 'refused', detail: 'Vehicle 7 is connected on udp.', remedy: 'Switch it off.' };
      return Promise.resolve(url.endsWith('/7') ? new Response(JSON.stringify(refusal), { status: 409 }) : new Response(null, { status: 204 }));
    });
    const api = new ApiClient('test', () => undefined, fetch as never);
    await vehicleList.remove(api, { id: '3~2', name: 'Quad 3~2' });
    expect(vehicleList.result).toEqual({ text: 'Quad 3~2 was removed.', refused: false });
    await vehicleList.remove(api, { id: '7', name: 'Quad 7' });
    expect(vehicleList.result).toEqual({ text: 'Vehicle 7 is connected on udp. Switch it off.', refused: true });
    expect(requests.map(([url, method]) => [url.split('/').at(-1), method])).toEqual([
      ['3~2', 'DELETE'],
      ['7', 'DELETE'],
    ]);
  });

  it('offers removal only for a lost vehicle that is not a replay', () => {
    expect(canRemove(facts('1', { lost: true }))).toBe(true);
    expect(canRemove(facts('1'))).toBe(false);
    expect(canRemove(facts('1', { lost: true, offline: true }))).toBe(false);
    expect(canRemove(facts('1', { lost: true, replayed: true }))).toBe(false);
  });
});
