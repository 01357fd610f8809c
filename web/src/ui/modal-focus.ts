/** Svelte actions that take, keep and return the keyboard focus for parts that open over the page. */

const FOCUSABLE =
  'a[href], button:not([disabled]), input:not([disabled]), select:not([disabled]), textarea:not([disabled]), summary, iframe, [tabindex]:not([tabindex="-1"])';

function focusableIn(node: HTMLElement): HTMLElement[] {
  return [...node.querySelectorAll<HTMLElement>(FOCUSABLE)].filter((one) => one.tabIndex >= 0 && one.getClientRects().length > 0);
}

/** No control has the focus: the one that had it was removed. */
function noControlHasFocus(): boolean {
  const active = document.activeElement;
  return active === null || active === document.body || !active.isConnected;
}

/** Returns the focus to its previous owner, unless another control has taken it. */
export function restoresFocus(node: HTMLElement): { destroy: () => void } {
  const before = document.activeElement as HTMLElement | null;
  return {
    destroy: () => {
      if (!noControlHasFocus() && !node.contains(document.activeElement)) return;
      if (before?.isConnected === true && before !== document.body) before.focus({ preventScroll: true });
    },
  };
}

/**
 * A confirmation takes the focus and keeps it while it is open, also with Tab. Pointers still reach everything else,
 * for example Hold. On closing it returns the focus.
 * @param first selector of the control that gets the focus first.
 */
export function modalFocus(node: HTMLElement, first: string): { destroy: () => void } {
  const focusReturn = restoresFocus(node);
  let last = node.querySelector<HTMLElement>(first) ?? focusableIn(node)[0] ?? node;
  last.focus({ preventScroll: true });

  const tab = (event: KeyboardEvent): void => {
    if (event.key !== 'Tab' || event.ctrlKey || event.altKey || event.metaKey) return;
    const all = focusableIn(node);
    const at = all.indexOf(document.activeElement as HTMLElement);
    event.preventDefault();
    all[(at + (event.shiftKey ? -1 : 1) + all.length) % all.length]?.focus();
  };
  const onFocusIn = (event: FocusEvent): void => {
    const to = event.target as HTMLElement;
    if (node.contains(to)) last = to;
    else if (last.isConnected) last.focus({ preventScroll: true });
    else focusableIn(node)[0]?.focus({ preventScroll: true });
  };
  /** Keeps the focus after a click on a part without focus, or in the 3D view, which sends no event. */
  const keepFocus = (): void =>
    void setTimeout(() => {
      if (node.isConnected && !node.contains(document.activeElement) && last.isConnected) last.focus({ preventScroll: true });
    });
  node.addEventListener('keydown', tab);
  node.addEventListener('focusout', keepFocus);
  document.addEventListener('focusin', onFocusIn);
  return {
    destroy: () => {
      document.removeEventListener('focusin', onFocusIn);
      node.removeEventListener('keydown', tab);
      node.removeEventListener('focusout', keepFocus);
      focusReturn.destroy();
    },
  };
}
