/** The stage, which contains the map and the 3D view: which of the two is large, and the state of the 3D view. */

import { covered } from '../../app/covered-edges.svelte';
import { randomId } from '../../app/identity';
import { readLanguage } from '../../app/language';
import { freeAreaOffset } from '../../app/covered-edges.svelte';
import type { Camera } from '../../app/services';
import type { SceneDryRun, ScenePreview } from '../../app/preview.svelte';
import type { LayerPosition } from '../../app/map-layers.svelte';
import type { GeoPosition } from '../../vehicle/geo';
import { SceneOverview } from './scene-overview';

export type SceneState = { phase: 'requested' } | { phase: 'available' } | { phase: 'absent'; reason: string };

/** The content that the page requests for the 3D view. */
export interface SceneRequest {
  mode: Camera;
  vehicle: string | null;
  theme: 'light' | 'dark';
  /** Preview of the unsent setpoint; null: none. */
  preview: ScenePreview | null;
  dry_run: SceneDryRun | null;
}

/** Functions of the map that the stage and the keyboard shortcuts call. */
export interface MapCommands {
  toggleFollow: () => void;
  zoomToVehicle: () => void;
  northUp: () => void;
  /** Fits positions into the free area. */
  fit: (positions: readonly GeoPosition[]) => void;
  /** What the large map shows: west, south, east, north [deg]; null: there is no large map. */
  visibleBounds: () => [number, number, number, number] | null;
  /** The middle of the free area and the distance to its edge; null: the map is not drawn, or is the inset. */
  visibleMiddle: () => { at: GeoPosition; edgeDistance_m: number } | null;
}

const RETRY_MS = 5000;
/** Time after which a request to the 3D view counts as failed [ms]. */
const SHOW_TIMEOUT_MS = 5000;
const SCENE_URL = '/scene/';
/** The page loads map and 3D view at the latest this time after its start [ms], also if no vehicle is connected. */
const VIEWS_WAIT_MS = 1000;

/** Waits until the browser has painted a frame in which `isShown` was true, but not longer than `VIEWS_WAIT_MS`. */
export async function afterFirstPaint(isShown: () => boolean): Promise<void> {
  const frame = (): Promise<unknown> => Promise.race([new Promise(requestAnimationFrame), new Promise((resolve) => setTimeout(resolve, VIEWS_WAIT_MS))]);
  const end_ms = performance.now() + VIEWS_WAIT_MS;
  while (!isShown() && performance.now() < end_ms) await frame();
  await frame();
  await new Promise((resolve) => setTimeout(resolve)); // a frame's callback runs before the frame is painted
}

class StageState {
  scene = $state.raw<SceneState>({ phase: 'requested' });
  camera = $state<Camera>('chase');
  /** Identifies this page's 3D view on the server. */
  readonly viewId = `page-${randomId().slice(0, 16)}`;
  /** Size of the stage [px]. */
  size = $state.raw({ width: 0, height: 0 });
  /** Pixel on the stage of the map point whose menu is open; it changes when the map moves. */
  mapPointPixel = $state.raw({ x: 0, y: 0 });
  /**
   * Offset of the middle of the free area from the stage's middle, right and down [px]. Map and 3D view show the
   * followed vehicle there.
   */
  readonly middleOffset = $derived(freeAreaOffset(this.size, covered()));
  map: MapCommands | null = null;
  /** Fits positions into the 3D view; null: the 3D view shows no layer. */
  fitScene: ((positions: readonly LayerPosition[]) => void) | null = null;
  /** Moves the 3D view's camera to an opened plan and back. */
  readonly overview = new SceneOverview();
  /** Like `MapCommands.visibleMiddle`, for the ground in the 3D view; null: the 3D view shows no layer. */
  visibleSceneMiddle: MapCommands['visibleMiddle'] | null = null;
  private pendingRequest: SceneRequest | null = null;
  private isMapChosen = $state(false);
  readonly largeView: 'map' | 'scene' = $derived(this.scene.phase === 'available' && !this.isMapChosen ? 'scene' : 'map');

  get sceneAvailable(): boolean {
    return this.scene.phase === 'available';
  }

  swap(): void {
    if (this.scene.phase === 'available') this.isMapChosen = !this.isMapChosen;
  }

  /** Makes the map large. */
  showMap(): void {
    this.isMapChosen = true;
  }

  showPositions(positions: readonly GeoPosition[]): void {
    this.map?.fit(positions);
    if (this.largeView === 'scene') this.fitScene?.(positions);
  }

  /** Shows an opened plan on the map now, and in the 3D view when the 3D view is next large. */
  showPlan(positions: readonly GeoPosition[]): void {
    if (positions.length > 0) this.map?.fit(positions);
    this.overview.request(this.camera);
  }

  /** Shows the opened plan again in the 3D view, because its path is now known. */
  refitPlan(): void {
    this.overview.refit();
  }

  visibleMiddle(): { at: GeoPosition; edgeDistance_m: number } | null {
    return this.largeView === 'scene' ? (this.visibleSceneMiddle?.() ?? null) : (this.map?.visibleMiddle() ?? null);
  }

  /** Sets the pixel of the menu's point, only if it has changed, because each assignment lays out the menu again. */
  setMapPointPixel(at: { x: number; y: number }): void {
    const [x, y] = [Math.round(at.x), Math.round(at.y)];
    if (x !== this.mapPointPixel.x || y !== this.mapPointPixel.y) this.mapPointPixel = { x, y };
  }

  /** The iframe's URL with its initial state behind the #, so that the browser downloads the 3D view once for all states. */
  sceneUrl(request: SceneRequest): string {
    const query = new URLSearchParams({ view: this.viewId, mode: request.mode, theme: request.theme, language: readLanguage() });
    if (request.vehicle !== null) query.set('vehicle', request.vehicle);
    return `${SCENE_URL}#${query}`;
  }

  /**
   * Sends the content to the 3D view: one request at a time, then only the newest request. A failure is visible in the 3D
   * view, so the page shows no message.
   */
  async show(request: SceneRequest): Promise<void> {
    const isSending = this.pendingRequest !== null;
    this.pendingRequest = request;
    if (isSending) return;
    for (let sentRequest: SceneRequest | null = null; sentRequest !== this.pendingRequest;) {
      sentRequest = this.pendingRequest;
      const { vehicle, ...rest } = sentRequest;
      const body = JSON.stringify(vehicle === null ? rest : sentRequest);
      const signal = AbortSignal.timeout(SHOW_TIMEOUT_MS); // a request without an answer must not hold up the later ones
      await fetch(`${SCENE_URL}view/${this.viewId}`, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body, signal }).catch(() => null);
    }
    this.pendingRequest = null;
  }

  /** Polls until the 3D view is available. @returns a function that stops polling. */
  pollScene(): () => void {
    let ended = false;
    let timer: ReturnType<typeof setTimeout> | undefined;
    const request = async (): Promise<void> => {
      const scene = await requestScene();
      if (ended) return;
      this.scene = scene;
      if (scene.phase !== 'available') timer = setTimeout(() => void request(), RETRY_MS);
    };
    void request();
    return () => {
      ended = true;
      clearTimeout(timer);
    };
  }
}

async function requestScene(): Promise<SceneState> {
  try {
    // HEAD: the iframe downloads the page itself, which is large.
    const response = await fetch(SCENE_URL, { method: 'HEAD', signal: AbortSignal.timeout(6000), headers: { Accept: 'text/html' } });
    if (!response.ok) return { phase: 'absent', reason: `the server responded with status ${response.status}` };
    const isPage = response.headers.get('content-type')?.includes('text/html') === true;
    return isPage ? { phase: 'available' } : { phase: 'absent', reason: 'the response is not a page' };
  } catch {
    return { phase: 'absent', reason: 'the server does not respond' };
  }
}

export const stage = new StageState();
