/** Reads the browser's gamepad 25 times a second, sends setpoints from its sticks, and stores why stick control ended. */

import type { AnySetpoint } from '../../../vehicle/setpoint';
import { connectedPads, pageState } from '../../../vehicle/gamepad';
import { StickControl, RATE_HZ, type StickOutput } from './stick-control';
import { SCALES, type PadMode } from './sticks';

/** Buttons of the standard gamepad layout that a pilot can hold while flying. */
export const DEADMAN_BUTTONS: readonly { value: number; text: string }[] = [
  { value: 5, text: 'R1' },
  { value: 4, text: 'L1' },
  { value: 7, text: 'R2' },
  { value: 6, text: 'L2' },
];

/** Functions of the page that the gamepad control uses. */
export interface GamepadHost {
  yaw_ned_rad: () => number | null;
  hoverThrust: () => number;
  send: (setpoint: AnySetpoint) => void;
  /** Called when stick control has ended and its last setpoint was sent. */
  onEnd: () => void;
}

export class GamepadControl {
  pads = $state.raw<readonly { index: number; id: string }[]>([]);
  selectedIndex = $state<number | null>(null);
  mode = $state<PadMode>('heading');
  scaleIndex = $state(0);
  deadmanButton = $state(5);
  /** Output for the newest state of the gamepad; null before the first reading. */
  output = $state.raw<StickOutput | null>(null);
  /** Why stick control ended; null if a person ended it. */
  endReason = $state<string | null>(null);
  private readonly stickControl = new StickControl(SCALES[0]?.scale ?? { speed_m_s: 1, climb_m_s: 0.5, turn_deg_s: 20, tilt_deg: 8 }, 5);
  private host: GamepadHost | null = null;

  get engaged(): boolean {
    return this.output !== null && this.output.phase !== 'off';
  }

  /** Starts to read the gamepad. @returns a function that stops the reading; the panel calls this function when the panel closes. */
  startReading(host: GamepadHost): () => void {
    this.host = host;
    const poll = (): void => this.poll();
    const timer = setInterval(poll, 1000 / RATE_HZ);
    const eventNames = ['blur', 'pagehide', 'gamepaddisconnected', 'gamepadconnected'] as const;
    for (const name of eventNames) window.addEventListener(name, poll);
    document.addEventListener('visibilitychange', poll);
    poll();
    return () => {
      this.disengage();
      clearInterval(timer);
      for (const name of eventNames) window.removeEventListener(name, poll);
      document.removeEventListener('visibilitychange', poll);
      this.host = null;
    };
  }

  engage(): void {
    this.endReason = null;
    this.stickControl.engage();
    this.poll();
  }

  disengage(reason: string | null = null): void {
    const stopSetpoint = this.stickControl.disengage();
    if (stopSetpoint !== null) {
      this.host?.send({ ...stopSetpoint });
      this.host?.onEnd();
      this.endReason = reason;
    }
    this.poll();
  }

  private poll(): void {
    const pads = connectedPads();
    if (pads.length !== this.pads.length || pads.some((p, i) => p.id !== this.pads[i]?.id || p.index !== this.pads[i]?.index)) {
      this.pads = pads.map(({ index, id }) => ({ index, id }));
    }
    if (this.selectedIndex === null || (!this.engaged && !pads.some((p) => p.index === this.selectedIndex))) this.selectedIndex = pads[0]?.index ?? null;
    const snapshot = pads.find((p) => p.index === this.selectedIndex) ?? null;
    this.stickControl.mode = this.mode;
    this.stickControl.deadmanButton = this.deadmanButton;
    this.stickControl.scale = SCALES[this.scaleIndex]?.scale ?? this.stickControl.scale;
    const inputs = {
      ...pageState(),
      yaw_ned_rad: this.host?.yaw_ned_rad() ?? null,
      hoverThrust: this.host?.hoverThrust() ?? 0.5,
    };
    const output = this.stickControl.update(snapshot, inputs, performance.now() / 1000);
    if (output.setpoint !== null) this.host?.send({ ...output.setpoint });
    if (output.endReason !== null) {
      this.endReason = output.endReason;
      this.host?.onEnd();
    }
    this.output = output;
  }
}

export const gamepad = new GamepadControl();
