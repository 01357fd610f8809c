/**
 * Svelte action for a box that may scroll: while its content overflows, the box can take the focus, so that the arrow
 * keys scroll it.
 */
export function scrolls(box: HTMLElement): { destroy: () => void } {
  const update = (): void => {
    const overflows = box.scrollHeight > box.clientHeight + 1;
    if (overflows) box.tabIndex = 0;
    else box.removeAttribute('tabindex');
  };
  const sizes = new ResizeObserver(update);
  const content = new MutationObserver(update);
  sizes.observe(box);
  content.observe(box, { childList: true, subtree: true, characterData: true });
  return {
    destroy: () => {
      sizes.disconnect();
      content.disconnect();
    },
  };
}
