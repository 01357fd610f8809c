/** Plans on the server: the edited one, its save state, the server's findings, import and export. */

import type { Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { WireEvent } from '../../live/wire';
import type { Area, Check, Format, ResolvedPlan, Imported, PlanApi, PlanVersion } from './api';
import { DEFAULT_CONDITIONS, powerOf, type Conditions } from './dry-run/conditions';
import { EMPTY, type PlannedHome } from './document/document';
import type { Draft, PlanEditor } from './editor/editor.svelte';
import { homeOf, type Document } from './document-kinds';
import type { Downloaded } from './flight/plan-transfer.svelte';
import { isMission, roleNames, type StepNode } from './offboard/mission';
import { frameOf } from './offboard/positions';
import { MAX_TABLES, withTable } from './offboard/tables';
import { fixed } from '../../ui/format';

/** A plan as it was last read or written. */
interface SavedPlan {
  readonly id: string;
  readonly version: number;
  readonly name: string;
  readonly plan: Document;
}

/** A message below the plan's name, with the possible next steps. */
export interface Notice {
  readonly tone: 'danger' | 'caution' | 'ok';
  readonly text: string;
  /** Another client saved the plan: the person can open that version, or save this one as a new plan. */
  readonly conflict?: boolean;
  /** An older version is open: saving makes it the newest. */
  readonly older?: boolean;
  /** The imported file has points without an altitude. */
  readonly file?: File;
  readonly areas?: readonly Area[];
}

/** Stored in the browser, so that a reload keeps it. */
interface Stored {
  readonly name: string;
  readonly plan: Document;
  readonly kept: { readonly id: string; readonly version: number } | null;
  readonly saved: boolean;
}

type Memory = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;
const STORED = 'gcs.plan-draft';
const STORED_CONDITIONS = 'gcs.plan-conditions';

export class Plans {
  /** Saved versions by document of the history, because undo can return to an earlier document. */
  private savedPlans = $state.raw<Readonly<Record<number, SavedPlan>>>({});
  list = $state.raw<readonly PlanVersion[] | null>(null);
  notice = $state.raw<Notice | null>(null);
  busy = $state(false);
  private answer = $state.raw<Check | null>(null);
  /** The document that `check` belongs to. */
  private checked = $state.raw<Document | null>(null);
  private checkedDocument = $state.raw(-1);
  private checkedInputs = $state.raw('');
  checkProblem = $state.raw<string | null>(null);
  /** A check is running; later changes are checked after it. */
  checking = $state(false);
  /** The vehicle whose parameters and home the check uses; null: none. */
  vehicle = $state.raw<string | null>(null);
  conditions = $state.raw<Conditions>(DEFAULT_CONDITIONS);

  constructor(
    private readonly api: PlanApi,
    private readonly editor: PlanEditor,
    private readonly memory: Memory,
  ) {
    this.restore();
  }

  readonly current: SavedPlan | null = $derived.by(() => this.savedPlans[this.editor.draft.document] ?? null);
  readonly saved: boolean = $derived.by(() => {
    const { plan, name } = this.editor.draft;
    if (this.current === null && isMission(plan)) return plan.steps.length === 0 && roleNames(plan).length === 0;
    if (this.current === null && !isMission(plan)) return plan.items.length === 0 && plan.fence.length === 0 && plan.rally_points.length === 0;
    if (this.current === null) return false;
    return this.current.plan === plan && this.current.name === name;
  });
  /** The server's check of this document, in its present or an earlier state. */
  readonly check: Check | null = $derived.by(() => (this.checkedDocument === this.editor.draft.document ? this.answer : null));
  /** The vehicle and the power values that the check used. */
  private readonly checkInputs: string = $derived.by(() => JSON.stringify([this.vehicle, powerOf(this.conditions)]));
  readonly isChecked: boolean = $derived.by(() => this.checked === this.editor.document && this.checkedInputs === this.checkInputs);

  begin(home: PlannedHome | null): void {
    this.editor.begin(home);
    this.notice = null;
  }

  beginMission(home: PlannedHome | null): void {
    this.editor.beginMission(home);
    this.notice = null;
  }

  /** Converts the edited waypoint plan to an offboard mission; undo restores the plan. */
  async convert(vehicle: string | null): Promise<boolean> {
    const { name } = this.editor.draft;
    const answer = await this.call(this.api.convert(this.editor.plan, nameOf(name), vehicle));
    if (!answer.ok) {
      this.showProblem('The offboard mission was not created.', answer.problem);
      return false;
    }
    this.editor.replace(name, answer.value.plan);
    const notes = answer.value.notes.join(' ');
    this.notice = { tone: notes === '' ? 'ok' : 'caution', text: `Converted to an offboard mission. It is not saved yet. ${notes}`.trim() };
    return true;
  }

  async refresh(): Promise<void> {
    const answer = await this.api.list();
    if (answer.ok) this.list = answer.value.plans;
    else this.showProblem('The list of plans could not be read.', answer.problem);
  }

  async open(id: string): Promise<boolean> {
    const answer = await this.call(this.api.open(id));
    if (!answer.ok) {
      this.showProblem('The plan could not be opened.', answer.problem);
      return false;
    }
    const { name, version, plan } = answer.value;
    const whole = isMission(plan) ? plan : { ...EMPTY, ...plan };
    this.setSaved(this.editor.replace(name, whole), { id, version, name, plan: whole });
    this.notice = null;
    return true;
  }

  /** The saved versions of a plan, newest first; null: see `notice`. */
  async versions(id: string): Promise<readonly PlanVersion[] | null> {
    const answer = await this.call(this.api.versions(id));
    if (answer.ok) return answer.value.versions;
    this.showProblem('The versions of the plan could not be read.', answer.problem);
    return null;
  }

  /** Opens an older version without saving it. Saving then adds a new version after the newest one. */
  async openVersion({ id, version, changed_by }: PlanVersion, newest: PlanVersion): Promise<boolean> {
    const answer = await this.call(this.api.open(id, version));
    if (!answer.ok) {
      this.showProblem(`Version ${version} could not be opened.`, answer.problem);
      return false;
    }
    const { name, plan } = answer.value;
    this.setSaved(this.editor.replace(name, isMission(plan) ? plan : { ...EMPTY, ...plan }), { id, version: newest.version, name, plan: { ...EMPTY } });
    const text = `Version ${version} of ${newest.version}, saved by ${changed_by}. If you save it, it becomes version ${newest.version + 1}.`;
    this.notice = { tone: 'caution', text, older: true };
    return true;
  }

  /** @param asNew saves it as another plan. */
  async save(asNew = false): Promise<void> {
    const draft = this.editor.draft;
    const kept = asNew ? null : this.current;
    const name = nameOf(draft.name);
    const answer = await this.call(kept === null ? this.api.create(name, draft.plan) : this.api.save(kept.id, name, draft.plan, kept.version));
    if (!answer.ok) {
      const conflict = answer.problem.code === 'conflict';
      this.showProblem(conflict ? '' : 'Not saved.', answer.problem, conflict);
      return;
    }
    this.setSaved(draft.document, { id: answer.value.id, version: answer.value.version, name: draft.name, plan: draft.plan });
    this.notice = { tone: 'ok', text: `Saved as version ${answer.value.version}.` };
  }

  async delete(plan: PlanVersion): Promise<void> {
    const answer = await this.call(this.api.delete(plan.id, plan.version));
    if (!answer.ok) return this.showProblem('Not deleted.', answer.problem);
    for (const [document, kept] of Object.entries(this.savedPlans)) if (kept.id === plan.id) this.removeSaved(Number(document));
    await this.refresh();
  }

  /** @param altitude_m altitude above home for points without one; null: the server refuses such a file. */
  async import(file: File, altitude_m: number | null = null): Promise<boolean> {
    const answer = await this.call(this.api.import(file, altitude_m));
    if (!answer.ok) {
      const open = altitude_m === null && answer.problem.detail.includes('altitude');
      this.showProblem(`“${file.name}” was not imported.`, answer.problem);
      if (open && this.notice !== null) this.notice = { ...this.notice, file };
      return false;
    }
    this.openImported(file.name.replace(/\.[^.]*$/, ''), answer.value);
    return true;
  }

  /** Makes a step of the mission fly the trajectory in a CSV or NumPy file, as one change. */
  async importTable(file: File, node: StepNode): Promise<boolean> {
    const [draft, mission] = [this.editor.draft, this.editor.mission];
    const answer = await this.call(this.api.importTable(file));
    const what = `“${file.name}” was not imported.`;
    if (!answer.ok) {
      this.showProblem(what, answer.problem);
      return false;
    }
    const changed = mission === null || this.editor.draft !== draft;
    const next = changed ? null : withTable(mission, node, answer.value);
    if (next === null) {
      const why = changed ? 'The plan was changed during the request. Try again.' : `A mission has at most ${MAX_TABLES} tables. Split the mission.`;
      this.notice = { tone: 'caution', text: `${what} ${why}` };
      return false;
    }
    this.editor.change(next);
    const { rows, duration_s, has_yaw } = answer.value;
    this.notice = { tone: 'ok', text: `“${file.name}”: ${rows} rows, ${fixed(duration_s, 1)} s, ${has_yaw ? 'with' : 'without'} yaw.` };
    return true;
  }

  /** Opens the vehicle's plan as a new plan; undo restores the edited one. */
  openFromVehicle(vehicleName: string, { plan, plan_name, notes }: Downloaded, home: PlannedHome | null): void {
    this.editor.replace(plan_name?.name ?? `From ${vehicleName}`, { ...EMPTY, ...plan, planned_home: plan.planned_home ?? home });
    const text = [`Opened the plan of ${vehicleName}. It is not saved on the server yet.`, ...notes].join(' ');
    this.notice = { tone: notes.length > 0 ? 'caution' : 'ok', text };
  }

  /** @returns the file; null: the server could not write it, see `notice`. */
  async export(format: Format): Promise<Blob | null> {
    const answer = await this.call(this.api.export(this.editor.document, format));
    if (!answer.ok) {
      this.showProblem('Not exported.', answer.problem);
      return null;
    }
    const notes = answer.value.notes.join(' ');
    this.notice = notes === '' ? null : { tone: 'caution', text: notes };
    return answer.value.file;
  }

  /**
   * Resolves altitudes above terrain with the server's elevation files.
   * @param tolerance_m waypoints are added where a straight line deviates more from its height above ground; null:
   * none are added.
   */
  async followGround(tolerance_m: number | null): Promise<boolean> {
    const { draft, plan } = this.editor;
    const answer = await this.call(this.api.followGround(plan, tolerance_m));
    if (!answer.ok) {
      this.showProblem('The altitudes were not computed.', answer.problem);
      return false;
    }
    if (this.editor.draft !== draft) {
      this.notice = { tone: 'caution', text: 'The altitudes were not computed, because the plan was changed during the request. Try again.' };
      return false;
    }
    this.editor.change(answer.value.plan);
    this.notice = groundNotice(answer.value);
    return true;
  }

  /** Checks the present plan on the server; one check at a time. */
  async runCheck(): Promise<void> {
    const { document: number, plan } = this.editor.draft;
    const inputs = this.checkInputs;
    if (this.checking) return;
    this.checking = true;
    const answer = await this.api.check(plan, this.vehicle, powerOf(this.conditions));
    this.checking = false;
    [this.checked, this.checkedDocument, this.checkedInputs] = [plan, number, inputs];
    this.answer = answer.ok ? answer.value : null;
    this.checkProblem = answer.ok ? null : problemText('Not checked.', answer.problem);
  }

  /** Reads the parameters that a check did not know, and checks again. */
  async readParameters(vehicle: string): Promise<void> {
    const answer = await this.call(this.api.readParameters(vehicle));
    if (!answer.ok) return this.showProblem('The parameters were not read.', answer.problem);
    await this.runCheck();
  }

  /** Stored in the browser, because they belong to the operator's aircraft. */
  setConditions(conditions: Conditions): void {
    this.conditions = conditions;
    this.memory.setItem(STORED_CONDITIONS, JSON.stringify(conditions));
  }

  /** Updates the mission's position and compiled path for the map; the path of another document is removed. */
  compile(vehicleHome: PlannedHome | null): void {
    const flight = this.check?.flight ?? null;
    this.editor.compiled = { flight, isCurrent: this.isChecked };
    this.editor.frame = frameOf(this.editor.mission, vehicleHome ?? homeOf(this.editor.document), flight?.origin ?? null);
  }

  /** Handles the event that a client saved or deleted a plan. */
  onEvent(event: WireEvent, ownKey: string | null): void {
    if (event.kind !== 'plan_changed') return;
    if (this.list !== null) void this.refresh();
    const plan = event['plan'] as PlanVersion | undefined;
    const mine = event['client_key'] === ownKey;
    if (mine || plan === undefined || plan.id !== this.current?.id) return;
    const who = String(event['client']);
    if (event['action'] === 'deleted') {
      this.removeSaved(this.editor.draft.document);
      this.notice = { tone: 'caution', text: `${who} deleted this plan. Save yours to keep it as a new plan.` };
    } else
      this.notice = {
        tone: 'caution',
        text: `${who} saved version ${plan.version} of this plan. Yours is based on version ${this.current.version}.`,
        conflict: true,
      };
  }

  /** Stores the draft for the next load of the page. */
  store(draft: Draft): void {
    const stored: Stored = { name: draft.name, plan: draft.plan, kept: this.current, saved: this.saved };
    try {
      this.memory.setItem(STORED, JSON.stringify({ ...stored, kept: stored.kept === null ? null : { id: stored.kept.id, version: stored.kept.version } }));
    } catch {
      this.memory.removeItem(STORED); // too large for this browser: an older draft would be wrong
    }
  }

  private restore(): void {
    try {
      const known = JSON.parse(this.memory.getItem(STORED_CONDITIONS) ?? '{}') as Conditions;
      this.conditions = { ...DEFAULT_CONDITIONS, ...known };
      const stored = JSON.parse(this.memory.getItem(STORED) ?? 'null') as Stored | null;
      if (stored === null || !(isMission(stored.plan) ? Array.isArray(stored.plan.steps) : Array.isArray(stored.plan.items))) return;
      const plan = isMission(stored.plan) ? stored.plan : { ...EMPTY, ...stored.plan };
      const document = this.editor.load(stored.name, plan);
      if (stored.kept !== null) this.setSaved(document, { ...stored.kept, name: stored.name, plan: stored.saved ? plan : EMPTY });
    } catch {
      this.memory.removeItem(STORED);
      this.memory.removeItem(STORED_CONDITIONS);
    }
  }

  private openImported(name: string, { plan, notes, areas }: Imported): void {
    this.editor.replace(isMission(plan) ? plan.name : name, isMission(plan) ? plan : { ...EMPTY, ...plan });
    this.notice = notes.length > 0 || areas.length > 0 ? { tone: 'caution', text: notes.join(' ') || 'The file contains areas.', areas } : null;
  }

  private setSaved(document: number, kept: SavedPlan): void {
    this.savedPlans = { ...this.savedPlans, [document]: kept };
  }

  private removeSaved(document: number): void {
    this.savedPlans = Object.fromEntries(Object.entries(this.savedPlans).filter(([one]) => Number(one) !== document));
  }

  private async call<T>(request: Promise<Outcome<T>>): Promise<Outcome<T>> {
    this.busy = true;
    const answer = await request;
    this.busy = false;
    return answer;
  }

  private showProblem(what: string, problem: Problem, conflict = false): void {
    this.notice = { tone: 'danger', text: problemText(what, problem), conflict };
  }
}

function nameOf(name: string): string {
  return name.trim() === '' ? 'Plan' : name.trim();
}

function groundNotice({ resolved, unknown, added, notes }: ResolvedPlan): Notice {
  const missing =
    unknown === 0
      ? []
      : [`${unknown} ${unknown === 1 ? 'altitude is' : 'altitudes are'} still unknown. Put elevation files of this area into the data folder.`];
  const waypoints = added === 0 ? '' : `, ${added} ${added === 1 ? 'waypoint' : 'waypoints'} added`;
  const text = [
    `${resolved} ${resolved === 1 ? 'altitude' : 'altitudes'} above the ground computed from elevation data${waypoints}.`,
    ...missing,
    ...notes,
  ].join(' ');
  return { tone: unknown === 0 && notes.length === 0 ? 'ok' : 'caution', text };
}

function problemText(what: string, problem: Problem): string {
  // Without an answer it is unknown whether a command was executed; a request about plans can simply be repeated.
  const why = problem.code === 'unreachable' ? ['The server did not answer.', 'Is it still running?'] : [problem.detail, problem.remedy];
  return [what, ...why].filter((part) => part !== null && part !== '').join(' ');
}
