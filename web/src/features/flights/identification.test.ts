import { describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import { Identification } from './identification.svelte';
import type { LogView } from './log-view.svelte';

vi.stubGlobal('location', { protocol: 'http:', host: 'test' });
const { VehicleModels, withError } = await import('../../app/vehicle-model.svelte');

const PROBLEM = { type: 'about:blank', title: 'Invalid request', detail: 'The flight is of another vehicle.', status: 422, code: 'invalid_request' };

function server(answer: (call: string) => [number, unknown]) {
  const sent: string[] = [];
  const api = new ApiClient('test', undefined, (path, { method, body }) => {
    const call = `${method} ${path.replace('/api/v1', '')}`;
    sent.push(body === undefined || body === null ? call : `${call} ${String(body)}`);
    const [status, value] = answer(call);
    return Promise.resolve(status === 204 ? new Response(null, { status }) : Response.json(value, { status }));
  });
  return { api, sent };
}

describe('the model of an aircraft', () => {
  it('is identified in the open flight, and is not shown in another one', async () => {
    const { api, sent } = server(() => [200, { thrust_n: 30 }]);
    const identification = new Identification(api, { flight: { id: 'f1-0' } } as unknown as LogView);
    await identification.find(1.5);
    expect([sent, identification.found?.thrust_n]).toEqual([['GET /flights/f1-0/model?mass_kg=1.5'], 30]);
    const late = identification.find(null);
    identification.reset();
    await late;
    expect([identification.found, identification.isBusy]).toEqual([null, false]);
  });

  it('is kept and forgotten for one vehicle, and what was refused is said of that vehicle only', async () => {
    let isRefused = false;
    const { api, sent } = server((call) => (isRefused ? [422, PROBLEM] : call.startsWith('DELETE') ? [204, null] : [200, { model: { log: 'a.ulg' } }]));
    const models = new VehicleModels(api);
    expect(await models.keep('1', 'f1-0', null)).toBe(true);
    expect([models.of('1')?.log, models.of('2'), models.of(null)]).toEqual(['a.ulg', null, null]);
    expect(await models.forget('1')).toBe(true);
    expect(models.of('1')).toBeNull();
    isRefused = true;
    expect(await models.keep('2', 'f1-0', 2)).toBe(false);
    expect([models.problemOf('1'), models.problemOf('2')?.detail]).toEqual([null, PROBLEM.detail]);
    expect(sent).toEqual([
      'PUT /vehicles/1/model {"flight":"f1-0","mass_kg":null}',
      'DELETE /vehicles/1/model',
      'PUT /vehicles/2/model {"flight":"f1-0","mass_kg":2}',
    ]);
  });

  it('has its errors beside it', () => {
    expect([withError(20, 0.3, 'm/s²'), withError(1, null, '1/s')]).toEqual(['20.00 m/s² ± 0.30', '1.00 1/s']);
  });
});
