/** Who flies which role of the mission that is edited: chosen once, for the flight and for the dry run. */

export class Cast {
  vehicles = $state.raw<Readonly<Record<string, string>>>({});

  choose(role: string, vehicle: string): void {
    this.vehicles = { ...this.vehicles, [role]: vehicle };
  }

  rename(old: string, name: string): void {
    const { [old]: vehicle = '', ...others } = this.vehicles;
    this.vehicles = { ...others, [name]: vehicle };
  }

  /** Of these roles alone; an empty text where none is chosen. */
  of(roles: readonly string[]): Record<string, string> {
    return Object.fromEntries(roles.map((role) => [role, this.vehicles[role] ?? '']));
  }
}
