import { afterEach, describe, expect, it, vi } from 'vitest';
import { randomId } from '../../app/identity';
import { stage, type SceneRequest } from './stage.svelte';

const request = (vehicle: string): SceneRequest => ({ mode: 'chase', vehicle, theme: 'dark', preview: null, dry_run: null });
const settle = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));

describe('the 3D view', () => {
  afterEach(() => {
    vi.unstubAllGlobals();
    vi.restoreAllMocks();
  });

  it('shows the newest content although an earlier request never gets an answer', async () => {
    const timeouts: AbortController[] = [];
    vi.spyOn(AbortSignal, 'timeout').mockImplementation(() => {
      const controller = new AbortController();
      timeouts.push(controller);
      return controller.signal;
    });
    const sent: string[] = [];
    vi.stubGlobal('fetch', (_url: string, init: RequestInit) => {
      sent.push((JSON.parse(init.body as string) as { vehicle: string }).vehicle);
      return new Promise((_resolve, reject) => init.signal?.addEventListener('abort', () => reject(new Error('timeout'))));
    });
    void stage.show(request('1'));
    for (const vehicle of ['2', '3']) void stage.show(request(vehicle));
    await settle();
    expect(sent).toEqual(['1']);
    timeouts[0]?.abort();
    await settle();
    expect(sent).toEqual(['1', '3']);
    timeouts[1]?.abort();
    await settle();
  });

  it('is asked for without being downloaded, and has one address for all its states', async () => {
    const calls: [string, string | undefined][] = [];
    vi.stubGlobal('fetch', (url: string, init?: RequestInit) => {
      calls.push([url, init?.method]);
      return Promise.resolve(new Response('', { headers: { 'content-type': 'text/html; charset=utf-8' } }));
    });
    const stop = stage.pollScene();
    await settle();
    stop();
    expect(stage.sceneAvailable).toBe(true);
    expect(calls).toEqual([['/scene/', 'HEAD']]);
    const urls = ['1', '2'].map((vehicle) => stage.sceneUrl(request(vehicle)));
    expect(new Set(urls.map((url) => url.split('#')[0]))).toEqual(new Set(['/scene/']));
    expect(urls[1]).toContain('vehicle=2');
    expect(urls[1]).toContain('language=en');
  });
});

describe('the id of a page', () => {
  it('has 128 bits that nobody can guess, also on plain http, where `crypto.randomUUID` does not exist', () => {
    vi.spyOn(Math, 'random').mockReturnValue(0.5);
    vi.stubGlobal('crypto', { getRandomValues: crypto.getRandomValues.bind(crypto) });
    const ids = Array.from({ length: 100 }, randomId);
    vi.unstubAllGlobals();
    expect(new Set(ids).size).toBe(100);
    for (const id of ids) expect(id).toMatch(/^[0-9a-f]{32}$/);
  });
});
