import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import { loadFindings, missing, severalVehicles } from './findings';
import { detailsOf, FlightLibrary, matching, removedText, titleOf, type Flight } from './library.svelte';
import { LogView, timeText, valueAt, type Overview } from './log-view.svelte';
import { fieldsOfSet, findFields, labelOf, SETS } from './sets';

const FLIGHT: Flight = {
  id: 'f1',
  name: 'a.ulg',
  source: 'vehicle',
  kind: 'ulog',
  bytes: 12_400_000,
  added_unix_s: 5,
  start_unix_s: null,
  duration_s: 61,
  vehicles: ['7'],
  firmware: null,
  problem: null,
  running: false,
  read: true,
};
const topic = (id: string, fields: readonly string[]): Overview['topics'][number] => ({
  id,
  name: id.split(':')[0] ?? '',
  instance: id.split(':')[1] ?? '',
  samples: 10,
  begin_s: 0,
  end_s: 9,
  rate_hz: 1,
  fields: fields.map((name) => ({ name, unit: null, type: 'float32' })),
});
const TOPICS = [
  topic('battery_status:0', ['voltage_v', 'current_a']),
  topic('vehicle_attitude:0', ['q[0]', 'q[1]', 'q[2]', 'q[3]']),
  topic('vehicle_local_position:0', ['x', 'y', 'z', 'vx']),
  topic('vehicle_local_position:1', ['x', 'y', 'z', 'vx']),
];
const OVERVIEW: Overview = {
  kind: 'ulog',
  start_unix_s: null,
  duration_s: 100,
  firmware: null,
  hardware: null,
  vehicles: [],
  topics: TOPICS,
  parameters: [],
  parameter_changes: [],
  messages: [],
  messages_left_out: 0,
  dropouts: [],
  problems: [],
};

interface Sent {
  readonly call: string;
  readonly body: unknown;
}
function server(answer: (call: string) => [number, unknown]): { api: ApiClient; sent: Sent[] } {
  const sent: Sent[] = [];
  const api = new ApiClient('test', undefined, (path, { method, body }) => {
    const call = `${method} ${path.replace('/api/v1', '')}`;
    sent.push({ call, body });
    const [status, value] = answer(call);
    return Promise.resolve(status === 204 ? new Response(null, { status }) : Response.json(value, { status }));
  });
  return { api, sent };
}

describe('the list of flights', () => {
  const LIST = { flights: [FLIGHT], total_bytes: 1, max_bytes: 20e9, removed: [] };

  it('is searched by name, vehicle and time', () => {
    expect(matching([FLIGHT], 'vehicle 7')).toEqual([FLIGHT]);
    expect(matching([FLIGHT], 'A.ULG log')).toEqual([FLIGHT]);
    expect(matching([FLIGHT], 'vehicle 8')).toEqual([]);
    expect(detailsOf(FLIGHT)).toBe('vehicle 7 · 1 min 01 s · log of the vehicle · 12 MB');
    expect([titleOf(FLIGHT), titleOf({ ...FLIGHT, start_unix_s: 0 })]).toEqual(['a.ulg', expect.stringMatching(/^19/)]);
  });

  it('says what was deleted to make room', () => {
    expect(removedText(LIST)).toBeNull();
    const removed = [1, 2].map((i) => ({ name: `${i}.tlog`, bytes: 5, unix_s: 1e9 }));
    expect(removedText({ ...LIST, removed })).toMatch(/^To stay within 20 GB, the server deleted 1\.tlog on 2001.* and 1 more before it\.$/);
  });

  it('adds a file in parts, each at the place where the one before ends', async () => {
    const { api, sent } = server((call) => {
      if (call === 'POST /flights/uploads') return [201, { id: 'u1', received_bytes: 0, part_bytes: 4, flight: null }];
      if (call.includes('offset_bytes=8')) return [200, { id: 'u1', received_bytes: 10, part_bytes: 4, flight: 'f9' }];
      return call.startsWith('POST') ? [200, { id: 'u1', received_bytes: 4, part_bytes: 4, flight: null }] : [200, LIST];
    });
    const library = new FlightLibrary(api);
    expect(await library.add(new File(['0123456789'], 'a.ulg'))).toBe('f9');
    const parts = sent.filter(({ call }) => call.includes('offset_bytes'));
    expect(parts.map(({ call }) => call)).toEqual([0, 4, 8].map((offset) => `POST /flights/uploads/u1?offset_bytes=${offset}`));
    expect(await (parts[2]?.body as Blob).text()).toBe('89');
    expect([library.adding, library.list?.flights.length]).toEqual([null, 1]);
  });

  it('says why a file was not added, and drops what has arrived', async () => {
    const { api, sent } = server((call) => {
      if (call === 'POST /flights/uploads') return [201, { id: 'u1', received_bytes: 0, part_bytes: 4, flight: null }];
      if (call.startsWith('POST')) return [409, { title: 'Not sent', detail: 'The disk is full.' }];
      return call.startsWith('DELETE') ? [204, null] : [200, LIST];
    });
    const library = new FlightLibrary(api);
    expect(await library.add(new File(['0123456789'], 'a.ulg'))).toBeNull();
    expect(library.problem?.detail).toBe('The disk is full.');
    expect(sent.map(({ call }) => call)).toContain('DELETE /flights/uploads/u1');
  });

  it('deletes a flight with the text that the server requires', async () => {
    const { api, sent } = server((call) => (call.startsWith('DELETE') ? [204, null] : [200, LIST]));
    const library = new FlightLibrary(api);
    library.toDelete = 'f1';
    expect(await library.delete('f1')).toBe(true);
    expect(decodeURIComponent(sent[0]?.call ?? '').replaceAll('+', ' ')).toBe('DELETE /flights/f1?confirm=flight f1 is deleted');
    expect(library.toDelete).toBeNull();
  });
});

describe('sets of plots', () => {
  it('show the fields that the log has, of the first instance', () => {
    const titles = SETS.filter((set) => fieldsOfSet(set, TOPICS).length > 0).map(({ title }) => title);
    expect(titles).toEqual(['Position', 'Velocity', 'Attitude', 'Battery']);
    const [position, , attitude] = SETS;
    expect(position && fieldsOfSet(position, TOPICS)).toEqual([['vehicle_local_position:0/x'], ['vehicle_local_position:0/y'], ['vehicle_local_position:0/z']]);
    const [[roll]] = fieldsOfSet(attitude as (typeof SETS)[number], TOPICS) as [[string]];
    expect(roll).toBe('roll({vehicle_attitude:0/q[0]}, {vehicle_attitude:0/q[1]}, {vehicle_attitude:0/q[2]}, {vehicle_attitude:0/q[3]})');
    expect(labelOf(roll)).toBe('roll of vehicle_attitude');
  });

  it('are of MAVLink messages in a telemetry log', () => {
    const [position] = SETS;
    expect(position && fieldsOfSet(position, [topic('LOCAL_POSITION_NED:1.1', ['x', 'y', 'z'])])[2]).toEqual(['LOCAL_POSITION_NED:1.1/z']);
  });

  it('fields are found by words of topic and field', () => {
    expect(findFields(TOPICS, 'local z').flatMap(({ fields }) => fields.map(({ field }) => field))).toEqual([
      'vehicle_local_position:0/z',
      'vehicle_local_position:1/z',
    ]);
    expect(findFields(TOPICS, '').length).toBe(4);
    expect([labelOf('battery_status:0/voltage_v'), labelOf('ATTITUDE:1.1/roll')]).toEqual(['battery_status voltage_v', 'ATTITUDE:1.1 roll']);
  });
});

describe('an open log', () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  async function opened(): Promise<{ view: LogView; sent: Sent[] }> {
    const { api, sent } = server((call) =>
      call.includes('/series')
        ? [200, { series: [{ field: 'battery_status:0/voltage_v', unit: 'V', samples: 2, t_s: [0, 5], values: [16, null] }] }]
        : [200, OVERVIEW],
    );
    const view = new LogView(api);
    await view.open('f1', 'a.ulg');
    return { view, sent };
  }

  it('requests the values of all panes once after a pause, and again for another window', async () => {
    const { view, sent } = await opened();
    view.toggle('battery_status:0/voltage_v');
    view.zoom({ from_s: 10, to_s: 20 });
    view.zoom({ from_s: 10, to_s: 30 });
    await vi.advanceTimersByTimeAsync(200);
    const requests = sent.filter(({ call }) => call.includes('/series'));
    expect(requests.length).toBe(1);
    expect(decodeURIComponent(requests[0]?.call ?? '')).toContain('field=battery_status:0/voltage_v&from_s=10&to_s=30');
    expect(view.series.get('battery_status:0/voltage_v')?.unit).toBe('V');
    view.zoom(view.whole);
    await vi.advanceTimersByTimeAsync(200);
    expect(sent.filter(({ call }) => call.includes('/series')).length).toBe(2);
  });

  it('zooms around the cursor and stays within the log', async () => {
    const { view } = await opened();
    view.moveCursor(80);
    view.zoomBy(0.5);
    expect(view.shown).toEqual({ from_s: 40, to_s: 90 });
    view.pan(1);
    expect(view.shown).toEqual({ from_s: 50, to_s: 100 });
    view.zoom({ from_s: -Infinity, to_s: Infinity });
    expect(view.shown).toEqual({ from_s: 0, to_s: 100 });
    view.zoom({ from_s: 10, to_s: 12 });
    view.moveCursor(50);
    expect([view.shown, view.cursor_s]).toEqual([{ from_s: 49, to_s: 51 }, 50]);
  });

  it('adds fields to the active pane, and keeps one pane', async () => {
    const { view } = await opened();
    view.toggle('a:0/x');
    view.addPane();
    view.toggle('a:0/y');
    expect(view.panes.map(({ fields }) => fields)).toEqual([['a:0/x'], ['a:0/y']]);
    view.toggle('a:0/y');
    expect(view.isPlotted('a:0/y')).toBe(false);
    for (const { id } of view.panes) view.removePane(id);
    expect(view.panes.map(({ fields }) => fields)).toEqual([[]]);
    expect(view.activePane).toBe(view.panes[0]?.id);
  });

  it('ignores the answer for a log that was closed meanwhile', async () => {
    const { view } = await opened();
    view.toggle('battery_status:0/voltage_v');
    vi.advanceTimersByTime(100);
    view.close();
    await vi.advanceTimersByTimeAsync(200);
    expect([view.series.size, view.overview, view.problem]).toEqual([0, null, null]);
  });

  it('reads values and times at the cursor', () => {
    const series = { field: 'x', unit: null, samples: 3, t_s: [1, 2, 3], values: [10, null, 30] };
    expect([0, 1.5, 2.5, 9].map((t_s) => valueAt(series, t_s))).toEqual([null, 10, null, 30]);
    expect([timeText(1.5, null), timeText(123.44, 0)]).toEqual(['1.50 s', expect.stringMatching(/^123\.4 s · \d\d:02:03$/)]);
  });
});

describe('findings', () => {
  const FINDING = {
    kind: 'vibration',
    title: 'Vibration',
    vehicle: '1',
    severity: 'caution',
    begin_s: 40,
    end_s: 44,
    text: 'The vibration was high.',
    limit: 'Good below 4.9 m/s².',
    remedy: 'Balance the propellers.',
    panes: [['battery_status:0/voltage_v'], [], ['vehicle_local_position:0/x', 'vehicle_local_position:0/y']],
  } as const;

  it('open the plots that show them, around their time', async () => {
    const { api, sent } = server((call) => [200, call.includes('series') ? { series: [] } : OVERVIEW]);
    const log = new LogView(api);
    await log.open('f1', 'a.ulg');
    log.showEvidence(FINDING.panes, { from_s: FINDING.begin_s, to_s: FINDING.end_s });
    expect(log.panes.map(({ fields }) => fields)).toEqual([FINDING.panes[0], FINDING.panes[2]]);
    expect(log.shown).toEqual({ from_s: 36, to_s: 48 });
    expect(log.cursor_s).toBe(40);
    await log.loadSeries();
    expect(sent.at(-1)?.call).toContain('series');
  });

  it('keep the plots if nothing logged shows them, and stay within the log', async () => {
    const log = new LogView(server(() => [200, OVERVIEW]).api);
    await log.open('f1', 'a.ulg');
    const before = log.panes;
    log.showEvidence([[]], { from_s: -1, to_s: 1 });
    expect(log.panes).toBe(before);
    expect(log.shown.from_s).toBe(0);
    expect(log.cursor_s).toBe(0);
  });

  it('are loaded or say why not', async () => {
    const found = { findings: [FINDING], not_judged: [] };
    expect(await loadFindings(server(() => [200, found]).api, 'f1')).toEqual({ findings: found });
    const problem = { title: 'Gone', detail: 'There is no such flight.', code: 'unknown_flight' };
    expect(await loadFindings(server(() => [404, problem]).api, 'f1')).toMatchObject({ problem: { title: 'Gone' } });
  });

  it('name what was not judged once for each reason, and vehicles only of several', () => {
    const without = (title: string, reason: string) => ({ kind: 'x', title, vehicle: '1', reason });
    expect(missing([without('Compass', 'A'), without('Load', 'B'), without('Fence', 'A'), without('Compass', 'A')])).toEqual([
      { reason: 'A', titles: ['Compass', 'Fence'] },
      { reason: 'B', titles: ['Load'] },
    ]);
    expect(severalVehicles([FINDING, FINDING])).toBe(false);
    expect(severalVehicles([FINDING, { ...FINDING, vehicle: '2' }])).toBe(true);
  });
});
