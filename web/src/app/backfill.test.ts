import { describe, expect, it } from 'vitest';
import { ApiClient } from '../api/client';
import { TelemetryStore } from '../live/store';
import { loadFleet } from './backfill';

const apiReturning = (value: unknown): ApiClient => new ApiClient('p', undefined, () => Promise.resolve(Response.json(value)));
const identity = (firmware: string) => ({ vehicle: '1', topic: 'identity', vehicle_time_boot_s: null, received_unix_s: 90, value: { firmware } });

describe('the fleet from the server', () => {
  it('never replaces samples from the socket', async () => {
    const store = new TelemetryStore(() => 100);
    store.apply({ type: 'samples', samples: [identity('1.16.0')] });
    expect(await loadFleet(apiReturning([{ id: '1', identity: { firmware: null } }]), store)).toEqual({ ids: ['1'], removedAny: false });
    expect(store.vehicle('1').identity.firmware).toBe('1.16.0');
  });

  it('provides values that the socket has not sent yet', async () => {
    const store = new TelemetryStore(() => 100);
    await loadFleet(apiReturning([{ id: '1', identity: { firmware: '1.15.0' } }]), store);
    expect(store.vehicle('1').identity.firmware).toBe('1.15.0');
    store.apply({ type: 'samples', samples: [identity('1.16.0')] });
    expect(store.vehicle('1').identity.firmware).toBe('1.16.0');
  });

  it('reports that a vehicle was removed', async () => {
    const store = new TelemetryStore(() => 100);
    store.vehicle('2');
    expect(await loadFleet(apiReturning([{ id: '1' }]), store)).toEqual({ ids: ['1'], removedAny: true });
  });
});
