import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient, ofVehicle, pageName, type Outcome } from './client';
import { furtherReasons, parseProblem, unreachableProblem } from './problems';
import { Requested } from './requested.svelte';
import { CommandQueue } from './command-queue';

const headersOf = (init: RequestInit | undefined): object => Object.fromEntries(new Headers(init?.headers));

describe('problems', () => {
  it('reads the vehicle’s reasons and the remedy', () => {
    const problem = parseProblem(409, {
      title: 'The vehicle refused',
      code: 'rejected',
      detail: 'Arming denied: Resolve system health failures first',
      remedy: 'Wait for GPS.',
      reasons: ['Preflight Fail: ekf2 missing data', 'Arming denied: Resolve system health failures first'],
    });
    expect(problem).toMatchObject({ title: 'The vehicle refused', code: 'rejected', status: 409, remedy: 'Wait for GPS.' });
    expect(furtherReasons(problem)).toEqual(['Preflight Fail: ekf2 missing data']);
  });
  it('names the field of a malformed request', () => {
    const problem = parseProblem(422, { title: 'Invalid request', code: 'invalid_request', detail: 'alt_home_m: too high', field: 'alt_home_m' });
    expect(problem.field).toBe('alt_home_m');
    const validationProblem = parseProblem(422, { detail: [{ loc: ['body', 'alt_home_m'], msg: 'Input should be less than 120' }] });
    expect(validationProblem).toMatchObject({ field: 'alt_home_m', detail: 'alt_home_m: Input should be less than 120', code: 'invalid_request' });
  });
  it('says what interrupted a command', () => {
    const problem = parseProblem(409, { code: 'interrupted', detail: 'Interrupted by “Hold”.', remedy: 'Check the vehicle’s state.' });
    expect(problem).toMatchObject({ title: 'Interrupted', detail: 'Interrupted by “Hold”.', remedy: 'Check the vehicle’s state.' });
  });
  it('has a detail even if the body is empty', () => {
    for (const body of [null, 'oops', [], {}]) {
      expect(parseProblem(502, body)).toMatchObject({ title: 'The server answered with HTTP status 502', detail: 'The server gave no reason.', reasons: [] });
    }
  });
});

describe('requests with files', () => {
  it('send a file unchanged and return the server’s problem', async () => {
    const file = new Blob(['QGC WPL 110']);
    const requests: RequestInit[] = [];
    const responses = [new Response(JSON.stringify({ notes: [] })), new Response(JSON.stringify({ detail: 'line 2: no number.' }), { status: 422 })];
    const client = new ApiClient('page-7', undefined, (_, init) => {
      requests.push(init);
      return Promise.resolve(responses.shift() ?? new Response(null, { status: 500 }));
    });
    const importFile = () =>
      client.post('/plans/import', {
        params: { query: { filename: 'a b.plan' } },
        body: file,
        bodySerializer: (body) => body,
        headers: { 'Content-Type': 'application/octet-stream' },
      });
    expect(await importFile()).toEqual({ ok: true, value: { notes: [] } });
    expect(requests[0]?.body).toBe(file);
    expect(headersOf(requests[0])).toMatchObject({ 'content-type': 'application/octet-stream', 'x-client': 'page-7' });
    expect(await importFile()).toMatchObject({ ok: false, problem: { detail: 'line 2: no number.', status: 422 } });
  });

  it('return the notes from the header, or no notes', async () => {
    const download = async (headers: Record<string, string>, status = 200) => {
      const client = new ApiClient('page-7', undefined, (path, init) => {
        expect([path, init.body]).toEqual(['/api/v1/plans/export?format=yaml', '{"plan":{}}']);
        return Promise.resolve(new Response(status === 200 ? 'steps:' : '{"detail": "Write it as yaml."}', { status, headers }));
      });
      return client.download('/plans/export', { params: { query: { format: 'yaml' } }, body: { plan: {} as never } }, 'X-Plan-Notes');
    };
    const exported = await download({ 'X-Plan-Notes': '["The geofence is left out."]' });
    expect(exported.ok && [await exported.value.file.text(), exported.value.notes]).toEqual(['steps:', ['The geofence is left out.']]);
    expect(await download({})).toMatchObject({ ok: true, value: { notes: [] } });
    expect(await download({ 'X-Plan-Notes': '{}' })).toMatchObject({ ok: true, value: { notes: [] } });
    expect(await download({ 'X-Plan-Notes': 'no JSON' })).toMatchObject({ ok: false });
    expect(await download({}, 422)).toMatchObject({ ok: false, problem: { detail: 'Write it as yaml.' } });
  });
});

describe('client', () => {
  it('sends its name and a JSON body, and returns the response', async () => {
    let sentRequest: RequestInit = {};
    const client = new ApiClient('page-7', undefined, (_, init) => {
      sentRequest = init;
      return Promise.resolve(new Response('{"ok":true}'));
    });
    expect(await client.post('/vehicles/{v}/takeoff', { ...ofVehicle('1'), body: { alt_home_m: 10 } })).toEqual({ ok: true, value: { ok: true } });
    expect(headersOf(sentRequest)).toMatchObject({ 'x-client': 'page-7', 'content-type': 'application/json' });
    expect(sentRequest.body).toBe('{"alt_home_m":10}');
  });
  it('turns a refusal and an unreachable server into problems', async () => {
    const refusingClient = new ApiClient('p', undefined, () => Promise.resolve(new Response('{"detail":"no","code":"refused"}', { status: 409 })));
    expect(await refusingClient.post('/vehicles/{v}/hold', ofVehicle('1'))).toMatchObject({ ok: false, problem: { code: 'refused', title: 'Not sent' } });
    const unreachableClient = new ApiClient('p', undefined, () => Promise.reject(new TypeError('failed')));
    expect(await unreachableClient.post('/vehicles/{v}/hold', ofVehicle('1'))).toMatchObject({ ok: false, problem: { code: 'unreachable', status: 0 } });
  });
  it('reports that the server rejects the token', async () => {
    let rejections = 0;
    const respond = (status: number) => Promise.resolve(new Response('{"detail":"no","code":"token_missing"}', { status }));
    for (const status of [401, 403])
      await new ApiClient(
        'p',
        () => (rejections += 1),
        () => respond(status),
      ).get('/version');
    expect(rejections).toBe(1);
  });
  it('gives two pages different names', () => {
    expect(pageName(0)).toBe('page-0000');
    expect(pageName(0xffff)).toBe('page-ffff');
  });
});

describe('requests to one vehicle', () => {
  const settle = async (): Promise<void> => void (await vi.advanceTimersByTimeAsync(0));
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  function setup(): {
    commandQueue: CommandQueue;
    sent: string[];
    respond: (name: string) => void;
    request: (name: string, vehicles: string[]) => Promise<Outcome<string>>;
  } {
    const commandQueue = new CommandQueue();
    const sent: string[] = [];
    const responders = new Map<string, () => void>();
    const request = (name: string, vehicles: string[]): Promise<Outcome<string>> =>
      commandQueue.run(vehicles, () => {
        sent.push(name);
        return new Promise((done) => responders.set(name, () => done({ ok: true, value: name })));
      });
    return { commandQueue, sent, respond: (name) => responders.get(name)?.(), request };
  }

  it('are sent after the server has answered all earlier requests to the same vehicles', async () => {
    const { commandQueue, sent, respond, request } = setup();
    void request('1 and 2', ['1', '2']);
    const secondOutcome = request('2', ['2']);
    void request('3', ['3']);
    await settle();
    expect(sent).toEqual(['1 and 2', '3']);
    respond('1 and 2');
    await settle();
    expect(sent).toEqual(['1 and 2', '3', '2']);
    expect([commandQueue.busy(['1']), commandQueue.busy(['1', '2'])]).toEqual([false, true]);
    respond('2');
    expect(await secondOutcome).toEqual({ ok: true, value: '2' });
    await settle();
    expect(commandQueue.busy(['2'])).toBe(false);
  });

  it('are not sent if they wait too long, and even then later requests wait for the earlier response', async () => {
    const { commandQueue, sent, respond, request } = setup();
    void request('renewal', ['1']);
    const lateOutcome = request('late', ['1']);
    await vi.advanceTimersByTimeAsync(3000);
    expect(await lateOutcome).toMatchObject({ ok: false, problem: { title: 'Not sent', status: 0 } });
    const nextOutcome = request('next', ['1']);
    await settle();
    expect(sent).toEqual(['renewal']);
    respond('renewal');
    await settle();
    expect(sent).toEqual(['renewal', 'next']);
    respond('next');
    expect((await nextOutcome).ok).toBe(true);
    await settle();
    expect(commandQueue.busy(['1'])).toBe(false);
  });

  it('are sent after a request that failed', async () => {
    const commandQueue = new CommandQueue();
    await expect(commandQueue.run(['1'], () => Promise.reject(new Error('gone')))).rejects.toThrow('gone');
    expect(await commandQueue.run(['1'], () => Promise.resolve({ ok: true, value: 'next' }))).toEqual({ ok: true, value: 'next' });
  });
});

describe('a requested value', () => {
  it('is requested once for each key, however often it is shown, and ignores the answer for an earlier key', async () => {
    const answers: ((outcome: Outcome<string>) => void)[] = [];
    const requested = new Requested<string>();
    const show = (key: string | null): void => requested.show(key, () => new Promise((resolve) => answers.push(resolve)));
    show('a');
    show('a');
    answers[0]?.({ ok: true, value: 'of a' });
    await Promise.resolve();
    show('a');
    expect([answers.length, requested.value]).toEqual([1, 'of a']);
    show('b');
    show('c');
    answers[1]?.({ ok: true, value: 'of b' });
    await Promise.resolve();
    expect(requested.value).toBeNull();
    answers[2]?.({ ok: false, problem: unreachableProblem() });
    await Promise.resolve();
    requested.load();
    answers[3]?.({ ok: true, value: 'of c' });
    await Promise.resolve();
    expect([requested.value, requested.problem]).toEqual(['of c', null]);
    show(null);
    expect(requested.value).toBeNull();
  });
});
