import { describe, expect, it } from 'vitest';
import type { VehicleFacts } from '../../../vehicle/facts';
import { buildSetpoint, formFromCurrentState, setUncontrolled, type Form } from './form';
import { parseTyped } from '../../../vehicle/fields';
import { KINDS, kindName } from '../../../vehicle/setpoint-kinds';
import { bodyToNed, previewOf, previewOnMap, previewText } from './preview';
import { SentLog, setpointText } from './sent-log';
import { SetpointSocket, type Ack, type SocketLike } from './setpoint-socket';
import { targetOf, eulerOf, Traces, WINDOW_S } from './traces';

const reading = <T>(value: T): { value: T; age_s: number; stale: boolean } => ({ value, age_s: 0, stale: false });
const FACTS = {
  id: '1',
  localPosition: reading({ position_ned_m: [10, 20, -5], velocity_ned_m_s: [0, 0, 0] }),
  attitude: reading({ roll_rad: 0, pitch_rad: 0, yaw_ned_rad: Math.PI / 2 }),
  globalPosition: reading({ lat_deg: 47, lon_deg: 8, alt_amsl_m: 505, alt_home_m: 5 }),
} as unknown as VehicleFacts;

function validSetpoint(form: Form): Record<string, unknown> {
  const result = buildSetpoint(form);
  if (!result.ok) throw new Error(JSON.stringify(result.errors));
  return { ...result.setpoint };
}

function errorsOf(form: Form): Readonly<Record<string, string>> {
  const result = buildSetpoint(form);
  return result.ok ? {} : result.errors;
}

const withField = (form: Form, key: string, text: string, isUncontrolled = false): Form => ({
  ...form,
  fields: { ...form.fields, [key]: { text, isUncontrolled } },
});

describe('forms', () => {
  it('start with the vehicle’s current state', () => {
    expect(validSetpoint(formFromCurrentState('position', FACTS, null))).toEqual({ type: 'position', position_ned_m: [10, 20, -5], yaw_ned_rad: Math.PI / 2 });
    expect(validSetpoint(formFromCurrentState('velocity', FACTS, null))['velocity_ned_m_s']).toEqual([0, 0, 0]);
    expect(validSetpoint(formFromCurrentState('position_global', FACTS, null))).toMatchObject({ lat_deg: 47, lon_deg: 8, alt_home_m: 5 });
    expect(validSetpoint(formFromCurrentState('attitude', FACTS, 0.55))).toEqual({
      type: 'attitude',
      roll_rad: 0,
      pitch_rad: 0,
      yaw_ned_rad: Math.PI / 2,
      thrust: 0.55,
    });
  });

  it('build a setpoint of every type from complete numbers', () => {
    for (const { kind, quantities } of KINDS.filter((k) => k.quantities.length > 0)) {
      const setpoint = validSetpoint({ ...formFromCurrentState(kind, FACTS, 0.5), followedVehicle: '2' });
      expect(setpoint['type']).toBe(kind);
      for (const { field, optional } of quantities) if (!optional && field !== 'alt') expect(setpoint).toHaveProperty(field);
    }
    expect(errorsOf(formFromCurrentState('actuators', FACTS, 0.5))).toHaveProperty('kind');
  });

  it('negate up values for NED, and convert degrees to radians', () => {
    expect(validSetpoint(withField(formFromCurrentState('position', FACTS, null), 'p2', '12,5'))['position_ned_m']).toEqual([10, 20, -12.5]);
    expect(validSetpoint(withField(formFromCurrentState('rates', FACTS, 0.5), 'r2', '−90'))['rates_frd_rad_s']).toEqual([0, 0, -Math.PI / 2]);
    expect(validSetpoint({ ...formFromCurrentState('position', FACTS, null), yaw: '270' })['yaw_ned_rad']).toBeCloseTo(-Math.PI / 2);
    expect(validSetpoint({ ...formFromCurrentState('velocity', FACTS, null), yawChoice: 'rate', yaw: '90' })).toMatchObject({
      yaw_rate_ned_rad_s: Math.PI / 2,
    });
    expect(validSetpoint({ ...formFromCurrentState('velocity', FACTS, null), yawChoice: 'none' })).not.toHaveProperty('yaw_ned_rad');
  });

  it('allow an uncontrolled axis if another quantity controls it; north and east change together', () => {
    const partialForm = setUncontrolled({ ...formFromCurrentState('trajectory', FACTS, null), omittedFields: ['acceleration_ned_m_s2'] }, 'p1', true);
    expect(validSetpoint(setUncontrolled(partialForm, 'v2', true))).toMatchObject({ position_ned_m: [null, null, -5], velocity_ned_m_s: [0, 0, null] });
    expect(errorsOf({ ...partialForm, omittedFields: ['velocity_ned_m_s', 'acceleration_ned_m_s2'] })).toMatchObject({
      p0: expect.stringMatching(/^North is not controlled/) as string,
      p1: expect.any(String) as string,
    });
    expect(validSetpoint(withField(formFromCurrentState('velocity', FACTS, null), 'v2', '1', true))['velocity_ned_m_s']).toEqual([0, 0, -1]);
  });

  it('report the invalid field, and leave fields of unknown values empty', () => {
    expect(errorsOf(withField(formFromCurrentState('position', FACTS, null), 'p1', 'far'))).toEqual({ p1: 'East: enter a number.' });
    expect(errorsOf(withField(formFromCurrentState('attitude', FACTS, 0.5), 'thrust', '1.2'))).toEqual({
      thrust: 'Thrust (0 to 1): enter a number from 0 to 1.',
    });
    expect(errorsOf(formFromCurrentState('attitude', FACTS, null))).toEqual({ thrust: 'Thrust (0 to 1): enter a number.' });
    expect(errorsOf(formFromCurrentState('position', { ...FACTS, localPosition: null }, null))).toHaveProperty('p0');
    expect(parseTyped(' 1e400 ')).toBeNull();
  });

  it('require a vehicle and an offset of at least 2 m for the type follow', () => {
    const form = formFromCurrentState('follow', FACTS, null);
    expect(errorsOf(form)).toEqual({ followedVehicle: 'Choose the vehicle to follow.' });
    expect(validSetpoint({ ...form, followedVehicle: '2', followYaw: 'face' })).toEqual({
      type: 'follow',
      offset_frd_m: [-5, 0, -2],
      vehicle: '2',
      yaw: 'face',
    });
    expect(errorsOf({ ...withField(withField(form, 'o0', '1'), 'o2', '1'), followedVehicle: '2' })).toHaveProperty('o0');
    expect(previewOf({ type: 'follow', offset_frd_m: [-5, 0, -2] }, FACTS)).toBeNull();
  });

  it('contain feedforward only if the person chooses it', () => {
    const form = formFromCurrentState('trajectory', FACTS, null);
    expect(validSetpoint(form)).not.toHaveProperty('velocity_ned_m_s');
    expect(validSetpoint({ ...form, omittedFields: ['acceleration_ned_m_s2'] })['velocity_ned_m_s']).toEqual([0, 0, 0]);
  });
});

describe('preview', () => {
  it('rotates an offset along the heading', () => {
    expect(bodyToNed([1, 0, -2], Math.PI / 2).map((v) => v + 0)).toEqual([expect.closeTo(0), expect.closeTo(1), -2]);
    const preview = previewOf({ type: 'position_body', offset_frd_m: [3, 0, -1], yaw_offset_rad: 0.5 }, FACTS);
    expect(preview?.position_ned_m).toEqual([expect.closeTo(10), expect.closeTo(23), -6]);
    expect(preview?.yaw_ned_rad).toBeCloseTo(Math.PI / 2 + 0.5);
  });

  it('shows the position that a velocity reaches, and marks it as extrapolated', () => {
    const preview = previewOf({ type: 'velocity', velocity_ned_m_s: [1, null, -1], yaw_rate_ned_rad_s: 0 }, FACTS);
    expect(preview).toMatchObject({ position_ned_m: [13, 20, -8], isExtrapolated: true });
    expect(preview && previewText(preview, FACTS)).toBe('3.0 m away after 3 s at this velocity, 3.0 m above the vehicle');
  });

  it('is null for an attitude, and without the vehicle’s position', () => {
    expect(previewOf({ type: 'attitude', roll_rad: 0 }, FACTS)).toBeNull();
    expect(previewOf({ type: 'position', position_ned_m: [0, 0, 0] }, { ...FACTS, localPosition: null })).toBeNull();
  });

  it('shows a global position setpoint in the local frame and on the map', () => {
    const preview = previewOf({ type: 'position_global', lat_deg: 47.0001, lon_deg: 8, alt_amsl_m: 515, yaw_ned_rad: 0 }, FACTS);
    expect(preview?.position_ned_m[0]).toBeCloseTo(10 + 11.12, 1);
    expect(preview?.position_ned_m[2]).toBeCloseTo(-15);
    const mapPosition = preview && previewOnMap(preview, FACTS);
    expect(mapPosition?.lat_deg).toBeCloseTo(47.0001, 6);
    expect(preview && previewText(preview, FACTS)).toBe('11.1 m away, 10.0 m above the vehicle, turns 90° left');
  });
});

class FakeSocket implements SocketLike {
  readyState = 1;
  bufferedAmount = 0;
  onopen: SocketLike['onopen'] = null;
  onclose: SocketLike['onclose'] = null;
  onmessage: SocketLike['onmessage'] = null;
  sent: Record<string, unknown>[] = [];
  send(data: string): void {
    this.sent.push(JSON.parse(data) as Record<string, unknown>);
  }
  close(): void {
    this.readyState = 3;
  }
  receive(value: unknown): void {
    this.onmessage?.({ data: typeof value === 'string' ? value : JSON.stringify(value) } as MessageEvent);
  }
}

describe('the setpoint socket', () => {
  function openSocket(): { setpointSocket: SetpointSocket; fakeSocket: FakeSocket; acks: Ack[]; endReasons: (string | null)[]; passTime: (s: number) => void } {
    const fakeSocket = new FakeSocket();
    const acks: Ack[] = [];
    const endReasons: (string | null)[] = [];
    let now_s = 0;
    const setpointSocket = new SetpointSocket(
      'ws://x',
      () => now_s,
      (a) => acks.push(a),
      (state, reason) => {
        if (state === 'closed') endReasons.push(reason);
      },
      () => fakeSocket,
    );
    return {
      setpointSocket,
      fakeSocket,
      acks,
      endReasons,
      passTime: (s) => {
        now_s += s;
      },
    };
  }

  it('numbers its setpoints and matches each acknowledgement to its setpoint by seq', () => {
    const { setpointSocket, fakeSocket, acks, passTime } = openSocket();
    expect(setpointSocket.send({ type: 'velocity' })).toBe(1);
    passTime(0.02);
    fakeSocket.receive({ seq: 1, applied: { type: 'velocity' }, limited: ['slower'] });
    fakeSocket.receive({ seq: 1, applied: {} });
    fakeSocket.receive('{');
    expect(fakeSocket.sent).toEqual([{ type: 'velocity', seq: 1 }]);
    expect(acks).toEqual([{ seq: 1, applied: { type: 'velocity' }, limited: ['slower'], problem: null, superseded: false, roundTrip_s: 0.02 }]);
  });

  it('reports a refusal with the server’s text', () => {
    const { setpointSocket, fakeSocket, acks } = openSocket();
    setpointSocket.send({});
    fakeSocket.receive({ seq: 1, error: { title: 'Another client has control', detail: 'Vehicle 1 is controlled by tablet.', code: 'not_in_control' } });
    expect(acks[0]?.problem).toMatchObject({ detail: 'Vehicle 1 is controlled by tablet.' });
    expect(acks[0]?.applied).toBeNull();
  });

  it('drops setpoints that the network cannot send in time', () => {
    const { setpointSocket, fakeSocket } = openSocket();
    fakeSocket.bufferedAmount = 5000;
    expect(setpointSocket.send({})).toBeNull();
    expect(setpointSocket.droppedCount).toBe(1);
    fakeSocket.bufferedAmount = 0;
    fakeSocket.readyState = 0;
    expect(setpointSocket.send({})).toBeNull();
    expect(fakeSocket.sent).toEqual([]);
  });

  it('reports its end once, with the reason', () => {
    const { setpointSocket, fakeSocket, endReasons } = openSocket();
    fakeSocket.onclose?.({ reason: '' } as CloseEvent);
    setpointSocket.close();
    expect(endReasons).toEqual(['The connection to the server ended.']);
  });
});

describe('the log of sent setpoints', () => {
  it('merges the repeated setpoints of a gamepad into one line, and keeps the note that one was limited', () => {
    const log = new SentLog();
    const lineId = log.add('gamepad', { type: 'velocity_body', velocity_frd_m_s: [1, 0, 0] }, 100);
    log.addResult(lineId, { note: 'slowed to 2 m/s', refused: false, roundTrip_s: 0.01 });
    expect(log.add('gamepad', { type: 'velocity_body', velocity_frd_m_s: [2, 0, 0] }, 100.04)).toBe(lineId);
    log.addResult(lineId, { note: null, refused: false, roundTrip_s: 0.02 });
    expect(log.lines).toHaveLength(1);
    expect(log.lines[0]).toMatchObject({ count: 2, resultCount: 2, note: 'slowed to 2 m/s', roundTrip_s: 0.02 });
    log.add('gamepad', { type: 'velocity_body', velocity_frd_m_s: [0, 0, 0] }, 102);
    log.add('form', { type: 'position' }, 102.1);
    expect(log.lines.map((l) => l.count)).toEqual([1, 1, 2]);
  });

  it('describes a setpoint in the form’s units', () => {
    expect(setpointText({ type: 'position', position_ned_m: [1, null, -3], yaw_ned_rad: -Math.PI / 2 })).toBe(
      'Position  N 1.0 E – up 3.0 m from local origin  yaw 270°',
    );
    expect(setpointText({ type: 'rates', rates_frd_rad_s: [0, 0, Math.PI], thrust: 0.5 })).toBe('Body rates  roll 0.0 pitch 0.0 yaw 180.0 °/s  thrust 0.50');
    expect(kindName('orbit')).toBe('orbit');
  });

  it('keeps the newest 60 lines', () => {
    const log = new SentLog();
    for (let i = 0; i < 100; i += 1) log.add('form', { type: 'position' }, i);
    expect(log.lines).toHaveLength(60);
  });
});

describe('traces', () => {
  const sample = (unix_s: number, up_m: number, targetUp_m: number | null): Parameters<Traces['add']>[0] => ({
    unix_s,
    local: { position_ned_m: [0, 0, -up_m], velocity_ned_m_s: [0, 0, 0] } as never,
    attitude: null,
    target: targetUp_m === null ? null : { position_ned_m: [0, 0, -targetUp_m], velocity_ned_m_s: null, attitude_rad: null },
  });

  it('keep one minute, oldest first, up positive, with a gap while there is no target', () => {
    const traces = new Traces();
    traces.add(sample(0, 1, null));
    traces.add(sample(50, 2, 3));
    traces.add(sample(50, 9, 9));
    traces.add(sample(100, 4, null));
    expect(traces.columns('position', 2, 100)).toEqual([
      [-50, -49, 0],
      [3, null, null],
      [2, null, 4],
    ]);
    expect(traces.columns('position', 2, 100 + WINDOW_S + 1)[0]).toEqual([]);
    traces.clear();
    expect(traces.columns('position', 2, 100)[0]).toEqual([]);
  });

  it('have a gap where the yaw jumps from 180° to −180°', () => {
    const traces = new Traces();
    [170, 179, -179].forEach((deg, i) =>
      traces.add({ ...sample(i, 0, null), attitude: { roll_rad: 0, pitch_rad: 0, yaw_ned_rad: deg * (Math.PI / 180) } as never }),
    );
    expect(traces.columns('attitude', 2, 2)[2].map((v) => v && Math.round(v))).toEqual([170, 179, null]);
  });

  it('read an attitude from a quaternion or a yaw, and rotate a body velocity to NED', () => {
    expect(eulerOf([Math.SQRT1_2, 0, 0, Math.SQRT1_2])).toEqual([0, 0, expect.closeTo(Math.PI / 2)]);
    expect(targetOf(null, null)).toBeNull();
    const stream = { streaming: true, position_ned_m: null, velocity_ned_m_s: null, yaw_ned_rad: 1 } as never;
    expect(targetOf(stream, { type: 'position' })?.attitude_rad).toEqual([null, null, 1]);
    const rotated = targetOf({ ...(stream as object), velocity_frd_m_s: [2, 0, -1] } as never, null, Math.PI / 2);
    expect(rotated?.velocity_ned_m_s).toEqual([expect.closeTo(0), 2, -1]);
  });
});
