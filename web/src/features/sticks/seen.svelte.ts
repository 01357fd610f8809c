/** Whether a gamepad was seen since the page was loaded: browsers report one when one of its buttons is first pressed. */

class Seen {
  value = $state(false);

  constructor() {
    this.value = (globalThis.navigator?.getGamepads?.() ?? []).some((pad) => pad !== null);
    globalThis.addEventListener?.('gamepadconnected', () => (this.value = true));
  }
}

export const padSeen = new Seen();
