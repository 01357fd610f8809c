/** The plans on the server, and requests about the edited plan: save, check, import, export. */

import type { Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { WireEvent } from '../../live/wire';
import type { Area, AreaUse, Check, Format, ResolvedPlan, ImportAnswer, ImportedFile, PlanApi, PlanVersion } from './api';
import { DEFAULT_CONDITIONS, powerOf, type Conditions } from './dry-run/conditions';
import { EMPTY_PLAN, type PlannedHome } from './document/document';
import type { Draft, PlanEditor } from './editor/editor.svelte';
import { homeOf, type Document } from './document-kinds';
import type { DownloadedPlan } from './flight/vehicle-mission.svelte';
import { isMission, roleNames, type StepNode } from './offboard/mission';
import { missionFrameOf } from './offboard/positions';
import { MAX_TABLES, withTable } from './offboard/edit';
import { fixed } from '../../ui/format';

/** A plan as it was last read from the server or saved there. */
export interface SavedPlan {
  readonly id: string;
  readonly version: number;
  readonly name: string;
  readonly plan: Document;
}

/** A message below the plan's name, and what the person can do next. */
export interface Notice {
  readonly tone: 'danger' | 'caution' | 'ok';
  readonly text: string;
  /** Another client saved the plan: the person can open the saved version, or save the edited plan as a new plan. */
  readonly conflict?: boolean;
  /** An older version is open. */
  readonly olderVersion?: boolean;
  /** A file that was not imported, because points have no altitude, or because the reference of its altitudes is unknown. */
  readonly question?: { readonly file: File; readonly missing: 'altitude_m' | 'altitude_reference' };
  /** Areas in an imported file whose use a person must choose. */
  readonly areas?: readonly Area[];
  /** What stays of `text` when all areas have a use; empty: the notice then closes. */
  readonly lastingText?: string;
}

/** The draft as it is stored in the browser for the next load of the page. */
interface StoredDraft {
  readonly name: string;
  readonly plan: Document;
  /** The saved version that the draft is based on; null: none. */
  readonly kept: { readonly id: string; readonly version: number } | null;
  readonly saved: boolean;
}

type BrowserStorage = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;
const DRAFT_KEY = 'gcs.plan-draft';
const CONDITIONS_KEY = 'gcs.plan-conditions';

export class Plans {
  /** Saved version of each document in the history, by document id: undo can return to an earlier document. */
  private savedPlans = $state.raw<Readonly<Record<number, SavedPlan>>>({});
  list = $state.raw<readonly PlanVersion[] | null>(null);
  notice = $state.raw<Notice | null>(null);
  /** Number of requests without an answer. */
  private requestCount = $state(0);
  readonly busy: boolean = $derived.by(() => this.requestCount > 0);
  /** The plans that are being deleted. */
  private readonly deletedIds = new Set<string>();
  /** The save without an answer: the draft, and whether it is saved as a new plan. */
  private saving: { readonly draft: Draft; readonly asNewPlan: boolean; readonly saved: Promise<SavedPlan | null> } | null = null;
  private checkResult = $state.raw<Check | null>(null);
  /** The document of the newest check. */
  private checkedDocument = $state.raw<Document | null>(null);
  private checkedDocumentId = $state.raw(-1);
  /** `currentInputs` at the newest check. */
  private checkedInputs = $state.raw('');
  checkProblem = $state.raw<string | null>(null);
  /** A check is running. */
  checking = $state(false);
  /** The vehicle whose parameters and home the check uses; null: none. */
  vehicle = $state.raw<string | null>(null);
  conditions = $state.raw<Conditions>(DEFAULT_CONDITIONS);

  constructor(
    private readonly api: PlanApi,
    private readonly editor: PlanEditor,
    private readonly storage: BrowserStorage,
  ) {
    this.restore();
  }

  /** Null: the server does not have the open plan. */
  readonly savedPlan: SavedPlan | null = $derived.by(() => this.savedPlans[this.editor.draft.documentId] ?? null);
  /** The edited plan has no unsaved changes; also true for a new plan without content. */
  readonly saved: boolean = $derived.by(() => {
    const { plan, name } = this.editor.draft;
    if (this.savedPlan === null && isMission(plan)) return plan.steps.length === 0 && roleNames(plan).length === 0;
    if (this.savedPlan === null && !isMission(plan)) return plan.items.length === 0 && plan.fence.length === 0 && plan.rally_points.length === 0;
    if (this.savedPlan === null) return false;
    return this.savedPlan.plan === plan && this.savedPlan.name === name;
  });
  /** Result of the newest check of the open plan; while `isChecked` is false, the server checked an earlier state of the plan. */
  readonly check: Check | null = $derived.by(() => (this.checkedDocumentId === this.editor.draft.documentId ? this.checkResult : null));
  /** The vehicle and the power values that the next check uses. */
  private readonly currentInputs: string = $derived.by(() => JSON.stringify([this.vehicle, powerOf(this.conditions)]));
  readonly isChecked: boolean = $derived.by(() => this.checkedDocument === this.editor.document && this.checkedInputs === this.currentInputs);

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
    const draft = this.editor.draft;
    const { name } = draft;
    const failure = 'The offboard mission was not created.';
    const response = await this.whileBusy(this.api.convert(this.editor.plan, nameOrDefault(name), vehicle));
    if (!response.ok) {
      this.showProblem(failure, response.problem);
      return false;
    }
    if (this.editor.draft !== draft) {
      this.notice = { tone: 'caution', text: `${failure} The plan was changed during the request. Try again.` };
      return false;
    }
    this.editor.replace(name, response.value.plan);
    const notes = response.value.notes.join(' ');
    this.notice = { tone: notes === '' ? 'ok' : 'caution', text: `Converted to an offboard mission. It is not saved yet. ${notes}`.trim() };
    return true;
  }

  async refresh(): Promise<void> {
    const response = await this.api.list();
    if (response.ok) this.list = response.value.plans;
    else this.showProblem('The list of plans could not be read.', response.problem);
  }

  async open(id: string): Promise<boolean> {
    const response = await this.whileBusy(this.api.open(id));
    if (!response.ok) {
      this.showProblem('The plan could not be opened.', response.problem);
      return false;
    }
    const { name, version, plan } = response.value;
    const withDefaults = isMission(plan) ? plan : { ...EMPTY_PLAN, ...plan };
    this.setSaved(this.editor.replace(name, withDefaults), { id, version, name, plan: withDefaults });
    this.notice = null;
    return true;
  }

  /** The saved versions of a plan, newest first; null: they were not read, see `notice`. */
  async versions(id: string): Promise<readonly PlanVersion[] | null> {
    const response = await this.whileBusy(this.api.versions(id));
    if (response.ok) return response.value.versions;
    this.showProblem('The versions of the plan could not be read.', response.problem);
    return null;
  }

  /** Opens an older version without saving it. When the person saves it, it becomes the newest version. */
  async openVersion({ id, version, changed_by }: PlanVersion, newestVersion: PlanVersion): Promise<boolean> {
    const response = await this.whileBusy(this.api.open(id, version));
    if (!response.ok) {
      this.showProblem(`Version ${version} could not be opened.`, response.problem);
      return false;
    }
    const { name, plan } = response.value;
    this.setSaved(this.editor.replace(name, isMission(plan) ? plan : { ...EMPTY_PLAN, ...plan }), {
      id,
      version: newestVersion.version,
      name,
      plan: { ...EMPTY_PLAN }, // not the opened plan, so that the older version counts as not saved
    });
    const text = `Version ${version} of ${newestVersion.version}, saved by ${changed_by}. If you save it, it becomes version ${newestVersion.version + 1}.`;
    this.notice = { tone: 'caution', text, olderVersion: true };
    return true;
  }

  /**
   * Saves the edited plan as it is now. A second call for the same draft waits for the first one; the save of a changed draft
   * follows the earlier one, so that both are versions of one plan.
   * @param asNewPlan true: saves a new plan, not a new version.
   * @returns the saved version of this draft; null: it was not saved, see `notice`.
   */
  save(asNewPlan = false): Promise<SavedPlan | null> {
    const draft = this.editor.draft;
    const earlier = this.saving;
    if (earlier?.draft === draft && earlier.asNewPlan === asNewPlan) return earlier.saved;
    const saved = (earlier === null ? Promise.resolve() : earlier.saved).then(() => this.saveDraft(draft, asNewPlan));
    const saving = { draft, asNewPlan, saved };
    this.saving = saving;
    void saved.then(() => {
      if (this.saving === saving) this.saving = null;
    });
    return saved;
  }

  /** The saved version of the edited plan as it is now; saves it if necessary. Null: it was not saved, see `notice`. */
  async savedVersion(): Promise<SavedPlan | null> {
    return this.saved && this.savedPlan !== null ? this.savedPlan : this.save();
  }

  private async saveDraft(draft: Draft, asNewPlan: boolean): Promise<SavedPlan | null> {
    const base = asNewPlan ? null : (this.savedPlans[draft.documentId] ?? null);
    const name = nameOrDefault(draft.name);
    const response = await this.whileBusy(base === null ? this.api.create(name, draft.plan) : this.api.save(base.id, name, draft.plan, base.version));
    if (!response.ok) {
      const conflict = response.problem.code === 'conflict';
      this.showProblem(conflict ? '' : 'Not saved.', response.problem, conflict);
      return null;
    }
    const saved = { id: response.value.id, version: response.value.version, name: draft.name, plan: draft.plan };
    this.setSaved(draft.documentId, saved);
    this.notice = { tone: 'ok', text: `Saved as version ${saved.version}.` };
    return saved;
  }

  async delete(plan: PlanVersion): Promise<void> {
    if (this.deletedIds.has(plan.id)) return;
    this.deletedIds.add(plan.id);
    const response = await this.whileBusy(this.api.delete(plan.id, plan.version));
    this.deletedIds.delete(plan.id);
    if (!response.ok) return this.showProblem('Not deleted.', response.problem);
    for (const [documentId, saved] of Object.entries(this.savedPlans)) if (saved.id === plan.id) this.removeSaved(Number(documentId));
    await this.refresh();
  }

  /**
   * Opens the plan in a file as a new plan.
   * @param answer what the file does not state; without it the server refuses such a file and names what is missing.
   */
  async import(file: File, answer: ImportAnswer = {}): Promise<boolean> {
    const response = await this.whileBusy(this.api.import(file, answer));
    if (!response.ok) {
      const { field } = response.problem;
      this.showProblem(`“${file.name}” was not imported.`, response.problem);
      const missing = field === 'altitude_m' || field === 'altitude_reference' ? field : null;
      if (missing !== null && this.notice !== null) this.notice = { ...this.notice, question: { file, missing } };
      return false;
    }
    this.openImported(file.name.replace(/\.[^.]*$/, ''), response.value);
    return true;
  }

  /** Makes a step of the mission fly the trajectory in a CSV or NumPy file; one undo reverts it. */
  async importTable(file: File, node: StepNode): Promise<boolean> {
    const [draft, mission] = [this.editor.draft, this.editor.mission];
    const response = await this.whileBusy(this.api.importTable(file));
    const failure = `“${file.name}” was not imported.`;
    if (!response.ok) {
      this.showProblem(failure, response.problem);
      return false;
    }
    const hasChanged = mission === null || this.editor.draft !== draft;
    const next = hasChanged ? null : withTable(mission, node, response.value);
    if (next === null) {
      const why = hasChanged ? 'The plan was changed during the request. Try again.' : `A mission has at most ${MAX_TABLES} tables. Split the mission.`;
      this.notice = { tone: 'caution', text: `${failure} ${why}` };
      return false;
    }
    this.editor.change(next);
    const { rows, duration_s, has_yaw } = response.value;
    this.notice = { tone: 'ok', text: `“${file.name}”: ${rows} rows, ${fixed(duration_s, 1)} s, ${has_yaw ? 'with' : 'without'} yaw.` };
    return true;
  }

  /** Opens the vehicle's plan as a new plan; undo restores the previously edited plan. */
  openFromVehicle(vehicleName: string, { plan, plan_name, notes }: DownloadedPlan, home: PlannedHome | null): void {
    this.editor.replace(plan_name?.name ?? `From ${vehicleName}`, { ...EMPTY_PLAN, ...plan, planned_home: plan.planned_home ?? home });
    const text = [`Opened the plan of ${vehicleName}. It is not saved on the server yet.`, ...notes].join(' ');
    this.notice = { tone: notes.length > 0 ? 'caution' : 'ok', text };
  }

  /** @returns the file; null: the server did not write the file, see `notice`. */
  async export(format: Format): Promise<Blob | null> {
    const response = await this.whileBusy(this.api.export(this.editor.document, format));
    if (!response.ok) {
      this.showProblem('Not exported.', response.problem);
      return null;
    }
    const notes = response.value.notes.join(' ');
    this.notice = notes === '' ? null : { tone: 'caution', text: notes };
    return response.value.file;
  }

  /**
   * Computes the AMSL altitudes of items above terrain from the server's elevation files.
   * @param tolerance_m largest deviation of a leg from its height above ground: the server adds waypoints where a leg
   * deviates more. Null: the server adds no waypoints.
   */
  async resolveTerrain(tolerance_m: number | null): Promise<boolean> {
    const { draft, plan } = this.editor;
    const response = await this.whileBusy(this.api.resolveTerrain(plan, tolerance_m));
    if (!response.ok) {
      this.showProblem('The altitudes were not computed.', response.problem);
      return false;
    }
    if (this.editor.draft !== draft) {
      this.notice = { tone: 'caution', text: 'The altitudes were not computed, because the plan was changed during the request. Try again.' };
      return false;
    }
    this.editor.change(response.value.plan);
    this.notice = terrainNotice(response.value);
    return true;
  }

  /** Checks the edited plan on the server; does nothing while another check is running. */
  async runCheck(): Promise<void> {
    const { documentId, plan } = this.editor.draft;
    const inputs = this.currentInputs;
    if (this.checking) return;
    this.checking = true;
    const response = await this.api.check(plan, this.vehicle, powerOf(this.conditions));
    this.checking = false;
    [this.checkedDocument, this.checkedDocumentId, this.checkedInputs] = [plan, documentId, inputs];
    this.checkResult = response.ok ? response.value : null;
    this.checkProblem = response.ok ? null : problemText('Not checked.', response.problem);
  }

  /** Makes the server read the vehicle's parameters, and checks the plan again. */
  async readParameters(vehicle: string): Promise<void> {
    const response = await this.whileBusy(this.api.readParameters(vehicle));
    if (!response.ok) return this.showProblem('The parameters were not read.', response.problem);
    await this.runCheck();
  }

  /** Sets the conditions and stores them in the browser. */
  setConditions(conditions: Conditions): void {
    this.conditions = conditions;
    this.storage.setItem(CONDITIONS_KEY, JSON.stringify(conditions));
  }

  /** Passes the compiled path and the frame of the mission to the editor for the map, from the newest check. */
  showCompiledPath(vehicleHome: PlannedHome | null): void {
    const flight = this.check?.flight ?? null;
    this.editor.compiled = { flight, isCurrent: this.isChecked };
    this.editor.frame = missionFrameOf(this.editor.mission, vehicleHome ?? homeOf(this.editor.document), flight?.origin ?? null);
  }

  /** Handles the event that a client saved or deleted a plan. */
  handleEvent(event: WireEvent, ownClientKey: string | null): void {
    if (event.kind !== 'plan_changed') return;
    if (this.list !== null) void this.refresh();
    const plan = event['plan'] as PlanVersion | undefined;
    const isOwn = event['client_key'] === ownClientKey;
    if (isOwn || plan === undefined || plan.id !== this.savedPlan?.id) return;
    const client = String(event['client']);
    if (event['action'] === 'deleted') {
      this.removeSaved(this.editor.draft.documentId);
      this.notice = { tone: 'caution', text: `${client} deleted this plan. Save your version to keep it as a new plan.` };
    } else
      this.notice = {
        tone: 'caution',
        text: `${client} saved version ${plan.version} of this plan. Your version is based on version ${this.savedPlan.version}.`,
        conflict: true,
      };
  }

  /** Stores the draft for the next load of the page. */
  store(draft: Draft): void {
    const stored: StoredDraft = { name: draft.name, plan: draft.plan, kept: this.savedPlan, saved: this.saved };
    try {
      this.storage.setItem(DRAFT_KEY, JSON.stringify({ ...stored, kept: stored.kept === null ? null : { id: stored.kept.id, version: stored.kept.version } }));
    } catch {
      this.storage.removeItem(DRAFT_KEY); // the draft is too large for this browser; an older draft must not be restored
    }
  }

  private restore(): void {
    this.restoreItem<Conditions>(CONDITIONS_KEY, (conditions) => (this.conditions = { ...DEFAULT_CONDITIONS, ...conditions }));
    this.restoreItem<StoredDraft>(DRAFT_KEY, (stored) => {
      if (!(isMission(stored.plan) ? Array.isArray(stored.plan.steps) : Array.isArray(stored.plan.items))) return;
      const plan = isMission(stored.plan) ? stored.plan : { ...EMPTY_PLAN, ...stored.plan };
      const documentId = this.editor.load(stored.name, plan);
      if (stored.kept !== null) this.setSaved(documentId, { ...stored.kept, name: stored.name, plan: stored.saved ? plan : EMPTY_PLAN });
    });
  }

  /** Applies a stored value; removes it if it cannot be read. */
  private restoreItem<T>(key: string, apply: (stored: T) => void): void {
    try {
      const stored = JSON.parse(this.storage.getItem(key) ?? 'null') as T | null;
      if (stored !== null) apply(stored);
    } catch {
      this.storage.removeItem(key);
    }
  }

  /** Uses an imported area as the person has chosen, and asks no longer about this area. */
  useArea(area: Area, use: AreaUse): void {
    if (this.notice?.areas?.includes(area) !== true) return;
    const areas = this.notice.areas.filter((other) => other !== area);
    const { lastingText = '' } = this.notice;
    if (areas.length > 0) this.notice = { ...this.notice, areas };
    else this.notice = lastingText === '' ? null : { tone: 'caution', text: lastingText };
    if (use.fence.length > 0) this.editor.addZones(use.fence);
  }

  /** Opens an imported plan. A file with nothing but areas replaces no plan: its areas are added to the edited one. */
  private openImported(name: string, { plan, notes, areas }: ImportedFile): void {
    if (!isNothing(plan)) this.editor.replace(isMission(plan) ? plan.name : name, isMission(plan) ? plan : { ...EMPTY_PLAN, ...plan });
    const lastingText = notes.filter((note) => !note.includes('choose a use for each')).join(' ');
    const text = notes.join(' ') || 'The file contains areas.';
    this.notice = notes.length > 0 || areas.length > 0 ? { tone: 'caution', text, areas, lastingText } : null;
  }

  private setSaved(documentId: number, saved: SavedPlan): void {
    this.savedPlans = { ...this.savedPlans, [documentId]: saved };
  }

  private removeSaved(documentId: number): void {
    this.savedPlans = Object.fromEntries(Object.entries(this.savedPlans).filter(([id]) => Number(id) !== documentId));
  }

  /** Waits for a request; meanwhile `busy` is true. */
  private async whileBusy<T>(request: Promise<Outcome<T>>): Promise<Outcome<T>> {
    this.requestCount += 1;
    const response = await request;
    this.requestCount -= 1;
    return response;
  }

  private showProblem(failure: string, problem: Problem, conflict = false): void {
    this.notice = { tone: 'danger', text: problemText(failure, problem), conflict };
  }
}

/** Whether a plan has no content: a file of areas alone becomes such a plan. */
function isNothing(plan: Document): boolean {
  if (isMission(plan)) return false;
  const { items, fence, rally_points, obstacles, planned_home } = { ...EMPTY_PLAN, ...plan };
  return planned_home === null && [items, fence, rally_points, obstacles ?? []].every((part) => part.length === 0);
}

function nameOrDefault(name: string): string {
  return name.trim() === '' ? 'Plan' : name.trim();
}

function terrainNotice({ resolved, unknown, added, notes }: ResolvedPlan): Notice {
  const unknownTexts =
    unknown === 0
      ? []
      : [`${unknown} ${unknown === 1 ? 'altitude is' : 'altitudes are'} still unknown. Put elevation files of this area into the server’s data folder.`];
  const waypoints = added === 0 ? '' : ` Added ${added} ${added === 1 ? 'waypoint' : 'waypoints'}.`;
  const text = [
    `Computed the AMSL altitudes of ${resolved} ${resolved === 1 ? 'point that is' : 'points that are'} above terrain from elevation data.${waypoints}`,
    ...unknownTexts,
    ...notes,
  ].join(' ');
  return { tone: unknown === 0 && notes.length === 0 ? 'ok' : 'caution', text };
}

function problemText(failure: string, problem: Problem): string {
  // For `unreachable`, `detail` is about a command to a vehicle. A request about plans can simply be repeated.
  const why = problem.code === 'unreachable' ? ['The server did not answer.', 'Is it still running?'] : [problem.detail, problem.remedy];
  return [failure, ...why].filter((part) => part !== null && part !== '').join(' ');
}
