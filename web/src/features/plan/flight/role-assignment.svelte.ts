/** Which vehicle flies which role of the edited mission; used for the flight and for the dry run. */

export class RoleAssignment {
  vehicles = $state.raw<Readonly<Record<string, string>>>({});

  choose(role: string, vehicle: string): void {
    this.vehicles = { ...this.vehicles, [role]: vehicle };
  }

  rename(old: string, name: string): void {
    const { [old]: vehicle = '', ...otherVehicles } = this.vehicles;
    this.vehicles = { ...otherVehicles, [name]: vehicle };
  }

  /** The vehicles of these roles; an empty text for a role without a vehicle. */
  forRoles(roles: readonly string[]): Record<string, string> {
    return Object.fromEntries(roles.map((role) => [role, this.vehicles[role] ?? '']));
  }
}
