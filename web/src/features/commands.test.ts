/**
 * Every command of the page × every change of the vehicles × double click and repeated key, at each moment at which the command
 * waits. A seed decides the order. `PAGE_SEEDS` sets the number of orders for each command and change.
 */

import { render } from 'svelte/server';
import { afterAll, describe, expect, it, vi } from 'vitest';
import type { Outcome } from '../api/client';
import type { VehicleFacts } from '../vehicle/facts';
import { EMPTY_PLAN } from './plan/document/document';
import { FakeServer, samplesOf, seeded, stubBrowser, type SentRequest } from '../app/page.fixture';

declare const process: { env: Record<string, string | undefined> };
const SEEDS = Number(process.env['PAGE_SEEDS'] ?? 1);
const CHANGES = ['nothing changes', 'another vehicle is selected', 'the vehicle is removed', 'the vehicle is replaced'] as const;
type Change = (typeof CHANGES)[number];

stubBrowser();
vi.useFakeTimers();
const server = new FakeServer();
vi.stubGlobal('fetch', server.fetch);

const { page } = await import('../app/page.svelte');
const { actions } = await import('../app/vehicle-actions.svelte');
const { provide } = await import('../app/services');
const { vehicleModels } = await import('../app/vehicle-model.svelte');
const { commandTo } = await import('../app/actions/command.svelte');
const { default: Refusal } = await import('../app/Refusal.svelte');
const { offboard, groups } = await import('./offboard/controllers');
const { editor: setpoints } = await import('./offboard/setpoints/editor.svelte');
const { draft } = await import('./offboard/groups/draft.svelte');
const { NEW_DRAFT } = await import('./offboard/groups/group-form');
const { dryRun, editor, plans, vehicleMission } = await import('./plan/controllers');
const { DEFAULT_CONDITIONS } = await import('./plan/dry-run/conditions');
const start = await import('./plan/flight/start-commands');
const { planInFly } = await import('./plan/flight/plan-in-fly.svelte');
const { DEFAULT_VALIDITY } = await import('../vehicle/setpoint');
const { gimbalControl } = await import('./gimbal/controllers');
const { gimbalSetup } = await import('./gimbal/setup/controllers');
const { cameraControl } = await import('./camera/controllers');
const { control } = await import('./control/controllers');
const { paramPanel } = await import('./params/controllers');
const { shellPanel } = await import('./shell/controllers');
const { messageForm } = await import('./inspector/controllers');
const { vehicleFiles } = await import('./files/controllers');
const { readinessPanel } = await import('./readiness/controllers');
const { BATCH_ACTIONS, batchCommand } = await import('./vehicles/batch');
const { vehicleList } = await import('./vehicles/controllers');
const { groundSources, mapPointMenu, mapSources } = await import('./stage/controllers');
const { guided } = await import('./guided/controllers');
const { autotune } = await import('./autotune/controllers');
const { modeMenu } = await import('./modes/controllers');
const { modeGroups } = await import('./modes/mode-texts');
const { holdByStick } = await import('./sticks/controllers');
const { replay } = await import('./replay/controllers');
const { library: flights, vehicleLogs, afterLanding } = await import('./flights/controllers');
const { linkList } = await import('./status/controllers');
const { continueCommand } = await import('./programs/programs.svelte');
const { allowCommand, continueAgentCommand, refuseCommand } = await import('./programs/agents.svelte');

provide('offboard', { start: (facts, streamStart) => offboard.start(facts, streamStart) });
provide('gimbal', gimbalControl);

const GROUP = {
  id: '1',
  created_unix_s: 1,
  state: 'flying',
  findings: [],
  client_key: null,
  mission: null,
  members: ['1', '3'].map((vehicle) => ({ vehicle, role: null, held: false, ordered_type: 'velocity' })),
};
const MISSION = { name: 'Test', steps: [], actions: {}, fence: [], lists: {} } as never;
const AGENT_REQUEST = { id: '7', agent: 'helper', plan_name: 'Round', plan_version: 1, dry_run_age_s: 1, duration_s: 60, findings: 0 } as never;
const OFFER = {
  item: 1,
  title: 'Waypoint',
  count: 4,
  mission_id: 7,
  altitude_m: 10,
  altitude_reference: 'home',
  distance_m: 5,
  interrupted_item: 2,
  interrupted_unix_s: 1,
  cautions: [],
} as const;
const MODE = { name: 'Survey', mode: 'external_1', mission: 'Test', version: 1, takes_off: true, defer_failsafes_s: 0 } as never;
const REQUEST = { key: 'other', client: 'Other', reason: null, answer_left_s: 3 } as never;
const inputs = () => ({ findings: [], acceptedErrors: [], time_s: null });
const fileDraft = (vehicle: string, kind: 'put' | 'remove') =>
  ({ vehicle, kind, path: '/a', existing: null, danger: null, content_base64: '', size_bytes: 0 }) as const;
const stateNow = () => ({ inAir: page.factsNow('1')?.inAir ?? true, current: 1 });

interface PageCommand {
  /** What a click on the command's button calls, with the vehicle 1. */
  readonly click: (facts: VehicleFacts) => unknown;
  /** The vehicles for which the page may send requests; default: 1. */
  readonly vehicles?: readonly string[];
  /** The vehicle is on the ground. */
  readonly onGround?: boolean;
  /** Each click is one of a series. */
  readonly series?: boolean;
}

const COMMANDS: Readonly<Record<string, PageCommand>> = {
  arm: { click: (facts) => actions.request('arm', facts), onGround: true },
  disarm: { click: (facts) => actions.request('disarm', facts), onGround: true },
  'take off': { click: (facts) => actions.request('takeoff', facts), onGround: true },
  land: { click: (facts) => actions.request('land', facts) },
  return: { click: (facts) => actions.request('rtl', facts) },
  hold: { click: (facts) => actions.request('hold', facts) },
  'land now': { click: (facts) => actions.request('land_now', facts) },
  'stop motors': { click: (facts) => actions.request('kill', facts) },
  'take control by force': { click: (facts) => actions.request('force_control', facts) },
  'take control': { click: (facts) => control.take(facts) },
  'request control': { click: (facts) => control.requestControl(facts) },
  'release control': { click: (facts) => control.release(facts) },
  'give control': { click: (facts) => control.grant(facts, REQUEST) },
  'keep control': { click: (facts) => control.deny(facts, REQUEST) },
  'choose a mode': {
    click: (facts) => {
      const row = modeGroups([{ mode: 'mission', label: 'Mission', settable: true, can_run: true, reasons: [] }], facts)[0]?.rows[0];
      if (row !== undefined) modeMenu.choose(row, facts);
    },
  },
  'choose Hold': {
    click: (facts) => {
      const row = modeGroups([{ mode: 'hold', label: 'Hold', settable: true, can_run: true, reasons: [] }], facts)[0]?.rows[0];
      if (row !== undefined) modeMenu.choose(row, facts);
    },
  },
  'go here': {
    click: (facts) => {
      mapPointMenu.open({ lat_deg: 47.401, lon_deg: 8.5, ground_amsl_m: null, scenePixel: null }, facts);
      mapPointMenu.requestGoto(facts);
    },
  },
  ...Object.fromEntries(
    (['go', 'altitude', 'heading', 'speed', 'orbit', 'home'] as const).map((kind): [string, PageCommand] => [
      `guide: ${kind}`,
      {
        click: (facts) => {
          guided.open(kind, facts, { lat_deg: 47.401, lon_deg: 8.5, ground_amsl_m: null });
          if (kind === 'heading') guided.enter('yaw_ned_deg', '90');
          if (kind === 'speed') guided.enter('speed_m_s', '3');
          // The vehicle of these tests streams setpoints, and home does not move then.
          guided.request(kind === 'home' ? { ...facts, offboard: null } : facts);
        },
      },
    ]),
  ),
  'guide: follow': {
    click: (facts) => {
      guided.open('follow', facts);
      guided.change({ leader: page.ids.find((id) => id !== facts.id) ?? '' });
      guided.request({ ...facts, offboard: null });
    },
  },
  'look here': {
    click: (facts) => {
      mapPointMenu.open({ lat_deg: 47.401, lon_deg: 8.5, ground_amsl_m: null, scenePixel: null }, facts);
      return mapPointMenu.lookAt(facts);
    },
  },
  'set ROI': {
    click: (facts) => {
      mapPointMenu.open({ lat_deg: 47.401, lon_deg: 8.5, ground_amsl_m: null, scenePixel: null }, facts);
      return mapPointMenu.setRoi(facts);
    },
  },
  'start autotune': { click: (facts) => autotune.start(facts) },
  'end autotune': { click: (facts) => autotune.end(facts) },
  'clear ROI': { click: (facts) => gimbalControl.clearRoi(facts) },
  'take the gimbal': { click: (facts) => gimbalControl.takeOrRelease(facts, true) },
  'release the gimbal': { click: (facts) => gimbalControl.takeOrRelease(facts, false) },
  'lock yaw': { click: (facts) => gimbalControl.setYawLock(facts, true) },
  'point the gimbal': { click: (facts) => gimbalControl.point(facts, { pitch_deg: -20, yaw_deg: 0 }), series: true },
  'mend the gimbal set-up': {
    onGround: true,
    click: (facts) => gimbalSetup.mend(facts, { code: 'input_none', text: '', changes: [{ name: 'MNT_MODE_IN', value: 4 }], restarts: true }),
  },
  'write reviewed parameters': {
    onGround: true,
    click: (facts) => {
      const rows = [{ name: 'A', state: 'change', old: 1, new: 2 }];
      const review = { vehicle: facts.id, name: facts.name, title: '', rows, undo: false, fixed: actions.gate.fix([facts.id]) };
      Object.assign(gimbalSetup.changes, { openReview: review, chosen: new Set(['A']) });
      return gimbalSetup.changes.write(facts.id, false);
    },
  },
  'restart the vehicle': { onGround: true, click: (facts) => gimbalSetup.changes.restart(facts.id) },
  'ask for the gimbal status': { onGround: true, click: (facts) => gimbalSetup.callModule(facts, 'status') },
  'retract the gimbal': { click: (facts) => gimbalSetup.pose(facts, 'retract') },
  'try an axis': { click: (facts) => gimbalSetup.tryAxis(facts, 'pitch', -10, true), series: true },
  'hold by stick': { click: (facts) => holdByStick(facts) },
  'turn the gimbal by stick': { click: (facts) => gimbalControl.turnAt(facts, 10, 0), series: true },
  'take a photo': { click: (facts) => cameraControl.takePhoto(facts, facts.components[0] as never) },
  'send a MAVLink message': {
    click: (facts) => messageForm.send(page.api, { vehicle: facts.id, message: 'PING', fields: { seq: 1 }, whileArmed: true }),
  },
  'send a line to the console': { click: (facts) => shellPanel.send(page.api, facts.id, 'gimbal status', true) },
  'write a file': { click: (facts) => vehicleFiles.confirm(page.api, fileDraft(facts.id, 'put')) },
  'remove a file': { click: (facts) => vehicleFiles.confirm(page.api, fileDraft(facts.id, 'remove')) },
  'get a file': { click: (facts) => vehicleFiles.get(page.api, facts.id, '/a') },
  'make a folder': { click: (facts) => vehicleFiles.makeFolder(page.api, facts.id, '/b') },
  'set a parameter': { click: (facts) => paramPanel.set(page.api, facts.id, 'MPC_XY_CRUISE', 3) },
  'switch to a ready mode': { click: (facts) => readinessPanel.switchMode(page.api, facts.id, 'hold') },
  'run the checks': { click: (facts) => readinessPanel.check(page.api, facts.id) },
  'erase the logs': { click: (facts) => vehicleLogs.erase(page.api, facts.id) },
  'stream the log': { click: (facts) => vehicleLogs.stream(page.api, facts.id) },
  'stop the log stream': { click: (facts) => vehicleLogs.stopStream(page.api, facts.id) },
  'download the log of a flight': { click: (facts) => afterLanding.download([facts.id]) },
  'decline the log of a flight': { click: (facts) => afterLanding.decline(facts.id) },
  'choose what happens after landings': { click: () => afterLanding.choose('download') },
  'download a log': { click: (facts) => vehicleLogs.download(page.api, facts.id, 0) },
  'hold all flying': { click: (facts) => vehicleList.hold(page.api, [facts]) },
  ...Object.fromEntries(
    BATCH_ACTIONS.map((action): [string, PageCommand] => [
      `${action} several`,
      {
        vehicles: ['1', '3'],
        onGround: action === 'arm' || action === 'takeoff',
        click: () => {
          const vehicles = ['1', '3'].flatMap((id) => page.factsNow(id) ?? []).map((facts) => ({ facts, missionCount: 4 }));
          const command = batchCommand(page.api, action, { ready: vehicles, refused: [] }, () => 10);
          actions.requestCommand({ ...command, stops: false }, 'actionBar');
        },
      },
    ]),
  ),
  'remove a vehicle': { click: (facts) => vehicleList.remove(page.api, facts) },
  'start offboard': { click: (facts) => actions.request('offboard_start', facts, 'offboard') },
  'start offboard with a setpoint': {
    click: (facts) => setpoints.requestStart(facts, { type: 'velocity', velocity_ned_m_s: [1, 0, 0] }, DEFAULT_VALIDITY),
  },
  'move the target': {
    click: (facts) =>
      actions.attempt(
        commandTo(facts, 'Moving the target', () => offboard.nudge(facts, 'north', 1), { series: true }),
        'offboard',
      ),
    series: true,
  },
  'send a setpoint': { click: (facts) => (setpoints.selectVehicle(facts), setpoints.fill(facts), setpoints.sendOrStart(facts, true)) },
  'switch avoidance': { click: (facts) => offboard.setAvoidance(facts.id, true) },
  'set the limits': { click: (facts) => (setpoints.selectVehicle(facts), setpoints.setLimits(facts, {} as never)) },
  'set the failsafe': { click: (facts) => (setpoints.selectVehicle(facts), setpoints.setFailsafe(facts, 'hold' as never, 1)) },
  'start a group': {
    vehicles: ['1', '3'],
    click: () => {
      draft.fields = { ...NEW_DRAFT, members: ['1', '3'], motion: 'velocity' };
      draft.requestStart();
    },
  },
  'send to a group': {
    vehicles: ['1', '3'],
    click: () => {
      draft.fields = { ...NEW_DRAFT, motion: 'velocity' };
      return draft.send(GROUP as never);
    },
  },
  'renew a group': { vehicles: ['1', '3'], click: () => draft.renew(GROUP as never) },
  'hold a group': { vehicles: ['1', '3'], click: () => groups.hold(GROUP as never) },
  'save a plan': { vehicles: [], click: () => plans.save() },
  'save as a new plan': { vehicles: [], click: () => plans.save(true) },
  'save a new version': {
    vehicles: [],
    click: () => {
      if (plans.savedPlan === null)
        (plans as unknown as { setSaved: (id: number, saved: unknown) => void }).setSaved(editor.draft.documentId, {
          id: 'p1',
          version: 1,
          name: '',
          plan: EMPTY_PLAN,
        });
      return plans.save();
    },
  },
  'delete a plan': { vehicles: [], click: () => plans.delete({ id: 'p1', version: 1 } as never) },
  'dry run': { click: (facts) => dryRun.start(editor.document, { vehicle: facts.id }, DEFAULT_CONDITIONS) },
  'hold and upload': { click: (facts) => vehicleMission.upload(facts.id, () => plans.savedVersion(), true) },
  upload: { click: (facts) => vehicleMission.upload(facts.id, () => plans.savedVersion()) },
  'read back': { click: (facts) => vehicleMission.readBack(facts.id, editor.plan, { plan_id: 'p1', version: 1 }) },
  'cancel a transfer': {
    click: () => {
      vehicleMission.transfer = { id: 'o1', state: 'running', kind: 'mission/upload', vehicle: '1' } as never;
      return vehicleMission.cancel();
    },
  },
  'fly the plan': {
    onGround: true,
    click: (facts) => {
      const command = { plan: editor.plan, row: null, missionId: 7, dryRun: null, progress: null, stateNow, ...inputs() };
      actions.requestCommand(start.startPlanCommand(page.api, facts, command), 'actionBar');
    },
  },
  'resume the plan': {
    click: (facts) => actions.requestCommand(start.resumeCommand(page.api, facts, OFFER, inputs()), 'actionBar'),
  },
  ...Object.fromEntries(
    (['resume', 'skip', 'restart'] as const).map((does): [string, PageCommand] => [
      `${does} the plan in the air`,
      {
        click: (facts) => {
          const choice = { does, item: does === 'resume' ? null : does === 'skip' ? 3 : 0 };
          actions.requestCommand(start.continueCommand(page.api, facts, choice, { current: 1, count: 4, mission_id: 7 }, stateNow), 'actionBar');
        },
      },
    ]),
  ),
  'read the plan of the vehicle': { click: (facts) => planInFly.read(facts.id) },
  'fly an offboard mission': {
    click: async (facts) => {
      const mission = new start.OffboardMissionStart(facts, MISSION, { ...inputs(), dryRun: null });
      const given = actions.give([facts.id]);
      const saved = await plans.savedVersion();
      if (saved !== null) actions.requestCommand(await mission.command(page.api, saved), 'actionBar', given);
    },
  },
  'fly with several vehicles': {
    vehicles: ['1', '3'],
    click: async () => {
      const command = start.rolesStart(MISSION, ['lead', 'wing'], { lead: '1', wing: '3' }, (id) => `Quad ${id}`, {
        ...inputs(),
        ifStreamStops: null,
        dry_run: null,
      });
      const given = actions.give(['1', '3']);
      const saved = await plans.savedVersion();
      if (saved !== null) actions.requestCommand(command(page.api, saved), 'actionBar', given);
    },
  },
  ...Object.fromEntries(
    (['pause', 'resume', 'skip', 'go_on', 'abort'] as const).map((command): [string, PageCommand] => [
      `${command} the mission`,
      {
        click: (facts) => {
          const toSend = start.flightCommand(page.api, command, facts);
          return actions.attempt({ ...toSend, stops: false }, 'actionBar');
        },
      },
    ]),
  ),
  'let a program continue': {
    vehicles: [],
    click: (facts) => actions.requestCommand(continueCommand(page.api, facts, { name: 'guard', client: 'Program' } as never), 'programs'),
  },
  'let an agent continue': {
    click: (facts) => actions.requestCommand(continueAgentCommand(page.api, facts, { name: 'helper' } as never), 'agents'),
  },
  'allow the flight of an agent': {
    vehicles: [],
    click: (facts) =>
      actions.requestCommand(
        allowCommand(page.api, facts, AGENT_REQUEST, () => true),
        'agents',
      ),
  },
  'refuse the flight of an agent': {
    vehicles: [],
    click: (facts) => actions.attempt(refuseCommand(page.api, facts, AGENT_REQUEST), 'agents'),
  },
  'select a flight mode': {
    click: (facts) =>
      actions.requestCommand(
        start.selectModeCommand(page.api, MODE, facts, () => facts.inAir),
        'actionBar',
      ),
  },
  'register a flight mode': {
    click: (facts) =>
      actions.attempt(
        commandTo(facts, 'Register flight mode', async (_, fixed): Promise<Outcome<unknown>> => {
          const request = { name: 'Survey', despite: [], defer_failsafes_s: 0 };
          return (await start.registerMode(page.api, facts.id, fixed, () => plans.savedVersion(), request)) ?? { ok: true, value: null };
        }),
        'actionBar',
      ),
  },
  'remove a flight mode': {
    click: (facts) =>
      actions.attempt(
        commandTo(facts, 'Remove flight mode', () => start.removeMode(page.api, facts.id, 'Survey')),
        'actionBar',
      ),
  },
  'choose a map source': { vehicles: [], click: () => mapSources.choose('osm') },
  'add a map source': { vehicles: [], click: () => mapSources.add({ name: 'Field', url: 'http://10.0.0.2/{z}/{x}/{y}', attribution: '', may_save: true }) },
  'remove a map source': { vehicles: [], click: () => mapSources.remove({ id: 'own1' } as never) },
  'choose a source of heights': { vehicles: [], click: () => groundSources.choose('terrain_tiles') },
  'add a source of heights': {
    vehicles: [],
    click: () => groundSources.add({ name: 'Hills', url: 'http://10.0.0.2/{z}/{x}/{y}', attribution: '', may_save: true }),
  },
  'remove a source of heights': { vehicles: [], click: () => groundSources.remove({ id: 'own1' } as never) },
  'save the ground': {
    vehicles: [],
    click: () => {
      groundSources.measured = { region: { source: 'own1' }, tiles: 1, estimated_bytes: 1 } as never;
      return groundSources.save('Field');
    },
  },
  'save an area': {
    vehicles: [],
    click: () => {
      mapSources.measured = { region: { source: 'own1' }, tiles: 1, estimated_bytes: 1 } as never;
      return mapSources.save('Field');
    },
  },
  'add a log': { vehicles: [], click: () => flights.add(new File(['ULog'], 'a.ulg')) },
  'keep the model of a vehicle': { click: (facts) => vehicleModels.keep(facts.id, 'f1-0', null) },
  'forget the model of a vehicle': { click: (facts) => vehicleModels.forget(facts.id) },
  'name a flight': { vehicles: [], click: () => flights.setName('f1-0', 'Bridge') },
  'separate a part of a flight': { vehicles: [], click: () => flights.decide('f1-0', 'f2-1', false) },
  'delete a flight': { vehicles: [], click: () => flights.delete('f1') },
  'open a replay': { vehicles: [], click: () => replay.open('flight.tlog') },
  'close a replay': {
    vehicles: [],
    click: () => {
      page.store.apply({ type: 'replays', replays: [{ name: 'r', vehicles: ['1'] }] as never });
      void replay.close();
      page.store.apply({ type: 'replays', replays: [] });
    },
  },
  'command a replay': {
    vehicles: [],
    click: () => {
      page.store.apply({ type: 'replays', replays: [{ name: 'r', vehicles: ['1'] }] as never });
      replay.setPlaying(false);
      page.store.apply({ type: 'replays', replays: [] });
    },
  },
};

/** Requests that change nothing: the server computes or compares, or reads from the vehicle again; and the page's own settings. */
const COMPUTING = new Set([
  '/vehicles/{v}/files/list',
  '/elevation/regions/size',
  '/settings',
  '/map_regions/size',
  '/map_sources/wmts_layers',
  '/flights/{f}/rerun',
  '/proofs',
  '/vehicles/{v}/futures',
  '/plans/check',
  '/plans/convert',
  '/plans/divide',
  '/plans/ground',
  '/plans/import',
  '/plans/insert',
  '/plans/table',
  '/plans/export',
  '/plans/pattern',
  '/vehicles/{v}/mission/compare',
  '/vehicles/{v}/params/refresh',
  '/vehicles/{v}/param_changes/review',
]);
/** A command that the page gives itself, with its own tests (`dry-run.test.ts`, `vehicle-plan.test.ts`). */
const seenPaths = new Set<string>();

/** The page's view of vehicle 2: what the late answers about vehicle 1 must not change. */
function viewOfOther(): string {
  const facts = page.factsNow('2');
  if (facts === null) return '';
  return JSON.stringify([
    paramPanel.problemOf('2'),
    shellPanel.problemOf('2'),
    messageForm.problemOf('2'),
    messageForm.resultOf('2'),
    vehicleFiles.problemOf('2'),
    vehicleFiles.doneOf('2'),
    readinessPanel.problemOf('2'),
    vehicleMission.problem,
    vehicleMission.missionView?.vehicle ?? '2',
    vehicleMission.transfer,
    vehicleMission.comparison(editor.plan),
    gimbalControl.targetAnglesOf(facts),
    gimbalControl.yawLock(facts),
    gimbalControl.limitNoticeOf(facts),
    gimbalSetup.changes.problemOf('2'),
    gimbalSetup.changes.resultOf('2'),
    gimbalSetup.changes.progressOf('2'),
    gimbalSetup.changes.reviewOf('2'),
    setpoints.offboardView,
    mapPointMenu.mapPoint,
  ]);
}

/** All texts that tell a person why something was not sent. */
function words(): string {
  return JSON.stringify([actions.refusals, plans.notice, vehicleList.result, gimbalSetup.changes.problemOf('1')]);
}

function addVehicles(inAir: boolean): void {
  page.store.connected = true;
  for (const id of ['1', '2', '3']) page.store.apply({ type: 'samples', samples: samplesOf(id, `uid ${id}`, inAir, page.store.nowUnixS()) });
  page.repaintCount += 1;
}

/** The vehicles that a request is for. */
function vehiclesOf({ path, body }: SentRequest): string[] {
  const inPath = /^\/vehicles\/([^/?]+)/.exec(path)?.[1];
  const members = Array.isArray(body['members'])
    ? (body['members'] as { vehicle: string }[])
    : ((body['setpoints'] as { vehicle: string }[] | undefined) ?? []);
  const inBody = Array.isArray(body['vehicles'])
    ? (body['vehicles'] as string[])
    : Object.values((body['vehicles'] as Record<string, string> | undefined) ?? {});
  const single = typeof body['vehicle'] === 'string' ? [body['vehicle']] : [];
  return [...(inPath === undefined ? [] : [inPath]), ...members.map(({ vehicle }) => vehicle), ...inBody, ...single];
}

const isCommand = ({ method, path }: SentRequest): boolean => method !== 'GET' && ![...COMPUTING].some((computing) => matches(computing, path));

function matches(template: string, path: string): boolean {
  const pattern = template.replace(/[.*+?^()|[\]\\]/g, '\\$&').replace(/\$?\{[^}]*\}/g, '[^/?]+');
  return new RegExp(`^${pattern}(\\?.*)?$`).test(path);
}

async function settle(): Promise<void> {
  await vi.advanceTimersByTimeAsync(0);
  for (const listener of page.paintListeners) listener();
  await vi.advanceTimersByTimeAsync(0);
}

function answer(request: SentRequest, refuse: boolean): void {
  const vehicle = vehiclesOf(request)[0] ?? '1';
  const accepted = {
    id: 'p1',
    version: 2,
    vehicle,
    state: request.method === 'GET' && request.path.startsWith('/operations/') ? 'succeeded' : 'running',
    kind: 'mission/download',
    text: '',
    error: null,
    operation: 'o1',
    last: { rows: [], stopped: null, waiting: [], undo_count: 0 },
    members: GROUP.members,
    findings: [],
    name: 'r',
    vehicles: [],
    results: [],
    maps: [],
    unreadable: [],
    part_bytes: 1000,
    flight: 'f1',
  };
  request.answer(refuse ? Response.json({ code: 'rejected', detail: 'Refused.' }, { status: 409 }) : Response.json(accepted));
}

/** Ends the earlier command: its requests get answers, and its confirmation closes. */
async function reset(): Promise<void> {
  actions.cancelConfirmation();
  while (server.open.length > 0) {
    for (const request of server.open) answer(request, true);
    await vi.advanceTimersByTimeAsync(4000);
    actions.cancelConfirmation();
  }
  await settle();
  actions.refusals = {};
  page.store.keepOnly([]);
  page.repaintCount += 1;
  [dryRun.operation, vehicleMission.transfer, plans.notice, vehicleList.result] = [null, null, null, null];
  mapPointMenu.close();
  setpoints.offboardView = null;
  editor.replace('Test', EMPTY_PLAN);
  server.requests = [];
}

const STEPS = ['click again', 'click again', 'change', 'confirm', 'answer', 'answer'] as const;
/** Orders in which the change comes while the command waits for the confirmation, and while it waits for an answer. */
const ORDERS: readonly (readonly (typeof STEPS)[number][])[] = [
  ['click again', 'change', 'confirm', 'answer', 'answer'],
  ['confirm', 'click again', 'change', 'answer', 'answer'],
];

/** @param order the steps after the first click. @param refuses whether the server refuses the next request. */
async function give(command: PageCommand, change: Change, order: readonly (typeof STEPS)[number][], refuses: () => boolean): Promise<void> {
  addVehicles(command.onGround !== true);
  page.select('1');
  vehicleMission.selectVehicle('1');
  const facts = page.factsNow('1') as VehicleFacts;
  await settle();
  server.requests.length = 0;

  const vehicles = command.vehicles ?? ['1'];
  let changedAt: number | null = null;
  let viewBefore = '';
  let wasAsked = false;
  let closedByChange = false;
  void command.click(facts);
  await settle();
  for (const step of [...order, 'confirm', 'answer', 'answer', 'answer']) {
    if (step === 'click again' && changedAt === null) void command.click(facts);
    if (step === 'confirm' && actions.confirmation !== null) {
      wasAsked = true;
      actions.confirmation.slider.slide(1, performance.now() / 1000);
    }
    if (step === 'answer' && server.open[0] !== undefined) answer(server.open[0], refuses());
    if (step === 'change' && change !== 'nothing changes') {
      await settle();
      const isOpen = actions.confirmation !== null;
      changedAt = server.next();
      if (change === 'another vehicle is selected') page.select('2');
      else page.store.apply({ type: 'event', event: { kind: 'vehicle_removed', vehicle: '1', unix_s: 0, severity: null, text: '' } });
      if (change === 'the vehicle is replaced') page.store.apply({ type: 'samples', samples: samplesOf('1', 'another uid', true, page.store.nowUnixS()) });
      page.repaintCount += 1;
      vehicleMission.selectVehicle(page.selectedId);
      const selected = page.facts;
      if (selected !== null) setpoints.selectVehicle(selected);
      await settle();
      if (selected !== null && page.selectedId === '2') {
        setpoints.offboardView = { limits: 'of 2', failsafe: 'of 2' } as never;
        mapPointMenu.open({ lat_deg: 47.4, lon_deg: 8.501, ground_amsl_m: null, scenePixel: null }, selected);
      }
      viewBefore = viewOfOther();
      closedByChange = isOpen && actions.confirmation === null;
      if (isOpen && vehicles.length === 1) expect(closedByChange, 'the confirmation closes').toBe(true);
      if (closedByChange) expect(words(), 'a word says why').toContain('Not sent');
    }
    await settle();
    expect(server.open.length, 'requests do not pile up').toBeLessThan(12);
  }

  for (let open = server.open[0]; open !== undefined; open = server.open[0]) {
    answer(open, false);
    await settle();
  }

  const sent = server.requests.filter(isCommand);
  for (const { method, path } of sent) seenPaths.add(`${method} ${path}`);
  if (change === 'nothing changes' && (wasAsked || vehicles.length > 0)) expect(sent.length, 'the command is sent').toBeGreaterThan(0);
  for (const request of sent) for (const id of vehiclesOf(request)) expect(vehicles, `${request.path} is for ${id}`).toContain(id);
  for (const [index, request] of sent.entries()) {
    const twin = sent
      .slice(0, index)
      .find(({ method, path, answeredAt }) => method === request.method && path === request.path && (answeredAt === null || answeredAt > request.order));
    if (command.series !== true) expect(twin?.path, 'not sent again before its answer').toBeUndefined();
  }
  const sentAfter = sent.filter(({ order }) => changedAt !== null && order > changedAt);
  if (change === 'the vehicle is removed' || change === 'the vehicle is replaced') {
    const toVehicle = sentAfter.filter((request) => vehiclesOf(request).includes('1') || request.path.startsWith('/groups'));
    expect(
      toVehicle.map(({ path }) => path),
      'nothing is sent to another vehicle',
    ).toEqual([]);
    if (vehicles.length > 0 && sent.length === 0) expect(words(), 'a word says why').toMatch(/removed|place of/);
  }
  if (closedByChange)
    expect(
      sentAfter.filter((request) => vehiclesOf(request).length > 0),
      'a closed confirmation sends nothing',
    ).toEqual([]);
  if (change === 'another vehicle is selected') expect(viewOfOther(), 'the view of the other vehicle').toBe(viewBefore);
}

describe.each(Object.entries(COMMANDS))('the command “%s”', (name, command) => {
  it.each(CHANGES)(
    'is sent once, to its vehicles only, when %s',
    async (change) => {
      for (const order of ORDERS) {
        await reset();
        await give(command, change, order, () => false);
      }
      for (let seed = 1; seed <= SEEDS; seed++) {
        const random = seeded(seed * 7919 + name.length * 31 + CHANGES.indexOf(change));
        const order = STEPS.map((step) => [random(), step] as const).sort(([a], [b]) => a - b);
        await reset();
        await give(
          command,
          change,
          order.map(([, step]) => step),
          () => random() < 0.5,
        );
      }
    },
    5000 * (1 + SEEDS),
  );
});

describe('a stop without an answer', () => {
  it('is sent again on a later press, but not on a double click', async () => {
    await reset();
    addVehicles(true);
    const press = async (): Promise<number> => {
      actions.request('hold', page.factsNow('1'));
      await settle();
      return server.requests.filter(isCommand).length;
    };
    expect([await press(), await press()]).toEqual([1, 1]);
    await vi.advanceTimersByTimeAsync(1000);
    expect(await press()).toBe(2);
  });
});

describe('a command refused because of findings', () => {
  const ACCEPTING = ['arm', 'fly the plan', 'resume the plan', 'fly an offboard mission', 'fly with several vehicles', 'select a flight mode'];
  const confirm = async (): Promise<void> => {
    actions.confirmation?.slider.slide(1, performance.now() / 1000);
    await settle();
  };
  const refuse = async (codes: string[], reasons: string[] = []): Promise<void> => {
    for (const request of server.open.filter(isCommand))
      request.answer(Response.json({ code: 'plan_findings', detail: 'It would fly. Nothing was sent.', codes, reasons }, { status: 409 }));
    await settle();
  };
  /** Gives and confirms the command; earlier requests, such as those of a save, are accepted. */
  const give = async ({ click, onGround }: PageCommand): Promise<void> => {
    await reset();
    addVehicles(onGround !== true);
    page.select('1');
    void click(page.factsNow('1') as VehicleFacts);
    await settle();
    for (let round = 0; round < 5 && actions.confirmation === null; round++) {
      if (server.open[0] !== undefined) answer(server.open[0], false);
      await settle();
    }
    await confirm();
  };
  const sent = (): SentRequest[] => server.requests.filter((request) => isCommand(request) && request.path !== '/plans');
  const clickOf = (name: string): PageCommand => COMMANDS[name] as PageCommand;

  it.each(ACCEPTING)('“%s” is sent again with their codes only after a new confirmation that names them', async (name) => {
    await give(clickOf(name));
    await refuse(['first']);
    expect([sent().length, actions.confirmation]).toEqual([1, null]);
    const refusal = actions.refusals['actionBar'];
    expect(render(Refusal, { props: { refusal, onclose: () => undefined, onaccept: () => undefined } as never }).body).toContain('Accept and confirm again…');
    actions.acceptFindings('actionBar');
    await settle();
    expect(sent().length, 'nothing is sent before the confirmation').toBe(1);
    expect(actions.confirmation?.command.texts()).toMatchObject({ effect: expect.stringContaining('You accept this finding: It would fly.'), danger: true });
    await confirm();
    await refuse(['second'], ['Too near.', 'Too far.']);
    actions.acceptFindings('actionBar');
    expect(actions.confirmation?.command.texts().effect).toMatch(/It would fly\. You accept these findings: Too near\. Too far\.$/);
    await confirm();
    const [first, ...again] = sent();
    const withoutCodes = { ...first?.body };
    delete withoutCodes['despite'];
    expect(again.map(({ path, body }) => [path, body])).toEqual([
      [first?.path, { ...withoutCodes, despite: ['first'] }],
      [first?.path, { ...withoutCodes, despite: ['first', 'second'] }],
    ]);
  });

  it.each(['take off', 'land', 'start offboard'])('“%s” offers no acceptance, because its request cannot name it', async (name) => {
    await give(clickOf(name));
    await refuse(['first']);
    expect(actions.refusals['actionBar']?.acceptance ?? null).toBeNull();
  });

  it('is not offered for acceptance if it was refused for another reason', async () => {
    await give(clickOf('arm'));
    server.open.forEach((request) => request.answer(Response.json({ code: 'interrupted', detail: 'Hold was commanded.', codes: ['first'] }, { status: 409 })));
    await settle();
    const refusal = actions.refusals['actionBar'];
    expect(render(Refusal, { props: { refusal, onclose: () => undefined, onaccept: () => undefined } as never }).body).not.toContain('Accept and confirm');
    expect(refusal).toMatchObject({ acceptance: null, problem: { title: 'Interrupted', detail: 'Hold was commanded.' } });
  });

  const CHANGES_OF_STATE: Readonly<Record<string, readonly [string, object]>> = {
    mode: ['status', { armed: false, mode: 'mission', mode_label: 'Mission', landed_state: 'on_ground', link_lost: false }],
    mission: ['mission', { current: 1, count: 4, mission_id: 99 }],
    'current item': ['mission', { current: 2, count: 4 }],
  };
  it.each(Object.entries(CHANGES_OF_STATE))('is not sent if the vehicle’s %s has changed since the refusal', async (_, [topic, value]) => {
    for (const isAsked of [false, true]) {
      await give(clickOf('arm'));
      await refuse(['first']);
      if (isAsked) actions.acceptFindings('actionBar');
      page.store.apply({
        type: 'samples',
        samples: [{ vehicle: '1', topic, vehicle_time_boot_s: null, received_unix_s: page.store.nowUnixS(), value }] as never,
      });
      page.repaintCount += 1;
      await settle();
      if (!isAsked) actions.acceptFindings('actionBar');
      expect(actions.confirmation).toBeNull();
      expect(words()).toContain('has changed since the refusal');
      expect(sent()).toHaveLength(1);
    }
  });

  it('is not sent after another vehicle was selected, or the vehicle was replaced', async () => {
    for (const change of ['select', 'replace']) {
      await give(clickOf('arm'));
      await refuse(['first']);
      if (change === 'select') page.select('2');
      else {
        page.store.apply({ type: 'event', event: { kind: 'vehicle_removed', vehicle: '1', unix_s: 0, severity: null, text: '' } });
        page.store.apply({ type: 'samples', samples: samplesOf('1', 'another uid', false, page.store.nowUnixS()) });
        page.repaintCount += 1;
      }
      actions.acceptFindings('actionBar');
      await settle();
      expect([actions.confirmation, sent().length]).toEqual([null, 1]);
      expect(words()).toContain('Not sent');
    }
  });
});

describe('a save', () => {
  const sent = () => server.requests.filter(isCommand).map(({ method, path, body }) => [method, path, body['base_version']]);
  it('of one draft is one plan, however often it is given', async () => {
    await reset();
    const saves = [plans.save(), plans.save(), plans.savedVersion()];
    await settle();
    expect(sent()).toEqual([['POST', '/plans', undefined]]);
    for (const request of server.open) answer(request, false);
    expect(new Set(await Promise.all(saves)).size).toBe(1);
    await settle();
    expect(sent()).toHaveLength(1);
  });
  it('of a changed draft follows the earlier save as a version of the same plan', async () => {
    await reset();
    void plans.save();
    editor.rename('Changed');
    void plans.save();
    await settle();
    expect(sent()).toEqual([['POST', '/plans', undefined]]);
    for (const request of server.open) answer(request, false);
    await settle();
    expect(sent()).toEqual([
      ['POST', '/plans', undefined],
      ['PUT', '/plans/p1', 2],
    ]);
  });
});

describe('a link', () => {
  const CONFIRM = 'link field closes, vehicle 1 in flight loses its last link';
  const sent = () => server.requests.filter(isCommand);
  it('is added once, and that of a vehicle in flight is removed only after the confirmation that says so', async () => {
    await reset();
    void linkList.add(' udpin://0.0.0.0:14550 ', '');
    void linkList.add('udpin://0.0.0.0:14550', '');
    await settle();
    expect(sent().map(({ body }) => body)).toEqual([{ url: 'udpin://0.0.0.0:14550', name: null }]);
    while (server.open.length > 0) {
      for (const request of server.open) answer(request, false);
      await settle();
    }
    void linkList.remove('field');
    await settle();
    const detail = "Vehicle 1 is armed or flown by setpoints, and link 'field' is its last link. The link stays open.";
    sent()
      .at(-1)
      ?.answer(Response.json({ code: 'refused', detail, remedy: `To close it anyway, send confirm='${CONFIRM}'.` }, { status: 409 }));
    while (server.open.length > 0) {
      await settle();
      for (const request of server.open) answer(request, false);
    }
    await settle();
    expect([linkList.confirmation?.detail, linkList.problem]).toEqual([detail, null]);
    void linkList.confirmed();
    await settle();
    expect(sent().map(({ method, path }) => `${method} ${decodeURIComponent(path).replaceAll('+', ' ')}`)).toEqual([
      'POST /links',
      'DELETE /links/field',
      `DELETE /links/field?confirm=${CONFIRM}`,
    ]);
    for (const { method, path } of sent()) seenPaths.add(`${method} ${path}`);
    sent()
      .at(-1)
      ?.answer(new Response(null, { status: 204 }));
    await settle();
    expect(linkList.confirmation).toBeNull();
  });
});

describe('the page', () => {
  const sources = import.meta.glob<string>(['../**/*.{ts,svelte}', '!../**/*.test.ts'], { query: '?raw', import: 'default', eager: true });
  const callsOf = (source: string): string[] =>
    [...source.matchAll(/\.(post|put|delete)\(\s*(?:'(\/[^']+)'|`(\/[^`]+)`)/g)].map(
      ([, method, path, template]) => `${method?.toUpperCase()} ${path ?? template}`,
    );

  it('sends no command that these tests do not give', () => {
    const calls = Object.values(sources).flatMap(callsOf);
    expect(calls.length).toBeGreaterThan(40);
    const untested = calls.filter((call) => {
      const [method = '', template = ''] = call.split(/ (.*)/);
      if (COMPUTING.has(template)) return false;
      return ![...seenPaths].some((seen) => seen.startsWith(`${method} `) && matches(template, seen.slice(method.length + 1)));
    });
    expect(untested).toEqual([]);
  });
  it('sends commands from no component, where these tests cannot give them', () => {
    const inComponents = Object.entries(sources).flatMap(([file, source]) =>
      file.endsWith('.svelte') ? callsOf(source).map((call) => `${file}: ${call}`) : [],
    );
    expect(inComponents).toEqual([]);
  });
});

afterAll(() => vi.useRealTimers());
