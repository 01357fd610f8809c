/** Whether a log is open, whose plots take a part of the page. Apart from the rest of the room, which is loaded when it is first opened. */

class PlotsShown {
  isOpen = $state(false);
}

export const plotsShown = new PlotsShown();
