import { beforeEach, describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { inFolder, MAX_WRITTEN_BYTES, parentOf, toBase64, VehicleFiles } from './files.svelte';

const ENTRY = { name: 'extras.txt', path: '/etc/extras.txt', size_bytes: 3, danger: 'startup' } as const;
const FOLDER = { path: '/etc', danger: 'startup', entries: [ENTRY] } as const;
const operation = (more: object): object => ({
  id: '7',
  kind: 'files/put',
  vehicle: '1',
  subject: null,
  state: 'running',
  progress: 0.5,
  text: '1 of 2 kB written, 1.0 kB/s.',
  error: null,
  result: null,
  ...more,
});

let answers: Record<string, { status: number; body: unknown }>;
let sent: { call: string; body: unknown }[];
const saved: string[] = [];

function api(): ApiClient {
  return new ApiClient('test', undefined, (path, { method, body }) => {
    const call = `${method} ${String(path).replace('/api/v1', '')}`;
    sent.push({ call, body: typeof body === 'string' ? JSON.parse(body) : null });
    const answer = answers[call] ?? { status: 500, body: {} };
    return Promise.resolve(new Response(JSON.stringify(answer.body), { status: answer.status, headers: { 'content-type': 'application/json' } }));
  });
}

beforeEach(() => {
  sent = [];
  saved.length = 0;
  answers = { 'POST /vehicles/1/files/list': { status: 200, body: FOLDER } };
});

const files = (): VehicleFiles => new VehicleFiles(undefined, (url, name) => void saved.push(`${url} ${name}`));

describe('files on a vehicle', () => {
  it('have paths', () => {
    expect([parentOf('/a/b'), parentOf('/a'), parentOf('/')]).toEqual(['/a', '/', '/']);
    expect([inFolder('', 'x'), inFolder('/', 'x'), inFolder('/a', 'x')]).toEqual(['/x', '/x', '/a/x']);
    expect(atob(toBase64(new Uint8Array(70_000).fill(65)))).toHaveLength(70_000);
  });

  it('are written only after a confirmation that names what is replaced and what hangs on it', async () => {
    const [client, panel] = [api(), files()];
    await panel.read(client, '1', '/etc');
    await panel.askToPut('1', new File(['new'], 'extras.txt'));
    const draft = panel.toConfirm;
    expect(draft).toMatchObject({ kind: 'put', path: '/etc/extras.txt', existing: ENTRY, danger: 'startup', content_base64: btoa('new') });
    expect(sent).toHaveLength(1);
    answers['POST /vehicles/1/files/put'] = { status: 202, body: operation({ state: 'succeeded', result: {} }) };
    if (draft !== null) await panel.confirm(client, draft);
    expect(sent[1]).toEqual({
      call: 'POST /vehicles/1/files/put',
      body: { path: '/etc/extras.txt', content_base64: btoa('new'), confirm: '/etc/extras.txt is written on vehicle 1' },
    });
    expect([panel.toConfirm, panel.doneOf('1'), panel.doneOf('2')]).toEqual([null, '/etc/extras.txt was written; its checksum is right.', null]);
  });

  it('are removed after a confirmation, and a refusal is shown for that vehicle only', async () => {
    const [client, panel] = [api(), files()];
    await panel.read(client, '1', '/etc');
    panel.askToRemove('1', ENTRY);
    answers['POST /vehicles/1/files/remove'] = { status: 409, body: { title: 'Refused', detail: 'Vehicle 1 is armed.', code: 'refused' } };
    if (panel.toConfirm !== null) await panel.confirm(client, panel.toConfirm);
    expect([panel.problemOf('1')?.detail, panel.problemOf('2')]).toEqual(['Vehicle 1 is armed.', null]);
  });

  it('are saved in the browser once the server has them; a failure says why', async () => {
    const [client, panel] = [api(), files()];
    const result = { file: '0123456789abcdef', name: 'extras.txt', verified: 'crc32' };
    answers['POST /vehicles/1/files/get'] = { status: 202, body: operation({ kind: 'files/get', state: 'succeeded', result }) };
    await panel.get(client, '1', '/etc/extras.txt');
    expect(saved).toEqual(['/api/v1/vehicles/1/files/0123456789abcdef extras.txt']);
    answers['POST /vehicles/1/files/get'] = { status: 202, body: operation({ state: 'failed', error: { title: 'Failed', detail: 'It ended.' } }) };
    await panel.get(client, '1', '/etc/extras.txt');
    expect([saved.length, panel.problemOf('1')?.detail]).toEqual([1, 'It ended.']);
  });

  it('that are too large are not sent', async () => {
    const [client, panel] = [api(), files()];
    await panel.read(client, '1', '/etc');
    await panel.askToPut('1', new File([new Uint8Array(MAX_WRITTEN_BYTES + 1)], 'a.bin'));
    expect([panel.toConfirm, panel.problemOf('1')?.title]).toEqual([null, 'Not written']);
  });
});
