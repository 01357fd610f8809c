/** The offboard room's state: forms, available setpoint types, sent setpoints and their results. */

import { page } from '../../../app/page.svelte';
import { commandTo } from '../../../app/actions/command.svelte';
import { actions } from '../../../app/vehicle-actions.svelte';
import { offboard } from '../controllers';
import type { VehicleFacts } from '../../../vehicle/facts';
import { BOUNDS } from '../../../api/bounds';
import { ofVehicle, type Outcome } from '../../../api/client';
import type { Vector3 } from '../../../live/topics';
import type { WireEvent } from '../../../live/wire';
import { fixed } from '../../../ui/format';
import { limitProblem, parseTyped } from '../../../vehicle/fields';
import type { AnySetpoint, Validity, OnExpiry } from '../../../vehicle/setpoint';
import { expiryText, readOffboard } from '../../../vehicle/offboard';
import { buildSetpoint, formFromCurrentState, type Form } from './form';
import type { FailsafeAction, LimitsBody, OffboardView } from './offboard-info';
import type { SetpointKind } from '../../../vehicle/setpoint-kinds';
import { previewOf, previewText, type SetpointPreview } from './preview';
import { SentLog, setpointText, type SentLine, type InputMethod } from './sent-log';
import { SetpointSocket, type Ack, type SocketState } from './setpoint-socket';

/** Setpoint types with a position. By default the open page renews setpoints of these types. */
const POSITION_KINDS: readonly SetpointKind[] = ['position', 'position_global', 'position_body', 'trajectory', 'follow'];
const POSITION_VALIDITY_S = 10;
const MOTION_VALIDITY_S = 2;
/** Validity of setpoints from a gamepad [s]; setpoints from a dragged handle are valid longer. */
const DIRECT_VALIDITY_S = 0.5;
export const DIRECT_VALIDITY: Validity = { valid_for_s: DIRECT_VALIDITY_S, on_expiry: { action: 'hold', hold_for_s: 5 }, renew: false };

const SOCKET_CLOSE_DELAY_MS = 500;

export interface DragTarget {
  position_ned_m: Vector3;
  yaw_ned_rad: number;
}

class SetpointEditor {
  input = $state<InputMethod>('form');
  kind = $state<SetpointKind>('position');
  private forms = $state.raw<Readonly<Record<string, Form>>>({});
  /** False until a person presses Start or Send. */
  showsErrors = $state(false);
  expiryAction = $state<OnExpiry['action']>('hold');
  private validForTexts = $state.raw<Readonly<Record<string, string>>>({});
  private renewChoices = $state.raw<Readonly<Record<string, boolean>>>({});
  /** The server's view of the vehicle's offboard state: available types, limits, failsafe. */
  offboardView = $state.raw<OffboardView | null>(null);
  sentLines = $state.raw<readonly SentLine[]>([]);
  dragTarget = $state.raw<DragTarget | null>(null);
  /** Whether the page sends the target while a handle is dragged. */
  sendsWhileDragging = $state(false);
  private vehicle: string | null = null;
  private readonly log = new SentLog();
  private connection: { vehicle: string; socket: SetpointSocket } | null = null;
  /** Log line ids of the setpoints that the server has not acknowledged, by sequence number. */
  private readonly unacknowledged = new Map<number, number>();

  /** Resets the state when another vehicle is selected. */
  selectVehicle(facts: VehicleFacts): void {
    if (facts.id === this.vehicle) return;
    this.vehicle = facts.id;
    this.closeSocketLater();
    this.forms = {};
    this.offboardView = null;
    this.dragTarget = null;
    this.sendsWhileDragging = false;
    this.showsErrors = false;
  }

  /** The form of the chosen setpoint type; initially filled with the vehicle's current state. */
  form(facts: VehicleFacts): Form {
    return this.forms[this.kind] ?? formFromCurrentState(this.kind, facts, this.hoverThrust);
  }

  /** Fills the form with the vehicle's current state. A filled form stays unchanged unless `overwrite`. */
  fill(facts: VehicleFacts, overwrite = false): void {
    if (!overwrite && this.forms[this.kind] !== undefined) return;
    this.edit(formFromCurrentState(this.kind, facts, this.hoverThrust));
  }

  edit(form: Form): void {
    this.forms = { ...this.forms, [form.kind]: form };
  }

  chooseKind(kind: SetpointKind): void {
    this.kind = kind;
    this.showsErrors = false;
  }

  get hoverThrust(): number | null {
    return this.offboardView?.limits.vehicle.hover_thrust ?? null;
  }

  get validForText(): string {
    return this.validForTexts[this.kind] ?? String(POSITION_KINDS.includes(this.kind) ? POSITION_VALIDITY_S : MOTION_VALIDITY_S);
  }
  set validForText(text: string) {
    this.validForTexts = { ...this.validForTexts, [this.kind]: text };
  }

  get renew(): boolean {
    return this.renewChoices[this.kind] ?? POSITION_KINDS.includes(this.kind);
  }
  set renew(renew: boolean) {
    this.renewChoices = { ...this.renewChoices, [this.kind]: renew };
  }

  get validForProblem(): string | null {
    return limitProblem(parseTyped(this.validForText) ?? NaN, BOUNDS.SetpointRequest.valid_for_s, 's');
  }

  get validity(): Validity {
    const on_expiry: OnExpiry = this.expiryAction === 'hold' ? { action: 'hold', hold_for_s: 5 } : { action: this.expiryAction };
    return { valid_for_s: parseTyped(this.validForText) ?? 0, on_expiry, renew: this.renew };
  }

  preview(facts: VehicleFacts): SetpointPreview | null {
    if (this.input === 'gamepad' || this.input === 'group') return null;
    if (this.input === 'drag') return this.dragTarget === null ? null : { ...this.dragTarget, isExtrapolated: false };
    const buildResult = buildSetpoint(this.form(facts));
    return buildResult.ok ? previewOf(buildResult.setpoint, facts) : null;
  }

  // --- server state ---

  async fetchOffboardView(id: string): Promise<void> {
    const response = await page.api.get('/vehicles/{v}/offboard', ofVehicle(id));
    if (response.ok && id === this.vehicle) this.offboardView = response.value;
  }

  /** Changes the shown view, unless another vehicle was selected meanwhile. */
  private updateView(id: string, changed: Partial<OffboardView>): void {
    if (id === this.vehicle && this.offboardView !== null) this.offboardView = { ...this.offboardView, ...changed };
  }

  async setLimits(facts: VehicleFacts, limits: LimitsBody): Promise<boolean> {
    const send = async (): Promise<Outcome<unknown>> => {
      const response = await page.api.put('/vehicles/{v}/offboard/limits', { ...ofVehicle(facts.id), body: limits });
      if (response.ok) this.updateView(facts.id, { limits: response.value });
      return response;
    };
    return actions.attempt(commandTo(facts, 'Setting the limits', send), 'offboardRoom');
  }

  async setFailsafe(facts: VehicleFacts, action: FailsafeAction, after_s: number): Promise<boolean> {
    const send = async (): Promise<Outcome<unknown>> => {
      const response = await page.api.put('/vehicles/{v}/offboard/failsafe', { ...ofVehicle(facts.id), body: { action, after_s } });
      if (response.ok) this.updateView(facts.id, { failsafe: response.value });
      return response;
    };
    return actions.attempt(commandTo(facts, 'Setting the failsafe action', send), 'offboardRoom');
  }

  // --- sending ---

  /** Sends the form's setpoint or the drag target to the running stream; without a stream, asks to start the stream with this setpoint. */
  sendOrStart(facts: VehicleFacts, streaming: boolean): void {
    const setpoint = this.input === 'drag' ? this.dragSetpoint() : this.formSetpoint(facts);
    const validity = this.input === 'drag' ? { ...this.validity, valid_for_s: POSITION_VALIDITY_S, renew: true } : this.validity;
    if (setpoint === null || (this.input === 'form' && this.validForProblem !== null)) return;
    if (streaming) void this.send(facts, setpoint, validity);
    else this.requestStart(facts, setpoint, validity);
  }

  /** Opens the confirmation that starts the stream with this setpoint. */
  requestStart(facts: VehicleFacts, setpoint: AnySetpoint, validity: Validity): void {
    const target = setpoint.type === 'position' || this.input === 'form' ? previewOf(setpoint as never, facts) : null;
    const targetText = target === null ? '' : ` (${previewText(target, facts)})`;
    const expiryActionText = expiryText(validity.on_expiry, this.offboardView?.failsafe?.words ?? facts.offboard?.ifStreamStops ?? null);
    const valid_s = fixed(validity.valid_for_s, 1);
    const validityText = validity.renew
      ? `renewed while this page is open. If it is not renewed for ${valid_s} s, ${expiryActionText}`
      : `for ${valid_s} s, then ${expiryActionText}`;
    const input = this.input;
    actions.request('offboard_start', facts, 'offboardRoom', null, {
      setpoint,
      validity,
      rate_hz: 50,
      text: `${setpointText(setpoint)}${targetText}, ${validityText}`,
      onOutcome: (outcome) => this.recordOutcome(this.recordSent(input, setpoint), outcome, null),
    });
  }

  private formSetpoint(facts: VehicleFacts): AnySetpoint | null {
    this.showsErrors = true;
    const buildResult = buildSetpoint(this.form(facts));
    return buildResult.ok ? buildResult.setpoint : null;
  }

  private dragSetpoint(): AnySetpoint | null {
    return this.dragTarget === null ? null : { type: 'position', ...this.dragTarget };
  }

  private async send(facts: VehicleFacts, setpoint: AnySetpoint, validity: Validity): Promise<void> {
    const lineId = this.recordSent(this.input, setpoint);
    const sent_s = performance.now() / 1000;
    let outcome: Outcome<unknown> | null = null;
    await actions.attempt(
      commandTo(facts, 'Setpoint', async () => (outcome = await offboard.send(facts.id, setpoint, validity))),
      'offboardRoom',
    );
    const finalOutcome = outcome as Outcome<unknown> | null;
    if (finalOutcome !== null) this.recordOutcome(lineId, finalOutcome, performance.now() / 1000 - sent_s);
  }

  recordOutcome(lineId: number, outcome: Outcome<unknown>, roundTrip_s: number | null): void {
    const appliedLimitTexts = outcome.ok ? (readOffboard(outcome.value)?.appliedLimitTexts ?? []) : [];
    this.log.addResult(lineId, { note: outcome.ok ? appliedLimitTexts.join(' ') || null : outcome.problem.detail, refused: !outcome.ok, roundTrip_s });
    this.sentLines = this.log.lines;
  }

  recordSent(input: InputMethod, setpoint: AnySetpoint): number {
    const lineId = this.log.add(input, setpoint, page.store.nowUnixS(this.vehicle));
    this.sentLines = this.log.lines;
    return lineId;
  }

  // --- the WebSocket of gamepad and drag ---

  /** Opens the WebSocket for setpoints from the gamepad or from a drag. When the server closes it or refuses a setpoint, `onEnd` is called with the reason. */
  openSocket(id: string, onEnd: (reason: string) => void): void {
    this.closeSocket();
    const url = page.socketUrl(`/vehicles/${encodeURIComponent(id)}/offboard/stream`);
    const onState = (state: SocketState, reason: string | null): void => {
      if (state === 'closed' && reason !== null) onEnd(reason);
    };
    this.connection = {
      vehicle: id,
      socket: new SetpointSocket(
        url,
        () => performance.now() / 1000,
        (ack) => this.onAck(ack, onEnd),
        onState,
      ),
    };
  }

  /** Closes the WebSocket after a short time, in which the server acknowledges the last setpoint. */
  closeSocketLater(): void {
    const connection = this.connection;
    setTimeout(() => {
      if (connection !== null && this.connection === connection) this.closeSocket();
    }, SOCKET_CLOSE_DELAY_MS);
  }

  closeSocket(): void {
    this.connection?.socket.close();
    this.connection = null;
    this.unacknowledged.clear();
  }

  /** Sends one setpoint from the gamepad or from a drag over the open WebSocket. */
  sendDirect(input: InputMethod, setpoint: AnySetpoint, validity: Validity = DIRECT_VALIDITY): void {
    if (this.connection === null) return;
    const { valid_for_s, on_expiry } = validity;
    const seq = this.connection.socket.send({ setpoint, valid_for_s, on_expiry });
    if (seq === null) return;
    offboard.onDirectControl(this.connection.vehicle);
    this.unacknowledged.set(seq, this.recordSent(input, setpoint));
  }

  private onAck(ack: Ack, onEnd: (reason: string) => void): void {
    const lineId = this.unacknowledged.get(ack.seq);
    this.unacknowledged.delete(ack.seq);
    if (lineId === undefined) return;
    this.log.addResult(lineId, { note: ack.problem?.detail ?? (ack.limited.join(' ') || null), refused: ack.problem !== null, roundTrip_s: ack.roundTrip_s });
    this.sentLines = this.log.lines;
    if (ack.problem !== null) onEnd(ack.problem.detail);
  }

  // --- drag ---

  /** Sets the target to the vehicle's position and yaw; null if the position or the yaw is not known. */
  resetDragTarget(facts: VehicleFacts): void {
    const position_ned_m = facts.localPosition?.value.position_ned_m;
    const yaw = facts.attitude?.value.yaw_ned_rad;
    this.dragTarget = position_ned_m === undefined || yaw === undefined ? null : { position_ned_m: [...position_ned_m] as Vector3, yaw_ned_rad: yaw };
  }

  /** Called when a person moved a handle in this page's 3D view. */
  onSceneDrag(event: WireEvent): void {
    const position = event['position_ned_m'];
    const yaw = event['yaw_ned_rad'];
    if (this.dragTarget === null || event.vehicle !== this.vehicle || !Array.isArray(position)) return;
    this.dragTarget = { position_ned_m: position as Vector3, yaw_ned_rad: typeof yaw === 'number' ? yaw : this.dragTarget.yaw_ned_rad };
    if (this.sendsWhileDragging) this.sendDragTarget(event['released'] === true);
  }

  /** Sends the target: valid for 2 s while the handle is dragged, and renewed after the handle's release. */
  sendDragTarget(released: boolean): void {
    const setpoint = this.dragSetpoint();
    if (setpoint === null || this.connection === null) return;
    this.sendDirect('drag', setpoint, released ? { ...DIRECT_VALIDITY, valid_for_s: POSITION_VALIDITY_S } : { ...DIRECT_VALIDITY, valid_for_s: 2 });
    if (released) void offboard.send(this.connection.vehicle, setpoint, { ...DIRECT_VALIDITY, valid_for_s: POSITION_VALIDITY_S, renew: true });
  }

  setSendsWhileDragging(facts: VehicleFacts, isOn: boolean): void {
    this.sendsWhileDragging = isOn;
    if (!isOn) this.closeSocket();
    else
      this.openSocket(facts.id, () => {
        this.sendsWhileDragging = false;
        this.closeSocket();
      });
  }
}

export const editor = new SetpointEditor();
