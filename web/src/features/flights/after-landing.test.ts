import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { AfterLanding } from './after-landing.svelte';

function scripted(answers: Record<string, [number, unknown]>) {
  const sent: string[] = [];
  const api = new ApiClient('test', undefined, (path, { method, body }) => {
    sent.push(`${method} ${path}${typeof body === 'string' ? ` ${body}` : ''}`);
    const [status, answer] = answers[`${method} ${path}`] ?? [404, { title: 'Unknown', detail: path }];
    return Promise.resolve(new Response(status === 204 ? null : JSON.stringify(answer), { status, headers: { 'Content-Type': 'application/json' } }));
  });
  return { after: new AfterLanding(api), sent };
}

describe('the logs after a landing', () => {
  it('are what the server does, and a choice that it refuses leaves it as it was', async () => {
    const answers: Record<string, [number, unknown]> = { 'GET /api/v1/logs_after_landing': [200, { choice: 'offer', landed: {} }] };
    const { after, sent } = scripted(answers);
    expect(after.choice).toBeNull();
    await after.read();
    expect(after.choice).toBe('offer');
    answers['POST /api/v1/logs_after_landing'] = [409, { title: 'Not stored', detail: 'The disk is full.', code: 'storage' }];
    await after.choose('download');
    expect([after.choice, after.problemOf(null)?.detail, after.problemOf('1')]).toEqual(['offer', 'The disk is full.', null]);
    answers['POST /api/v1/logs_after_landing'] = [200, { choice: 'never', landed: {} }];
    await after.choose('never');
    expect([after.choice, after.problemOf(null)]).toEqual(['never', null]);
    expect(sent.at(-1)).toBe('POST /api/v1/logs_after_landing {"choice":"never"}');
  });

  it('are downloaded vehicle by vehicle, and declined; a refusal is said beside its vehicle', async () => {
    const { after, sent } = scripted({
      'POST /api/v1/vehicles/1/logs/after_landing': [202, {}],
      'POST /api/v1/vehicles/2/logs/after_landing': [409, { title: 'Refused', detail: 'Vehicle 2 is armed.', code: 'refused' }],
      'DELETE /api/v1/vehicles/1/logs/after_landing': [204, null],
    });
    await after.download(['1', '2']);
    expect([after.problemOf('1'), after.problemOf('2')?.detail]).toEqual([null, 'Vehicle 2 is armed.']);
    await after.decline('1');
    expect(after.problemOf('2')).toBeNull();
    expect(sent).toEqual([
      'POST /api/v1/vehicles/1/logs/after_landing',
      'POST /api/v1/vehicles/2/logs/after_landing',
      'DELETE /api/v1/vehicles/1/logs/after_landing',
    ]);
  });
});
