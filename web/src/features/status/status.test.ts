import { describe, expect, it } from 'vitest';
import type { Status } from '../../live/topics';
import { batteryIndicator, gpsIndicator } from './indicators';
import { linkDetails, recordingIndicator, type ServerLink } from './links.svelte';
import { statusLabel, type StatusFacts } from './status-label';

const status = (more: Partial<Status> = {}): Status => ({
  armed: true,
  mode: 'hold',
  mode_label: 'Hold',
  custom_mode: 1,
  intended_custom_mode: null,
  landed_state: 'in_air',
  system_status: 4,
  link_lost: false,
  last_heartbeat_age_s: 0.2,
  ...more,
});
const label = (more: Partial<StatusFacts>) => statusLabel({ status: status(), age_s: 0.1, lost: false, replayed: false, ready: null, stream: null, ...more });

describe('the status label', () => {
  it('shows who commands the vehicle', () => {
    expect(label({ status: status({ mode: 'offboard' }), stream: { type: 'position', rate_hz: 49.8, client: 'a' } })).toEqual({
      title: 'Offboard',
      detail: 'from a · Position setpoints, 50 Hz',
      tone: 'target',
    });
    expect(label({ status: status({ mode: 'offboard' }) }).detail).toContain('another computer');
    const externalMode = status({ mode: 'external_1', mode_label: 'Short line' });
    expect(label({ status: externalMode })).toMatchObject({ title: 'Short line', detail: 'an external mode of another program' });
    expect(label({ status: externalMode, stream: { type: 'path', rate_hz: 50, client: 'a' } }).detail).toContain('mission of this server');
    expect(label({ status: status({ mode: 'position' }) }).detail).toContain('pilot');
    expect(label({ status: status({ mode: 'new_one', mode_label: 'New one' }) }).title).toBe('New one');
  });
  it('shows a disarmed vehicle as ready only if the vehicle reports it', () => {
    const disarmed = status({ armed: false, landed_state: 'on_ground' });
    expect(label({ status: disarmed, ready: true }).title).toBe('Ready');
    expect(label({ status: disarmed, ready: false })).toMatchObject({ title: 'Not ready', tone: 'caution' });
    expect(label({ status: disarmed }).title).toBe('Disarmed');
    expect(label({ status: null }).title).toBe('No vehicle state');
  });
  it('shows a lost connection, a replay or a failsafe instead of the mode', () => {
    expect(label({ lost: true, age_s: 7 })).toMatchObject({ title: 'Connection lost', detail: '7 s ago · last: Hold, armed', tone: 'danger' });
    expect(label({ lost: true, offline: true, age_s: 7 })).toMatchObject({ title: 'No connection to the server', detail: 'last: Hold, armed' });
    expect(label({ replayed: true }).title).toBe('Replay');
    expect(label({ status: status({ mode: 'land', custom_mode: 2, intended_custom_mode: 9 }) }).title).toBe('Failsafe: Landing');
  });
  it('shows a failsafe before the intended mode is known, and none only because it is not known', () => {
    const critical = status({ mode: 'land', custom_mode: 2, intended_custom_mode: null, system_status: 5 });
    expect(label({ status: critical })).toMatchObject({ title: 'Failsafe: Landing', tone: 'danger' });
    expect(label({ status: { ...critical, system_status: 4 } }).title).toBe('Landing');
  });
});

it('an indicator shows a severity with a word, and unknown values as unknown', () => {
  const reading = (remaining_percent: number | null) => ({
    value: {
      remaining_percent,
      voltage_v: null,
      current_a: null,
      consumed_mah: null,
      time_remaining_s: null,
      cell_voltages_v: null,
      battery_id: 0,
      batteries: [],
    },
    age_s: 0,
    stale: false,
  });
  expect(batteryIndicator(reading(9))).toMatchObject({ severity: 'danger', problem: '≤ 10 %', text: '9 %' });
  expect(batteryIndicator(reading(null)).text).toBe('–');
  expect(batteryIndicator(null).text).toBe('–');
  expect(gpsIndicator({ value: { fix_type: 1, satellites: 3, hdop: null, horizontal_accuracy_m: null }, age_s: 0, stale: false })).toMatchObject({
    text: '3 sats',
    problem: 'no fix',
    severity: 'danger',
  });
});

it('the indicators show the state of the recordings and the counters of the links', () => {
  const link: ServerLink = {
    name: 'a',
    url: 'udpin://x',
    state: 'open',
    detail: '',
    replay: false,
    forward: false,
    guard: false,
    peers: [],
    bytes_received: 5,
    bytes_sent: 0,
    bytes_dropped: 0,
    recording: { file: 'a.tlog', bytes: 2_000_000, started_unix_s: 1000, stopped: null },
    frames_received: 3,
    frames_unknown: 0,
    frames_lost: 0,
    crc_errors: 0,
    bytes_skipped: 0,
    handler_errors: 0,
    frames_sent: 0,
    frames_waiting: 0,
    frames_replaced: 0,
    frames_expired: 0,
    frames_dropped: 0,
    frames_refused: 0,
    frames_unverified: 0,
    signing: null,
  };
  const linkWith = (change: object): ServerLink => ({ ...link, recording: { file: 'a.tlog', bytes: 0, started_unix_s: 1000, stopped: null, ...change } });
  expect(recordingIndicator([], false, 1221).text).toBe('–');
  expect(recordingIndicator([link], true, 1221)).toMatchObject({ text: '03:41', severity: 'none' });
  expect(recordingIndicator([link], true, 1221).details[0]?.[1]).toContain('a.tlog · 2.0 MB');
  expect(recordingIndicator([linkWith({ file: null, started_unix_s: null })], true, 1221).text).toBe('Waiting');
  expect(recordingIndicator([{ ...link, replay: true, recording: null }], true, 1221).text).toBe('None');
  expect(recordingIndicator([{ ...link, recording: null }], true, 1221)).toMatchObject({ text: 'Off', severity: 'caution' });
  const stopped = recordingIndicator([link, linkWith({ stopped: 'disk full' })], true, 1221);
  expect(stopped).toMatchObject({ text: 'Stopped', severity: 'danger' });
  expect(stopped.details[1]?.[1]).toBe('disk full');
  const lines = linkDetails(
    [
      { ...link, frames_received: 98, frames_lost: 2, crc_errors: 1 },
      { ...link, name: 'b', state: 'waiting', detail: 'port taken' },
    ],
    null,
  ).details;
  expect(lines.filter(([name]) => name === '').map(([, value]) => value)).toEqual(['a', 'b']);
  expect(lines).toContainEqual(['Frames', '98 in, 2 lost (2.0 %)']);
  expect(lines).toContainEqual(['CRC errors', '1']);
  expect(lines.some(([, value]) => value.includes('port taken'))).toBe(true);
  expect(lines.some(([name]) => name === 'Signing')).toBe(false);
  const signing = { key: 'field', mode: 'required', link_id: 0, unsigned: 2, wrong_signature: 1, replayed: 0, too_old: 0, too_many_streams: 0 };
  const signedLines = linkDetails(
    [
      { ...link, signing, frames_refused: 3 },
      { ...link, frames_unverified: 4 },
    ],
    null,
  ).details;
  expect(signedLines).toContainEqual(['Signing', 'key field, required; 3 frames refused']);
  expect(signedLines).toContainEqual(['Not verified', '4 signed frames (this link has no key)']);
  expect(linkDetails([link], 12_340).text).toBe('12.3 kB/s');
});
