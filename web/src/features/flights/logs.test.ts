import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import { VehicleLogs } from './logs.svelte';

const LOG = { number: 3, ended_unix_s: 1, size_bytes: 4000, received_bytes: 0, downloaded: null };
const operation = (more: object) => ({ id: '7', vehicle: '1', subject: '3', state: 'running', text: '', error: null, result: null, ...more });

function scripted(answers: Record<string, [number, unknown][]>) {
  const sent: string[] = [];
  const api = new ApiClient('test', undefined, (path, { method }) => {
    const call = `${method} ${path}`;
    sent.push(call);
    const [status, body] = answers[call]?.shift() ?? [404, { title: 'Unknown', detail: call }];
    return Promise.resolve(new Response(status === 204 ? null : JSON.stringify(body), { status, headers: { 'Content-Type': 'application/json' } }));
  });
  return { api, sent };
}

describe('the logs on a vehicle', () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  it('are listed, downloaded and then offered as a file', async () => {
    const { api } = scripted({
      'GET /api/v1/vehicles/1/logs': [[200, { logs: [LOG] }]],
      'POST /api/v1/vehicles/1/logs/3/download': [[202, operation({})]],
      'GET /api/v1/operations/7': [
        [200, operation({ text: '1 of 4 MB' })],
        [200, operation({ state: 'succeeded', progress: 1, result: { file: 'a.ulg', flight: 'f1' } })],
      ],
    });
    const logs = new VehicleLogs();
    await logs.read(api, '1');
    expect(logs.logsOf('1')).toEqual([LOG]);
    expect(logs.logsOf('2')).toBeNull();
    const download = logs.download(api, '1', 3);
    await vi.advanceTimersByTimeAsync(600);
    expect(logs.downloadOf('1', 3)?.text).toBe('1 of 4 MB');
    await vi.advanceTimersByTimeAsync(600);
    await download;
    expect(logs.downloadOf('1', 3)).toBeNull();
    expect(logs.logsOf('1')).toEqual([{ ...LOG, downloaded: { file: 'a.ulg', flight: 'f1' } }]);
  });

  it('say why they cannot be read or downloaded, and are left as they were', async () => {
    const problem = { title: 'Refused', detail: 'Vehicle 1 is armed.', code: 'refused' };
    const { api, sent } = scripted({
      'GET /api/v1/vehicles/1/logs': [[409, problem]],
      'POST /api/v1/vehicles/1/logs/3/download': [[202, operation({})]],
      'GET /api/v1/operations/7': [[200, operation({ state: 'failed', error: problem })]],
      'DELETE /api/v1/operations/7': [[200, operation({ state: 'cancelled' })]],
    });
    const logs = new VehicleLogs();
    await logs.read(api, '1');
    expect(logs.problemOf('1')?.detail).toBe('Vehicle 1 is armed.');
    const download = logs.download(api, '1', 3);
    await vi.advanceTimersByTimeAsync(100);
    await logs.cancel(api);
    expect(sent.at(-1)).toBe('DELETE /api/v1/operations/7');
    await vi.advanceTimersByTimeAsync(600);
    await download;
    expect(logs.problemOf('1')?.detail).toBe('Vehicle 1 is armed.');
  });

  it('continue where a cancelled download has ended, and are erased after a confirmation', async () => {
    const { api, sent } = scripted({
      'GET /api/v1/vehicles/1/logs': [[200, { logs: [LOG] }]],
      'POST /api/v1/vehicles/1/logs/3/download': [[202, operation({})]],
      'GET /api/v1/operations/7': [[200, operation({ state: 'cancelled', progress: 0.25 })]],
      'POST /api/v1/vehicles/1/logs/erase': [[204, null]],
    });
    const logs = new VehicleLogs();
    await logs.read(api, '1');
    const download = logs.download(api, '1', 3);
    await vi.advanceTimersByTimeAsync(600);
    await download;
    expect(logs.logsOf('1')).toEqual([{ ...LOG, received_bytes: 1000 }]);
    logs.toErase = '1';
    await logs.erase(api, '1');
    expect([logs.toErase, logs.logsOf('1')]).toEqual([null, []]);
    expect(sent).toContain('POST /api/v1/vehicles/1/logs/erase');
  });

  it('are streamed while the vehicle writes them, also if another page has begun it', async () => {
    const stream = (more: object) => operation({ kind: 'logs/stream', subject: null, ...more });
    const { api, sent } = scripted({
      'GET /api/v1/operations': [[200, { operations: [stream({})] }]],
      'GET /api/v1/operations/7': [
        [200, stream({ text: '1.2 MB received, 60 kB/s, 0.0% lost.' })],
        [200, stream({ state: 'succeeded', result: { flight: 'f1' } })],
      ],
      'DELETE /api/v1/vehicles/1/logs/stream': [[204, null]],
    });
    const logs = new VehicleLogs();
    const found = logs.findStream(api, '1');
    await vi.advanceTimersByTimeAsync(600);
    expect(logs.streamOf('1')?.text).toContain('60 kB/s');
    expect(logs.streamOf('2')).toBeNull();
    await logs.stopStream(api, '1');
    await vi.advanceTimersByTimeAsync(600);
    await found;
    expect(logs.streamOf('1')?.state).toBe('succeeded');
    expect(sent).toContain('DELETE /api/v1/vehicles/1/logs/stream');
  });
});
