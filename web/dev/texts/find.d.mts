export function comparedIn(source: string, file: string): Set<string>;
export function textsOf(source: string, file: string, compared: Set<string>): { texts: { text: string; start: number; end: number }[] };
