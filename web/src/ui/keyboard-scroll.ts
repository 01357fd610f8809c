/**
 * Svelte action for a box that may scroll: while its content overflows, the box can take the focus, so that the arrow
 * keys scroll it.
 */
export function keyboardScroll(box: HTMLElement): { destroy: () => void } {
  const update = (): void => {
    const overflows = box.scrollHeight > box.clientHeight + 1;
    if (overflows) box.tabIndex = 0;
    else box.removeAttribute('tabindex');
  };
  const sizeObserver = new ResizeObserver(update);
  const contentObserver = new MutationObserver(update);
  sizeObserver.observe(box);
  contentObserver.observe(box, { childList: true, subtree: true, characterData: true });
  return {
    destroy: () => {
      sizeObserver.disconnect();
      contentObserver.disconnect();
    },
  };
}
