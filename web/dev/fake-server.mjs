// A simulated server for work on the page: plausible telemetry, and a response to every POST. Development only.
// PORT (default 8090). It also serves ../gcs_server/static, with the strict CSP that the real server sends.
import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { extname, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';
import { WebSocketServer } from 'ws';

const root = fileURLToPath(new URL('../../gcs_server/static', import.meta.url));
const now = () => Date.now() / 1000;
const CSP =
  "default-src 'self'; connect-src 'self'; img-src 'self'; style-src 'self'; script-src 'self'; font-src 'self'; object-src 'none'; base-uri 'none'; frame-ancestors 'self'";
const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css', '.svg': 'image/svg+xml', '.woff2': 'font/woff2', '.txt': 'text/plain' };
const HOME = { lat_deg: 47.397742, lon_deg: 8.545594, alt_amsl_m: 488.1 };
const PORT = Number(process.env.PORT ?? 8090);
const scenario = process.env.SCENARIO ?? 'ground';

class FakeVehicle {
  constructor(id, north, east) {
    Object.assign(this, {
      id,
      armed: false,
      mode: 'hold',
      pos: [north, east, 0],
      goal: [north, east, 0],
      yaw: 0.6,
      start: now(),
      stream: null,
      gimbal: { p: -0.5, y: 0.5, rp: 0, ry: 0, owner: null, lock: false },
      battery: 82,
      silent: false,
    });
  }
  step(dt) {
    const before = [...this.pos];
    const speed = this.mode === 'offboard' || this.mode === 'rtl' ? 4 : 1.5;
    const d = this.goal.map((g, i) => g - this.pos[i]);
    const gap = Math.hypot(...d);
    if (this.armed && gap > 1e-3) this.pos = this.pos.map((p, i) => p + (d[i] / gap) * Math.min(gap * 1.2 * dt, speed * dt));
    this.vel = this.pos.map((p, i) => (p - before[i]) / dt);
    if (this.armed && (this.mode === 'land' || this.mode === 'rtl') && -this.pos[2] < 0.05) {
      this.armed = false;
      this.mode = 'hold';
      event(this.id, 'status_text', 'Disarmed by landing');
    }
    if (this.mode === 'takeoff' && gap < 0.2) {
      this.mode = 'hold';
      event(this.id, 'status_text', 'Takeoff completed');
    }
    this.gimbal.p += this.gimbal.rp * dt;
    this.gimbal.y += this.gimbal.ry * dt;
    if (this.stream && now() > this.stream.until) {
      this.stream = null;
      this.mode = 'hold';
      event(this.id, 'warning', 'Setpoint expired: holding', 4);
    }
    this.battery = Math.max(5, this.battery - (this.armed ? dt * 0.02 : 0));
  }
  samples() {
    const t = now(),
      [n, e, d] = this.pos,
      v = this.vel ?? [0, 0, 0],
      wob = Math.sin(t * 1.3) * 0.05;
    const flying = -d > 0.2,
      roll = wob + v[1] * 0.04,
      pitch = -v[0] * 0.05 + wob / 2;
    const label = { hold: 'Hold', takeoff: 'Take off', land: 'Land', rtl: 'Return', offboard: 'Offboard' }[this.mode];
    const all = {
      status: {
        armed: this.armed,
        mode: this.mode,
        mode_label: label,
        custom_mode: 1,
        intended_custom_mode: null,
        landed_state: flying ? (this.mode === 'takeoff' ? 'taking_off' : this.mode === 'land' ? 'landing' : 'in_air') : 'on_ground',
        system_status: 3,
        link_lost: false,
        last_heartbeat_age_s: 0.2,
      },
      attitude: { roll_rad: roll, pitch_rad: pitch, yaw_ned_rad: this.yaw, q_ned_frd: [1, 0, 0, 0], rates_frd_rad_s: [0, 0, 0] },
      local_position: { position_ned_m: this.pos, velocity_ned_m_s: v },
      global_position: {
        lat_deg: HOME.lat_deg + n / 111195,
        lon_deg: HOME.lon_deg + e / 75270,
        alt_amsl_m: HOME.alt_amsl_m - d,
        alt_home_m: -d,
        velocity_ned_m_s: v,
        heading_deg: (this.yaw * 57.2958 + 360) % 360,
      },
      gps: { fix_type: 3, satellites: 14, hdop: 0.7, horizontal_accuracy_m: 0.8 },
      battery: { remaining_percent: Math.round(this.battery), voltage_v: 16.1, current_a: 14.2, consumed_mah: 410, time_remaining_s: 840 },
      home: { ...HOME, position_ned_m: [0, 0, 0] },
      hud: { groundspeed_m_s: Math.hypot(v[0], v[1]), airspeed_m_s: 0, climb_m_s: -v[2], throttle_percent: 49 },
      health: { sensors_present: 1, sensors_enabled: 1, sensors_healthy: 1, ready_to_arm: true, cpu_load: 0.3 },
      identity: this.identity(),
      gimbal: {
        gimbal_device_id: 1,
        roll_rad: 0,
        pitch_rad: this.gimbal.p,
        yaw_frd_rad: this.gimbal.y,
        yaw_ned_rad: this.gimbal.y + this.yaw,
        q: [1, 0, 0, 0],
        yaw_in_earth_frame: false,
        yaw_lock: this.gimbal.lock,
        primary_control: this.gimbal.owner,
        secondary_control: null,
        flags: 0,
        pitch_min_rad: -1.92,
        pitch_max_rad: 0.5,
        yaw_min_rad: -2.6,
        yaw_max_rad: 2.6,
        component_id: 1,
        gimbals: [],
      },
      offboard: this.stream
        ? {
            state: 'streaming',
            streaming: true,
            rate_hz: 50,
            rate_achieved_hz: 49.8 + Math.random() * 0.4,
            setpoint: this.stream.setpoint,
            valid_for_s: this.stream.valid,
            valid_left_s: this.stream.until - t,
            on_expiry: this.stream.on_expiry,
            if_stream_stops: '1 s after the last setpoint the vehicle lands at its current position (COM_OBL_RC_ACT 0, no RC transmitter).',
            client: 'page',
          }
        : { state: 'idle', streaming: false },
    };
    return Object.entries(all).map(([topic, value]) => ({ vehicle: this.id, topic, vehicle_time_boot_s: t - this.start, received_unix_s: t, value }));
  }
  identity() {
    return {
      system_id: Number(this.id),
      component_id: 1,
      autopilot: 12,
      vehicle_type: 2,
      uid: null,
      simulated: true,
      replayed: this.id === '3',
      firmware: '1.16.0',
      capabilities: null,
      warnings: [],
    };
  }
}

const vehicles = new Map([
  ['1', new FakeVehicle('1', 0, 0)],
  ['2', new FakeVehicle('2', -8, 10)],
]);
const clients = new Set(),
  messages = [];
const send = (frame) => {
  const text = JSON.stringify(frame);
  for (const c of clients) c.send(text);
};
function event(vehicle, kind, text, severity = 6) {
  const e = { kind, vehicle, unix_s: now(), severity, text };
  messages.push(e);
  send({ type: 'event', event: e });
}
const refuse = (status, body) => ({ status, body: { type: 'about:blank', status, ...body } });

function post(v, command, body) {
  const setStream = (b) => {
    v.stream = { setpoint: b.setpoint, until: now() + b.valid_for_s, valid: b.valid_for_s, on_expiry: b.on_expiry };
    v.goal = b.setpoint.position_ned_m;
    v.yaw = b.setpoint.yaw_ned_rad ?? v.yaw;
  };
  switch (command) {
    case 'arm':
      if (scenario === 'refuse')
        return refuse(409, {
          title: 'Rejected',
          code: 'rejected',
          detail: 'The vehicle refused to arm.',
          reasons: ['Preflight Fail: ekf2 missing data', 'Arming denied: Resolve system health failures first'],
          remedy: 'Wait for a valid position estimate, then arm again.',
        });
      v.armed = true;
      break;
    case 'disarm':
      if (-v.pos[2] > 0.2)
        return refuse(409, { title: 'Rejected', code: 'rejected', detail: 'Disarming denied: not landed', reasons: [], remedy: 'Land first.' });
      v.armed = false;
      break;
    case 'takeoff':
      v.armed = true;
      v.mode = 'takeoff';
      v.goal = [v.pos[0], v.pos[1], -body.alt_home_m];
      break;
    case 'land':
      v.mode = 'land';
      v.stream = null;
      v.goal = [v.pos[0], v.pos[1], 0];
      break;
    case 'rtl':
      v.mode = 'rtl';
      v.stream = null;
      v.goal = [0, 0, 0];
      break;
    case 'hold':
      v.mode = 'hold';
      v.stream = null;
      v.goal = [...v.pos];
      break;
    case 'kill':
      v.armed = false;
      v.pos[2] = 0;
      break;
    case 'offboard/start':
      setStream(body);
      v.mode = 'offboard';
      break;
    case 'offboard/setpoint':
      setStream(body);
      break;
    case 'gimbal/take':
      v.gimbal.owner = [255, 190];
      break;
    case 'gimbal/release':
      v.gimbal.owner = null;
      break;
    case 'gimbal/angles':
      Object.assign(v.gimbal, { p: body.pitch_deg / 57.2958, y: body.yaw_deg / 57.2958 - (body.yaw_lock ? v.yaw : 0), rp: 0, ry: 0, lock: body.yaw_lock });
      break;
    case 'gimbal/rates':
      Object.assign(v.gimbal, { rp: body.pitch_rate_deg_s / 57.2958, ry: body.yaw_rate_deg_s / 57.2958, lock: body.yaw_lock });
      break;
    default:
      return refuse(404, { title: 'Not Found', detail: command });
  }
  event(v.id, 'command', `${command} by page: done`);
  return { status: 200, body: { ok: true } };
}

async function api(request, path) {
  const [, kind, id, ...rest] = path.split('/');
  if (kind === 'links')
    return {
      status: 200,
      body: {
        links: [
          {
            name: 'udpin-14550',
            url: 'udpin://127.0.0.1:14550',
            state: 'open',
            detail: '',
            replay: false,
            forward: false,
            peers: ['127.0.0.1:18570'],
            bytes_received: 1234567,
            bytes_sent: 4000,
            bytes_dropped: 0,
            recording: { file: 'fake.tlog', bytes: 1234567, started_unix_s: Date.now() / 1000 - 221, stopped: null },
          },
        ],
      },
    };
  if (kind === 'warnings') return { status: 200, body: { warnings: [] } };
  if (kind !== 'vehicles') return { status: 200, body: {} };
  if (!id)
    return {
      status: 200,
      body: {
        vehicles: [...vehicles.values()].map((v) => ({ id: v.id, identity: v.identity(), topics: Object.fromEntries(v.samples().map((s) => [s.topic, s])) })),
      },
    };
  const v = vehicles.get(id);
  if (!v) return refuse(404, { title: 'Unknown vehicle', detail: id });
  if (request.method === 'GET' && rest[0] === 'gimbal') return { status: 200, body: { in_control: v.gimbal.owner !== null } };
  if (request.method === 'GET') return { status: 200, body: rest[0] === 'messages' ? { messages: messages.filter((m) => m.vehicle === id) } : { samples: [] } };
  let text = '';
  for await (const chunk of request) text += chunk;
  await new Promise((r) => setTimeout(r, 350));
  return post(v, rest.join('/'), text ? JSON.parse(text) : {});
}

const server = createServer(async (request, response) => {
  const path = new URL(request.url, 'http://x').pathname;
  if (path.startsWith('/api/v1')) {
    const { status, body } = await api(request, path.slice(7));
    return response.writeHead(status, { 'Content-Type': 'application/json' }).end(JSON.stringify(body));
  }
  if (path.startsWith('/scene')) {
    if (process.env.SCENE !== '1') return response.writeHead(502).end();
    return response.writeHead(200, { 'Content-Type': 'text/html' }).end('<!doctype html><html><body>3D</body></html>');
  }
  try {
    const file = normalize(path === '/' ? '/index.html' : path);
    const data = await readFile(root + file);
    response.writeHead(200, { 'Content-Type': TYPES[extname(file)] ?? 'application/octet-stream', 'Content-Security-Policy': CSP }).end(data);
  } catch {
    response.writeHead(404).end();
  }
});
const wss = new WebSocketServer({ server, path: '/api/v1/telemetry' });
wss.on('connection', (socket) => {
  socket.send(JSON.stringify({ type: 'hello', schema_version: 1, server_time_unix_s: now() }));
  clients.add(socket);
  socket.on('close', () => clients.delete(socket));
});
setInterval(() => {
  for (const v of vehicles.values()) v.step(0.04);
  send({ type: 'samples', samples: [...vehicles.values()].filter((v) => !v.silent).flatMap((v) => v.samples()) });
}, 40);

const one = vehicles.get('1');
event('1', 'status_text', 'Ready for takeoff');
if (scenario === 'flying') {
  Object.assign(one, { armed: true, mode: 'offboard', pos: [2, 3, -8], goal: [12, 40.5, -12.5], yaw: 0.7 });
  one.gimbal.owner = [255, 190];
  one.stream = {
    setpoint: { type: 'position', position_ned_m: [12, 40.5, -12.5], yaw_ned_rad: 1.29 },
    until: now() + 3600,
    valid: 3600,
    on_expiry: { action: 'hold', hold_for_s: 5 },
  };
  event('1', 'status_text', 'Takeoff detected');
  event('1', 'status_text', 'High wind: landing is advised', 4);
  event('1', 'event', 'Navigation failure: check the magnetometer', 3);
  setTimeout(() => (vehicles.get('2').silent = true), 1500);
}
server.listen(PORT, '127.0.0.1', () => console.log(`fake station on http://127.0.0.1:${PORT} (${scenario})`));
