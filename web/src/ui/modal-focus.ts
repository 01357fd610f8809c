/** Svelte actions for what opens over the page: who takes the keyboard, keeps it, and gives it back. */

const FOCUSABLE =
  'a[href], button:not([disabled]), input:not([disabled]), select:not([disabled]), textarea:not([disabled]), summary, iframe, [tabindex]:not([tabindex="-1"])';

function reachable(node: HTMLElement): HTMLElement[] {
  return [...node.querySelectorAll<HTMLElement>(FOCUSABLE)].filter((one) => one.tabIndex >= 0 && one.getClientRects().length > 0);
}

/** Nobody has the keyboard: what had it is gone. */
function nobody(): boolean {
  const active = document.activeElement;
  return active === null || active === document.body || !active.isConnected;
}

/** Gives the keyboard back to what had it before, unless somebody else took it meanwhile. */
export function givesFocusBack(node: HTMLElement): { destroy: () => void } {
  const before = document.activeElement as HTMLElement | null;
  return {
    destroy: () => {
      if (!nobody() && !node.contains(document.activeElement)) return;
      if (before?.isConnected === true && before !== document.body) before.focus({ preventScroll: true });
    },
  };
}

/**
 * A question takes the keyboard, keeps it while it is open and gives it back: Tab goes round in it. A pointer still
 * reaches what lies outside (Hold is never locked away), the keyboard stays.
 *
 * @param first selector of what has the keyboard at first.
 */
export function modalFocus(node: HTMLElement, first: string): { destroy: () => void } {
  const back = givesFocusBack(node);
  let last = node.querySelector<HTMLElement>(first) ?? reachable(node)[0] ?? node;
  last.focus({ preventScroll: true });

  const tab = (event: KeyboardEvent): void => {
    if (event.key !== 'Tab' || event.ctrlKey || event.altKey || event.metaKey) return;
    const all = reachable(node);
    const at = all.indexOf(document.activeElement as HTMLElement);
    event.preventDefault();
    all[(at + (event.shiftKey ? -1 : 1) + all.length) % all.length]?.focus();
  };
  const moved = (event: FocusEvent): void => {
    const to = event.target as HTMLElement;
    if (node.contains(to)) last = to;
    else if (last.isConnected) last.focus({ preventScroll: true });
    else reachable(node)[0]?.focus({ preventScroll: true });
  };
  /** A pointer went where nothing takes the keyboard, or into the 3D view, which tells nobody. */
  const left = (): void =>
    void setTimeout(() => {
      if (node.isConnected && !node.contains(document.activeElement) && last.isConnected) last.focus({ preventScroll: true });
    });
  node.addEventListener('keydown', tab);
  node.addEventListener('focusout', left);
  document.addEventListener('focusin', moved);
  return {
    destroy: () => {
      document.removeEventListener('focusin', moved);
      node.removeEventListener('keydown', tab);
      node.removeEventListener('focusout', left);
      back.destroy();
    },
  };
}
