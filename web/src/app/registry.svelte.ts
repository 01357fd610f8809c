/**
 * The registry of features. Each feature's folder has one `register.ts` that registers its rooms, panels, parts of
 * the frame, keys and services for other features. The frame (`app/frame`) draws the registered parts and does not
 * depend on features.
 */

import type { Component } from 'svelte';
import type { IconName } from '../ui/icons';
import type { VehicleFacts } from '../vehicle/facts';
import { hasProtocol, linkSupports, type Feature, type Protocol } from '../vehicle/facts';

export interface VehicleProps {
  facts: VehicleFacts;
}

/** Space that a room takes at the edges of the stage [px]; `top_px`: for a toolbar, below which the other parts of this edge stand. */
export interface RoomLayout {
  readonly left_px: number;
  readonly bottom_px: number;
  readonly top_px: number;
}

/** The layout of most rooms: a dock on the left, and one at the bottom. */
export function docks(width_px: number): RoomLayout {
  const left_px = width_px <= 1100 ? 320 : width_px <= 1340 ? 312 : 340;
  return { left_px, bottom_px: width_px <= 1340 ? 184 : 216, top_px: 0 };
}

/** A room replaces the cards beside the map with its own parts. The page loads the room's code when a person first opens it. */
export interface Room {
  id: string;
  /** Title on the rail. */
  title: string;
  icon: IconName;
  hint: string;
  order: number;
  /** Set if the room works without a connected vehicle. Its `load` then returns a `roomWithoutVehicle` component. */
  withoutVehicle?: boolean;
  /** The instruments beside the room are folded while no vehicle flies, until a person opens them. */
  foldsInstruments?: boolean;
  layout: (width_px: number) => RoomLayout;
  load: () => Promise<RoomParts>;
}

/**
 * Exactly one of `room` and `roomWithoutVehicle` is set. The frame places this component over `main`. Map and 3D view keep
 * the space of the room's layout free: the width `--dock-left` and the height `--dock-bottom`.
 */
export interface RoomParts {
  /** The room's component for the selected vehicle. */
  room?: Component<VehicleProps & { narrow: boolean }>;
  /** The room's component that needs no vehicle. */
  roomWithoutVehicle?: Component<{ narrow: boolean }>;
  /** Parts in the card column, below the cards that stay in every room. Hidden on a narrow screen. */
  cards: readonly Part[];
}

/** A panel that opens over the stage. The page loads the panel's code when a person first opens it. */
export interface Panel extends LazyPart {
  id: string;
  /** Escape closes the open panel with the lowest order first. */
  order: number;
  /** `side`: at the side of the stage, only one at a time (the open panel with the lowest order). `over`: over the stage, together with other panels. */
  place: 'side' | 'over';
  /** The panel's button on the rail; missing if another part of the page opens the panel. */
  rail?: { title: string; icon: IconName; hint: string };
  /** The panel is offered only while the selected vehicle's links carry this feature. */
  needs?: Feature;
  /** The panel is offered only while the selected vehicle is connected over this protocol. */
  protocol?: Protocol;
  /** The panel explains refusals with this code: beside them stands a button with this text that opens the panel. */
  explains?: { code: string; text: string };
}

/** Whether a panel is offered for the selected vehicle. */
export function isOffered(panel: Panel, facts: VehicleFacts | null): boolean {
  if (panel.protocol !== undefined && (facts === null || !hasProtocol(facts, panel.protocol))) return false;
  return panel.needs === undefined || facts === null || linkSupports(facts, panel.needs);
}

/** A page of the settings; its code is loaded when it is first shown. */
export interface SettingsPage {
  id: string;
  title: string;
  order: number;
  load: () => Promise<{ default: Component }>;
}

/** A page of the vehicle room; its code is loaded when it is first shown. */
export interface VehiclePage {
  id: string;
  title: string;
  order: number;
  load: () => Promise<{ default: Component<VehicleProps> }>;
}

/**
 * The frame's slots: the top bar's `vehicles` (left), `status` (middle) and `indicators` (right); `notices` in the
 * upper left corner of the stage; the `stage` with map, 3D view and the parts over them; the stage's `bottom` edge,
 * which shows only the first part that applies; the column of `cards` on the right; the sections of the `settings`.
 */
export type SlotName = 'vehicles' | 'status' | 'indicators' | 'notices' | 'stage' | 'bottom' | 'cards' | 'settings';

/** Set exactly one of `component` and `vehicleComponent`. */
export interface Part {
  component?: Component;
  /** Shown only while a vehicle is selected. */
  vehicleComponent?: Component<VehicleProps>;
}

/** A part whose code the page loads when the part is first shown. */
export interface LazyPart {
  load: () => Promise<Part>;
}

export type SlotPart = (Part | LazyPart) & SlotOptions;

interface SlotOptions {
  order: number;
  /** Whether the part applies now; missing: always. */
  applies?: () => boolean;
  /** Set for a card that stays while a room is open. */
  inEveryRoom?: boolean;
}

/** A line of the keyboard sheet and the handlers of its keys. */
export interface KeyLine {
  /** Text of the keys on the sheet. */
  keys: string;
  /** What the keys do. */
  description: string;
  /** The keys also work while the 3D view has the focus. Not possible for W A S D Q E, which move the 3D view's camera. */
  inScene: boolean;
  order: number;
  /**
   * Handlers by key: `h`, `Shift L`, `?`, `0`–`9`. A handler returns false if the key had no effect. Missing: a control
   * handles its keys without the registry.
   */
  handlers?: Readonly<Record<string, (facts: VehicleFacts | null) => boolean | void>>;
}

/** One thing that a person can find by its name: an action, a room, a panel, a vehicle, a plan, a parameter. */
export interface Findable {
  readonly title: string;
  /** What it does or is, beside the title; also searched. */
  readonly hint: string;
  /** Its keys, as on the keyboard sheet. */
  readonly keys?: string;
  /** Does it or shows it. A command of a vehicle asks for confirmation as its button does. */
  readonly run: () => unknown;
}

/** Things of one kind that a feature lets a person find. The page loads the code when a person first searches. */
export interface Finder {
  group: string;
  order: number;
  /** Reads what there is for the selected vehicle now. */
  load: () => Promise<(facts: VehicleFacts | null) => readonly Findable[] | Promise<readonly Findable[]>>;
}

/** Closes a part of the page when Escape is pressed. */
export interface Closer {
  order: number;
  isOpen: () => boolean;
  close: () => void;
}

function insertByOrder<T extends { order: number }>(entries: readonly T[], entry: T): T[] {
  return [...entries, entry].sort((a, b) => a.order - b.order);
}

class Registry {
  rooms: readonly Room[] = [];
  panels: readonly Panel[] = [];
  vehiclePages: readonly VehiclePage[] = [];
  settingsPages: readonly SettingsPage[] = [];
  /** Ids of the open panels. */
  private openPanels = $state.raw<readonly string[]>([]);
  keys: readonly KeyLine[] = [];
  closers: readonly Closer[] = [];
  finders: readonly Finder[] = [];
  /** Functions that return warnings about the server for the operator. */
  warnings: readonly (() => readonly string[])[] = [];
  private readonly slots = new Map<SlotName, readonly SlotPart[]>();

  addRoom(room: Room): void {
    this.rooms = insertByOrder(this.rooms, room);
  }

  addVehiclePage(page: VehiclePage): void {
    this.vehiclePages = insertByOrder(this.vehiclePages, page);
  }

  addSettingsPage(page: SettingsPage): void {
    this.settingsPages = insertByOrder(this.settingsPages, page);
  }

  addPanel(panel: Panel): void {
    this.panels = insertByOrder(this.panels, panel);
    this.addCloser({ order: panel.order, isOpen: () => this.isOpen(panel.id), close: () => this.close(panel.id) });
  }

  addKeys(lines: readonly KeyLine[]): void {
    for (const line of lines) this.keys = insertByOrder(this.keys, line);
  }

  addCloser(closer: Closer): void {
    this.closers = insertByOrder(this.closers, closer);
  }

  addFinder(finder: Finder): void {
    this.finders = insertByOrder(this.finders, finder);
  }

  addWarnings(read: () => readonly string[]): void {
    this.warnings = [...this.warnings, read];
  }

  addTo(slot: SlotName, part: SlotPart): void {
    this.slots.set(slot, insertByOrder(this.slot(slot), part));
  }

  slot(name: SlotName): readonly SlotPart[] {
    return this.slots.get(name) ?? [];
  }

  /** The panel that explains refusals with this code, if it is offered and not open; null: none. */
  explanationOf(code: string, facts: VehicleFacts | null): { id: string; text: string } | null {
    const panel = this.panels.find(({ explains }) => explains?.code === code);
    if (panel?.explains === undefined || this.isOpen(panel.id) || !isOffered(panel, facts)) return null;
    return { id: panel.id, text: panel.explains.text };
  }

  isOpen(id: string): boolean {
    return this.openPanels.includes(id);
  }

  /** Whether a panel is registered and offered for this vehicle. */
  offers(id: string, facts: VehicleFacts | null): boolean {
    return this.panels.some((panel) => panel.id === id && isOffered(panel, facts));
  }

  /** Opens or closes a panel. A room makes way for one of the rail that does not fit beside it. @returns false if the panel is not offered for this vehicle. */
  toggle(id: string, facts: VehicleFacts | null): boolean {
    if (!this.offers(id, facts)) return false;
    if (this.isOpen(id)) {
      this.close(id);
      return true;
    }
    this.openPanels = [...this.openPanels, id];
    if (this.isOnRail(id) && !fitsBeside(rooms.room)) rooms.openId = FLY;
    return true;
  }

  close(id: string): void {
    this.openPanels = this.openPanels.filter((open) => open !== id);
  }

  /** Closes the panels of the rail. */
  closeRail(): void {
    this.openPanels = this.openPanels.filter((id) => !this.isOnRail(id));
  }

  private isOnRail(id: string): boolean {
    return this.panels.some((panel) => panel.id === id && panel.rail !== undefined);
  }
}

/** Widths of the rail, of a panel with its margins, and of the instruments; heights of the top bar, of the action bar with the margins, and the least of a panel [px]. */
const RAIL_PX = 72;
const PANEL_PX = 584;
const INSTRUMENTS_PX = 344;
const TOP_BAR_PX = 56;
const ACTION_BAR_PX = 108;
const PANEL_HEIGHT_PX = 320;
/** On a narrower page a room has no instruments beside it [px]. */
export const NARROW_PX = 1100;

/**
 * Whether a panel of the rail fits on the page beside the dock of a room and above its action bar. Otherwise only one of them is open: the panel would hide
 * the room's forms, or Hold, Land now and Stop motors.
 */
export function fitsBeside(room: Room | null, width_px: number = innerWidth, height_px: number = innerHeight): boolean {
  if (room === null) return true;
  const { left_px, bottom_px, top_px } = room.layout(width_px);
  const instruments_px = width_px > NARROW_PX ? INSTRUMENTS_PX : 0;
  const free_px = height_px - TOP_BAR_PX - top_px - bottom_px - ACTION_BAR_PX;
  return RAIL_PX + left_px + PANEL_PX + instruments_px <= width_px && free_px >= PANEL_HEIGHT_PX;
}

export const registry = new Registry();

/** Id of the page without a room. */
const FLY = 'fly';

/** Opens and closes rooms. `openId` is the open room's id. */
class Rooms {
  openId = $state(FLY);

  readonly room = $derived(registry.rooms.find((room) => room.id === this.openId) ?? null);

  /** Panels of the rail that do not fit beside it make way for it. */
  open(id: string): void {
    this.openId = id;
    if (!fitsBeside(this.room)) registry.closeRail();
  }

  toggle(id: string): void {
    this.open(this.openId === id ? FLY : id);
  }
}

export const rooms = new Rooms();
