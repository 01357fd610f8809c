import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { positionAt } from '../../../vehicle/geo';
import { PlanApi } from '../api';
import { EMPTY_PLAN } from '../document/document';
import { withHome } from '../document-kinds';
import * as edit from '../document/edit';
import { PlanEditor } from './editor.svelte';
import { newItem } from '../document/items';
import * as offboard from '../offboard/edit';
import { fieldsOf, missionFields } from '../offboard/fields';
import { nodesOf, type Mission } from '../offboard/mission';
import { addRole, renameRole } from '../offboard/roles';
import { PatternDrawing } from '../patterns/drawing.svelte';
import { PATTERN_KINDS, type PatternKind } from '../patterns/shape';
import { Plans } from '../plans.svelte';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const at = (north_m: number, east_m = 0) => positionAt(HOME, { north_m, east_m });
const AREA = [at(0, 0), at(50, 0), at(50, 80), at(0, 80)];
const AT_40_M = { value_m: 40, reference: 'home' } as const;
const ITEMS = [newItem('waypoint', at(0), AT_40_M), newItem('trigger_distance', null, AT_40_M), newItem('waypoint', at(0, 80), AT_40_M)];
const STEP = { step: 'fly', name: 'Survey line 1', points: [{ lat_deg: 47.4, lon_deg: 8.5, alt_home_m: 40 }] };
const MISSION = {
  format: 'offboard-gcs-mission',
  version: 1,
  name: 'Converted',
  description: '',
  limits: {},
  avoidance: false,
  actions: { failure: 'hold', low_battery: 'return', link_loss: 'hold' },
  tables: {},
  home: HOME,
  fence: [],
  missions: {},
  steps: [{ step: 'take_off', height_m: 10 }, STEP, { ...STEP, name: 'Survey line 2' }, { step: 'land' }],
};

/** The editor with a fake server, and edits that need several calls. */
class Session {
  readonly editor = new PlanEditor();
  private readonly api = new PlanApi(new ApiClient('p', undefined, (url, init) => Promise.resolve(this.respond(url, init.body))));
  private readonly storage = { getItem: () => null, setItem: () => undefined, removeItem: () => undefined };
  readonly plans = new Plans(this.api, this.editor, this.storage);
  private readonly drawing = new PatternDrawing(this.api, this.editor, this.storage);

  private respond(url: string, body: unknown): Response {
    const request = (typeof body === 'string' ? JSON.parse(body) : {}) as { plan?: object };
    const generated = url.includes('offboard_mission') ? { ...MISSION, steps: [STEP] } : { ...EMPTY_PLAN, items: ITEMS };
    const responses: Record<string, unknown> = {
      pattern: { plan: generated, path: [], lines: [], figures: {}, notes: [] },
      convert: { plan: MISSION, notes: [] },
      ground: { plan: { ...request.plan, cruise_speed_m_s: 9 }, resolved: 1, unknown: 0, added: 0, notes: [] },
      import: { plan: { ...EMPTY_PLAN, items: ITEMS, planned_home: HOME }, notes: [], areas: [] },
      abc: { id: 'abc', version: 1, name: 'Saved', plan: { ...EMPTY_PLAN, items: ITEMS.slice(0, 1) } },
    };
    const name = /plans\/(\w+)/.exec(url)?.[1] ?? '';
    return new Response(JSON.stringify(responses[name]), { status: responses[name] === undefined ? 500 : 200 });
  }

  async insertPattern(kind: PatternKind): Promise<void> {
    this.drawing.begin(kind);
    this.drawing.replaceShape(AREA);
    await this.drawing.insert();
  }

  drag(ids: readonly string[], to: readonly [number, number]): void {
    const [grabbed = ''] = ids;
    this.editor.select(ids);
    this.editor.grab(grabbed);
    for (const fraction of [0.3, 0.7, 1]) this.editor.drag(grabbed, at(to[0] * fraction, to[1] * fraction));
    this.editor.drop(true);
  }

  /** The mission that is edited. */
  get mission(): Mission {
    if (this.editor.mission === null) throw new Error('A waypoint plan is edited.');
    return this.editor.mission;
  }
}

type Edits = Readonly<Record<string, (session: Session) => unknown>>;

const PLAN_EDITS: Edits = {
  'begin a plan': ({ editor }) => editor.begin(HOME),
  'add a waypoint by a click': ({ editor }) => editor.press(at(10)),
  'add another waypoint': ({ editor }) => editor.press(at(20, 30)),
  'add a third waypoint': ({ editor }) => editor.press(at(30)),
  'add a take-off': ({ editor }) => editor.addItem('takeoff', HOME),
  'add a jump': ({ editor }) => editor.addItem('jump', null),
  'add a return': ({ editor }) => editor.addItem('return_home', null),
  'insert at a midpoint': ({ editor }) => editor.pick('middle:3', false),
  'delete a waypoint': ({ editor }) => {
    editor.select(['item:2']);
    return editor.remove();
  },
  'move a row up': ({ editor }) => {
    editor.select(['item:2']);
    editor.reorder(-1);
  },
  'move two rows down': ({ editor }) => {
    editor.select(['item:1', 'item:2']);
    editor.reorder(1);
  },
  'drag a waypoint': (session) => session.drag(['item:1'], [70, 20]),
  'drag an inserted waypoint': (session) => session.drag(['middle:1'], [40, -20]),
  'drag several points': (session) => session.drag(['item:1', 'item:2', 'home'], [15, 15]),
  'change a field': ({ editor }) => editor.change(edit.setItem(editor.plan, 1, { hold_s: 4 }), 'hold_s of 1'),
  'change another field': ({ editor }) => editor.change(edit.setItem(editor.plan, 1, { altitude: { ...AT_40_M, value_m: 33 } }), 'altitude of 1'),
  'change the planned speed': ({ editor }) => editor.change({ ...editor.plan, hover_speed_m_s: 6 }, 'planned speed'),
  'rename the plan': ({ editor }) => editor.rename('Field'),
  ...Object.fromEntries(PATTERN_KINDS.map((kind) => [`insert the pattern ${kind}`, (session: Session) => session.insertPattern(kind)])),
  'apply a fix': ({ editor }) => editor.changeAndDeselect(edit.insertItem(editor.plan, 0, newItem('takeoff', HOME, AT_40_M))),
  'resolve altitudes': ({ plans }) => plans.resolveTerrain(5),
};

/** Edits of the parts that both kinds of documents have. */
const SHARED_EDITS: Edits = {
  'add an inclusion zone': ({ editor }) => editor.addZone(true, AREA),
  'add an exclusion zone': ({ editor }) => editor.addZone(false, AREA.slice(0, 3)),
  'add an obstacle': ({ editor }) => editor.addArea('obstacle', AREA),
  'add a circle': ({ editor }) => {
    editor.startPlacing({ type: 'circle' });
    editor.press(at(5, 5));
  },
  'drag a corner': (session) => session.drag(['corner:0:1'], [90, 10]),
  'insert a corner': ({ editor }) => editor.pick('side:0:2', false),
  'delete a corner': ({ editor }) => {
    editor.select(['corner:0:0']);
    return editor.remove();
  },
  'drag a circle': (session) => session.drag(['circle:2'], [9, 9]),
  'change a radius': ({ editor }) => editor.change(edit.setZone(editor.document, 2, { radius_m: 70 }), 'radius of 2'),
  'change a zone': ({ editor }) => editor.change(edit.setZone(editor.document, 1, { inclusion: true })),
  'delete a zone': ({ editor }) => editor.change(edit.removeZone(editor.document, 1)),
  'move home': ({ editor }) => editor.change(withHome(editor.document, { ...HOME, alt_amsl_m: 501 }), 'altitude of home'),
};

const RALLY_EDITS: Edits = {
  'add a rally point': ({ editor }) => {
    editor.startPlacing({ type: 'rally' });
    editor.press(at(60, 60));
  },
  'drag a rally point': (session) => session.drag(['rally:0'], [61, 50]),
  'delete a rally point': ({ editor }) => {
    editor.select(['rally:0']);
    return editor.remove();
  },
  'import a file': ({ plans }) => plans.import(new File(['x'], 'field.kml')),
  'open a saved plan': ({ plans }) => plans.open('abc'),
  'open the plan of a vehicle': ({ plans }) => plans.openFromVehicle('Quad 1', { plan: { ...EMPTY_PLAN, items: ITEMS }, notes: [] } as never, HOME),
  'convert to a mission': ({ plans }) => plans.convert(null),
};

const MISSION_EDITS: Edits = {
  'add a step': ({ editor }) => editor.addStep('hold', null),
  'add a branch': ({ editor }) => editor.addStep('branch', null),
  'add to the branch': ({ editor }) => {
    const node = nodesOf(editor.mission ?? (MISSION as never)).find(({ step }) => step.step === 'branch');
    if (node !== undefined && editor.mission !== null) editor.change(offboard.addToBranch(editor.mission, node, 'otherwise').mission);
  },
  'add a point by a click': ({ editor }) => {
    editor.select(['step:step 2']);
    editor.startPlacing({ type: 'step', kind: 'fly' });
    editor.press(at(40, 40));
  },
  'insert a point at a midpoint': ({ editor }) => editor.pick('between:1:step 2', false),
  'drag a point': (session) => session.drag(['point:points:0:step 2'], [44, 4]),
  'drag several points': (session) => session.drag(['point:points:0:step 2', 'point:points:1:step 2'], [30, 30]),
  'delete a point': ({ editor }) => {
    editor.select(['point:points:1:step 2']);
    return editor.remove();
  },
  'move a step down': ({ editor }) => {
    editor.select(['step:step 2']);
    editor.reorder(1);
  },
  'delete two steps': ({ editor }) => {
    editor.select(['step:step 2', 'step:step 4']);
    return editor.remove();
  },
  'insert a pattern': (session) => session.insertPattern('survey'),
  'insert an orbit': (session) => session.insertPattern('orbit'),
  'add a call': ({ editor }) => editor.addStep('call', null),
  'call a new list of steps': (session) => {
    const node = nodesOf(session.mission).find(({ step }) => step.step === 'call');
    if (node !== undefined) session.editor.change(offboard.addCalledList(session.mission, node));
  },
  'add a role': (session) => session.editor.changeAndDeselect(addRole(session.mission)),
  'rename a role': (session) => session.editor.changeAndDeselect(renameRole(session.mission, 'wing', 'left wing')),
  'begin a mission': ({ editor }) => editor.beginMission(HOME),
};

/** One edit of each field of the mission itself: limits, actions, avoidance, description. */
function missionFieldEdits(mission: Mission): Edits {
  return Object.fromEntries(
    missionFields(mission).map(({ name }) => [
      `change ${name} of the mission`,
      (session: Session) => {
        const field = missionFields(session.mission).find((candidate) => candidate.name === name);
        if (field !== undefined) session.editor.change(field.set(session.mission, otherValue(field)), `${name} of the mission`);
      },
    ]),
  );
}

/** One edit of each of four fields of a trajectory step. */
const STEP_EDITS: Edits = Object.fromEntries(
  ['speed_m_s', 'heading', 'photo_every_m', 'avoidance'].map((name) => [
    `change ${name} of a step`,
    (session: Session) => {
      const node = nodesOf(session.mission).find(({ step }) => step.step === 'fly');
      const field =
        node === undefined
          ? undefined
          : fieldsOf(node.step, { mission: session.mission, frame: session.editor.frame }).find((candidate) => candidate.name === name);
      if (node !== undefined && field !== undefined) session.editor.change(offboard.setStep(session.mission, node, field.set(node.step, otherValue(field))));
    },
  ]),
);

/** A valid value that differs from the present one. */
function otherValue(field: { type: string; value: unknown; options?: readonly { value: string }[]; min?: number }): string | number | boolean {
  if (field.type === 'switch') return field.value !== true;
  if (field.type === 'choice') return field.options?.find(({ value }) => value !== String(field.value))?.value ?? '';
  return field.type === 'text' ? `${String(field.value)} changed` : Math.max(field.min ?? 0, 3) + (field.value === 3 ? 1 : 0);
}

const EDITS: readonly (readonly [string, (session: Session) => unknown])[] = [
  ...Object.entries(PLAN_EDITS),
  ...Object.entries(SHARED_EDITS),
  ...Object.entries(RALLY_EDITS),
  ...Object.entries(STEP_EDITS),
  ...Object.entries(missionFieldEdits(MISSION as unknown as Mission)),
  ...Object.entries(SHARED_EDITS).map(([name, run]) => [`${name} of a mission`, run] as const),
  ...Object.entries(MISSION_EDITS),
];

describe('undo and redo', () => {
  it('restore the exact document before and after every kind of edit', async () => {
    const session = new Session();
    const { editor } = session;
    const text = (): string => JSON.stringify(editor.draft);
    const states = [text()];
    for (const [name, run] of EDITS) {
      await run(session);
      expect(text(), `“${name}” changes the document`).not.toBe(states.at(-1));
      states.push(text());
      editor.endGroup();
      editor.undo();
      expect(text(), `undo of “${name}”`).toBe(states.at(-2));
      editor.redo();
      expect(text(), `redo of “${name}”`).toBe(states.at(-1));
    }
    for (const state of [...states].reverse().slice(1)) {
      expect(editor.canUndo).toBe(true);
      editor.undo();
      expect(text()).toBe(state);
    }
    expect(editor.canUndo).toBe(false);
    for (const state of states.slice(1)) {
      editor.redo();
      expect(text()).toBe(state);
    }
    expect(editor.canRedo).toBe(false);
  });
});
