export function holesOf(text: string): Set<string>;
export function translated(source: string, file: string, compared: Set<string>, texts: Map<string, string>): string;
