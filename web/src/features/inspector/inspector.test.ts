import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import type { TelemetrySocket } from '../../live/socket';
import { MAX_FIELDS } from '../../plots/plot-view.svelte';
import { Inspector } from './inspector.svelte';
import { MessageForm } from './message-form.svelte';
import { fieldOf, lost_percent, matching, numbersOf, parse, rateText, valueText, type Field, type Message, type Received } from './messages';

const ROLL = 'ATTITUDE:1.1/roll';
const message = (name: string | null, more: Partial<Message> = {}): Message => ({
  id: 30,
  name,
  component: 1,
  count: 5,
  rate_hz: 12.34,
  age_s: 0.1,
  size_bytes: 28,
  fields: { roll: 0.5, q: [1, null], text: 'a' },
  instance: null,
  instances: [],
  ...more,
});
const received = (more: Partial<Received> = {}): Received => ({ system: 1, since_s: 4, messages: [message('ATTITUDE')], loss: [], left_out: 0, ...more });
const field = (more: Partial<Field> = {}): Field => ({ name: 'a', type: 'float', length: 0, unit: null, enum: null, values: [], ...more });

describe('the list of messages', () => {
  it('is searched by name, number, component and field', () => {
    const messages = [message('ATTITUDE'), message(null, { id: 40000, component: 154, fields: null })];
    expect(matching(messages, '')).toHaveLength(2);
    expect(matching(messages, 'att roll')).toEqual([messages[0]]);
    expect(matching(messages, '40000')).toEqual([messages[1]]);
    expect(matching(messages, '154')).toEqual([messages[1]]);
  });

  it('shows rate, loss, and every number, elements of arrays too', () => {
    expect([rateText(1.96), rateText(49.7), rateText(null)]).toEqual(['2.0 Hz', '50 Hz', '']);
    expect(lost_percent(null)).toBeNull();
    expect(
      lost_percent(
        received({
          loss: [
            { component: 1, link: 'a', received: 80, lost: 20 },
            { component: 154, link: 'a', received: 100, lost: 0 },
          ],
        }),
      ),
    ).toBe(10);
    expect(numbersOf({ roll: 0.5, q: [1, null], text: 'a' })).toEqual([
      ['roll', 0.5],
      ['q[0]', 1],
      ['q[1]', null],
    ]);
    expect([valueText(null), valueText(-0.12345678), valueText(1795478891930667)]).toEqual(['NaN', '−0.1234568', '1795478891930667']);
  });
});

describe('a typed value', () => {
  it('is a number, NaN, a list or a text, or says what is wrong', () => {
    expect(parse(field(), '−1.5')).toEqual({ value: -1.5 });
    expect(parse(field(), 'nan')).toEqual({ value: null });
    expect(parse(field(), '')).toEqual({ value: 0 });
    expect(parse(field({ length: 4 }), '1, 2')).toEqual({ value: [1, 2] });
    expect(parse(field({ length: 4 }), '')).toEqual({ value: [] });
    expect(parse(field({ type: 'char', length: 9 }), 'MFT')).toEqual({ value: 'MFT' });
    expect(parse(field(), 'x1')).toEqual({ problem: 'a: x1 is not a number.' });
  });
});

function scripted(answers: Record<string, unknown>) {
  const sent: { call: string; body: unknown }[] = [];
  const api = new ApiClient('test', undefined, (path, { method, body }) => {
    const call = `${method} ${path}`;
    sent.push({ call, body: typeof body === 'string' ? JSON.parse(body) : null });
    const answer = Object.entries(answers).find(([start]) => call.startsWith(start));
    const [status, value] = answer === undefined ? [404, { title: 'Unknown', detail: call }] : [200, answer[1]];
    return Promise.resolve(new Response(JSON.stringify(value), { status, headers: { 'Content-Type': 'application/json' } }));
  });
  return { api, sent };
}

describe('the inspector', () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  it('shows only the messages of the watched vehicle, and reads plotted fields only while they are plotted', async () => {
    const series = [{ field: ROLL, unit: 'rad', gap: false, t_s: [99, 100], values: [1, 2] }];
    const { api, sent } = scripted({ 'GET /api/v1/vehicles/1/mavlink/series': { now_s: 100, after: 7, more: false, series } });
    const inspector = new Inspector(api);
    const stop = inspector.watch('1', 'One', 'ws://x', (socket: TelemetrySocket) => void (socket.stop = () => undefined));
    const sample = { vehicle: '1', topic: 'mavlink_messages', vehicle_time_boot_s: null, received_unix_s: 1, value: received() };
    inspector.onFrame({ type: 'samples', samples: [{ ...sample, vehicle: '2' }] }, '1');
    expect(inspector.content).toBeNull();
    inspector.onFrame({ type: 'samples', samples: [sample] }, '1');
    expect(inspector.content?.messages).toHaveLength(1);
    await vi.advanceTimersByTimeAsync(1000);
    expect(sent).toEqual([]);
    inspector.plots.toggle(ROLL);
    await vi.advanceTimersByTimeAsync(300);
    expect(inspector.plots.series.get(ROLL)?.values).toEqual([1, 2]);
    await vi.advanceTimersByTimeAsync(300);
    expect(sent.at(-1)?.call).toContain('after=7');
    for (let i = 0; i < 9; i += 1) inspector.plots.toggle(`ATTITUDE:1.1/q[${i}]`);
    expect(inspector.fields).toHaveLength(MAX_FIELDS);
    inspector.plots.toggle(ROLL);
    expect(inspector.fields).not.toContain(ROLL);
    stop();
    const count = sent.length;
    await vi.advanceTimersByTimeAsync(1000);
    expect(sent).toHaveLength(count);
  });

  it('plots a number of the instance that is shown', () => {
    expect(fieldOf(1, message('ATTITUDE'), 'roll')).toBe(ROLL);
    expect(fieldOf(3, message('BATTERY_STATUS', { instance: 1, instances: [0, 1] }), 'voltages[0]')).toBe('BATTERY_STATUS:3.1.1/voltages[0]');
  });
});

describe('the form of a message', () => {
  const definition = {
    id: 4,
    name: 'PING',
    fields: [field({ name: 'seq', type: 'uint32_t' }), field({ name: 'target_system', type: 'uint8_t' })],
  };

  it('sends what was confirmed, and shows the answer', async () => {
    const { api, sent } = scripted({
      'GET /api/v1/mavlink/messages/PING': definition,
      'GET /api/v1/mavlink/messages': { messages: ['PING'], refused: {} },
      'POST /api/v1/vehicles/1/mavlink/send': { acknowledged: null, result: null },
    });
    const form = new MessageForm();
    await form.load(api);
    await form.choose(api, 'PIN');
    expect(form.definition).toBeNull();
    await form.choose(api, 'PING');
    expect(form.fields.map(({ name }) => name)).toEqual(['seq']);
    form.texts['seq'] = 'x';
    form.ask('1', false);
    expect([form.toConfirm, form.problemOf('1')?.detail]).toEqual([null, 'seq: x is not a number.']);
    form.texts['seq'] = '7';
    form.ask('1', false);
    form.texts['seq'] = '8'; // after the question
    const draft = form.toConfirm;
    if (draft === null) throw new Error('nothing to confirm');
    await form.send(api, draft);
    expect(sent.at(-1)?.body).toEqual({ message: 'PING', fields: { seq: 7 }, while_armed: false, confirm: 'PING is sent unchecked to vehicle 1' });
    expect(form.resultOf('1')).toBe('Sent; this message has no answer.');
    expect(form.resultOf('2')).toBeNull();
  });
});
