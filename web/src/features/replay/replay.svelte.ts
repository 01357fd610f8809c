/**
 * State and control of replays: the shown replay and its commands. The page sends one request at a
 * time and merges the commands that a person gives during a request into the next request.
 */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { Replay } from '../../live/wire';
import { replayBounds, hasArrived, replayToShow, type RecordingIndex } from './replays';

/**
 * A seek times out when this time [ms] has passed since the server's response and the page has processed this number of frames
 * since then. Both are required: a busy browser may take a long time to process the frames that were sent before the response.
 */
const SEEK_TIMEOUT_MS = 2000;
const SEEK_TIMEOUT_FRAMES = 20;

interface ReplayCommand {
  /** The replay that the person commanded. */
  name: string;
  playing?: boolean;
  speed?: number;
  position_unix_s?: number;
}

const replayPath = (name: string): { params: { path: { name: string } } } => ({ params: { path: { name } } });

/** What the control needs from the page. */
export interface ReplayDeps {
  api: ApiClient;
  replays: () => readonly Replay[];
  selectedId: () => string | null;
  select: (id: string) => void;
  /** A person has opened a replay. */
  onOpened: () => void;
}

export class ReplayControl {
  /** A person has opened a replay: the time bar must take the keyboard focus. The time bar then resets this flag. */
  focusRequested = $state(false);
  /** Name of the recording that is being opened. */
  openingName = $state<string | null>(null);
  problem = $state.raw<Problem | null>(null);
  index = $state.raw<RecordingIndex | null>(null);
  /** Requested time that the replay has not reached yet. */
  requested_unix_s = $state<number | null>(null);
  /** Name of the replay whose first vehicle the page selects when the vehicle appears. */
  private expectedName = $state<string | null>(null);
  /** Whether the expected replay has no vehicle now: it was just opened, or its time is before the first vehicle appears. */
  private waitsForVehicle = false;
  private indexedName: string | null = null;
  private pendingCommand: ReplayCommand | null = null;
  private isSending = false;
  /** Name of the replay that is being closed. */
  private closingName: string | null = null;
  private respondedAt_ms = 0;
  private framesSinceResponse = 0;

  constructor(private readonly deps: ReplayDeps) {}

  get shownReplay(): Replay | null {
    return replayToShow(this.deps.replays(), this.deps.selectedId(), this.expectedName);
  }

  async open(recording: string): Promise<void> {
    if (this.openingName !== null) return;
    this.openingName = recording;
    this.problem = null;
    const response = await this.deps.api.post('/replays', { body: { recording } });
    this.openingName = null;
    if (!response.ok) {
      this.problem = response.problem;
      return;
    }
    this.expectedName = response.value.name;
    this.waitsForVehicle = true;
    this.deps.onOpened();
    this.focusRequested = true;
    this.onTelemetry();
  }

  async close(): Promise<void> {
    const name = this.shownReplay?.name;
    if (name === undefined || name === this.closingName) return;
    this.expectedName = null;
    this.closingName = name;
    const response = await this.deps.api.delete('/replays/{name}', replayPath(name));
    this.closingName = null;
    if (!response.ok) this.problem = response.problem;
  }

  /** Called for each frame of telemetry: selects the vehicle of the expected replay, and loads the marks of the shown replay. */
  onTelemetry(): void {
    this.checkSeek();
    const replays = this.deps.replays();
    const expectedReplay = replays.find((r) => r.name === this.expectedName);
    const selectedId = this.deps.selectedId();
    const firstVehicle = expectedReplay?.vehicles[0];
    if (expectedReplay !== undefined && firstVehicle === undefined) this.waitsForVehicle = true;
    if (expectedReplay !== undefined && firstVehicle !== undefined) {
      if (selectedId === null || (this.waitsForVehicle && !expectedReplay.vehicles.includes(selectedId))) this.deps.select(firstVehicle);
      else if (!this.waitsForVehicle && selectedId !== null && !expectedReplay.vehicles.includes(selectedId)) this.expectedName = null; // another vehicle was selected
      this.waitsForVehicle = false;
    }
    const shownReplay = this.shownReplay;
    if (shownReplay !== null) this.expectedName = shownReplay.name;
    const name = shownReplay === null || replayBounds(shownReplay) === null ? null : shownReplay.name;
    if (name !== this.indexedName) void this.readIndex(name);
  }

  setPlaying(playing: boolean): void {
    this.queueCommand({ playing });
  }

  setSpeed(speed: number): void {
    this.queueCommand({ speed });
  }

  seek(unix_s: number): void {
    this.requested_unix_s = unix_s;
    this.queueCommand({ position_unix_s: unix_s });
  }

  private queueCommand(command: Omit<ReplayCommand, 'name'>): void {
    const name = this.shownReplay?.name ?? this.expectedName; // between two vehicles of a replay, `shownReplay` is null for a moment
    if (name === null) return;
    const earlier = this.pendingCommand?.name === name ? this.pendingCommand : {};
    this.pendingCommand = { ...earlier, ...command, name };
    if (!this.isSending) void this.send();
  }

  private async send(): Promise<void> {
    this.isSending = true;
    while (this.pendingCommand !== null) {
      const { name, ...command }: ReplayCommand = this.pendingCommand;
      this.pendingCommand = null;
      const response = await this.deps.api.post('/replays/{name}', { ...replayPath(name), body: command });
      this.problem = response.ok ? null : response.problem;
    }
    if (this.problem !== null) this.requested_unix_s = null;
    this.respondedAt_ms = performance.now();
    this.framesSinceResponse = 0;
    this.isSending = false;
  }

  /**
   * Frames that the server sent before the seek have the earlier time. Until a frame has reached the requested time, or until
   * a timeout, the page shows the requested time.
   */
  private checkSeek(): void {
    if (this.requested_unix_s === null || this.isSending) return;
    const shownReplay = this.shownReplay;
    const isAtRequestedTime = shownReplay !== null && hasArrived(shownReplay, this.requested_unix_s);
    this.framesSinceResponse += 1;
    const hasTimedOut = this.framesSinceResponse > SEEK_TIMEOUT_FRAMES && performance.now() - this.respondedAt_ms > SEEK_TIMEOUT_MS;
    if (isAtRequestedTime || hasTimedOut) this.requested_unix_s = null;
  }

  private async readIndex(name: string | null): Promise<void> {
    this.indexedName = name;
    this.index = null;
    if (name === null) return;
    const response = await this.deps.api.get('/replays/{name}/index', replayPath(name));
    if (this.indexedName !== name) return;
    if (response.ok) this.index = response.value;
    else this.problem = response.problem;
  }
}
