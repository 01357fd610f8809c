/**
 * State and control of replays: the list of recordings, the replay that is shown, and its commands. One request is
 * under way at a time; of later commands only the newest is kept.
 */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { Replay } from '../../live/wire';
import { bounds, hasArrived, shownReplay, type Recording, type RecordingIndex } from './replays';

/**
 * Timeout of a seek after the server's answer: both the time [ms] and a number of frames must have passed. A busy
 * browser may still read frames from before the answer long after it.
 */
const SEEK_TIMEOUT_MS = 2000;
const SEEK_TIMEOUT_FRAMES = 20;

interface ReplayCommand {
  playing?: boolean;
  speed?: number;
  position_unix_s?: number;
}

const pathOf = (name: string): { params: { path: { name: string } } } => ({ params: { path: { name } } });

export interface ReplayDeps {
  api: ApiClient;
  replays: () => readonly Replay[];
  selectedId: () => string | null;
  select: (id: string) => void;
}

export class ReplayControl {
  listOpen = $state(false);
  /** A person has just opened a replay: its time bar takes the keyboard focus. */
  justOpened = $state(false);
  recordings = $state.raw<readonly Recording[] | null>(null);
  /** Name of the recording that is being opened. */
  opening = $state<string | null>(null);
  problem = $state.raw<Problem | null>(null);
  index = $state.raw<RecordingIndex | null>(null);
  /** Requested time that is not shown yet. */
  requested_unix_s = $state<number | null>(null);
  /** The replay whose vehicle is selected as soon as it has one. */
  private expected = $state<string | null>(null);
  /** The replay has no vehicle now: it was just opened, or its time is before the first vehicle. */
  private waiting = false;
  private indexed: string | null = null;
  private pendingCommand: ReplayCommand | null = null;
  private isSending = false;
  private answered_ms = 0;
  private framesSinceAnswer = 0;

  constructor(private readonly deps: ReplayDeps) {}

  get shown(): Replay | null {
    return shownReplay(this.deps.replays(), this.deps.selectedId(), this.expected);
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
    this.expected = answer.value.name;
    this.waiting = true;
    this.listOpen = false;
    this.justOpened = true;
    this.follow();
  }

  async close(): Promise<void> {
    const name = this.shown?.name;
    if (name === undefined) return;
    this.expected = null;
    const answer = await this.deps.api.delete('/replays/{name}', pathOf(name));
    if (!answer.ok) this.problem = answer.problem;
  }

  /** Called for each frame of telemetry: selects the expected vehicle and loads the marks of the replay shown. */
  follow(): void {
    this.checkSeek();
    const replays = this.deps.replays();
    const awaited = replays.find((r) => r.name === this.expected);
    const selected = this.deps.selectedId();
    const first = awaited?.vehicles[0];
    if (awaited !== undefined && first === undefined) this.waiting = true;
    if (awaited !== undefined && first !== undefined) {
      if (selected === null || (this.waiting && !awaited.vehicles.includes(selected))) this.deps.select(first);
      else if (!this.waiting && selected !== null && !awaited.vehicles.includes(selected)) this.expected = null; // another vehicle was selected
      this.waiting = false;
    }
    const shown = this.shown;
    if (shown !== null) this.expected = shown.name;
    const key = shown === null || bounds(shown) === null ? null : shown.name;
    if (key !== this.indexed) void this.readIndex(key);
  }

  play(playing: boolean): void {
    this.command({ playing });
  }

  speed(speed: number): void {
    this.command({ speed });
  }

  seek(unix_s: number): void {
    this.requested_unix_s = unix_s;
    this.command({ position_unix_s: unix_s });
  }

  private command(command: ReplayCommand): void {
    this.pendingCommand = { ...this.pendingCommand, ...command };
    if (!this.isSending) void this.send();
  }

  private async send(): Promise<void> {
    this.isSending = true;
    while (this.pendingCommand !== null) {
      const name = this.shown?.name ?? this.expected ?? undefined; // when the replay changes from one vehicle to the next, none is shown for a moment
      const command: ReplayCommand = this.pendingCommand;
      this.pendingCommand = null;
      if (name === undefined) break;
      const answer = await this.deps.api.post('/replays/{name}', { ...pathOf(name), body: command });
      this.problem = answer.ok ? null : answer.problem;
    }
    if (this.problem !== null) this.requested_unix_s = null;
    this.answered_ms = performance.now();
    this.framesSinceAnswer = 0;
    this.isSending = false;
  }

  /**
   * Frames under way may still have the earlier time. The page shows the requested time until a frame has reached it.
   */
  private checkSeek(): void {
    if (this.requested_unix_s === null || this.isSending) return;
    const shown = this.shown;
    const there = shown !== null && hasArrived(shown, this.requested_unix_s);
    this.framesSinceAnswer += 1;
    const hasTimedOut = this.framesSinceAnswer > SEEK_TIMEOUT_FRAMES && performance.now() - this.answered_ms > SEEK_TIMEOUT_MS;
    if (there || hasTimedOut) this.requested_unix_s = null;
  }

  private async readIndex(name: string | null): Promise<void> {
    this.indexed = name;
    this.index = null;
    if (name === null) return;
    const answer = await this.deps.api.get('/replays/{name}/index', pathOf(name));
    if (this.indexed !== name) return;
    if (answer.ok) this.index = answer.value;
    else this.problem = answer.problem;
  }
}
