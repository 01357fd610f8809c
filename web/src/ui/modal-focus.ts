/** Svelte actions that take, keep and return the keyboard focus for parts that open over the page. */

const FOCUSABLE =
  'a[href], button:not([disabled]), input:not([disabled]), select:not([disabled]), textarea:not([disabled]), summary, iframe, [tabindex]:not([tabindex="-1"])';

function focusableIn(node: HTMLElement): HTMLElement[] {
  return [...node.querySelectorAll<HTMLElement>(FOCUSABLE)].filter((element) => element.tabIndex >= 0 && element.getClientRects().length > 0);
}

/** Whether no control has the focus, because the focused control was removed. */
function noControlHasFocus(): boolean {
  const active = document.activeElement;
  return active === null || active === document.body || !active.isConnected;
}

/** When the node is removed, returns the focus to the element that had it before, unless another control has taken it. */
export function restoresFocus(node: HTMLElement): { destroy: () => void } {
  const previous = document.activeElement as HTMLElement | null;
  return {
    destroy: () => {
      if (!noControlHasFocus() && !node.contains(document.activeElement)) return;
      if (previous?.isConnected === true && previous !== document.body) previous.focus({ preventScroll: true });
    },
  };
}

/** For a panel below a button: its first control gets the focus, or the node; when the node is removed, the focus returns. */
export function takesFocus(node: HTMLElement): { destroy: () => void } {
  const focusReturn = restoresFocus(node);
  (focusableIn(node)[0] ?? node).focus({ preventScroll: true });
  return focusReturn;
}

/**
 * For a confirmation: takes the focus and keeps it inside the node while the node exists; Tab moves the focus inside the node. Pointers still
 * reach the rest of the page, for example Hold. When the node is removed, returns the focus.
 * @param first selector of the control that gets the focus first.
 */
export function modalFocus(node: HTMLElement, first: string): { destroy: () => void } {
  const focusReturn = restoresFocus(node);
  let lastFocused = node.querySelector<HTMLElement>(first) ?? focusableIn(node)[0] ?? node;
  lastFocused.focus({ preventScroll: true });

  const moveByTab = (event: KeyboardEvent): void => {
    if (event.key !== 'Tab' || event.ctrlKey || event.altKey || event.metaKey) return;
    const controls = focusableIn(node);
    const index = controls.indexOf(document.activeElement as HTMLElement);
    event.preventDefault();
    controls[(index + (event.shiftKey ? -1 : 1) + controls.length) % controls.length]?.focus();
  };
  const onFocusIn = (event: FocusEvent): void => {
    const newFocus = event.target as HTMLElement;
    if (node.contains(newFocus)) lastFocused = newFocus;
    else if (lastFocused.isConnected) lastFocused.focus({ preventScroll: true });
    else focusableIn(node)[0]?.focus({ preventScroll: true });
  };
  /** Takes the focus back after a click that causes no `focusin`: in the 3D view, or on a part that cannot have the focus. */
  const keepFocus = (): void =>
    void setTimeout(() => {
      if (node.isConnected && !node.contains(document.activeElement) && lastFocused.isConnected) lastFocused.focus({ preventScroll: true });
    });
  node.addEventListener('keydown', moveByTab);
  node.addEventListener('focusout', keepFocus);
  document.addEventListener('focusin', onFocusIn);
  return {
    destroy: () => {
      document.removeEventListener('focusin', onFocusIn);
      node.removeEventListener('keydown', moveByTab);
      node.removeEventListener('focusout', keepFocus);
      focusReturn.destroy();
    },
  };
}
