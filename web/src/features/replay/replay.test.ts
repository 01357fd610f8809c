import { describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import { TelemetryStore } from '../../live/store';
import { parseFrame, type Replay } from '../../live/wire';
import { ReplayControl } from './replay.svelte';
import { timeAfterKey, marksOf, messageTicks, modeSpans, markTimes, adjacentMark, fractionAt, replayToShow, stateAt, type RecordingIndex } from './replays';
import { dateTime, sizeText } from '../../ui/format';

const replay = (more: Partial<Replay> = {}): Replay => ({
  name: 'replay-a.tlog',
  recording: 'a.tlog',
  vehicles: ['1'],
  state: 'open',
  detail: '',
  playing: true,
  speed: 1,
  position_unix_s: 150,
  begin_unix_s: 100,
  end_unix_s: 200,
  ...more,
});
const index: RecordingIndex = {
  recording: 'a.tlog',
  begin_unix_s: 100,
  end_unix_s: 200,
  records: 9,
  bytes_skipped: 0,
  left_out: 0,
  vehicles: [
    {
      system_id: 1,
      messages_left_out: 0,
      modes: [
        { begin_unix_s: 101, end_unix_s: 140, mode: 'hold', mode_label: 'Hold' },
        { begin_unix_s: 140, end_unix_s: 200, mode: 'offboard', mode_label: 'Offboard' },
      ],
      armed: [{ begin_unix_s: 120, end_unix_s: 190 }],
      messages: [
        { unix_s: 130, severity: 6, text: 'Takeoff detected' },
        { unix_s: 160, severity: 4, text: 'Wind is strong' },
        { unix_s: 160.2, severity: 2, text: 'Battery empty' },
      ],
    },
  ],
};

describe('the time bar', () => {
  const marks = marksOf(index, '1~2');
  it('positions spans and messages between begin and end', () => {
    expect(fractionAt(150, 100, 200)).toBe(0.5);
    expect(fractionAt(250, 100, 200)).toBe(1);
    expect(fractionAt(150, 100, 100)).toBe(0);
    expect(modeSpans(marks, 100, 200).map((s) => [s.label, s.left, Number(s.width.toFixed(3))])).toEqual([
      ['Hold', 0.01, 0.39],
      ['Offboard', 0.4, 0.6],
    ]);
    expect(messageTicks(marks, 100, 200).map((t) => [t.left.toFixed(3), t.tone])).toEqual([
      ['0.300', 'neutral'],
      ['0.600', 'caution'],
      ['0.602', 'danger'],
    ]);
    expect(marksOf(null, '1')).toBeNull();
  });
  it('shows the mode and the most severe message at a time', () => {
    expect(stateAt(marks, 160, 1)).toEqual({ mode: 'Offboard', armed: true, message: 'Critical: Battery empty' });
    expect(stateAt(marks, 110, 1)).toEqual({ mode: 'Hold', armed: false, message: '' });
    expect(stateAt(marks, 100, 1).mode).toBe('');
  });
  it('steps between mode changes, changes of the arming state and warnings', () => {
    const times = markTimes(marks);
    expect(times).toEqual([101, 120, 140, 160, 160.2, 190]);
    expect(adjacentMark(times, 140, 1)).toBe(160);
    expect(adjacentMark(times, 140, -1)).toBe(120);
    expect(adjacentMark(times, 199, 1)).toBeNull();
  });
  it('steps by keys within begin and end', () => {
    expect(timeAfterKey('ArrowRight', false, 198, 100, 200)).toBe(200);
    expect(timeAfterKey('ArrowLeft', true, 150, 100, 200)).toBe(120);
    expect([timeAfterKey('Home', false, 150, 100, 200), timeAfterKey('End', false, 150, 100, 200)]).toEqual([100, 200]);
    expect(timeAfterKey('x', false, 150, 100, 200)).toBeNull();
  });
  it('formats dates and sizes', () => {
    expect(dateTime(0)).toMatch(/^19(69|70)-\d\d-\d\d \d\d:\d\d:00$/);
    expect([sizeText(12), sizeText(1_500), sizeText(12_400_000), sizeText(2e9)]).toEqual(['12 B', '1.5 kB', '12 MB', '2.0 GB']);
  });
});

describe('which replay is shown', () => {
  it('is the replay of the selected vehicle, or the expected replay', () => {
    const emptyReplay = replay({ name: 'b', vehicles: [] });
    expect(replayToShow([replay(), emptyReplay], '1', null)?.name).toBe('replay-a.tlog');
    expect(replayToShow([replay()], '2', null)).toBeNull();
    expect(replayToShow([emptyReplay], '2', 'b')?.name).toBe('b');
    expect(replayToShow([emptyReplay], '2', null)).toBeNull();
    expect(replayToShow([replay()], null, 'replay-a.tlog')?.name).toBe('replay-a.tlog'); // its vehicle has appeared again, but is not selected yet
    expect(replayToShow([emptyReplay], null, null)?.name).toBe('b');
  });
});

describe('a replay’s time', () => {
  it('applies to the replayed vehicle, not to the server’s events', () => {
    const store = new TelemetryStore(() => 5000);
    store.apply({ type: 'replays', replays: [replay()] });
    expect(store.nowUnixS('1')).toBe(150);
    expect(store.nowUnixS('2')).toBe(5000);
    expect(store.nowUnixS()).toBe(5000);
    store.apply({ type: 'event', event: { kind: 'vehicle_added', vehicle: '1', unix_s: 5000, severity: 6, text: 'Vehicle 1 on replay', replayed: true } });
    expect(store.vehicle('1').messages).toEqual([]);
    store.apply({ type: 'replays', replays: [] });
    expect(store.nowUnixS('1')).toBe(5000);
  });
  it('is read only from a valid frame', () => {
    expect(parseFrame(JSON.stringify({ type: 'replays', replays: [replay(), { name: 3 }] }))).toEqual({ type: 'replays', replays: [replay()] });
  });
});

describe('replay control', () => {
  function setup(replays: Replay[]) {
    const requests: { method: string; path: string; body: unknown }[] = [];
    let release: (() => void) | null = null;
    const api = new ApiClient('test', undefined, async (path, init) => {
      requests.push({ method: init.method ?? '', path, body: init.body === undefined ? null : JSON.parse(init.body as string) });
      if (release === null && init.method === 'POST') await new Promise<void>((done) => (release = done));
      return new Response(JSON.stringify(path.endsWith('/index') ? index : replays[0]), { status: 200 });
    });
    const select = vi.fn();
    const control = new ReplayControl({ api, replays: () => replays, selectedId: () => '1', select, onOpened: () => undefined });
    return { control, requests, select, respond: () => release?.() };
  }

  it('sends one request at a time, and merges the commands given meanwhile', async () => {
    const replays = [replay()];
    const { control, requests, respond } = setup(replays);
    control.seek(110);
    control.seek(120);
    control.seek(130);
    control.setSpeed(4);
    expect(control.requested_unix_s).toBe(130);
    await vi.waitFor(() => expect(requests).toHaveLength(1));
    respond();
    await vi.waitFor(() => expect(requests).toHaveLength(2));
    await new Promise((done) => setTimeout(done, 0));
    replays[0] = replay({ position_unix_s: 50, playing: false });
    control.onTelemetry();
    expect(control.requested_unix_s).toBe(130); // a frame from before the seek
    replays[0] = replay({ position_unix_s: 130, playing: false });
    control.onTelemetry();
    expect(control.requested_unix_s).toBeNull();
    expect(requests.filter((a) => a.method === 'POST').map((a) => a.body)).toEqual([{ position_unix_s: 110 }, { position_unix_s: 130, speed: 4 }]);
    expect(requests[0]?.path).toBe('/api/v1/replays/replay-a.tlog');
  });
  it('keeps the requested time while earlier frames arrive, until a timeout', async () => {
    const replays = [replay({ position_unix_s: 50, playing: false })];
    const { control, requests, respond } = setup(replays);
    const clock = vi.spyOn(performance, 'now').mockReturnValue(0);
    control.seek(130);
    await vi.waitFor(() => expect(requests).toHaveLength(1));
    respond();
    await new Promise((done) => setTimeout(done, 0));
    clock.mockReturnValue(60_000); // the browser was busy for a minute
    for (let i = 0; i < 20; i++) control.onTelemetry();
    expect(control.requested_unix_s).toBe(130);
    control.onTelemetry();
    expect(control.requested_unix_s).toBeNull(); // another client may have changed the time, or the connection is lost
    clock.mockRestore();
  });
  it('selects the vehicle of the opened replay', async () => {
    const otherReplay = replay({ name: 'replay-b', vehicles: ['7'] });
    const { control, requests, select, respond } = setup([otherReplay]);
    const opening = control.open('b.tlog');
    await vi.waitFor(() => expect(requests).toHaveLength(1));
    respond();
    await opening;
    expect(select).toHaveBeenCalledWith('7');
  });
  it('shows why a request failed', async () => {
    const api = new ApiClient(
      'test',
      undefined,
      async () =>
        new Response(JSON.stringify({ title: 'Recording unusable', detail: 'b.tlog: The file is empty.', code: 'recording_unusable', status: 409 }), {
          status: 409,
        }),
    );
    const control = new ReplayControl({ api, replays: () => [], selectedId: () => null, select: vi.fn(), onOpened: () => undefined });
    await control.open('b.tlog');
    expect(control.problem?.detail).toContain('empty');
    expect(control.openingName).toBeNull();
  });
});
