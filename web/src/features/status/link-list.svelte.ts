/** Adding and removing links of the server. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';

/** What the server asks to confirm before a vehicle in flight loses its last link. */
interface Confirmation {
  readonly link: string;
  readonly text: string;
  readonly detail: string;
}

export class LinkList {
  busy = $state(false);
  problem = $state.raw<Problem | null>(null);
  /** The link that was to be removed, and what that would do; null: nothing to confirm. */
  confirmation = $state.raw<Confirmation | null>(null);

  constructor(
    private readonly api: ApiClient,
    /** Reads the links again. */
    private readonly refresh: () => Promise<void>,
  ) {}

  /** @returns whether the link was added; the server keeps trying to open one that it cannot open yet. */
  add(url: string, name: string): Promise<boolean> {
    return this.run(async () => {
      const answer = await this.api.post('/links', { body: { url: url.trim(), name: name.trim() === '' ? null : name.trim() } });
      this.problem = answer.ok ? null : answer.problem;
      return answer.ok;
    });
  }

  /** Removes a link; if a vehicle in flight would lose its last one, this only asks: `confirmed` removes it. */
  remove(link: string): Promise<boolean> {
    return this.close(link, null);
  }

  /** Removes the link of the confirmation. */
  confirmed(): Promise<boolean> {
    const { confirmation } = this;
    return confirmation === null ? Promise.resolve(false) : this.close(confirmation.link, confirmation.text);
  }

  private close(link: string, confirm: string | null): Promise<boolean> {
    return this.run(async () => {
      const answer = await this.api.delete('/links/{name}', { params: { path: { name: link }, query: confirm === null ? {} : { confirm } } });
      const text = answer.ok ? null : requiredText(answer.problem);
      this.confirmation = answer.ok || text === null || text === confirm ? null : { link, text, detail: answer.problem.detail };
      this.problem = answer.ok || this.confirmation !== null ? null : answer.problem;
      return answer.ok;
    });
  }

  private async run(work: () => Promise<boolean>): Promise<boolean> {
    if (this.busy) return false;
    this.busy = true;
    try {
      return await work();
    } finally {
      this.busy = false;
      await this.refresh();
    }
  }
}

/** The confirmation that the server's refusal asks for; null: none would help. */
export function requiredText({ code, remedy }: Problem): string | null {
  return code === 'refused' ? (/confirm='([^']+)'/.exec(remedy ?? '')?.[1] ?? null) : null;
}
