export const FONT: string;
export function smallFont(): Promise<string>;
