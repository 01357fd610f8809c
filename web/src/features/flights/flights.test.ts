import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import { loadFindings, missing, severalVehicles } from './findings';
import { detailsOf, FlightLibrary, matching, removedText, sourcesOf, titleOf, type Flight, type LogFile, type Row } from './library.svelte';
import { timeText, valueAt } from '../../plots/plot-view.svelte';
import { follow } from './growth';
import { fieldsOfSet, findFields, labelOf, SETS } from '../../plots/sets';
import { LogView, type Overview } from './log-view.svelte';

const FILE: LogFile = {
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
const FLIGHT: Flight = {
  id: 'f1-0',
  name: null,
  vehicle: '7',
  start_unix_s: 1e9,
  duration_s: 61,
  distance_m: 1240,
  height_m: 30.2,
  modes: ['Take off', 'Mission'],
  failsafes: 1,
  ended: 'landed',
  plan: 'Bridge',
  parts: [
    { id: 'f1-0', file: 'f1', source: 'vehicle', offset_s: 0, begin_s: 20, end_s: 81, why: null },
    { id: 'f2-1', file: 'f2', source: 'recording', offset_s: -100, begin_s: 120, end_s: 181, why: 'same vehicle' },
    { id: 'n3-0', file: null, source: 'notes', offset_s: 20, begin_s: 0, end_s: 61, why: 'recorded by this server' },
  ],
  unsure: [],
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
  flights: [],
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
  const LIST = { flights: [], files: [FILE], total_bytes: 1, max_bytes: 20e9, removed: [] };

  it('has each flight once with its files, and files without a flight', async () => {
    const others = [
      { ...FILE, id: 'f2', source: 'recording' as const, bytes: 600_000 },
      { ...FILE, id: 'f3', name: 'ground.ulg' },
    ];
    const { api } = server(() => [200, { ...LIST, flights: [FLIGHT], files: [FILE, ...others] }]);
    const library = new FlightLibrary(api);
    await library.load();
    expect(library.rows.map(({ id, files }) => [id, ...files.map((file) => file.id)])).toEqual([
      ['f1-0', 'f1', 'f2'],
      ['f3', 'f3'],
    ]);
    const [flown] = library.rows as [Row];
    expect(detailsOf(flown)).toBe('vehicle 7 · 1 min 01 s · 1240 m · 30 m high · Take off, Mission · landed');
    expect(sourcesOf(flown)).toBe('log of the vehicle, recording · 13 MB');
    library.search = 'bridge landed';
    expect(library.found).toEqual([flown]);
    expect(titleOf({ ...flown, flight: { ...FLIGHT, name: 'Second try' } })).toBe('Second try');
  });

  it('is searched by name, vehicle and time', () => {
    const row: Row = { id: 'f1', flight: null, files: [FILE] };
    expect(matching([row], 'vehicle 7')).toEqual([row]);
    expect(matching([row], 'A.ULG log')).toEqual([row]);
    expect(matching([row], 'vehicle 8')).toEqual([]);
    expect([detailsOf(row), sourcesOf(row)]).toEqual(['vehicle 7 · 1 min 01 s · not armed', 'log of the vehicle · 12 MB']);
    expect([titleOf(row), titleOf({ ...row, files: [{ ...FILE, start_unix_s: 0 }] })]).toEqual(['a.ulg', expect.stringMatching(/^19/)]);
  });

  it('names a flight, and joins and separates its parts', async () => {
    const { api, sent } = server(() => [200, FLIGHT]);
    const library = new FlightLibrary(api);
    library.toName = 'f1-0';
    expect(await library.setName('f1-0', 'Bridge')).toBe(true);
    await library.decide('f1-0', 'f2-1', false);
    expect(library.toName).toBeNull();
    expect(sent.filter(({ call }) => call.startsWith('POST'))).toEqual([
      { call: 'POST /flights/f1-0/name', body: '{"name":"Bridge"}' },
      { call: 'POST /flights/f1-0/parts', body: '{"part":"f2-1","joined":false}' },
    ]);
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
    expect([library.adding, library.list?.files.length]).toEqual([null, 1]);
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

  it('shows all logs of a flight on the time of the first, with its commands', async () => {
    const { api, sent } = server((call) => {
      if (call.includes('/joined'))
        return [
          200,
          { flight: FLIGHT, plan: null, commands: [{ t_s: 19, unix_s: 1, client: 'Ann', command: 'arm', result: 'ok', detail: null }], parameters: [] },
        ];
      if (call.includes('/series')) return [200, { series: [{ field: 'x', unit: 'm', samples: 2, t_s: [120, 130], values: [1, 2] }] }];
      if (call.includes('/f2'))
        return [
          200,
          { ...OVERVIEW, kind: 'tlog', duration_s: 900, topics: ['LOCAL_POSITION_NED:7.1', 'ATTITUDE:1.1'].map((id) => topic(id, ['x', 'y', 'z'])) },
        ];
      return [200, { ...OVERVIEW, messages: [{ t_s: 30, severity: 4, text: 'Low battery' }] }];
    });
    const view = new LogView(api);
    await view.open('f1', 'a', FLIGHT);
    expect(view.parts.map(({ file, offset_s }) => [file, offset_s])).toEqual([
      ['f1', 0],
      ['f2', -100],
    ]);
    expect(view.whole).toEqual({ from_s: 5, to_s: 96 });
    expect(view.events.map(({ t_s, text, by }) => [t_s, text, by])).toEqual([
      [19, 'arm', 'Ann'],
      [30, 'Low battery', ''],
    ]);
    expect(view.sources.map(({ prefix, topics }) => [prefix, topics.length])).toEqual([
      ['', 4],
      ['1|', 1], // not those of vehicle 1
    ]);
    view.toggle('1|LOCAL_POSITION_NED:7.1/x');
    await vi.advanceTimersByTimeAsync(200);
    expect(decodeURIComponent(sent.at(-1)?.call ?? '')).toContain('GET /flights/f2/series?field=LOCAL_POSITION_NED:7.1/x&from_s=105&to_s=196');
    expect(view.series.get('1|LOCAL_POSITION_NED:7.1/x')?.t_s).toEqual([20, 30]);
    expect(labelOf('1|LOCAL_POSITION_NED:7.1/x')).toBe('LOCAL_POSITION_NED:7.1 x');
  });

  it('follows a log that is still being written, and a window of the past stays', async () => {
    let duration_s = 100;
    const { api, sent } = server((call) => [200, call.includes('/series') ? { series: [] } : { ...OVERVIEW, duration_s }]);
    const view = new LogView(api);
    await view.open('f1', 'a');
    view.toggle('a:0/x');
    duration_s = 130;
    await view.refresh(null);
    expect(view.shown).toEqual({ from_s: 0, to_s: 130 });
    view.zoom({ from_s: 110, to_s: 130 });
    duration_s = 140;
    await view.refresh(null);
    expect(view.shown).toEqual({ from_s: 120, to_s: 140 });
    view.zoom({ from_s: 10, to_s: 20 });
    await vi.advanceTimersByTimeAsync(200);
    duration_s = 150;
    await view.refresh(null);
    expect([view.shown, view.whole.to_s]).toEqual([{ from_s: 10, to_s: 20 }, 150]);
    const before = sent.filter(({ call }) => call.includes('/series')).length;
    await vi.advanceTimersByTimeAsync(200);
    expect(sent.filter(({ call }) => call.includes('/series')).length).toBe(before + 1);
    view.close();
    await view.refresh(null);
    expect(view.parts).toEqual([]);
  });

  it('reads again until all is written', async () => {
    let running = true;
    const flight = { ...FLIGHT, parts: FLIGHT.parts.slice(0, 1) };
    const library = new FlightLibrary(server(() => [200, { flights: [flight], files: [{ ...FILE, running }], total_bytes: 1, max_bytes: 1, removed: [] }]).api);
    const refresh = vi.fn(() => Promise.resolve());
    const end = follow(library, { flight, refresh });
    await vi.advanceTimersByTimeAsync(11_000);
    expect(refresh).toHaveBeenCalledTimes(2);
    running = false;
    end();
    await vi.advanceTimersByTimeAsync(60_000);
    expect(refresh).toHaveBeenCalledTimes(2);
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
