/** Calls to the server's API, with types from the server's OpenAPI description. A call returns its outcome and never throws. */

import createClient, { type Client, type ClientPathsWithMethod, type MaybeOptionalInit, type MethodResponse } from 'openapi-fetch';
import { parseProblem, unreachableProblem, type Problem } from './problems';
import type { paths } from './schema';
import { inPageLanguage } from './server-text';

export type Outcome<T> = { ok: true; value: T } | { ok: false; problem: Problem };

export type Fetch = (path: string, init: RequestInit) => Promise<Response>;

/** Request timeout [ms]; longer than any command's deadline, so that the server answers first. */
const TIMEOUT_MS = 45_000;
const API_PATH = '/api/v1';

/** The server's paths without their common prefix. */
type Api = { [P in keyof paths as P extends `${typeof API_PATH}${infer Rest}` ? Rest : never]: paths[P] };
type HttpClient = Client<Api>;
type Method = 'get' | 'post' | 'put' | 'delete';
type Path<M extends Method> = ClientPathsWithMethod<HttpClient, M>;
type Init<M extends Method, P extends Path<M>> = MaybeOptionalInit<Api[P], M>;
/** Path parameters, query and body; optional if none of them is required. */
type Arguments<I> = undefined extends I ? [I?] : [I];
type ApiCall<M extends Method> = <P extends Path<M>, I extends Init<M, P>>(
  path: P,
  ...init: Arguments<I>
) => Promise<Outcome<MethodResponse<HttpClient, M, P, I>>>;

/**
 * URL and init of a request, for openapi-fetch. Replaces `Request`, because in tests, outside a browser, `Request` rejects a path without a host.
 */
class PendingRequest {
  constructor(
    readonly url: string,
    readonly init: RequestInit,
  ) {}
}

export class ApiClient {
  private readonly http: HttpClient;
  readonly get: ApiCall<'get'> = this.apiCall('get');
  readonly post: ApiCall<'post'> = this.apiCall('post');
  readonly put: ApiCall<'put'> = this.apiCall('put');
  readonly delete: ApiCall<'delete'> = this.apiCall('delete');

  /**
   * @param identity this page's name for the journal, its unique id and its key from the server. A string: only the name; the page then has no id and no key.
   * @param onSignedOut called when the server rejects this page's token, for example because the token was changed on the server.
   */
  constructor(
    private readonly identity: string | { readonly name: string; readonly id: string; readonly key: string | null },
    private readonly onSignedOut: () => void = () => undefined,
    private readonly fetch: Fetch = (path, init) => globalThis.fetch(path, init),
  ) {
    this.http = createClient<Api>({ baseUrl: API_PATH, Request: PendingRequest as never, fetch: (request) => this.send(request as unknown as PendingRequest) });
  }

  /** This page's present name; a person may change it. */
  get name(): string {
    return typeof this.identity === 'string' ? this.identity : this.identity.name;
  }

  /** The server's key for this client; null until the server has sent it. */
  get key(): string | null {
    return typeof this.identity === 'string' ? null : this.identity.key;
  }

  /** Downloads a file. The response's header `notesHeader` contains `notes` as a JSON list of texts. */
  download<P extends Path<'post'>>(path: P, init: Init<'post', P>, notesHeader: string): Promise<Outcome<{ file: Blob; notes: readonly string[] }>> {
    return this.request('post', path, { ...init, parseAs: 'blob' }, (file, response) => {
      const notes: unknown = JSON.parse(response.headers.get(notesHeader) ?? '[]');
      return { file: file as Blob, notes: Array.isArray(notes) ? notes.map(String) : [] };
    });
  }

  private apiCall<M extends Method>(method: M): ApiCall<M> {
    return (path, ...[init]) => this.request(method, path, init ?? {}, (data) => data as never);
  }

  private async request<T>(method: Method, path: string, init: object, read: (data: unknown, response: Response) => T): Promise<Outcome<T>> {
    try {
      const { data, error, response } = await this.http.request(method, path as never, init as never);
      if (response.status === 401) this.onSignedOut();
      return response.ok
        ? { ok: true, value: read(inPageLanguage(data), response) }
        : { ok: false, problem: parseProblem(response.status, inPageLanguage(error)) };
    } catch {
      return { ok: false, problem: unreachableProblem() };
    }
  }

  private send({ url, init }: PendingRequest): Promise<Response> {
    const headers = new Headers(init.headers);
    headers.set('Accept', 'application/json');
    headers.set('X-Client', this.name);
    if (typeof this.identity !== 'string') headers.set('X-Client-Id', this.identity.id);
    return this.fetch(url, { ...init, headers, signal: endedBy(init.signal) });
  }
}

/** Ends a request after its timeout, or when its caller no longer needs it. */
function endedBy(caller: AbortSignal | null | undefined): AbortSignal {
  const timeout = AbortSignal.timeout(TIMEOUT_MS);
  return caller === null || caller === undefined ? timeout : AbortSignal.any([caller, timeout]);
}

/** The path parameter of a call to one vehicle's API. */
export const ofVehicle = (v: string): { params: { path: { v: string } } } => ({ params: { path: { v } } });

/** A default name, so that the journal can distinguish pages. @param number 0 to 65535. */
export function pageName(number: number): string {
  return `page-${number.toString(16).padStart(4, '0')}`;
}
