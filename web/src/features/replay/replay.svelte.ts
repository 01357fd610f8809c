/** Recordings on the page: the list, the one that is shown, and steering it: one request under way, the newest wish next. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { Replay } from '../../live/wire';
import { bounds, hasArrived, shownReplay, type Recording, type RecordingIndex } from './replays';

/** Telemetry that does not tell of a moment that was asked for by then never will: so long after the answer [ms], and
 * after so many more frames, since a busy browser reads frames from before the answer long after it. */
const PATIENCE_MS = 2000;
const PATIENCE_FRAMES = 20;

interface Wish {
  playing?: boolean;
  speed?: number;
  position_unix_s?: number;
}

const of = (name: string): { params: { path: { name: string } } } => ({ params: { path: { name } } });

export interface ReplayDeps {
  api: ApiClient;
  replays: () => readonly Replay[];
  selectedId: () => string | null;
  select: (id: string) => void;
}

export class ReplayControl {
  listOpen = $state(false);
  /** A person has just chosen what to see: its time bar takes the keyboard. */
  justOpened = $state(false);
  recordings = $state.raw<readonly Recording[] | null>(null);
  /** Name of the recording that is being opened. */
  opening = $state<string | null>(null);
  problem = $state.raw<Problem | null>(null);
  index = $state.raw<RecordingIndex | null>(null);
  /** Moment asked for and not shown yet. */
  wanted_unix_s = $state<number | null>(null);
  /** The replay whose vehicle is to be chosen as soon as there is one. */
  private awaited = $state<string | null>(null);
  /** It has no vehicle now: just opened, or sent to a moment before the first was heard. */
  private waiting = false;
  private indexed: string | null = null;
  private wish: Wish | null = null;
  private underWay = false;
  private answered_ms = 0;
  private framesSince = 0;

  constructor(private readonly deps: ReplayDeps) {}

  get shown(): Replay | null {
    return shownReplay(this.deps.replays(), this.deps.selectedId(), this.awaited);
  }

  async list(): Promise<void> {
    this.listOpen = true;
    const answer = await this.deps.api.get('/recordings');
    if (answer.ok) this.recordings = answer.value.recordings;
    this.problem = answer.ok ? null : answer.problem;
  }

  async open(recording: string): Promise<void> {
    this.opening = recording;
    this.problem = null;
    const answer = await this.deps.api.post('/replays', { body: { recording } });
    this.opening = null;
    if (!answer.ok) {
      this.problem = answer.problem;
      return;
    }
    this.awaited = answer.value.name;
    this.waiting = true;
    this.listOpen = false;
    this.justOpened = true;
    this.follow();
  }

  async close(): Promise<void> {
    const name = this.shown?.name;
    if (name === undefined) return;
    this.awaited = null;
    const answer = await this.deps.api.delete('/replays/{name}', of(name));
    if (!answer.ok) this.problem = answer.problem;
  }

  /** Called for each frame of telemetry: chooses the vehicle that was waited for, reads the marks of what is shown. */
  follow(): void {
    this.arrive();
    const replays = this.deps.replays();
    const awaited = replays.find((r) => r.name === this.awaited);
    const selected = this.deps.selectedId();
    const first = awaited?.vehicles[0];
    if (awaited !== undefined && first === undefined) this.waiting = true;
    if (awaited !== undefined && first !== undefined) {
      if (selected === null || (this.waiting && !awaited.vehicles.includes(selected))) this.deps.select(first);
      else if (!this.waiting && selected !== null && !awaited.vehicles.includes(selected)) this.awaited = null; // another was chosen
      this.waiting = false;
    }
    const shown = this.shown;
    if (shown !== null) this.awaited = shown.name;
    const key = shown === null || bounds(shown) === null ? null : shown.name;
    if (key !== this.indexed) void this.readIndex(key);
  }

  play(playing: boolean): void {
    this.steer({ playing });
  }

  speed(speed: number): void {
    this.steer({ speed });
  }

  seek(unix_s: number): void {
    this.wanted_unix_s = unix_s;
    this.steer({ position_unix_s: unix_s });
  }

  private steer(wish: Wish): void {
    this.wish = { ...this.wish, ...wish };
    if (!this.underWay) void this.send();
  }

  private async send(): Promise<void> {
    this.underWay = true;
    while (this.wish !== null) {
      const name = this.shown?.name ?? this.awaited ?? undefined; // between two of its vehicles nothing is shown
      const wish: Wish = this.wish;
      this.wish = null;
      if (name === undefined) break;
      const answer = await this.deps.api.post('/replays/{name}', { ...of(name), body: wish });
      this.problem = answer.ok ? null : answer.problem;
    }
    if (this.problem !== null) this.wanted_unix_s = null;
    this.answered_ms = performance.now();
    this.framesSince = 0;
    this.underWay = false;
  }

  /** Frames still under way tell of the moment before: what was asked for is shown until one tells that it is there. */
  private arrive(): void {
    if (this.wanted_unix_s === null || this.underWay) return;
    const shown = this.shown;
    const there = shown !== null && hasArrived(shown, this.wanted_unix_s);
    this.framesSince += 1;
    const enough = this.framesSince > PATIENCE_FRAMES && performance.now() - this.answered_ms > PATIENCE_MS;
    if (there || enough) this.wanted_unix_s = null;
  }

  private async readIndex(name: string | null): Promise<void> {
    this.indexed = name;
    this.index = null;
    if (name === null) return;
    const answer = await this.deps.api.get('/replays/{name}/index', of(name));
    if (this.indexed !== name) return;
    if (answer.ok) this.index = answer.value;
    else this.problem = answer.problem;
  }
}
