/** How a person reads the server's name of a step: "step 3", "step 11 then 1", "lead, step 2". The name itself is compared with the server's, and is never translated. */

const WORDS: Readonly<Record<string, string>> = { step: 'step', then: 'then', otherwise: 'otherwise', item: 'item', start: 'start' };

/** @param place the server's name of a step of a mission, or of an item of a plan. */
export const placeText = (place: string): string => place.replace(/\b(step|then|otherwise|item)(?= \d)|\bstart$/g, (word) => WORDS[word] ?? word);
