/** Errors of the API (problem+json) as texts: what happened, why, and what to do. */

export interface Problem {
  title: string;
  detail: string;
  /** Why the request failed, in the vehicle's own texts. */
  reasons: string[];
  /** What the operator can do. */
  remedy: string | null;
  code: string;
  status: number;
  /** The request field that is wrong. */
  field: string | null;
  /** Error codes of a rejected plan. */
  codes?: readonly string[];
}

const TITLES: Readonly<Record<string, string>> = {
  refused: 'Not sent',
  not_verified: 'Not sent',
  interrupted: 'Interrupted',
  plan_findings: 'Not sent',
  not_together: 'Group not started',
  unknown_group: 'Unknown group',
  rejected: 'The vehicle refused',
  no_reply: 'No answer',
  disconnected: 'Connection lost',
  unknown_vehicle: 'Unknown vehicle',
  invalid_request: 'Invalid request',
};

function nonEmptyText(value: unknown): string | null {
  return typeof value === 'string' && value.trim() !== '' ? value : null;
}

const nonEmptyTexts = (value: unknown): string[] => (Array.isArray(value) ? value.filter((item): item is string => nonEmptyText(item) !== null) : []);

/** Validation errors as one text, with the first wrong field. Reads the server's format `{field, message}` and FastAPI's format `{loc: ["body", "alt_home_m"], msg}`. */
function validationErrors(value: unknown): { detail: string; field: string | null } | null {
  if (!Array.isArray(value) || value.length === 0) return null;
  const lines: string[] = [];
  let field: string | null = null;
  for (const item of value as unknown[]) {
    if (typeof item !== 'object' || item === null) continue;
    const { loc, msg, field: fieldName, message } = item as Record<string, unknown>;
    const fieldPath = nonEmptyText(fieldName) ?? (Array.isArray(loc) ? loc.slice(1).join('.') : '');
    field ??= fieldPath || null;
    lines.push([fieldPath, nonEmptyText(msg) ?? nonEmptyText(message)].filter(Boolean).join(': '));
  }
  return lines.length === 0 ? null : { detail: lines.join('; '), field };
}

/** The problem in a response's body; if the body has no problem, a problem made from the status. */
export function parseProblem(status: number, body: unknown): Problem {
  const raw = typeof body === 'object' && body !== null ? (body as Record<string, unknown>) : {};
  const validation = validationErrors(raw['errors']) ?? validationErrors(raw['detail']);
  const code = nonEmptyText(raw['code']) ?? (status === 422 ? 'invalid_request' : `http_${status}`);
  const reasons = nonEmptyTexts(raw['reasons']);
  const codes = nonEmptyTexts(raw['codes']);
  return {
    title: nonEmptyText(raw['title']) ?? TITLES[code] ?? `The server answered with HTTP status ${status}`,
    detail: nonEmptyText(raw['detail']) ?? validation?.detail ?? (reasons.length > 0 ? '' : 'The server gave no reason.'),
    reasons,
    remedy: nonEmptyText(raw['remedy']),
    code,
    status,
    field: nonEmptyText(raw['field']) ?? validation?.field ?? null,
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
