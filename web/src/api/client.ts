/** Calls to the ground station: every outcome is a value, nothing throws. */

import { parseProblem, unreachable, type Problem } from './problems';

export type Outcome<T> = { ok: true; value: T } | { ok: false; problem: Problem };

export type Fetch = (path: string, init: RequestInit) => Promise<Response>;

/** Request timeout [ms]; longer than any command's deadline, so that the server answers first. */
const TIMEOUT_MS = 45_000;

export class ApiClient {
  /**
   * @param who this page's name in the journal, and its unique id.
   * @param signedOut called when the server rejects this page's token (it may have been changed).
   */
  constructor(
    private readonly who: string | { readonly name: string; readonly id: string; readonly key: string | null },
    private readonly signedOut: () => void = () => undefined,
    private readonly fetch: Fetch = (path, init) => globalThis.fetch(path, init),
    private readonly base = '/api/v1',
  ) {}

  /** The present identity: a person may rename the page. */
  get name(): string {
    return typeof this.who === 'string' ? this.who : this.who.name;
  }

  /** The server's key for this client; null until the server has sent it. */
  get key(): string | null {
    return typeof this.who === 'string' ? null : this.who.key;
  }

  get<T>(path: string): Promise<Outcome<T>> {
    return this.call<T>('GET', path);
  }

  post<T>(path: string, body?: object): Promise<Outcome<T>> {
    return this.call<T>('POST', path, body);
  }

  put<T>(path: string, body: object): Promise<Outcome<T>> {
    return this.call<T>('PUT', path, body);
  }

  delete(path: string): Promise<Outcome<null>> {
    return this.call<null>('DELETE', path);
  }

  /** Sends a file as it is. */
  upload<T>(path: string, file: Blob): Promise<Outcome<T>> {
    return this.send('POST', path, 'application/octet-stream', file, (response) => response.json().catch(() => null) as Promise<T>);
  }

  /** Downloads a file; `notes` are texts about it, sent as JSON in a header. */
  download(path: string, body: object, notesHeader: string): Promise<Outcome<{ file: Blob; notes: readonly string[] }>> {
    return this.send('POST', path, 'application/json', JSON.stringify(body), async (response) => {
      const notes: unknown = JSON.parse(response.headers.get(notesHeader) ?? '[]');
      return { file: await response.blob(), notes: Array.isArray(notes) ? notes.map(String) : [] };
    });
  }

  private call<T>(method: string, path: string, body?: object): Promise<Outcome<T>> {
    const [type, text] = body === undefined ? [null, null] : ['application/json', JSON.stringify(body)];
    return this.send(method, path, type, text, (response) => response.json().catch(() => null) as Promise<T>);
  }

  private async send<T>(
    method: string,
    path: string,
    type: string | null,
    body: BodyInit | null,
    read: (response: Response) => Promise<T>,
  ): Promise<Outcome<T>> {
    const headers: Record<string, string> = { 'X-Client': this.name, Accept: 'application/json' };
    if (typeof this.who !== 'string') headers['X-Client-Id'] = this.who.id;
    if (type !== null) headers['Content-Type'] = type;
    const init: RequestInit = { method, headers, signal: AbortSignal.timeout(TIMEOUT_MS) };
    if (body !== null) init.body = body;
    try {
      const response = await this.fetch(this.base + path, init);
      if (response.status === 401) this.signedOut();
      if (response.ok) return { ok: true, value: await read(response) };
      return { ok: false, problem: parseProblem(response.status, await response.json().catch(() => null)) };
    } catch {
      return { ok: false, problem: unreachable() };
    }
  }
}

/** A default name for this page, different for two pages in the journal. */
export function pageName(random: () => number = Math.random): string {
  return `page-${Math.floor(random() * 0xffff)
    .toString(16)
    .padStart(4, '0')}`;
}
