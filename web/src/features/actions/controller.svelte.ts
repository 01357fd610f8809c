/** Asks, confirms, sends, and keeps the refusal beside the button that was pressed. */

import { actionFacts, type VehicleFacts } from '../../app/facts';
import type { ApiClient, Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import { ASKED, call, question, unavailable, type ActionFacts, type ActionName, type Goal, type Question } from './actions';
import { Confirmation } from './confirmation';

/** Where a button stands, so that what comes back appears there. */
export type Place = 'bar' | 'offboard' | 'gimbal' | 'stage';

export interface Asked {
  action: ActionName;
  place: Place;
  facts: VehicleFacts;
  goal: Goal | null;
  question: Question;
  confirmation: Confirmation;
}

export interface Running {
  id: number;
  action: ActionName;
  place: Place;
  vehicleName: string;
}

export interface Refusal {
  what: string;
  vehicleName: string;
  problem: Problem;
}

const TAKEOFF_DEFAULT_M = 10;
/** The API's own bounds [m]. */
export const TAKEOFF_RANGE_M = { min: 1, max: 120 } as const;

function notNow(detail: string): Problem {
  return { title: 'Not now', detail, reasons: [], remedy: null, code: 'refused', status: 0, field: null };
}

export class ActionController {
  asked = $state.raw<Asked | null>(null);
  running = $state.raw<Running[]>([]);
  refusals = $state.raw<Partial<Record<Place, Refusal>>>({});
  takeoffAlt_home_m = $state(TAKEOFF_DEFAULT_M);
  /** Painted once per frame: the knob's place and the seconds left. */
  progress = $state(0);
  left_s = $state(0);
  private nextId = 1;

  constructor(
    private readonly api: ApiClient,
    private readonly nowS: () => number,
    /** Starts the stream where the vehicle is; lives with the offboard card. */
    private readonly startOffboard: (facts: VehicleFacts) => Promise<Outcome<unknown>>,
    /** The vehicle as it is now: between the question and its answer it flies on. */
    private readonly current: (id: string) => VehicleFacts | null,
  ) {}

  /** The question's words with the height as it is now. */
  words(asked: Asked): Question {
    return question(asked.action, this.facts(this.now(asked.facts)), asked.goal) ?? asked.question;
  }

  /** A button or a key: opens the confirmation, or acts at once where none is needed. */
  request(action: ActionName, facts: VehicleFacts | null, place: Place = 'bar', goal: Goal | null = null): void {
    if (facts === null || (action === 'goto' && goal === null)) return;
    this.dismiss(place);
    const reason = unavailable(action, { ...this.facts(facts), lost: facts.lost, replayed: facts.replayed });
    if (reason !== null) {
      this.asked = null;
      this.refusals = { ...this.refusals, [place]: { what: ASKED[action], vehicleName: facts.name, problem: notNow(reason) } };
      return;
    }
    const asks = question(action, this.facts(facts), goal);
    if (asks === null) {
      this.asked = null;
      void this.run(action, facts, place);
      return;
    }
    this.asked = { action, place, facts, goal, question: asks, confirmation: new Confirmation(asks.danger, this.nowS()) };
    this.progress = 0;
  }

  setTakeoffHeight(alt_home_m: number): void {
    if (!Number.isFinite(alt_home_m)) return;
    this.takeoffAlt_home_m = Math.min(TAKEOFF_RANGE_M.max, Math.max(TAKEOFF_RANGE_M.min, alt_home_m));
    this.asked?.confirmation.touch(this.nowS());
  }

  cancel(): void {
    this.asked = null;
  }

  dismiss(place: Place): void {
    this.refusals = { ...this.refusals, [place]: undefined };
  }

  /** Once per animation frame: fires what was confirmed, closes what expired or lost its vehicle. */
  paint(selectedId: string | null): void {
    const asked = this.asked;
    if (asked === null) return;
    const now = this.nowS();
    const phase = asked.facts.id === selectedId ? asked.confirmation.tick(now) : 'cancelled';
    this.progress = asked.confirmation.progress(now);
    this.left_s = asked.confirmation.left_s(now);
    if (phase === 'asking') return;
    this.asked = null;
    if (phase === 'confirmed') void this.run(asked.action, asked.facts, asked.place, asked.goal);
  }

  /** Any other call whose refusal belongs to a place: nudges, gimbal. */
  async attempt<T>(what: string, facts: VehicleFacts, place: Place, send: () => Promise<Outcome<T>>): Promise<boolean> {
    const outcome = await send();
    const refusal = outcome.ok ? undefined : { what, vehicleName: facts.name, problem: outcome.problem };
    this.refusals = { ...this.refusals, [place]: refusal };
    return outcome.ok;
  }

  private async run(action: ActionName, facts: VehicleFacts, place: Place, goal: Goal | null = null): Promise<void> {
    const entry: Running = { id: this.nextId++, action, place, vehicleName: facts.name };
    this.running = [...this.running, entry];
    const now = this.now(facts);
    const taken = await this.attempt(ASKED[action], now, place, () => this.send(action, now, goal));
    this.running = this.running.filter((r) => r.id !== entry.id);
    goal?.settled?.(taken);
  }

  private send(action: ActionName, facts: VehicleFacts, goal: Goal | null): Promise<Outcome<unknown>> {
    if (action === 'offboard_start') return this.startOffboard(facts);
    const { path, body } = call(action, this.facts(facts), goal);
    return this.api.post(path, body);
  }

  private now(facts: VehicleFacts): VehicleFacts {
    return this.current(facts.id) ?? facts;
  }

  private facts(facts: VehicleFacts): ActionFacts {
    return actionFacts(facts, this.takeoffAlt_home_m);
  }
}
