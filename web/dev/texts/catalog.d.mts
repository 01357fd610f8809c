export function readSources(): { sources: Map<string, string>; compared: Set<string> };
export function collect(): { areas: Map<string, { text: string; files: Set<string> }[]>; doubtful: string[] };
export function translations(language: string, choice?: { server?: boolean }): Map<string, string>;
export function serverSentences(language: string): string[];
