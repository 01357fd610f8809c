/** Whether the keyboard sheet is open. */
export const sheet = $state({ open: false });
