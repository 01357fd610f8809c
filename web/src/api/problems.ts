/** Errors of the API (problem+json) as texts: what happened, why, and what to do. */

export interface Problem {
  title: string;
  detail: string;
  /** The vehicle's own texts. */
  reasons: string[];
  /** What the operator can do. */
  remedy: string | null;
  code: string;
  status: number;
  /** The request field that is wrong. */
  field: string | null;
  /** Codes of the errors of a plan. */
  codes?: readonly string[];
}

const TITLES: Readonly<Record<string, string>> = {
  refused: 'Not sent',
  not_verified: 'Not sent',
  not_together: 'Group not started',
  unknown_group: 'Unknown group',
  rejected: 'The vehicle refused',
  no_reply: 'No answer',
  disconnected: 'Connection lost',
  unknown_vehicle: 'Unknown vehicle',
  invalid_request: 'Invalid request',
};

function text(value: unknown): string | null {
  return typeof value === 'string' && value.trim() !== '' ? value : null;
}

const texts = (value: unknown): string[] => (Array.isArray(value) ? value.filter((item): item is string => text(item) !== null) : []);

/** FastAPI's own validation errors: `[{loc: ["body", "alt_home_m"], msg}]`. */
function validationErrors(value: unknown): { detail: string; field: string | null } | null {
  if (!Array.isArray(value) || value.length === 0) return null;
  const lines: string[] = [];
  let field: string | null = null;
  for (const item of value as unknown[]) {
    if (typeof item !== 'object' || item === null) continue;
    const { loc, msg, field: named, message } = item as Record<string, unknown>;
    const name = text(named) ?? (Array.isArray(loc) ? loc.slice(1).join('.') : '');
    field ??= name || null;
    lines.push([name, text(msg) ?? text(message)].filter(Boolean).join(': '));
  }
  return lines.length === 0 ? null : { detail: lines.join('; '), field };
}

/** The problem in a response's body; if the body has no problem, a problem made from the status. */
export function parseProblem(status: number, body: unknown): Problem {
  const raw = typeof body === 'object' && body !== null ? (body as Record<string, unknown>) : {};
  const invalid = validationErrors(raw['errors']) ?? validationErrors(raw['detail']);
  const code = text(raw['code']) ?? (status === 422 ? 'invalid_request' : `http_${status}`);
  const reasons = texts(raw['reasons']);
  const codes = texts(raw['codes']);
  return {
    title: text(raw['title']) ?? TITLES[code] ?? `The server answered with HTTP status ${status}`,
    detail: text(raw['detail']) ?? invalid?.detail ?? (reasons.length > 0 ? '' : 'The server gave no reason.'),
    reasons,
    remedy: text(raw['remedy']),
    code,
    status,
    field: text(raw['field']) ?? invalid?.field ?? null,
    ...(codes.length > 0 ? { codes } : {}),
  };
}

/** The problem shown when the server sent no answer. */
export function unreachableProblem(): Problem {
  return {
    title: 'The server did not answer',
    detail: 'The command may or may not have reached the vehicle: check what the vehicle does.',
    reasons: [],
    remedy: 'Check that the server is running. The page reconnects automatically.',
    code: 'unreachable',
    status: 0,
    field: null,
  };
}

/** Reasons that the detail does not already contain. */
export function furtherReasons(problem: Problem): string[] {
  return problem.reasons.filter((reason) => !problem.detail.includes(reason));
}
